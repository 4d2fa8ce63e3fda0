//! Tendons and their actuators.

use std::collections::HashMap;

use super::attributes::Attributes;
use super::body::BodyReader;
use crate::formats::ImportError;
use crate::robot::{Drive, Pull, RouteSpec, TendonSpec, Waypoint};

/// A tendon, with the largest pull (N) that its actuator is limited to.
pub(super) struct DrivenTendon {
    pub route: RouteSpec,
    pub strongest: Option<f64>,
    /// The actuator.
    pub element: usize,
}

/// What an actuator does: its force is `gain ctrl + bias[0] + bias[1] length`, with
/// `length = gear L` of a tendon of length `L`; it acts on the tendon times `gear`, and lengthens it.
struct Law {
    gear: f64,
    gain: f64,
    bias: [f64; 2],
}

impl<'a> BodyReader<'a> {
    /// The tendons, in the order of their actuators: that of MuJoCo's `ctrl`.
    pub fn tendons(
        &mut self,
        holes: &HashMap<&'a str, Waypoint>,
    ) -> Result<Vec<DrivenTendon>, ImportError> {
        let document = self.document;
        let mut routes = HashMap::new();
        for (index, _) in document.section("tendon") {
            let (name, through) = self.route(index, holes)?;
            routes.insert(name, (index, through));
        }
        let mut driven = Vec::new();
        for (index, _) in document.section("actuator") {
            let attributes = self.classes.resolve(document, index, None)?;
            let Some(name) = attributes.text("tendon") else {
                return Err(attributes.refuse_element("expected an actuator on a tendon"));
            };
            let Some((_, through)) = routes.remove(name) else {
                let reason = "expected the name of a tendon that no other actuator pulls";
                return Err(attributes.refuse("tendon", reason));
            };
            let (tendon, strongest) = self.drive(&attributes, index)?;
            driven.push(DrivenTendon {
                route: RouteSpec { through, tendon },
                strongest,
                element: index,
            });
        }
        let mut idle: Vec<usize> = routes.into_values().map(|(index, _)| index).collect();
        idle.sort_unstable();
        for index in idle {
            self.note(index, "left out: no actuator pulls it");
        }
        Ok(driven)
    }

    fn route(
        &self,
        index: usize,
        holes: &HashMap<&'a str, Waypoint>,
    ) -> Result<(&'a str, Vec<Waypoint>), ImportError> {
        let document = self.document;
        if document.elements[index].tag != "spatial" {
            return Err(document.refuse(index, "expected <spatial>: tendons through sites"));
        }
        let tendon = self.classes.resolve(document, index, None)?;
        let known = [
            "group",
            "limited",
            "range",
            "solreflimit",
            "solimplimit",
            "solreffriction",
            "solimpfriction",
            "margin",
            "springlength",
            "width",
            "material",
            "rgba",
        ];
        let neutral = [
            "stiffness",
            "damping",
            "frictionloss",
            "armature",
            "actuatorfrcrange",
        ];
        tendon.only(&known, &neutral)?;
        if tendon.limited("limited", "range", self.compiler.auto_limits)? {
            return Err(tendon.refuse("range", "expected tendons without limits"));
        }
        let mut through = Vec::new();
        for (step, element) in document.children(index) {
            let attributes = Attributes::own(document, step);
            if element.tag != "site" {
                let reason = "expected <site>: tendons are straight between sites";
                return Err(attributes.refuse_element(reason));
            }
            let site = attributes.text("site");
            let Some(waypoint) = site.and_then(|name| holes.get(name)) else {
                return Err(attributes.refuse("site", "expected the name of a site of the robot"));
            };
            through.push(*waypoint);
        }
        let Some(name) = Attributes::own(document, index).text("name") else {
            return Err(tendon.refuse_element("expected a name, for an actuator to pull it by"));
        };
        Ok((name, through))
    }

    /// The drive that an actuator is, and the largest pull that it is limited to (N).
    fn drive(
        &mut self,
        actuator: &Attributes<'_>,
        index: usize,
    ) -> Result<(TendonSpec, Option<f64>), ImportError> {
        let law = self.law(actuator, index)?;
        if !actuator.limited("ctrllimited", "ctrlrange", self.compiler.auto_limits)? {
            let reason = "expected ctrllimited=\"true\" and a ctrlrange: tendons have a range";
            return Err(actuator.refuse_element(reason));
        }
        let Some(range) = actuator.numbers::<2>("ctrlrange")? else {
            return Err(actuator.refuse_element("expected an attribute `ctrlrange`"));
        };
        // The command in our sense is an affine function of MuJoCo's.
        let (drive, slope, shift) = if law.bias[1] == 0.0 {
            (
                Drive::Tension,
                -law.gear * law.gain,
                -law.gear * law.bias[0],
            )
        } else {
            let stiffness = -law.bias[1] * law.gear;
            let drive = Drive::Gain(stiffness * law.gear);
            (drive, law.gain / stiffness, law.bias[0] / stiffness)
        };
        if slope != 1.0 || shift != 0.0 {
            let what = match drive {
                Drive::Tension => "tension (N)",
                Drive::Gain(_) | Drive::Length => "rest length (m)",
            };
            // Adding 0 makes -0 a 0.
            let shift = shift + 0.0;
            let text = format!("a command is the {what}, {slope} ctrl + {shift}");
            self.note(index, text);
        }
        let mut range = range.map(|ctrl| slope * ctrl + shift);
        range.sort_by(f64::total_cmp);
        if range[0] < 0.0 {
            let reason = format!(
                "commands from {} to {}, as tensions or rest lengths; expected 0 or above",
                range[0], range[1]
            );
            return Err(actuator.refuse("ctrlrange", reason));
        }
        let (pull, strongest) = self.force_limit(actuator, &law, drive, range)?;
        let tendon = TendonSpec {
            drive,
            range,
            pull,
            axial_stiffness: None,
            stiffening: 0.0,
            friction: None,
            servo: None,
        };
        Ok((tendon, strongest))
    }

