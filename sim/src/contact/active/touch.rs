//! The contacts that there may be, as an active set takes them.

use nalgebra::{Matrix3, Vector3};

use crate::contact::equations::Equations;
use crate::contact::law::Response;
use crate::contact::near::Near;
use crate::contact::near_pairs::NearPair;
use crate::contact::surfaces::Surfaces;

/// Where a contact is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Place {
    pub surfaces: Surfaces,
    /// Of a bead and an obstacle the first, second, ... face.
    face: usize,
}

/// One contact.
pub(super) struct Touch<'a> {
    pub place: Place,
    pub gap: f64,
    /// The gap's gradient by the way of the first of the beads from the second, or from the obstacle.
    pub normal: Vector3<f64>,
    pub compliance: f64,
    pub between: Between<'a>,
}

pub(super) enum Between<'a> {
    Obstacle(&'a Near),
    Discs(&'a NearPair),
}

impl Touch<'_> {
    /// What it bears if it does (N).
    pub fn force(&self) -> f64 {
        -self.gap / self.compliance
    }

    /// What it does if it bears with the force `known` (N).
    pub fn bearing(&self, known: f64) -> Response {
        Response {
            force: known,
            ..Response::bearing(self.gap, self.compliance)
        }
    }

    /// The discs that it pushes along its normal, or against it, and where (m).
    pub fn ends(&self) -> impl Iterator<Item = End> + use<> {
        let ends = match self.between {
            Between::Obstacle(near) => [Some((near.bead.disc, near.centre)), None],
            Between::Discs(pair) => [0, 1].map(|i| Some((pair.beads[i].disc, pair.centres[i]))),
        };
        ends.into_iter().zip([1.0, -1.0]).filter_map(|(end, sign)| {
            let (disc, position) = end?;
            Some(End {
                disc,
                position,
                sign,
            })
        })
    }
}

/// A point of a disc that a contact pushes.
#[derive(Clone, Copy, Debug)]
pub(super) struct End {
    pub disc: usize,
    pub position: Vector3<f64>,
    pub sign: f64,
}

/// The contacts that there may be.
pub(super) fn touches(equations: &Equations) -> impl Iterator<Item = Touch<'_>> {
    let mut before: Option<&Near> = None;
    let mut face = 0;
    let obstacles = equations.neighbourhood.near.iter().map(move |near| {
        let again = before.is_some_and(|other| other.surfaces() == near.surfaces());
        face = if again { face + 1 } else { 0 };
        before = Some(near);
        Touch {
            place: Place {
                surfaces: near.surfaces(),
                face,
            },
            gap: near.gap,
            normal: near.normal,
            compliance: equations.law(near).compliance,
            between: Between::Obstacle(near),
        }
    });
    let compliance = equations.own_law().compliance;
    let discs = equations.near_pairs().iter().map(move |pair| Touch {
        place: Place {
            surfaces: Surfaces::Discs(pair.beads),
            face: 0,
        },
        gap: pair.gap,
        normal: pair.normal,
        compliance,
        between: Between::Discs(pair),
    });
    obstacles.chain(discs)
}

/// What the contacts of two surfaces bear.
#[derive(Clone, Copy)]
pub(super) struct Face {
    /// Of the first of them.
    pub normal: Vector3<f64>,
    /// By the multipliers (N).
    pub force: Vector3<f64>,
    /// What the force has besides (N).
    pub besides: Vector3<f64>,
    /// What a displacement of the bead, from the other one, diminishes the force by (N/m).
    pub stiffness: Matrix3<f64>,
    /// Second derivative of the gap by that (1/m).
    pub curvature: Matrix3<f64>,
}

impl Face {
    /// Of a contact that bears with the force `known` (N).
    pub fn new(touch: &Touch, known: f64) -> Self {
        let response = touch.bearing(known);
        let (stiffness, curvature) = match touch.between {
            Between::Obstacle(near) => (near.stiffness(&response), near.curvature),
            Between::Discs(pair) => (pair.pressed(&response).form(), pair.curvature()),
        };
        Self {
            normal: touch.normal,
            force: touch.normal * known,
            besides: touch.normal * (touch.force() - known),
            stiffness,
            curvature,
        }
    }

    /// The two together.
    pub fn and(self, other: Self) -> Self {
        Self {
            force: self.force + other.force,
            besides: self.besides + other.besides,
            stiffness: self.stiffness + other.stiffness,
            ..self
        }
    }
}
