//! Positions that count turns: servos forget theirs when their power goes.

use std::collections::BTreeMap;

use super::forward::{for_those, forward};
use super::{
    CurrentGoals, Fault, Identity, Modes, OperatingMode, PerServo, Ping, PositionGoals, Present,
    PresentState, Reboot, ServoError, ServoId, Ticks, Torque, TorqueSwitch, Watchdog,
};

/// A bus whose positions are those of a rig, counted over all turns, and which refuses to move a servo before somebody has said
/// where it is.
///
/// At power-on a servo knows its angle, not its turns. [`home`](Self::home) or [`restore`](Self::restore) give it a position;
/// until then, and again once it has restarted, its positions are [`ServoError::NotHomed`] and its torque stays off. Torque goes
/// on with the goal where the servo is, so that nothing jumps.
#[derive(Clone, Debug)]
pub struct Homed<B> {
    bus: B,
    /// What is added to a servo's own positions (ticks).
    offsets: BTreeMap<ServoId, i32>,
}

impl<B> Homed<B> {
    /// A bus none of whose servos is homed.
    pub fn new(bus: B) -> Self {
        Self {
            bus,
            offsets: BTreeMap::new(),
        }
    }

    /// The bus with the servos' own positions.
    pub fn bus_mut(&mut self) -> &mut B {
        &mut self.bus
    }

    /// Whether a servo has a position.
    pub fn is_homed(&self, id: ServoId) -> bool {
        self.offsets.contains_key(&id)
    }

    /// Says that a servo's position is not known any more.
    pub fn forget(&mut self, id: ServoId) {
        self.offsets.remove(&id);
    }

    fn offset(&self, id: ServoId) -> Result<i32, ServoError> {
        let offset = self.offsets.get(&id).copied();
        offset.ok_or(ServoError::NotHomed { id })
    }

    /// The servo's own position for one of the rig.
    fn own(
        &self,
        &(id, Ticks(position)): &(ServoId, Ticks),
    ) -> Result<(ServoId, Ticks), ServoError> {
        let offset = self.offset(id)?;
        let own = position.checked_sub(offset);
        own.map(|own| (id, Ticks(own)))
            .ok_or(ServoError::OutOfRange {
                id,
                quantity: "goal in ticks",
                value: position.into(),
                min: f64::from(i32::MIN) + f64::from(offset.max(0)),
                max: f64::from(i32::MAX) + f64::from(offset.min(0)),
            })
    }
}

impl<B: PresentState> Homed<B> {
    /// Says that a servo is at `position` now.
    ///
    /// # Errors
    /// [`ServoError`] where it does not say its own position.
    pub fn home(&mut self, id: ServoId, position: Ticks) -> Result<(), ServoError> {
        self.offsets.remove(&id);
        let own = present_of(&mut self.bus, id)?.position;
        self.offsets.insert(id, position.0.wrapping_sub(own.0));
        Ok(())
    }

    /// Gives a servo the turns that bring it nearest to `stored`, its position when it was last seen, and returns where that is.
    /// Right where the horn has turned by less than half a turn since.
    ///
    /// # Errors
    /// [`ServoError`] where it does not say its own position.
    pub fn restore(&mut self, id: ServoId, stored: Ticks) -> Result<Ticks, ServoError> {
        self.offsets.remove(&id);
        let own = present_of(&mut self.bus, id)?.position;
        let way = i64::from(stored.0) - i64::from(own.0);
        let turn = i64::from(Ticks::PER_TURN);
        let turns = (way + turn / 2).div_euclid(turn);
        let offset = i32::try_from(turns * turn).unwrap_or(0);
        self.offsets.insert(id, offset);
        Ok(Ticks(own.0.wrapping_add(offset)))
    }
}

/// The state of one servo.
fn present_of(bus: &mut impl PresentState, id: ServoId) -> Result<Present, ServoError> {
    bus.present(&[id])
        .pop()
        .unwrap_or(Err(ServoError::Unknown { id }))
}

