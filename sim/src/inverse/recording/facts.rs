//! What the table of unknowns is read against: the robot, the transmission and the recording of a fit.

use super::explicit::Explicit;
use super::places::{At, Each, Spread};
use super::{Group, Recording, Transmission};
use crate::robot::{Axis, Drive, ModuleSpec, RobotSpec, TendonSpec};

/// Least spread of a lag (s): that of servos and motion capture does not shrink with the time between rows.
const LAG: f64 = 0.05;
/// Spread of a tension (N), as a share of the largest.
const TENSION: f64 = 0.02;
/// Distance of holes from the axis where all lie on it, as a share of the robot's length.
const HOLES: f64 = 0.02;

/// What is fitted, to what.
pub(super) struct Facts<'a> {
    pub groups: &'a [Group],
    pub explicit: &'a Explicit,
    pub transmission: &'a Transmission,
    pub recording: &'a Recording,
}

impl Facts<'_> {
    pub fn spec(&self) -> &RobotSpec {
        &self.explicit.spec
    }

    /// The first tendon that ends at a module, of those that stretch or of all.
    pub fn tendon_of(&self, module: usize, stretching: bool) -> Option<&TendonSpec> {
        let ends = self.spec().routes.iter().zip(&self.explicit.ends);
        let mut own = ends.filter(|(_, end)| **end == module);
        own.find(|(route, _)| !stretching || route.tendon.stretches())
            .map(|(route, _)| &route.tendon)
    }

    /// What there is of a kind of unknown, in order.
    pub fn places(&self, each: Each) -> Vec<At> {
        let spec = self.spec();
        let (tendons, modules) = (0..spec.routes.len(), 0..spec.modules.len());
        let all = |numbers: std::ops::Range<usize>| numbers.map(|n| At::new(n, Axis::X)).collect();
        let about = |number: usize, axes: &[Axis]| -> Vec<At> {
            axes.iter().map(|&axis| At::new(number, axis)).collect()
        };
        let elastic = modules
            .clone()
            .filter(|&m| spec.modules[m].backbone.is_some());
        let having = |stretching| {
            let modules = modules.clone();
            let own = modules.filter(move |&m| self.tendon_of(m, stretching).is_some());
            own.map(|m| At::new(m, Axis::X)).collect()
        };
        match each {
            Each::Once => all(0..1),
            Each::Servo | Each::Tendon => all(tendons),
            Each::Module => all(modules),
            Each::ElasticModule(axes) => elastic.flat_map(|m| about(m, axes)).collect(),
            Each::ModuleOfTendons => having(false),
            Each::ModuleOfStretchingTendons => having(true),
            // A rotation about the axis of the robot is one of all holes.
            Each::BaseRotation if self.groups.contains(&Group::HoleAngles) => {
                about(0, &Axis::ALL[..2])
            }
            Each::BaseRotation | Each::BasePosition => about(0, &Axis::ALL),
            Each::MarkerPosition => (0..self.transmission.markers.len())
                .flat_map(|marker| about(marker, &Axis::ALL))
                .collect(),
            Each::GravityRotation => {
                // A rotation about gravity itself changes nothing.
                let along = nalgebra::Vector3::from(spec.gravity).iamax();
                let mut axes = about(0, &Axis::ALL);
                axes.retain(|at| at.axis.index() != along);
                axes
            }
        }
    }

    /// A prior's standard deviation: in the unknown's unit, or of a factor relative.
    pub fn spread(&self, spread: Spread, at: At) -> f64 {
        match spread {
            Spread::Of(spread) => spread,
            Spread::OfLength(share) => share * length(self.spec()),
            Spread::OfDisplacement(share) => {
                let tendon = &self.spec().routes[at.number].tendon;
                match tendon.drive {
                    Drive::Tension => TENSION * tendon.range[1],
                    Drive::Gain(_) | Drive::Length => share * self.hole_radius(),
                }
            }
            Spread::PerHoleRadius(count) => count / self.hole_radius(),
            Spread::OfStep(share) => (share * self.recording.median_step()).max(LAG),
        }
    }

    /// The unit of an unknown: of a tendon's displacement that of its drive.
    pub fn unit(&self, unit: &'static str, spread: Spread, at: At) -> &'static str {
        match (spread, self.spec().routes.get(at.number)) {
            (Spread::OfDisplacement(_), Some(route)) if route.tendon.drive == Drive::Tension => "N",
            _ => unit,
        }
    }

    /// Mean distance of the holes from the axis (m), or a share of the robot's length where all lie on it.
    fn hole_radius(&self) -> f64 {
        let holes: Vec<f64> = (self.spec().modules.iter())
            .flat_map(|module| module.holes.positions())
            .map(|[x, y]| x.hypot(y))
            .collect();
        let mean = holes.iter().sum::<f64>() / holes.len().max(1) as f64;
        if mean > 0.0 {
            mean
        } else {
            HOLES * length(self.spec())
        }
    }
}

/// Length of the backbone (m).
pub(super) fn length(spec: &RobotSpec) -> f64 {
    let module = |m: &ModuleSpec| m.first_offset + m.pitch * (m.discs as f64 - 1.0);
    spec.modules.iter().map(module).sum()
}
