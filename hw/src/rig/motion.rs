//! Moving, watched: motors on, goals in steps, motors off.

use std::ops::ControlFlow;
use std::time::Duration;

use tdcr_sim::robot::Command;

use super::stop::{Cause, EmergencyStop, Released};
use super::turns::Turns;
use super::watch::{Vitals, Watch};
use super::winch::{Winch, WinchState};
use super::{Rig, RigError};
use crate::log::{Level, LogRecord};
use crate::servo::{
    Fault, Limits, OperatingMode, PerServo, ServoBus, ServoError, ServoId, Setting, Ticks, Torque,
    WatchdogState,
};

/// How far servos swing to either side (ticks): as far as takes a motor beyond what its gear's friction holds.
pub(super) const SWING: i32 = 30;

/// How often one asks how the servos fare.
const CHECK_UP: Duration = Duration::from_millis(500);

/// How many times farther than `motion.slew` allows a goal may lie from the one before: ways keep to it but for what they are not
/// straight, and for whole ticks.
const STEPS_AT_ONCE: f64 = 2.0;

/// Step of a current limit (A): that of the X330 series.
const CURRENT_STEP: f64 = 1e-3;

/// Whether the motors are driven.
#[derive(Debug)]
pub(super) enum Drive {
    Released,
    Engaged(Box<Engaged>),
}

/// What is known of the goals that were sent: to all servos at once, which nobody acknowledges.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum GoalState {
    /// They were sent so often.
    Sent(usize),
    /// The servos say that they hold them.
    Confirmed,
}

/// What is known while the motors are driven.
#[derive(Debug)]
pub(super) struct Engaged {
    /// Homes in the servos' own counts.
    pub(super) homes: Vec<Ticks>,
    /// Goals, from home.
    pub(super) goals: Vec<Ticks>,
    /// Whether the servos hold them.
    pub(super) goal_state: GoalState,
    /// How far each servo has wound its tendon, or let it out (negative), since it last turned back (ticks).
    pub(super) wound: Vec<i32>,
    watch: Watch,
    /// When the next goals are due.
    pub(super) next: Duration,
    /// When the next check-up is.
    check_up: Duration,
    /// The last state of each servo.
    pub(super) states: Vec<WinchState>,
    /// Whether a servo missed the last look.
    pub(super) missed: bool,
    /// When something was last said on the bus.
    pub(super) heard: Duration,
    /// How long nothing was, at the longest, since all servos were seen in order.
    pub(super) silence: Duration,
}

impl Rig {
    /// Whether the motors are driven.
    pub fn is_engaged(&self) -> bool {
        matches!(self.drive, Drive::Engaged(_))
    }

    /// Switches the motors on where they stand: sets modes, current limits and watchdogs, and takes the present positions
    /// for goals first. Nothing is done where they are on.
    ///
    /// # Errors
    /// [`RigError::NotHomed`]; [`RigError::Stopped`] where a servo reports a fault or is too hot; [`RigError::Servo`]. The motors are off
    /// then.
    pub fn engage(&mut self) -> Result<(), RigError> {
        if self.is_engaged() {
            return Ok(());
        }
        self.meet()?;
        let homes = self.homes()?;
        self.limit(&homes);
        self.log_registers();
        match self.switch_on(&homes) {
            Ok(states) => {
                let now = self.clock.now();
                self.drive = Drive::Engaged(Box::new(Engaged {
                    homes,
                    goals: states.iter().map(|state| state.position).collect(),
                    goal_state: GoalState::Sent(1),
                    wound: vec![0; self.ids.len()],
                    watch: Watch::new(self.ids.len()),
                    next: now,
                    check_up: now,
                    states,
                    missed: false,
                    heard: now,
                    silence: Duration::ZERO,
                }));
                self.log_event(Level::Info, "the motors are on");
                self.poll().map(drop)
            }
            Err(error) => {
                let released = self.release_at_once();
                if !released.is_complete() {
                    tracing::warn!("{released}");
                }
                Err(error)
            }
        }
    }

