//! Refusing rig files that make no sense.

use super::RigError;
use super::file::{CameraLink, RigCameraSpec, RigFile, ServoLink};
use crate::servo::ServoId;

impl RigFile {
    /// Refuses values that make no sense.
    pub(super) fn check(&self) -> Result<(), RigError> {
        let tendons = self.robot.tendon_count();
        let servos = &self.spec.servos;
        if servos.ids.len() != tendons {
            let found = format!("{} ids", servos.ids.len());
            let expected = format!(
                "{tendons}, one for each tendon of robot `{}`",
                self.robot.name
            );
            return Err(RigError::field("servos.ids", found, expected));
        }
        for (k, &id) in servos.ids.iter().enumerate() {
            let field = format!("servos.ids[{k}]");
            if ServoId::new(id).is_none() {
                return Err(RigError::field(field, id, "an address of 0 to 252"));
            }
            if servos.ids[..k].contains(&id) {
                return Err(RigError::field(field, id, "no address twice"));
            }
        }
        let positive = |value: &f64| value.is_finite() && *value > 0.0;
        let one_or_each = |field: &str, found: usize| match found == 1 || found == tendons {
            true => Ok(()),
            false => {
                let expected = format!("one for each of the {tendons} servos, or a single one");
                Err(RigError::field(
                    format!("servos.{field}"),
                    format!("{found} entries"),
                    expected,
                ))
            }
        };
        one_or_each("directions", servos.directions.len())?;
        one_or_each("limits", servos.limits.len())?;
        for (name, list, fits, expected) in [
            (
                "spool_radius",
                &servos.spool_radius,
                &positive as &dyn Fn(&f64) -> bool,
                "a radius above 0 (m)",
            ),
            (
                "home_tension",
                &servos.home_tension,
                &|x| x.is_finite() && *x >= 0.0,
                "a tension of 0 or more (N)",
            ),
            (
                "current_limit",
                &servos.current_limit,
                &positive,
                "a current above 0 (A)",
            ),
        ] {
            one_or_each(name, list.len())?;
            for (k, value) in list.iter().enumerate() {
                if !fits(value) {
                    return Err(RigError::field(
                        format!("servos.{name}[{k}]"),
                        value,
                        expected,
                    ));
                }
            }
        }
        for (k, limits @ [low, high]) in servos.limits.iter().enumerate() {
            if !(low <= &0 && &0 <= high && low < high) {
                let expected = "[smallest, largest] about home, which is 0 (ticks)";
                let field = format!("servos.limits[{k}]");
                return Err(RigError::field(field, format!("{limits:?}"), expected));
            }
        }
        for (k, camera) in self.spec.cameras.iter().enumerate() {
            let same = |other: &RigCameraSpec| other.serial == camera.serial;
            if camera.serial.is_empty() || self.spec.cameras[..k].iter().any(same) {
                let expected = "a serial number, no one twice";
                let found = format!("{:?}", camera.serial);
                return Err(RigError::field(
                    format!("cameras[{k}].serial"),
                    found,
                    expected,
                ));
            }
            let sees_plant = self.spec.servos.link == ServoLink::Simulated;
            if camera.link == CameraLink::Simulated && !sees_plant {
                let expected =
                    "\"simulated\" only where the servos are: it sees the robot behind them";
                let field = format!("cameras[{k}].link");
                return Err(RigError::field(field, "\"simulated\"", expected));
            }
        }
        self.spec.masks.check("masks", self.spec.cameras.len())?;
        let modules = self.robot.modules.len();
        if let Some((field, found, expected)) = self.spec.commands.fault(modules) {
            return Err(RigError::field(
                format!("commands.{field}"),
                found,
                expected,
            ));
        }
        self.spec.motion.check()?;
        self.spec.safety.check()
    }
}
