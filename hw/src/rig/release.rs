//! Letting go: home and off, or off at once.

use super::motion::{Drive, all};
use super::settings::Release;
use super::stop::Released;
use super::turns::{Homing, Turns};
use super::{Rig, RigError};
use crate::log::Level;
use crate::servo::{ServoId, Setting, Ticks, Torque};

/// How often a servo is told to switch off its motor before one gives up.
const ATTEMPTS: usize = 3;

impl Rig {
    /// Takes the tension from the tendons as the rig's settings say, and switches the motors off. Nothing is done where they
    /// are off.
    ///
    /// # Errors
    /// [`RigError::Stopped`] where something goes wrong on the way; [`RigError::Servo`] for the first servo that did not
    /// confirm.
    pub fn release(&mut self) -> Result<(), RigError> {
        if self.file.spec.safety.release == Release::Home {
            self.go_home()?;
        }
        if !self.is_engaged() {
            return Ok(());
        }
        match self.release_at_once().unknown.into_iter().next() {
            None => Ok(()),
            Some((_, error)) => Err(error.into()),
        }
    }

    /// Goes home from wherever the robot is, all servos in proportion, at the speed of a motion. Nothing is done where the motors
    /// are off.
    ///
    /// # Errors
    /// As [`step`](Self::step).
    pub fn go_home(&mut self) -> Result<(), RigError> {
        let Drive::Engaged(engaged) = &self.drive else {
            return Ok(());
        };
        let motion = &self.file.spec.motion;
        let from: Vec<f64> = engaged.goals.iter().map(|goal| f64::from(goal.0)).collect();
        let winches = self.winches.iter().zip(&from);
        let steps = winches.map(|(winch, ticks)| {
            ticks.abs() * winch.spool.metres_per_tick() / (motion.slew * motion.period)
        });
        let steps = steps.fold(0.0, f64::max).ceil() as usize;
        for left in (0..steps).rev() {
            let part = left as f64 / steps as f64;
            let goals = from
                .iter()
                .map(|ticks| Ticks((part * ticks).round() as i32));
            self.step_to(&goals.collect::<Vec<_>>())?;
        }
        Ok(())
    }

    /// Switches all motors off at once, as far as servos can be reached, and says which confirmed.
    pub fn release_at_once(&mut self) -> Released {
        self.drive = Drive::Released;
        let mut released = Released::default();
        let mut left = self.ids.clone();
        for attempt in 1..=ATTEMPTS {
            let results = self.bus.set(Setting::Torque(&left, Torque::Off));
            let mut failed = Vec::new();
            for (&id, result) in left.iter().zip(results) {
                match result {
                    Ok(()) => released.off.push(id),
                    Err(error) if attempt == ATTEMPTS => released.unknown.push((id, error)),
                    Err(_) => failed.push(id),
                }
            }
            left = failed;
            if left.is_empty() {
                break;
            }
        }
        self.note_positions();
        // A servo whose motor is off needs no watchdog, and one that has bitten would hold the next goals.
        for error in self
            .bus
            .set(Setting::Watchdog(&released.off, None))
            .into_iter()
            .filter_map(Result::err)
        {
            tracing::debug!("{error}");
        }
        self.log_event(Level::Info, released.to_string());
        released
    }

    /// The hottest servo and its temperature (degrees Celsius). Also notes where the servos are: those whose motors are off
    /// may be turned by the tension that is left.
    ///
    /// # Errors
    /// [`RigError::Servo`] for the first that does not answer.
    pub fn hottest(&mut self) -> Result<(ServoId, f64), RigError> {
        if !self.is_engaged() {
            self.note_positions();
        }
        let temperatures = all(self.bus.temperatures(&self.ids))?;
        let servos = self.ids.iter().copied().zip(temperatures);
        let hottest = servos.max_by(|(_, a), (_, b)| a.total_cmp(b));
        hottest.ok_or(RigError::Released)
    }

    /// Notes where the servos are now, as far as that is known: without it, they are where they last were written down.
    pub(super) fn note_positions(&mut self) {
        let present = self.bus.present(&self.ids);
        let servos = self.ids.iter().zip(&self.homing).zip(present);
        let turns: Vec<Turns> = servos
            .filter_map(|((id, homing), present)| match (homing, present) {
                (Homing::Homed(home), Ok(present)) => Some(Turns {
                    id: id.get(),
                    home: home.0,
                    last: present.position.0,
                }),
                _ => None,
            })
            // What a servo says that restarted is in another count.
            .filter(|turns| {
                let known = ServoId::new(turns.id).and_then(|id| self.turns.of(id));
                known.is_some_and(|known| matches!(known.meet(Ticks(turns.last)), Homing::Homed(_)))
            })
            .collect();
        if let Err(error) = self.turns.write(&turns) {
            tracing::warn!("{error}");
        }
    }
}