    /// Lets the servos be told what the rig's file allows, their homes where they are, and to swing about it.
    fn limit(&self, homes: &[Ticks]) {
        let servos = self.winches.iter().zip(homes);
        self.limits.set(servos.map(|(winch, home)| {
            let [low, high] = winch.limits;
            let limits = Limits {
                min: Ticks(home.0.saturating_add(low).saturating_sub(SWING)),
                max: Ticks(home.0.saturating_add(high).saturating_add(SWING)),
                step: self.most_step(winch),
                current: winch.current_limit,
            };
            (winch.id, limits)
        }));
    }

    /// Farthest (ticks) that a goal of a servo may lie from the one before; a swing, from side to side, is always allowed.
    pub(super) fn most_step(&self, winch: &Winch) -> u32 {
        let motion = &self.file.spec.motion;
        let of_slew = motion.slew * motion.period / winch.spool.metres_per_tick();
        ((STEPS_AT_ONCE * of_slew).ceil() as u32).max(2 * SWING.unsigned_abs())
    }

    /// Refuses goals that are farther from the ones before than a step.
    fn must_be_near(&self, goals: &[Ticks]) -> Result<(), RigError> {
        let Drive::Engaged(engaged) = &self.drive else {
            return Err(RigError::Released);
        };
        let servos = self.winches.iter().zip(goals).zip(&engaged.goals);
        for ((winch, goal), before) in servos {
            let (way, most) = (goal.0.abs_diff(before.0), self.most_step(winch));
            if way > most {
                return Err(RigError::TooFar {
                    id: winch.id,
                    way,
                    most,
                    slew: self.file.spec.motion.slew,
                });
            }
        }
        Ok(())
    }

    fn switch_on(&mut self, homes: &[Ticks]) -> Result<Vec<WinchState>, RigError> {
        let ids = &self.ids;
        let safety = &self.file.spec.safety;
        let vitals = vitals(&mut *self.bus, ids);
        // Motors that are off are no fault yet.
        let on = vitals.into_iter().map(|vitals| Vitals {
            torque: Ok(Torque::On),
            ..vitals
        });
        let silence = [Duration::ZERO, safety.watchdog()];
        Watch::check(ids, on.collect(), safety, silence).map_err(|cause| {
            let release = Released::default();
            EmergencyStop { cause, release }
        })?;
        let mode = self.file.spec.servos.mode.into();
        let modes = all(self.bus.mode(ids))?;
        if modes.iter().any(|&found| found != mode) {
            all(self.bus.set(Setting::Torque(ids, Torque::Off)))?;
            all(self.bus.set(Setting::Mode(ids, mode)))?;
        }
        // A watchdog that has bitten holds its goals until it is set anew.
        all(self.bus.set(Setting::Watchdog(ids, None)))?;
        let winches = self.winches.iter();
        let limits: Vec<_> = winches
            .map(|winch| (winch.id, winch.current_limit))
            .collect();
        let kept = all(self.bus.current_limits(ids))?;
        let differs =
            |((_, wanted), kept): (&(ServoId, f64), f64)| (wanted - kept).abs() > CURRENT_STEP;
        if limits.iter().zip(kept).any(differs) {
            all(self.bus.set(Setting::Torque(ids, Torque::Off)))?;
            all(self.bus.set(Setting::CurrentLimits(&limits)))?;
        }
        if mode == OperatingMode::CurrentBasedPosition {
            all(self.bus.set(Setting::GoalCurrents(&limits)))?;
        }
        let present = all(self.bus.present(ids))?;
        let hold = ids
            .iter()
            .zip(&present)
            .map(|(&id, present)| (id, present.position));
        let hold: Vec<_> = hold.collect();
        all(self.bus.set(Setting::GoalPositions(&hold)))?;
        arm(&mut *self.bus, ids, safety.watchdog())?;
        all(self.bus.set(Setting::Torque(ids, Torque::On)))?;
        // Some forget the goal when they are switched on.
        all(self.bus.set(Setting::GoalPositions(&hold)))?;
        let servos = self.winches.iter().zip(homes).zip(present);
        Ok(servos
            .map(|((winch, &home), present)| winch.state(home, present))
            .collect())
    }

