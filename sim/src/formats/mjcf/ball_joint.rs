//! What the joints of a body are as one ball joint: a ball, a ball in series with hinges, or hinges at one place.

use nalgebra::Vector3;

use super::attributes::Attributes;
use super::body::BodyReader;
use super::frame::{SAME, SAME_PLACE};
use super::joint_element::{BallJoint, JointElement};
use crate::formats::ImportError;

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

/// The body's axis that a hinge lies along.
fn axis_of(joint: &Attributes<'_>) -> Result<usize, ImportError> {
    let direction = joint.numbers::<3>("axis")?.unwrap_or([0.0, 0.0, 1.0]);
    let axis = Vector3::from(direction).try_normalize(1e-10);
    let along = axis.and_then(|axis| (0..3).find(|&k| 1.0 - axis[k].abs() < SAME));
    along.ok_or_else(|| joint.refuse("axis", "expected an axis along x, y or z of its body"))
}
