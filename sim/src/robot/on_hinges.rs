//! Ball joints replaced by hinges, as many programs model a bending chain.
//!
//! A ball joint has the energy `1/2 phi' K phi` of its rotation vector `phi` from the rest; hinges about the same axes have
//! `1/2 t' K t` of their angles `t`. For turns about one axis the two are the same, and for combined ones they differ from the fourth
//! order in the angles on: `phi = t + 1/2 sum_(i<j) t_i t_j e_i x e_j + ..`. Joints without stiffness have the same poses and no energy.

use super::mass::RigidMass;
use super::{Disc, Hinge, HingeJoint, MassSpec, PerDisc, Robot, RobotSpec, SpecError};

/// Axes of a disc, in the order of the hinges.
const AXES: [[f64; 3]; 3] = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];

/// Hinges that take the place of a ball joint.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum HingeRow {
    /// About x, then y: a universal joint, whose disc does not twist.
    Universal,
    /// About x, y, then z.
    Three,
}

impl HingeRow {
    /// How many hinges.
    pub fn count(self) -> usize {
        match self {
            Self::Universal => 2,
            Self::Three => 3,
        }
    }
}

impl RobotSpec {
    /// This robot with hinges in place of its ball joints. Each has the stiffness of the backbone or rod about its axis, at rest where
    /// that is, and the joint's damping and armature. Rods' masses become the discs' own. Joints of hinges stay as they are.
    ///
    /// # Errors
    /// [`SpecError`] for an invalid robot.
    pub fn on_hinges(&self, row: HingeRow) -> Result<Self, SpecError> {
        let robot = Robot::new(self.clone())?;
        let mut spec = self.clone();
        let has_rod = spec.modules.iter().any(|module| module.rod.is_some());
        let mut discs = robot.discs().iter();
        for module in &mut spec.modules {
            let discs: Vec<&Disc> = discs.by_ref().take(module.discs).collect();
            if has_rod {
                // A rod is carried by the last disc of the module below, too.
                module.mass = MassSpec::Rigid(PerDisc::Each(discs.iter().map(mass).collect()));
            }
            if module.joint.is_some() {
                continue;
            }
            let own = |index: usize| module.damping.of_disc(index).copied();
            let joints: Vec<HingeJoint> = (discs.iter().enumerate())
                .map(|(index, disc)| joint(disc, own(index).unwrap_or_default(), row))
                .collect();
            let alike = joints.windows(2).all(|pair| pair[0] == pair[1]);
            module.joint = Some(match joints.first() {
                Some(first) if alike => PerDisc::Uniform(first.clone()),
                _ => PerDisc::Each(joints),
            });
            (module.backbone, module.rod) = (None, None);
        }
        Ok(spec)
    }
}

fn mass(disc: &&Disc) -> RigidMass {
    RigidMass {
        mass: disc.mass,
        inertia: disc.inertia.into(),
        centre_of_mass: disc.centre_of_mass.into(),
    }
}

/// The hinges of a ball joint whose module gives each the damping `own`.
fn joint(disc: &Disc, own: f64, row: HingeRow) -> HingeJoint {
    let springs = disc.backbone.map(|backbone| backbone.stiffness());
    let hinges = AXES.iter().enumerate().take(row.count());
    HingeJoint {
        hinges: hinges
            .map(|(axis, &direction)| Hinge {
                damping: disc.damping - own + disc.extra_damping[axis],
                ..Hinge::new(direction, springs.map_or(0.0, |springs| springs[axis]))
            })
            .collect(),
        zero: disc.backbone.map_or([0.0; 3], |backbone| backbone.rest),
    }
}