    fn law(&self, actuator: &Attributes<'_>, index: usize) -> Result<Law, ImportError> {
        let common = [
            "group",
            "ctrllimited",
            "ctrlrange",
            "forcelimited",
            "forcerange",
            "gear",
            "tendon",
            "lengthrange",
            "actlimited",
            "actrange",
        ];
        let neutral = [
            "kv",
            "timeconst",
            "inheritrange",
            "damping",
            "armature",
            "delay",
            "nsample",
            "actearly",
        ];
        let gear = actuator.list("gear")?.unwrap_or_default();
        let gear = gear.first().copied().unwrap_or(1.0);
        let (law, known): (Law, &[&str]) = match self.document.elements[index].tag.as_str() {
            "motor" => {
                let law = Law {
                    gear,
                    gain: 1.0,
                    bias: [0.0; 2],
                };
                // Defaults of other actuators reach a motor, and mean nothing to it.
                (
                    law,
                    &[
                        "kp", "gainprm", "biasprm", "gaintype", "biastype", "dyntype",
                    ],
                )
            }
            "position" => {
                let kp = actuator.number("kp")?.unwrap_or(1.0);
                (
                    Law {
                        gear,
                        gain: kp,
                        bias: [0.0, -kp],
                    },
                    &["kp"],
                )
            }
            "general" => {
                let law = Law {
                    gear,
                    ..general(actuator)?
                };
                (
                    law,
                    &["gainprm", "biasprm", "gaintype", "biastype", "dyntype"],
                )
            }
            _ => {
                let reason = "expected <position>, <motor> or <general>";
                return Err(actuator.refuse_element(reason));
            }
        };
        actuator.only(&[&common[..], known].concat(), &neutral)?;
        if law.gear == 0.0 || law.gain == 0.0 || law.bias[1] > 0.0 {
            let reason = "expected a force that changes with ctrl and falls with the length";
            return Err(actuator.refuse_element(reason));
        }
        Ok(law)
    }

    /// Whether the tendon can push, and the largest pull that it is limited to (N), if any.
    fn force_limit(
        &self,
        actuator: &Attributes<'_>,
        law: &Law,
        drive: Drive,
        range: [f64; 2],
    ) -> Result<(Pull, Option<f64>), ImportError> {
        if !actuator.limited("forcelimited", "forcerange", self.compiler.auto_limits)? {
            return Ok((Pull::Bilateral, None));
        }
        let Some(forces) = actuator.numbers::<2>("forcerange")? else {
            return Err(actuator.refuse_element("expected an attribute `forcerange`"));
        };
        let mut tensions = forces.map(|force| -law.gear * force);
        tensions.sort_by(f64::total_cmp);
        let [weakest, strongest] = tensions;
        match drive {
            Drive::Gain(_) | Drive::Length if weakest == 0.0 => {
                Ok((Pull::TensionOnly, Some(strongest)))
            }
            // The tendon pushes most where it has no length.
            Drive::Gain(gain) if weakest <= -gain * range[1] => {
                Ok((Pull::Bilateral, Some(strongest)))
            }
            Drive::Tension if weakest <= range[0] => Ok((Pull::Bilateral, Some(strongest))),
            _ => {
                let reason = "expected a range that ends at the force 0 (a tendon that only \
                              pulls), or one that no command exceeds";
                Err(actuator.refuse("forcerange", reason))
            }
        }
    }
}

/// The law of a `general` actuator.
fn general(actuator: &Attributes<'_>) -> Result<Law, ImportError> {
    for (name, usual) in [("dyntype", "none"), ("gaintype", "fixed")] {
        if actuator.text(name).is_some_and(|value| value != usual) {
            return Err(actuator.refuse(name, format!("expected {usual}")));
        }
    }
    let gain = actuator.list("gainprm")?.unwrap_or_default();
    let bias = actuator.list("biasprm")?.unwrap_or_default();
    let at = |list: &[f64], index: usize| list.get(index).copied().unwrap_or(0.0);
    let bias = match actuator.text("biastype") {
        None | Some("none") => [0.0; 3],
        Some("affine") => [at(&bias, 0), at(&bias, 1), at(&bias, 2)],
        Some(_) => return Err(actuator.refuse("biastype", "expected none or affine")),
    };
    if bias[2] != 0.0 {
        return Err(actuator.refuse("biasprm", "expected 0 in third place: no damping"));
    }
    Ok(Law {
        gear: 1.0,
        gain: gain.first().copied().unwrap_or(1.0),
        bias: [bias[0], bias[1]],
    })
}