    /// Sends a command's goals, waits until the next are due, and looks at what the servos do: their states, those of servos
    /// that missed this read as they last were.
    ///
    /// # Errors
    /// [`RigError::Limit`], [`RigError::TooFar`] and [`RigError::Command`] before anything is sent; [`RigError::Released`];
    /// [`RigError::Stopped`] after the tension was released.
    pub fn step(&mut self, command: &Command) -> Result<&[WinchState], RigError> {
        let goals = self.goals(command)?;
        self.must_be_near(&goals)?;
        self.log(|| LogRecord::Command(command.as_slice().to_vec()));
        self.step_to(&goals)
    }

    /// The goals of a command, from home.
    ///
    /// # Errors
    /// [`RigError::Command`], [`RigError::Limit`].
    pub fn goals(&self, command: &Command) -> Result<Vec<Ticks>, RigError> {
        let command = self.robot.command(command.as_slice())?;
        let winches = self.winches.iter().zip(command.as_slice());
        winches
            .map(|(winch, &command)| winch.goal(command))
            .collect()
    }

    /// The same for goals from home, which are within their limits.
    pub(super) fn step_to(&mut self, goals: &[Ticks]) -> Result<&[WinchState], RigError> {
        let Drive::Engaged(engaged) = &mut self.drive else {
            return Err(RigError::Released);
        };
        let servos = self.winches.iter().zip(goals).zip(&engaged.goals);
        for (wound, ((winch, to), from)) in engaged.wound.iter_mut().zip(servos) {
            let winds = i32::from(winch.spool.direction) * to.0.saturating_sub(from.0);
            *wound = match winds.signum() == -wound.signum() {
                true => winds,
                false => wound.saturating_add(winds),
            };
        }
        engaged.goals.copy_from_slice(goals);
        engaged.goal_state = GoalState::Confirmed;
        self.send_goals()?;
        // What one servo misses of goals in motion is made up for by the next ones.
        self.wait_until_due()?;
        self.watch()
    }

    /// Waits until goals are due, makes sure that the last ones are held, and looks at what the servos do. Whoever waits for
    /// longer than the servos' watchdog allows calls this meanwhile; who computes, [`hold_while`](Self::hold_while).
    ///
    /// # Errors
    /// As [`step`](Self::step).
    pub fn poll(&mut self) -> Result<&[WinchState], RigError> {
        self.wait_until_due()?;
        self.make_sure_of_goals()?;
        self.watch()
    }

    fn wait_until_due(&mut self) -> Result<(), RigError> {
        let Drive::Engaged(engaged) = &mut self.drive else {
            return Err(RigError::Released);
        };
        let period = self.file.spec.motion.period();
        self.clock.wait_until(engaged.next);
        engaged.next = (engaged.next + period).max(self.clock.now());
        Ok(())
    }

    /// Looks at what the servos do, and stops where something is wrong.
    fn watch(&mut self) -> Result<&[WinchState], RigError> {
        match self.look() {
            Ok(()) => {}
            Err(Looked::Wrong(cause)) => return Err(self.stop(cause)),
            Err(Looked::Unwritten(error)) => {
                self.release_at_once();
                return Err(error);
            }
        }
        match &self.drive {
            Drive::Engaged(engaged) => Ok(&engaged.states),
            Drive::Released => Err(RigError::Released),
        }
    }

    /// Releases the tension because of `cause`.
    pub(super) fn stop(&mut self, cause: Cause) -> RigError {
        let release = self.release_at_once();
        let stop = EmergencyStop { cause, release };
        self.log_event(Level::Error, stop.to_string());
        stop.into()
    }

