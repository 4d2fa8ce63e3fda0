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

use super::attributes::Attributes;
use super::body::BodyReader;
use super::disc::SAME_PLACE;
use super::write::{Attribute, number, numbers};
use crate::backbone::rotation_vector;
use crate::formats::ImportError;
use crate::robot::Disc;

/// Deviation of a direction from an axis, and of stiffnesses from one another (relative), that counts
/// as none.
const SAME: f64 = 1e-9;
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

/// A joint element of a body.
pub(super) struct JointElement {
    element: usize,
    /// The axis of a hinge; `None` for a ball.
    axis: Option<usize>,
    center: Vector3<f64>,
    damping: f64,
    armature: f64,
    stiffness: f64,
}

/// What a body's joints are as one ball joint, in the body's frame.
#[derive(Clone, Copy)]
pub(super) struct BallJoint {
    /// Centre (m).
    pub center: Vector3<f64>,
    pub damping: f64,
    pub armature: f64,
    /// Stiffness about x, y and z (N m/rad).
    pub springs: Vector3<f64>,
    /// The axis about which it does not turn at all, if any.
    pub held: Option<usize>,
}

impl BallJoint {
    /// Whether it has a rest that it springs back to.
    pub fn is_elastic(&self) -> bool {
        self.springs != Vector3::zeros() || self.held.is_some()
    }
}

const AXES: [&str; 3] = ["x", "y", "z"];

impl BodyReader<'_> {
    pub fn joint_element(
        &self,
        index: usize,
        class: Option<&str>,
    ) -> Result<JointElement, ImportError> {
        let joint = self.classes.resolve(self.document, index, class)?;
        // MuJoCo's own default is a hinge about z.
        let is_hinge = match joint.text("type") {
            Some("ball") => false,
            None | Some("hinge") => true,
            Some(_) => return Err(joint.refuse("type", "expected ball or hinge")),
        };
        let known = [
            "type",
            "pos",
            "damping",
            "armature",
            "stiffness",
            "limited",
            "range",
            "axis",
            "group",
            "margin",
            "solreflimit",
            "solimplimit",
            "solreffriction",
            "solimpfriction",
        ];
        // They mean nothing to a ball.
        let of_hinges = ["ref", "springref"];
        let mut neutral = vec!["frictionloss", "springdamper"];
        if is_hinge {
            neutral.extend(of_hinges);
            joint.only(&known, &neutral)?;
        } else {
            joint.only(&[&known[..], &of_hinges].concat(), &neutral)?;
        }
        if joint.limited("limited", "range", self.compiler.auto_limits)? {
            let reason = "MuJoCo's limits are not springs as they are here: expected none";
            return Err(joint.refuse("range", reason));
        }
        let axis = is_hinge.then(|| axis_of(&joint)).transpose()?;
        let value = |name| Ok::<_, ImportError>(joint.not_negative(name)?.unwrap_or(0.0));
        Ok(JointElement {
            element: index,
            axis,
            center: joint.numbers::<3>("pos")?.unwrap_or_default().into(),
            damping: value("damping")?,
            armature: value("armature")?,
            stiffness: value("stiffness")?,
        })
    }

    /// What the joints of a body are together; `None` where it has none.
    pub fn ball_joint(
        &mut self,
        joints: &[JointElement],
    ) -> Result<Option<BallJoint>, ImportError> {
        let Some(first) = joints.first() else {
            return Ok(None);
        };
        let mut seen = [false; 3];
        for joint in joints {
            if (joint.center - first.center).norm() > SAME_PLACE {
                let reason = "lies beside the body's first joint; expected all at one place";
                return Err(self.document.refuse(joint.element, reason));
            }
            if joint
                .axis
                .is_some_and(|axis| std::mem::replace(&mut seen[axis], true))
            {
                let reason = "there are two hinges about this axis; expected one";
                return Err(self.document.refuse(joint.element, reason));
            }
        }
        let balls: Vec<&JointElement> = joints.iter().filter(|j| j.axis.is_none()).collect();
        match (balls.as_slice(), joints.len() - balls.len()) {
            ([ball], 0) => Ok(Some(ball.alone(Vector3::repeat(ball.stiffness), None))),
            ([ball], 1 | 2) => self.series(ball, joints).map(Some),
            ([], 2 | 3) => self.hinges(joints, seen).map(Some),
            ([], _) => {
                let reason = "a hinge alone; expected a ball joint, or two or three hinges at one \
                              place about axes of their body";
                Err(self.document.refuse(first.element, reason))
            }
            _ => {
                let reason = "expected one ball joint in each moving body, with hinges about two of \
                              its axes at most";
                Err(self.document.refuse(first.element, reason))
            }
        }
    }

    /// A ball and hinges in series with it.
    fn series(
        &mut self,
        ball: &JointElement,
        joints: &[JointElement],
    ) -> Result<BallJoint, ImportError> {
        let mut springs = Vector3::repeat(ball.stiffness);
        let mut as_written = true;
        for joint in joints {
            let Some(axis) = joint.axis else { continue };
            let sum = ball.stiffness + joint.stiffness;
            if sum == 0.0 {
                let reason = "hinge and ball turn freely about one axis; expected a spring on one";
                return Err(self.document.refuse(joint.element, reason));
            }
            springs[axis] = ball.stiffness * joint.stiffness / sum;
            let factor = (1.0 + joint.stiffness / sum) / (1.0 - joint.stiffness / sum);
            as_written &= (joint.damping - ball.damping * factor).abs()
                <= SAME * joint.damping.max(ball.damping);
        }
        if !as_written {
            let text = "ball and hinges are read as one ball joint with the ball's damping and \
                        armature: poses at rest are the same, motions are not";
            self.note(ball.element, text);
        }
        Ok(ball.alone(springs, None))
    }

    /// Two or three hinges.
    fn hinges(
        &mut self,
        joints: &[JointElement],
        seen: [bool; 3],
    ) -> Result<BallJoint, ImportError> {
        let first = &joints[0];
        let mut springs = Vector3::zeros();
        for joint in joints {
            let same = joint.damping == first.damping && joint.armature == first.armature;
            if !same {
                let reason = "damping or armature differ from those of the body's first hinge; \
                              expected the same of all, as a ball joint has them";
                return Err(self.document.refuse(joint.element, reason));
            }
            if let Some(axis) = joint.axis {
                springs[axis] = joint.stiffness;
            }
        }
        let held = seen.iter().position(|seen| !seen);
        let text = match held {
            None => {
                "three hinges are read as a ball joint: the same while turns are small".to_owned()
            }
            Some(axis) => format!(
                "two hinges are read as a ball joint with a stiff spring about {}, which they do \
                 not turn about",
                AXES[axis]
            ),
        };
        self.note(first.element, text);
        Ok(first.alone(springs, held))
    }
}

impl JointElement {
    fn alone(&self, springs: Vector3<f64>, held: Option<usize>) -> BallJoint {
        BallJoint {
            center: self.center,
            damping: self.damping,
            armature: self.armature,
            springs,
            held,
        }
    }
}

/// The body's axis that a hinge lies along.
fn axis_of(joint: &Attributes<'_>) -> Result<usize, ImportError> {
    let direction = joint.numbers::<3>("axis")?.unwrap_or([0.0, 0.0, 1.0]);
    let axis = Vector3::from(direction).try_normalize(1e-10);
    let along = axis.and_then(|axis| (0..3).find(|&k| 1.0 - axis[k].abs() < SAME));
    along.ok_or_else(|| joint.refuse("axis", "expected an axis along x, y or z of its body"))
}
