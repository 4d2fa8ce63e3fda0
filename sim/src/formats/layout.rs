//! From a flat chain of discs to modules.

use crate::robot::{
    Backbone, BaseSpec, Body, Cameras, HingeJoint, Holes, MassSpec, ModuleSpec, PerDisc, RigidMass,
    RobotSpec, RouteSpec, Routing, Waypoint,
};

/// A robot disc by disc, as other tools describe it.
pub(crate) struct Layout {
    pub name: String,
    pub gravity: [f64; 3],
    pub base: BaseSpec,
    pub discs: Vec<DiscLayout>,
    pub tendons: Vec<RouteSpec>,
    pub cameras: Cameras,
}

/// One disc.
#[derive(Clone, Debug)]
pub(crate) struct DiscLayout {
    /// Distance of its origin from that of the body below, along z (m).
    pub step: f64,
    /// Distance of its joint below its origin (m).
    pub joint_below: f64,
    pub radius: f64,
    pub half_height: f64,
    pub mass: DiscMass,
    pub holes: Vec<[f64; 2]>,
    pub damping: f64,
    pub armature: f64,
    pub backbone: Option<Backbone>,
    /// Hinges in place of a ball joint.
    pub joint: Option<HingeJoint>,
}

/// Mass of one disc, as in [`MassSpec`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum DiscMass {
    Density(f64),
    Rigid(RigidMass),
}

impl Layout {
    /// The same robot in modules: runs of like discs at one pitch, ended by the discs where tendons
    /// end. Tendons that modules bring along are recognised; the others have routes of their own.
    pub fn into_spec(self) -> RobotSpec {
        let ends: Vec<usize> = (self.tendons.iter())
            .filter_map(|route| match route.through.last()?.0 {
                Body::Disc(disc) => Some(disc),
                Body::Base => None,
            })
            .collect();
        let mut modules = Vec::new();
        let mut start = 0;
        for end in 1..=self.discs.len() {
            let run = &self.discs[start..end];
            let goes_on = (self.discs.get(end))
                .is_some_and(|next| !ends.contains(&(end - 1)) && continues(run, next));
            if !goes_on {
                modules.push(module(run));
                start = end;
            }
        }
        let mut spec = RobotSpec {
            name: self.name,
            gravity: self.gravity,
            routing: Routing::ModuleBelow,
            fluid: None,
            base: self.base,
            modules,
            routes: Vec::new(),
            cameras: self.cameras,
        };
        spec.take_tendons(self.tendons);
        spec
    }
}

/// Eight cameras around a robot, in the proportions of the paper's rings.
pub(crate) fn ring_around(base: &BaseSpec, discs: &[DiscLayout], resolution: [u32; 2]) -> Cameras {
    let length = discs.iter().map(|disc| disc.step).sum();
    Cameras::around(base.position, length, resolution)
}

/// Whether `next` goes on with the module that `run` begins.
fn continues(run: &[DiscLayout], next: &DiscLayout) -> bool {
    let Some(first) = run.first() else {
        return false;
    };
    let same_pitch = run.get(1).is_none_or(|second| second.step == next.step);
    let same_mass = matches!(
        (first.mass, next.mass),
        (DiscMass::Density(_), DiscMass::Density(_)) | (DiscMass::Rigid(_), DiscMass::Rigid(_))
    );
    same_pitch
        && same_mass
        && first.joint_below == next.joint_below
        && first.radius == next.radius
        && first.half_height == next.half_height
        && first.holes == next.holes
        && first.backbone.is_some() == next.backbone.is_some()
        && first.joint.is_some() == next.joint.is_some()
}

