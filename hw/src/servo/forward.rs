//! Traits of a bus whose work another bus does: boxes, references, and what a decorator leaves as it is.

use super::{
    CurrentGoals, CurrentLimits, HardwareErrors, Health, Identity, Modes, OperatingMode, PerServo,
    Ping, PositionGoals, Present, PresentState, Registers, ServoError, ServoId, Ticks, Torque,
    TorqueSwitch, Watchdog, WatchdogState,
};

/// Implements traits by calling another bus.
///
/// `forward!([B, S] Ping, Modes for Logged<B, S>, |this| this.bus)` implements `Ping` where `B: Ping`, and `Modes` where
/// `B: Modes`.
macro_rules! forward {
    ([$($generics:tt)*] $first:ident $(, $more:ident)+ for $type:ty, |$this:ident| $bus:expr) => {
        forward!([$($generics)*] $first for $type, |$this| $bus);
        forward!([$($generics)*] $($more),+ for $type, |$this| $bus);
    };
    ([$($generics:tt)*] Ping for $type:ty, |$this:ident| $bus:expr) => {
        impl<$($generics)*> Ping for $type where B: Ping {
            forward!(@ $this, $bus,
                fn ping(id: ServoId) -> Result<Identity, ServoError>;
                fn scan() -> Result<Vec<(ServoId, Identity)>, ServoError>;
            );
        }
    };
    ([$($generics:tt)*] TorqueSwitch for $type:ty, |$this:ident| $bus:expr) => {
        impl<$($generics)*> TorqueSwitch for $type where B: TorqueSwitch {
            forward!(@ $this, $bus,
                fn set_torque(ids: &[ServoId], torque: Torque) -> PerServo<()>;
                fn torque(ids: &[ServoId]) -> PerServo<Torque>;
            );
        }
    };
    ([$($generics:tt)*] Modes for $type:ty, |$this:ident| $bus:expr) => {
        impl<$($generics)*> Modes for $type where B: Modes {
            forward!(@ $this, $bus,
                fn set_mode(ids: &[ServoId], mode: OperatingMode) -> PerServo<()>;
                fn mode(ids: &[ServoId]) -> PerServo<OperatingMode>;
            );
        }
    };
    ([$($generics:tt)*] PositionGoals for $type:ty, |$this:ident| $bus:expr) => {
        impl<$($generics)*> PositionGoals for $type where B: PositionGoals {
            forward!(@ $this, $bus,
                fn set_goal_positions(goals: &[(ServoId, Ticks)]) -> PerServo<()>;
                fn goal_positions(ids: &[ServoId]) -> PerServo<Ticks>;
            );
        }
    };
    ([$($generics:tt)*] CurrentGoals for $type:ty, |$this:ident| $bus:expr) => {
        impl<$($generics)*> CurrentGoals for $type where B: CurrentGoals {
            forward!(@ $this, $bus,
                fn set_goal_currents(goals: &[(ServoId, f64)]) -> PerServo<()>;
            );
        }
    };
    ([$($generics:tt)*] CurrentLimits for $type:ty, |$this:ident| $bus:expr) => {
        impl<$($generics)*> CurrentLimits for $type where B: CurrentLimits {
            forward!(@ $this, $bus,
                fn set_current_limits(limits: &[(ServoId, f64)]) -> PerServo<()>;
                fn current_limits(ids: &[ServoId]) -> PerServo<f64>;
            );
        }
    };
    ([$($generics:tt)*] PresentState for $type:ty, |$this:ident| $bus:expr) => {
        impl<$($generics)*> PresentState for $type where B: PresentState {
            forward!(@ $this, $bus, fn present(ids: &[ServoId]) -> PerServo<Present>;);
        }
    };
    ([$($generics:tt)*] Health for $type:ty, |$this:ident| $bus:expr) => {
        impl<$($generics)*> Health for $type where B: Health {
            forward!(@ $this, $bus,
                fn temperatures(ids: &[ServoId]) -> PerServo<f64>;
                fn voltages(ids: &[ServoId]) -> PerServo<f64>;
                fn hardware_errors(ids: &[ServoId]) -> PerServo<HardwareErrors>;
                fn registers(id: ServoId) -> Result<Vec<Registers>, ServoError>;
                fn reboot(id: ServoId) -> Result<(), ServoError>;
            );
        }
    };
    ([$($generics:tt)*] Watchdog for $type:ty, |$this:ident| $bus:expr) => {
        impl<$($generics)*> Watchdog for $type where B: Watchdog {
            forward!(@ $this, $bus,
                fn set_watchdog(ids: &[ServoId], timeout: Option<std::time::Duration>) -> PerServo<()>;
                fn watchdog(ids: &[ServoId]) -> PerServo<WatchdogState>;
            );
        }
    };
    (@ $this:ident, $bus:expr, $(fn $method:ident($($argument:ident: $of:ty),*) -> $result:ty;)*) => {$(
        fn $method(&mut self, $($argument: $of),*) -> $result {
            let $this = self;
            $bus.$method($($argument),*)
        }
    )*};
}
pub(super) use forward;

forward!([B: ?Sized] Ping, TorqueSwitch, Modes, PositionGoals, CurrentGoals, CurrentLimits, PresentState, Health, Watchdog for Box<B>,
    |this| **this);
forward!([B: ?Sized] Ping, TorqueSwitch, Modes, PositionGoals, CurrentGoals, CurrentLimits, PresentState, Health, Watchdog for &mut B,
    |this| **this);

/// Hands what there are verdicts for and no errors to `call`, in order, and puts its results beside the errors.
pub(crate) fn for_those<I, T>(
    verdicts: impl IntoIterator<Item = Result<I, ServoError>>,
    call: impl FnOnce(&[I]) -> PerServo<T>,
) -> PerServo<T> {
    let mut admitted = Vec::new();
    let refused: Vec<Option<ServoError>> = verdicts
        .into_iter()
        .map(|verdict| match verdict {
            Ok(servo) => {
                admitted.push(servo);
                None
            }
            Err(error) => Some(error),
        })
        .collect();
    let results = if admitted.is_empty() {
        Vec::new()
    } else {
        call(&admitted)
    };
    let mut results = results.into_iter();
    refused
        .into_iter()
        // A bus gives one result for each servo; were one missing, the list would end early.
        .map_while(|refused| match refused {
            None => results.next(),
            Some(error) => Some(Err(error)),
        })
        .collect()
}