forward!([B] Ping, CurrentGoals, Watchdog for Homed<B>, |this| this.bus);

impl<B: TorqueSwitch + PositionGoals + PresentState> TorqueSwitch for Homed<B> {
    fn set_torque(&mut self, ids: &[ServoId], torque: Torque) -> PerServo<()> {
        if torque == Torque::Off {
            return self.bus.set_torque(ids, torque);
        }
        let present = self.present(ids);
        let goals: Vec<_> = ids
            .iter()
            .zip(&present)
            .filter_map(|(&id, present)| Some((id, present.as_ref().ok()?.position)))
            .collect();
        let mut present = present.into_iter();
        let mut sent = self.set_goal_positions(&goals).into_iter();
        let goal_ids: Vec<_> = goals.iter().map(|&(id, _)| id).collect();
        let mut held = self.goal_positions(&goal_ids).into_iter();
        let mut goals = goals.iter();
        for_those(
            ids,
            |&id| {
                let missing = ServoError::Unknown { id };
                present.next().unwrap_or(Err(missing))?;
                // Of these there is one for each servo whose state is known.
                let (sent, held, goal) = (sent.next(), held.next(), goals.next());
                sent.unwrap_or(Err(ServoError::Unknown { id }))?;
                let held = held.unwrap_or(Err(ServoError::Unknown { id }))?;
                if goal == Some(&(id, held)) {
                    return Ok(id);
                }
                Err(ServoError::Refused {
                    id,
                    action: "take its present position as its goal".to_owned(),
                    fault: Fault::Result,
                })
            },
            |ids| self.bus.set_torque(ids, torque),
        )
    }

    fn torque(&mut self, ids: &[ServoId]) -> PerServo<Torque> {
        self.bus.torque(ids)
    }
}

impl<B: Modes> Modes for Homed<B> {
    fn set_mode(&mut self, ids: &[ServoId], mode: OperatingMode) -> PerServo<()> {
        // A servo whose positions are within one turn forgets its turns.
        if mode == OperatingMode::Position {
            self.offsets.retain(|id, _| !ids.contains(id));
        }
        self.bus.set_mode(ids, mode)
    }

    fn mode(&mut self, ids: &[ServoId]) -> PerServo<OperatingMode> {
        self.bus.mode(ids)
    }
}

impl<B: PositionGoals> PositionGoals for Homed<B> {
    fn set_goal_positions(&mut self, goals: &[(ServoId, Ticks)]) -> PerServo<()> {
        let own: Vec<_> = goals.iter().map(|goal| self.own(goal)).collect();
        let mut own = own.into_iter();
        for_those(
            goals,
            |&(id, _)| own.next().unwrap_or(Err(ServoError::Unknown { id })),
            |goals| self.bus.set_goal_positions(goals),
        )
    }

    fn goal_positions(&mut self, ids: &[ServoId]) -> PerServo<Ticks> {
        let goals = self.bus.goal_positions(ids);
        let goals = ids.iter().zip(goals);
        goals
            .map(|(&id, goal)| Ok(Ticks(goal?.0.wrapping_add(self.offset(id)?))))
            .collect()
    }
}

impl<B: PresentState> PresentState for Homed<B> {
    fn present(&mut self, ids: &[ServoId]) -> PerServo<Present> {
        let present = self.bus.present(ids);
        let present = ids.iter().zip(present);
        present
            .map(|(&id, present)| {
                if matches!(present, Err(ServoError::Restarted { .. })) {
                    self.forget(id);
                }
                let present = present?;
                let position = Ticks(present.position.0.wrapping_add(self.offset(id)?));
                Ok(Present {
                    position,
                    ..present
                })
            })
            .collect()
    }
}

impl<B: Reboot> Reboot for Homed<B> {
    fn reboot(&mut self, id: ServoId) -> Result<(), ServoError> {
        self.forget(id);
        self.bus.reboot(id)
    }
}
