//! What the joints of a body are together: a ball, a ball in series with hinges, or hinges at one place.

use nalgebra::Vector3;

use super::attributes::Attributes;
use super::body::BodyReader;
use super::frame::{SAME, SAME_PLACE};
use super::joint_element::{BodyJoint, JointElement, JointKind};
use crate::formats::ImportError;
use crate::robot::{Hinge, HingeJoint};

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
        neutral.retain(|name| !is_hinge || *name != "springdamper");
        let damper = ["springdamper"];
        let damper = if is_hinge { &damper[..] } else { &[] };
        joint.only(
            &[&known[..], &of_hinges].concat(),
            &[&neutral[..], damper].concat(),
        )?;
        if joint.limited("limited", "range", self.compiler.auto_limits)? {
            let reason = "MuJoCo's limits are not springs as they are here: expected none";
            return Err(joint.refuse("range", reason));
        }
        let value = |name| Ok::<_, ImportError>(joint.not_negative(name)?.unwrap_or(0.0));
        let hinge = is_hinge.then(|| self.hinge(&joint)).transpose()?;
        Ok(JointElement {
            element: index,
            hinge,
            center: joint.numbers::<3>("pos")?.unwrap_or_default().into(),
            damping: value("damping")?,
            armature: value("armature")?,
            stiffness: value("stiffness")?,
        })
    }

    /// A hinge, with a damping and an armature of its own.
    fn hinge(&self, joint: &Attributes<'_>) -> Result<Hinge, ImportError> {
        let axis = joint.numbers::<3>("axis")?.unwrap_or([0.0, 0.0, 1.0]);
        if Vector3::from(axis).norm() < 1e-10 {
            return Err(joint.refuse("axis", "expected a direction that is not zero"));
        }
        let value = |name| Ok::<_, ImportError>(joint.not_negative(name)?.unwrap_or(0.0));
        let angle = |name| {
            let angle = joint.number(name)?.unwrap_or(0.0);
            Ok::<_, ImportError>(self.compiler.angle(angle))
        };
        // Angles count from where the model has the body: MuJoCo's coordinate there is `ref`.
        Ok(Hinge {
            axis,
            stiffness: value("stiffness")?,
            rest: angle("springref")? - angle("ref")?,
            damping: value("damping")?,
            armature: value("armature")?,
        })
    }

    /// What the joints of a body are together; `None` where it has none.
    pub fn body_joint(
        &mut self,
        joints: &[JointElement],
    ) -> Result<Option<BodyJoint>, ImportError> {
        let Some(first) = joints.first() else {
            return Ok(None);
        };
        for joint in joints {
            if (joint.center - first.center).norm() > SAME_PLACE {
                let reason = "lies beside the body's first joint; expected all at one place";
                return Err(self.document.refuse(joint.element, reason));
            }
        }
        let balls: Vec<&JointElement> = joints.iter().filter(|j| j.hinge.is_none()).collect();
        match (balls.as_slice(), joints.len() - balls.len()) {
            ([ball], 0) => Ok(Some(ball.ball(Vector3::repeat(ball.stiffness)))),
            ([ball], 1 | 2) => self.series(ball, joints).map(Some),
            ([], 1..=3) => self.hinges(joints).map(Some),
            _ => {
                let reason = "expected one ball joint in each moving body, with hinges about two of \
                              its axes at most, or one to three hinges";
                Err(self.document.refuse(first.element, reason))
            }
        }
    }

    /// A ball and hinges in series with it.
    fn series(
        &mut self,
        ball: &JointElement,
        joints: &[JointElement],
    ) -> Result<BodyJoint, ImportError> {
        let mut springs = Vector3::repeat(ball.stiffness);
        let mut as_written = true;
        let mut seen = [false; 3];
        for joint in joints {
            let Some(hinge) = joint.hinge else { continue };
            let Some(axis) = axis_of(&hinge) else {
                let reason = "beside a ball joint: expected an axis along x, y or z of its body";
                return Err(self.document.refuse(joint.element, reason));
            };
            if std::mem::replace(&mut seen[axis], true) {
                let reason = "there are two hinges about this axis; expected one";
                return Err(self.document.refuse(joint.element, reason));
            }
            if hinge.rest != 0.0 {
                let reason = "attribute springref: expected the hinge at rest where the model has it, beside a ball joint";
                return Err(self.document.refuse(joint.element, reason));
            }
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
        Ok(ball.ball(springs))
    }

    /// Hinges alone.
    fn hinges(&self, joints: &[JointElement]) -> Result<BodyJoint, ImportError> {
        let first = &joints[0];
        let mut hinges: Vec<Hinge> = joints.iter().filter_map(|joint| joint.hinge).collect();
        // What all have alike is the module's.
        let alike = |of: fn(&Hinge) -> f64| hinges.iter().all(|hinge| of(hinge) == of(&hinges[0]));
        let (mut damping, mut armature) = (0.0, 0.0);
        let [same_damping, same_armature] =
            [alike(|hinge| hinge.damping), alike(|hinge| hinge.armature)];
        for hinge in &mut hinges {
            if same_damping {
                damping = std::mem::take(&mut hinge.damping);
            }
            if same_armature {
                armature = std::mem::take(&mut hinge.armature);
            }
        }
        let joint = HingeJoint {
            hinges,
            zero: [0.0; 3],
        };
        if let Err(error) = HingeJoint::validate("joint", &joint) {
            return Err(self.document.refuse(first.element, error.to_string()));
        }
        Ok(BodyJoint {
            center: first.center,
            damping,
            armature,
            kind: JointKind::Hinges(joint),
        })
    }
}

/// The body's axis that a hinge lies along, if it does.
fn axis_of(hinge: &Hinge) -> Option<usize> {
    let axis = Vector3::from(hinge.axis).normalize();
    (0..3).find(|&k| 1.0 - axis[k].abs() < SAME)
}
