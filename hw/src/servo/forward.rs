//! What a bus before another one leaves as it is, and what it leaves for some servos alone.

use super::{
    HardwareErrors, Identity, OperatingMode, PerServo, Present, Registers, ServoBus, ServoError,
    ServoId, Setting, Ticks, Torque, WatchdogState,
};

/// Within an `impl ServoBus`: the named methods are those of the bus `$bus`. `reads` are all
/// but `set`, `present` and `reboot`.
macro_rules! forward {
    (reads, |$this:ident| $bus:expr) => {
        forward!(|$this| $bus,
            fn torque(ids: &[ServoId]) -> PerServo<Torque>;
            fn mode(ids: &[ServoId]) -> PerServo<OperatingMode>;
            fn goal_positions(ids: &[ServoId]) -> PerServo<Ticks>;
            fn current_limits(ids: &[ServoId]) -> PerServo<f64>;
            fn watchdog(ids: &[ServoId]) -> PerServo<WatchdogState>;
            fn temperatures(ids: &[ServoId]) -> PerServo<f64>;
            fn voltages(ids: &[ServoId]) -> PerServo<f64>;
            fn hardware_errors(ids: &[ServoId]) -> PerServo<HardwareErrors>;
            fn registers(id: ServoId) -> Result<Vec<Registers>, ServoError>;
            fn ping(id: ServoId) -> Result<Identity, ServoError>;
            fn scan() -> Result<Vec<(ServoId, Identity)>, ServoError>;
        );
    };
    (|$this:ident| $bus:expr, $(fn $method:ident($($argument:ident: $of:ty),*) -> $result:ty;)*) => {$(
        fn $method(&mut self, $($argument: $of),*) -> $result {
            let $this = self;
            $bus.$method($($argument),*)
        }
    )*};
}
pub(super) use forward;

impl<B: ServoBus + ?Sized> ServoBus for Box<B> {
    forward! { reads, |this| (**this) }
    forward! {
        |this| (**this),
        fn set(setting: Setting<'_>) -> PerServo<()>;
        fn present(ids: &[ServoId]) -> PerServo<Present>;
        fn reboot(id: ServoId) -> Result<(), ServoError>;
    }
}

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