    /// Reads all servos and judges what they say.
    fn look(&mut self) -> Result<(), Looked> {
        let Drive::Engaged(engaged) = &mut self.drive else {
            return Ok(());
        };
        let safety = &self.file.spec.safety;
        let now = self.clock.now();
        let present = self.bus.present(&self.ids);
        engaged.talked(now, self.clock.now());
        let silence = [engaged.silence, safety.watchdog()];
        let servos = self.winches.iter().zip(&engaged.homes).zip(present);
        let states = servos.map(|((winch, &home), present)| {
            let (present, id) = (present?, winch.id);
            let errors = present.errors;
            match present.watchdog {
                _ if !errors.is_empty() => Err(ServoError::Hardware { id, errors }),
                WatchdogState::Tripped => Err(ServoError::WatchdogTripped { id }),
                _ => Ok(winch.state(home, present)),
            }
        });
        let (goals, winches) = (&engaged.goals, &self.winches);
        let states = states.collect();
        let read = (engaged.watch).take(now, winches, goals, states, safety, silence)?;
        engaged.missed = read.iter().any(Option::is_none);
        if !engaged.missed {
            engaged.silence = Duration::ZERO;
        }
        for (state, read) in engaged.states.iter_mut().zip(read) {
            *state = read.unwrap_or(*state);
        }
        if now >= engaged.check_up {
            engaged.check_up = now + CHECK_UP;
            let vitals = vitals(&mut *self.bus, &self.ids);
            engaged.heard = self.clock.now();
            Watch::check(&self.ids, vitals, safety, silence)?;
        }
        let servos = self.ids.iter().zip(&engaged.homes).zip(&engaged.states);
        let turns: Vec<Turns> = servos
            .map(|((id, home), state)| Turns {
                id: id.get(),
                home: home.0,
                last: home.0.saturating_add(state.position.0),
            })
            .collect();
        self.turns.follow(&turns).map_err(Looked::Unwritten)
    }

    /// Moves along commands, each a step. `go_on` is asked before each whether to.
    ///
    /// # Errors
    /// As [`step`](Self::step); [`RigError::Interrupted`] after the tension was released.
    pub fn move_along<'a>(
        &mut self,
        commands: impl IntoIterator<Item = &'a Command>,
        go_on: &mut dyn FnMut() -> ControlFlow<()>,
    ) -> Result<(), RigError> {
        for command in commands {
            if go_on().is_break() {
                self.release()?;
                return Err(RigError::Interrupted);
            }
            self.step(command)?;
        }
        Ok(())
    }

    /// Where the servos are told to be, as a command (m); `None` where the motors are off.
    pub fn commanded(&self) -> Option<Vec<f64>> {
        let Drive::Engaged(engaged) = &self.drive else {
            return None;
        };
        let winches = self.winches.iter().zip(&engaged.goals);
        Some(
            winches
                .map(|(winch, &goal)| winch.spool.command(goal))
                .collect(),
        )
    }

    /// The goals that the servos were told last, from home; `None` where the motors are off.
    pub fn held_goals(&self) -> Option<&[Ticks]> {
        match &self.drive {
            Drive::Engaged(engaged) => Some(&engaged.goals),
            Drive::Released => None,
        }
    }

    /// Where the servos were at the last look; `None` where the motors are off.
    pub fn last_states(&self) -> Option<&[WinchState]> {
        match &self.drive {
            Drive::Engaged(engaged) => Some(&engaged.states),
            Drive::Released => None,
        }
    }
}

/// What a look may end with.
enum Looked {
    Wrong(Cause),
    Unwritten(RigError),
}

impl From<Cause> for Looked {
    fn from(cause: Cause) -> Self {
        Self::Wrong(cause)
    }
}

impl From<EmergencyStop> for RigError {
    fn from(stop: EmergencyStop) -> Self {
        Self::Stopped(Box::new(stop))
    }
}

/// The values of all servos, or the first error.
pub(super) fn all<T>(values: PerServo<T>) -> Result<Vec<T>, ServoError> {
    values.into_iter().collect()
}

/// Arms the watchdogs of servos, and makes sure that they are.
fn arm(bus: &mut dyn ServoBus, ids: &[ServoId], watchdog: Duration) -> Result<(), ServoError> {
    all(bus.set(Setting::Watchdog(ids, Some(watchdog))))?;
    let found = all(bus.watchdog(ids))?;
    let armed = |state: WatchdogState| matches!(state, WatchdogState::Armed(_));
    match ids.iter().zip(found).find(|(_, state)| !armed(*state)) {
        None => Ok(()),
        Some((&id, _)) => Err(ServoError::Refused {
            id,
            action: "arm its watchdog".to_owned(),
            fault: Fault::Result,
        }),
    }
}

fn vitals(bus: &mut dyn ServoBus, ids: &[ServoId]) -> Vec<Vitals> {
    let temperatures = bus.temperatures(ids);
    let errors = bus.hardware_errors(ids);
    let torques = bus.torque(ids);
    let servos = temperatures.into_iter().zip(errors).zip(torques);
    servos
        .map(|((temperature, errors), torque)| Vitals {
            temperature,
            errors,
            torque,
        })
        .collect()
}
