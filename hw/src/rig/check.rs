//! Refusing rig files that make no sense.

use super::RigError;
use super::file::{CameraLink, RigCameraSpec, RigFile, RigSpec, ServoLink, TendonMode};
use super::settings::LARGEST_CURRENT;
use crate::dynamixel::BAUD_RATES;
use crate::servo::{SPOOL_RADII, ServoId};

/// Limits of currents (A).
const CURRENTS: [f64; 2] = [0.01, LARGEST_CURRENT];

/// Farthest position that these servos have (ticks): 256 turns (e-Manual, "Extended Position Control Mode").
const FARTHEST: i32 = 1_048_575;

/// Speed of the fastest of these servos without load (rad/s): the XL330-M288's 103 rev/min at 5 V, and a tenth for 6 V.
const FASTEST: f64 = 12.0;

/// Stall torque of the strongest of these servos (N m): the XC330-M288's 0.93 at 5 V, and what 6 V add.
const STRONGEST: f64 = 1.2;

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
        if !BAUD_RATES.contains(&servos.baud) {
            let expected = format!("one of the servos' rates, {BAUD_RATES:?}");
            return Err(RigError::field("servos.baud", servos.baud, expected));
        }
        for (name, unit, list, bounds) in [
            ("spool_radius", "m", &servos.spool_radius, SPOOL_RADII),
            ("home_tension", "N", &servos.home_tension, [0.0, 1e5]),
            ("current_limit", "A", &servos.current_limit, CURRENTS),
        ] {
            one_or_each(name, list.len())?;
            for (k, value) in list.iter().enumerate() {
                let [low, high] = bounds;
                if !(low..=high).contains(value) {
                    let expected = format!("{low} to {high} {unit}");
                    return Err(RigError::field(
                        format!("servos.{name}[{k}]"),
                        value,
                        expected,
                    ));
                }
            }
        }
        for (k, limits @ [low, high]) in servos.limits.iter().enumerate() {
            let within = -FARTHEST <= *low && *high <= FARTHEST;
            if !(within && low <= &0 && &0 <= high && low < high) {
                let expected = format!(
                    "[smallest, largest] about home, which is 0, within {FARTHEST} to either side (ticks)"
                );
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
        let sizes: Vec<[u32; 2]> = (self.spec.cameras.iter())
            .map(|camera| camera.camera.resolution)
            .collect();
        self.spec.masks.check("masks", &sizes)?;
        let modules = self.robot.modules.len();
        if let Some((field, found, expected)) = self.spec.commands.fault(modules) {
            return Err(RigError::field(
                format!("commands.{field}"),
                found,
                expected,
            ));
        }
        if let Some(around) = &self.spec.scene
            && !(around.clearance.is_finite() && around.clearance >= 0.0)
        {
            let expected = "a distance of 0 or more (m)";
            return Err(RigError::field(
                "scene.clearance",
                around.clearance,
                expected,
            ));
        }
        let RigSpec { motion, safety, .. } = &self.spec;
        motion.check()?;
        safety.check(motion)?;
        self.check_that_all_can_act()
    }

    /// Refuses limits that nothing can ever reach.
    fn check_that_all_can_act(&self) -> Result<(), RigError> {
        let RigSpec {
            servos,
            commands,
            motion,
            safety,
            ..
        } = &self.spec;
        let bounded = servos.mode == TendonMode::CurrentBasedPosition;
        let least = servos
            .current_limit
            .iter()
            .copied()
            .fold(f64::MAX, f64::min);
        if let Some(current) = safety.current
            && bounded
            && current >= least
        {
            let expected = format!(
                "below servos.current_limit, {least} A: no servo draws more than that, so the motion would never end for it"
            );
            return Err(RigError::field("safety.current", current, expected));
        }
        let spans = servos.limits.iter();
        let widest = (spans.map(|[low, high]| high.saturating_sub(*low))).fold(0, i32::max);
        if safety.lag >= widest {
            let expected = format!(
                "below {widest}, the farthest that servos.limits let a goal be from a position"
            );
            return Err(RigError::field("safety.lag", safety.lag, expected));
        }
        let radii = || servos.spool_radius.iter().copied();
        let largest = radii().fold(0.0, f64::max);
        if motion.slew > FASTEST * largest {
            let expected = format!(
                "no more than {:.3} m/s, which spools of {largest} m wind at the {FASTEST} rad/s of the fastest servo",
                FASTEST * largest
            );
            return Err(RigError::field("motion.slew", motion.slew, expected));
        }
        let smallest = radii().fold(f64::MAX, f64::min);
        let [low, high] = commands.tension;
        if high > STRONGEST / smallest {
            let expected = format!(
                "no more than {:.0} N, which the {STRONGEST} N m of the strongest servo pull with on spools of {smallest} m",
                STRONGEST / smallest
            );
            return Err(RigError::field(
                "commands.tension",
                format!("[{low}, {high}]"),
                expected,
            ));
        }
        Ok(())
    }
}