fn module(run: &[DiscLayout]) -> ModuleSpec {
    let first = &run[0];
    let densities: Vec<f64> = run.iter().filter_map(|d| d.mass.density()).collect();
    let rigid: Vec<RigidMass> = run.iter().filter_map(|d| d.mass.rigid()).collect();
    let backbones: Vec<Backbone> = run.iter().filter_map(|d| d.backbone).collect();
    let joints: Vec<HingeJoint> = run.iter().filter_map(|d| d.joint.clone()).collect();
    ModuleSpec {
        discs: run.len(),
        first_offset: first.step,
        pitch: run.get(1).map_or(first.step, |second| second.step),
        clocking: 0.0,
        joint_below: first.joint_below,
        radius: first.radius,
        half_height: first.half_height,
        mass: if rigid.is_empty() {
            MassSpec::Density(per_disc(densities))
        } else {
            MassSpec::Rigid(per_disc(rigid))
        },
        holes: Holes::At(first.holes.clone()),
        damping: per_disc(run.iter().map(|d| d.damping).collect()),
        armature: per_disc(run.iter().map(|d| d.armature).collect()),
        joint: (!joints.is_empty()).then(|| per_disc(joints)),
        backbone: (!backbones.is_empty()).then(|| per_disc(backbones)),
        rod: None,
        limit: None,
        tendons: None,
    }
}

impl DiscMass {
    fn density(self) -> Option<f64> {
        match self {
            Self::Density(density) => Some(density),
            Self::Rigid(_) => None,
        }
    }

    fn rigid(self) -> Option<RigidMass> {
        match self {
            Self::Density(_) => None,
            Self::Rigid(rigid) => Some(rigid),
        }
    }
}

/// One value where all are the same.
fn per_disc<T: Clone + PartialEq>(values: Vec<T>) -> PerDisc<T> {
    match values.first() {
        Some(first) if values.iter().all(|value| value == first) => PerDisc::Uniform(first.clone()),
        _ => PerDisc::Each(values),
    }
}

impl RobotSpec {
    /// Gives the modules the tendons that they would bring along, by the routing that explains most
    /// of them; the others keep routes of their own. The order of the tendons stays.
    fn take_tendons(&mut self, tendons: Vec<RouteSpec>) {
        let explained = |routing| {
            let modules = self.module_tendons(routing, &tendons);
            modules.iter().flatten().count()
        };
        if explained(Routing::Base) > explained(Routing::ModuleBelow) {
            self.routing = Routing::Base;
        }
        let of_modules = self.module_tendons(self.routing, &tendons);
        let mut taken = 0;
        for (module, first) in self.modules.iter_mut().zip(of_modules) {
            if let Some(first) = first {
                module.tendons = Some(tendons[first].tendon.clone());
                taken = first + module.holes.count();
            }
        }
        self.routes = tendons.into_iter().skip(taken).collect();
    }

    /// For each module, the first of the tendons that are as if it had brought them along.
    fn module_tendons(&self, routing: Routing, tendons: &[RouteSpec]) -> Vec<Option<usize>> {
        let (mut next, mut first_disc) = (0, 0);
        let mut found = Vec::with_capacity(self.modules.len());
        for module in &self.modules {
            let (count, end) = (module.holes.count(), first_disc + module.discs);
            let lowest = match routing {
                Routing::ModuleBelow => first_disc,
                Routing::Base => 0,
            };
            let fits = |(hole, tendon): (usize, &RouteSpec)| {
                tendon.tendon == tendons[next].tendon && goes_straight(tendon, hole, lowest, end)
            };
            let own = tendons.get(next..next + count).unwrap_or_default();
            let brings = !own.is_empty() && own.iter().enumerate().all(fits);
            found.push(brings.then_some(next));
            next += if brings { count } else { 0 };
            first_disc = end;
        }
        found
    }
}

/// Whether a route goes through the holes `hole` of the body below disc `lowest` and of all discs
/// from there up to `end`.
fn goes_straight(route: &RouteSpec, hole: usize, lowest: usize, end: usize) -> bool {
    let below = lowest.checked_sub(1).map_or(Body::Base, Body::Disc);
    let expected = std::iter::once(below)
        .chain((lowest..end).map(Body::Disc))
        .map(|body| Waypoint(body, hole));
    route.through.iter().copied().eq(expected)
}
