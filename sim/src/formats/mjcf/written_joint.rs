//! A disc's joint as MuJoCo has it.

use nalgebra::{UnitQuaternion, Vector3};

use super::joint::{Freedom, SeriesJoint};
use super::write::{Attribute, number, numbers};
use crate::robot::{Disc, Hinges};

/// A ball, alone or with hinges in series that make its stiffness differ by axis; or hinges, as they are here.
pub(super) enum WrittenJoint {
    Ball(SeriesJoint),
    Hinges {
        hinges: Box<Hinges>,
        /// Place in the disc's frame (m).
        center: Vector3<f64>,
    },
}

impl WrittenJoint {
    pub fn of(disc: &Disc) -> Self {
        match &disc.hinges {
            None => Self::Ball(SeriesJoint::of(disc)),
            Some(hinges) => Self::Hinges {
                hinges: hinges.clone(),
                center: -disc.origin,
            },
        }
    }

    /// Whether its coordinates are those that it has here.
    pub fn is_as_here(&self) -> bool {
        match self {
            Self::Ball(joint) => joint.is_ball(),
            Self::Hinges { .. } => true,
        }
    }

    /// The attributes of the elements `joint`.
    pub fn elements(&self) -> Vec<Vec<Attribute<'static>>> {
        match self {
            Self::Ball(joint) => joint.elements(),
            Self::Hinges { hinges, center } => (0..hinges.count)
                .map(|index| hinge_element(hinges, index, center))
                .collect(),
        }
    }

    /// Its degrees of freedom where it is turned by `q` from rest.
    pub fn freedoms(&self, q: &UnitQuaternion<f64>) -> Vec<Freedom> {
        match self {
            Self::Ball(joint) => joint.freedoms(q),
            // Along its own coordinates, whose springs and inertia are counted already.
            Self::Hinges { hinges, .. } => (0..hinges.count)
                .map(|index| Freedom {
                    axis: Vector3::ith(index, 1.0),
                    stiffness: 0.0,
                    damping: hinges.damping[index],
                    armature: 0.0,
                })
                .collect(),
        }
    }

    /// MuJoCo's coordinates where it is turned by `q` from rest.
    pub fn coordinates(&self, q: &UnitQuaternion<f64>) -> Vec<f64> {
        match self {
            Self::Ball(joint) => joint.coordinates(q),
            Self::Hinges { hinges, .. } => hinges
                .angles(q)
                .iter()
                .copied()
                .take(hinges.count)
                .collect(),
        }
    }
}

fn hinge_element(hinges: &Hinges, index: usize, center: &Vector3<f64>) -> Vec<Attribute<'static>> {
    let mut joint = vec![
        ("type", "hinge".to_owned()),
        ("axis", numbers(hinges.axes[index].as_slice())),
    ];
    if *center != Vector3::zeros() {
        joint.push(("pos", numbers(center.as_slice())));
    }
    joint.push(("damping", number(hinges.damping[index])));
    joint.push(("armature", number(hinges.armature[index])));
    joint.push(("stiffness", number(hinges.stiffness[index])));
    if hinges.rest[index] != 0.0 {
        joint.push(("springref", number(hinges.rest[index])));
    }
    joint
}
