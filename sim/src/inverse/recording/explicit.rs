//! Robots in which every hole, joint and tendon has numbers of its own, so that each can be calibrated.

use crate::robot::{
    Backbone, Body, Holes, MassSpec, PerDisc, RigidMass, Robot, RobotSpec, RouteSpec, SpecError,
    Waypoint,
};

/// A robot whose tendons share no hole.
#[derive(Clone, Debug)]
pub(super) struct Explicit {
    /// Tendons have routes of their own; modules have no clocking; where a module has a rod, all modules have backbones and
    /// masses disc by disc in its place.
    pub spec: RobotSpec,
    /// Whose each hole is: of the base, then of each module.
    pub owners: Vec<Vec<usize>>,
    /// The module at whose disc each tendon ends; that of the base counts as the first.
    pub ends: Vec<usize>,
}

impl Explicit {
    /// # Errors
    /// [`SpecError`] for a robot that is not valid.
    pub fn new(first: &RobotSpec) -> Result<Self, SpecError> {
        let robot = Robot::new(first.clone())?;
        let mut spec = first.clone();
        let group = |body: Body| match body {
            Body::Base => 0,
            Body::Disc(disc) => first.module_of(disc).map_or(0, |module| module + 1),
        };
        let groups = first.modules.len() + 1;
        let mut holes: Vec<Vec<[f64; 2]>> = vec![Vec::new(); groups];
        let mut owners: Vec<Vec<usize>> = vec![Vec::new(); groups];
        let mut routes = Vec::new();
        let mut ends = Vec::new();
        for (t, (laid, tendon)) in robot.tendons().iter().zip(first.tendons()).enumerate() {
            // The tendon's copies of the holes it goes through: one for each pattern's hole.
            let mut copied: Vec<(usize, usize, usize)> = Vec::new();
            let mut through = Vec::new();
            for &Waypoint(body, hole) in &laid.route {
                let group = group(body);
                let known = copied.iter().find(|c| (c.0, c.1) == (group, hole));
                let own = match known {
                    Some(&(_, _, own)) => own,
                    None => {
                        let place = first.hole_position(body, hole).unwrap_or_default();
                        holes[group].push(place);
                        owners[group].push(t);
                        copied.push((group, hole, holes[group].len() - 1));
                        holes[group].len() - 1
                    }
                };
                through.push(Waypoint(body, own));
            }
            let end = laid.route.last().map_or(0, |end| group(end.0));
            ends.push(end.saturating_sub(1));
            routes.push(RouteSpec {
                through,
                tendon: tendon.clone(),
            });
        }
        spec.routes = routes;
        let mut holes = holes.into_iter();
        spec.base.holes = Holes::At(holes.next().unwrap_or_default());
        for (module, holes) in spec.modules.iter_mut().zip(holes) {
            module.holes = Holes::At(holes);
            module.clocking = 0.0;
            module.tendons = None;
        }
        if spec.modules.iter().any(|module| module.rod.is_some()) {
            without_rods(&mut spec, &robot);
        }
        Ok(Self { spec, owners, ends })
    }
}

/// Puts each joint's elasticity and each disc's mass, the rod's included, in place of the rods.
fn without_rods(spec: &mut RobotSpec, robot: &Robot) {
    let mut discs = robot.discs().iter();
    for module in &mut spec.modules {
        let own: Vec<_> = discs.by_ref().take(module.discs).collect();
        let mass = own.iter().map(|disc| RigidMass {
            mass: disc.mass,
            inertia: disc.inertia.into(),
            centre_of_mass: disc.centre_of_mass.into(),
        });
        module.mass = MassSpec::Rigid(PerDisc::Each(mass.collect()));
        module.damping = PerDisc::Each(own.iter().map(|disc| disc.damping).collect());
        let joints: Option<Vec<Backbone>> = own.iter().map(|disc| disc.backbone).collect();
        module.backbone = joints.map(PerDisc::Each);
        module.rod = None;
    }
}

/// Changes each joint's elasticity of a module, which has one.
pub(super) fn change_joints(
    spec: &mut RobotSpec,
    module: usize,
    mut change: impl FnMut(&mut Backbone),
) {
    match &mut spec.modules[module].backbone {
        None => {}
        Some(PerDisc::Uniform(joint)) => change(joint),
        Some(PerDisc::Each(joints)) => joints.iter_mut().for_each(change),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::robot::{Loads, RodDamping, RodSpec};

    /// Clocked modules on a rod, of which each number is shared by many.
    #[test]
    fn an_explicit_robot_is_the_same_robot() {
        let mut spec = RobotSpec::standard("3m").expect("a standard robot");
        for (m, module) in spec.modules.iter_mut().enumerate() {
            module.clocking = 0.3 * m as f64;
            module.backbone = None;
            module.rod = Some(RodSpec {
                youngs: 2e9,
                poisson: 0.3,
                radius: 0.002,
                density: 1000.0,
                damping: RodDamping::default(),
            });
            module.joint_below = 0.004;
        }
        let explicit = Explicit::new(&spec).expect("a valid robot");
        let [robot, other] =
            [spec, explicit.spec].map(|spec| Robot::new(spec).expect("a valid robot"));
        let command = robot.mean_command();
        let mut values = command.as_slice().to_vec();
        values[0] *= 0.9;
        let tips = [robot, other].map(|robot| {
            let command = robot.command(&values).expect("within the ranges");
            let loads = Loads::payload(0.01).expect("a payload");
            let settled = robot.settle(&command, &loads);
            assert!(settled.converged);
            settled.positions[robot.discs().len() - 1]
        });
        assert!((tips[0] - tips[1]).norm() < 1e-9);
    }
}
