//! Joints whose stiffness differs by axis, in MuJoCo.
//!
//! A ball joint of MuJoCo has one stiffness `k`, with the energy `1/2 k |log R|²`: ours, where bending
//! and torsion are alike. Where they are not, a ball with the largest of the three stiffnesses stands in
//! series with a hinge about each softer axis: their compliances add, so a hinge of `k s / (1 - s)`
//! makes the axis `s` times as stiff as the ball. For a round rod that is one hinge, about the rod's
//! axis, as torsion is softer than bending by the factor `1 / (1 + nu)`.
//!
//! With one hinge, bending alone and torsion alone have exactly the energy `1/2 phi' K phi`. Together
//! they differ by terms of fourth order in the angles, and so do turns about two hinges. How far the
//! ten discs of 2m then settle from ours, its joints bent by 6 to 23 degrees: 4e-5 mm at most for a round
//! rod (torsion 0.77 times bending), 0.01 mm for a helical spring (1.15 times), 0.6 mm where torsion is 3
//! times as stiff as bending. `tests/python/test_mjcf.py` settles one of each in MuJoCo.
//!
//! The hinge moves with its share `1 - s` of the turn and the ball with `s`. Damping and armature of
//! the hinge are `(1 + s) / (1 - s)` times those of the ball: then slow turns dissipate and store as
//! much as about one joint. The armature also has that factor of the disc's own inertia, without
//! which hinge and ball would turn against each other without any.

use nalgebra::{UnitQuaternion, Vector3};

use super::frame::SAME;
use super::write::{Attribute, number, numbers};
use crate::backbone::rotation_vector;
use crate::robot::Disc;

/// Steps of the iteration for the hinges' angles. Each gains a factor of the angle squared.
const ITERATIONS: usize = 40;

/// A disc's joint as MuJoCo has it: a ball, and hinges in series with it.
pub(super) struct SeriesJoint {
    center: Vector3<f64>,
    /// Stiffness of the ball (N m/rad); `None` where the disc turns freely.
    stiffness: Option<f64>,
    damping: f64,
    armature: f64,
    hinges: Vec<Hinge>,
}

/// A hinge along an axis of its disc.
pub(super) struct Hinge {
    /// 0 for x, 1 for y, 2 for z.
    axis: usize,
    stiffness: f64,
    damping: f64,
    armature: f64,
}

/// One degree of freedom of a joint.
pub(super) struct Freedom {
    /// What it turns the disc about, in the disc's frame.
    pub axis: Vector3<f64>,
    pub stiffness: f64,
    pub damping: f64,
    pub armature: f64,
}

impl SeriesJoint {
    pub fn of(disc: &Disc) -> Self {
        let springs = disc.backbone.as_ref().map(|b| b.stiffness());
        let largest = springs.map(|springs| springs.max());
        let mut hinges = Vec::new();
        if let (Some(springs), Some(largest)) = (springs, largest) {
            for (axis, &spring) in springs.iter().enumerate() {
                let share = spring / largest;
                if 1.0 - share > SAME {
                    hinges.push(Hinge::in_series(disc, axis, largest, share));
                }
            }
        }
        Self {
            center: -disc.origin,
            stiffness: largest,
            damping: disc.damping,
            armature: disc.armature,
            hinges,
        }
    }

    /// Whether it is a ball alone.
    pub fn is_ball(&self) -> bool {
        self.hinges.is_empty()
    }

    /// The attributes of the elements `joint`: the hinges come first, as MuJoCo takes no hinge after a
    /// ball.
    pub fn elements(&self) -> Vec<Vec<Attribute<'static>>> {
        let element = |kind: &str, hinge: Option<&Hinge>| {
            let mut joint = vec![("type", kind.to_owned())];
            if let Some(hinge) = hinge {
                joint.push(("axis", numbers(hinge.axis().as_slice())));
            }
            if self.center != Vector3::zeros() {
                joint.push(("pos", numbers(self.center.as_slice())));
            }
            joint
        };
        let hinges = self.hinges.iter().map(|hinge| {
            let mut joint = element("hinge", Some(hinge));
            joint.push(("damping", number(hinge.damping)));
            joint.push(("armature", number(hinge.armature)));
            joint.push(("stiffness", number(hinge.stiffness)));
            joint
        });
        let mut ball = element("ball", None);
        ball.push(("damping", number(self.damping)));
        ball.push(("armature", number(self.armature)));
        ball.extend(self.stiffness.map(|k| ("stiffness", number(k))));
        hinges.chain([ball]).collect()
    }

    /// Its degrees of freedom where it turns by `q` from rest.
    pub fn freedoms(&self, q: &UnitQuaternion<f64>) -> Vec<Freedom> {
        let (angles, ball) = self.balance(q);
        let mut freedoms: Vec<Freedom> = (0..3)
            .map(|axis| Freedom {
                axis: Vector3::ith(axis, 1.0),
                stiffness: self.stiffness.unwrap_or(0.0),
                damping: self.damping,
                armature: self.armature,
            })
            .collect();
        let mut after = ball;
        for (hinge, angle) in self.hinges.iter().zip(angles).rev() {
            freedoms.push(Freedom {
                axis: after.inverse() * hinge.axis(),
                stiffness: hinge.stiffness,
                damping: hinge.damping,
                armature: hinge.armature,
            });
            after = hinge.turn(angle) * after;
        }
        freedoms
    }

    /// MuJoCo's coordinates of the turn `q` from rest: the hinges' angles (rad), then the ball's
    /// quaternion (w, x, y, z).
    pub fn coordinates(&self, q: &UnitQuaternion<f64>) -> Vec<f64> {
        let (mut coordinates, ball) = self.balance(q);
        let sign = if ball.w < 0.0 { -1.0 } else { 1.0 };
        coordinates.extend([ball.w, ball.i, ball.j, ball.k].map(|number| sign * number));
        coordinates
    }

    /// The hinges' angles (rad) and the ball's turn that make up the turn `q` from rest, at which they
    /// hold one another.
    fn balance(&self, q: &UnitQuaternion<f64>) -> (Vec<f64>, UnitQuaternion<f64>) {
        let stiffness = self.stiffness.unwrap_or(0.0);
        let mut angles = vec![0.0; self.hinges.len()];
        let mut ball = *q;
        for _ in 0..ITERATIONS * self.hinges.len().min(1) {
            // The ball turns about its moment, which is the same in the frames on either side of it.
            let moment = rotation_vector(&ball) * stiffness;
            let mut after = UnitQuaternion::identity();
            for (hinge, angle) in self.hinges.iter().zip(&mut angles).rev() {
                let left = moment.dot(&(after.inverse() * hinge.axis())) - hinge.stiffness * *angle;
                *angle += left / (stiffness + hinge.stiffness);
                after = hinge.turn(*angle) * after;
            }
            ball = after.inverse() * q;
        }
        (angles, ball)
    }
}

impl Hinge {
    fn axis(&self) -> Vector3<f64> {
        Vector3::ith(self.axis, 1.0)
    }

    fn turn(&self, angle: f64) -> UnitQuaternion<f64> {
        UnitQuaternion::from_scaled_axis(self.axis() * angle)
    }

    /// The hinge that makes a ball of `stiffness` `share` times as stiff about an axis.
    fn in_series(disc: &Disc, axis: usize, stiffness: f64, share: f64) -> Self {
        let factor = (1.0 + share) / (1.0 - share);
        Self {
            axis,
            stiffness: stiffness * share / (1.0 - share),
            damping: disc.damping * factor,
            armature: (disc.armature + disc.inertia[axis]) * factor,
        }
    }
}
