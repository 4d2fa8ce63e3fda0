//! What the items are called.

macro_rules! items {
    ($($(#[$doc:meta])* $item:ident = $name:literal,)*) => {
        /// An item of the control table.
        #[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
        pub enum Item {
            $($(#[$doc])* $item,)*
        }

        impl Item {
            /// All items, by address.
            pub const ALL: [Self; [$($name),*].len()] = [$(Self::$item),*];

            /// The manufacturer's name.
            pub const fn name(self) -> &'static str {
                match self {
                    $(Self::$item => $name,)*
                }
            }
        }
    };
}

items! {
    /// Model number: see [`Model::number`](super::Model::number).
    ModelNumber = "Model Number",
    /// Set by the manufacturer.
    ModelInformation = "Model Information",
    /// Version of the firmware.
    FirmwareVersion = "Firmware Version",
    /// Address on the bus.
    Id = "ID",
    /// Index into [`BAUD_RATES`](super::BAUD_RATES).
    BaudRate = "Baud Rate",
    /// Time from an instruction to its status.
    ReturnDelayTime = "Return Delay Time",
    /// Bit 0: reversed; bit 2: profiles by time; bit 3: goals switch torque on.
    DriveMode = "Drive Mode",
    /// What goals mean.
    OperatingMode = "Operating Mode",
    /// Second address, for groups; none from 253 on.
    SecondaryId = "Secondary(Shadow) ID",
    /// 2 for Protocol 2.0.
    ProtocolType = "Protocol Type",
    /// Added to the position.
    HomingOffset = "Homing Offset",
    /// Speed from which on "Moving" is 1.
    MovingThreshold = "Moving Threshold",
    /// Overheating begins here.
    TemperatureLimit = "Temperature Limit",
    /// Largest supply voltage.
    MaxVoltageLimit = "Max Voltage Limit",
    /// Smallest supply voltage.
    MinVoltageLimit = "Min Voltage Limit",
    /// Largest duty cycle.
    PwmLimit = "PWM Limit",
    /// Largest current.
    CurrentLimit = "Current Limit",
    /// Largest speed of goals.
    VelocityLimit = "Velocity Limit",
    /// Largest goal within one turn.
    MaxPositionLimit = "Max Position Limit",
    /// Smallest goal within one turn.
    MinPositionLimit = "Min Position Limit",
    /// Bit 0: torque on at power-on; bit 1: RAM from the backup. For firmware 46 and newer.
    StartupConfiguration = "Startup Configuration",
    /// How fast the duty cycle changes.
    PwmSlope = "PWM Slope",
    /// Hardware errors that switch torque off, bit by bit as in "Hardware Error Status".
    Shutdown = "Shutdown",
    /// Whether the motor is driven. Locks the EEPROM.
    TorqueEnable = "Torque Enable",
    /// Lamp.
    Led = "LED",
    /// 0: only pings are answered; 1: also reads; 2: everything.
    StatusReturnLevel = "Status Return Level",
    /// Whether a write waits for "action".
    RegisteredInstruction = "Registered Instruction",
    /// Faults, bit by bit: see [`HardwareErrors`](crate::servo::HardwareErrors).
    HardwareErrorStatus = "Hardware Error Status",
    /// Gain of the velocity controller.
    VelocityIGain = "Velocity I Gain",
    /// Gain of the velocity controller.
    VelocityPGain = "Velocity P Gain",
    /// Gain of the position controller.
    PositionDGain = "Position D Gain",
    /// Gain of the position controller.
    PositionIGain = "Position I Gain",
    /// Gain of the position controller.
    PositionPGain = "Position P Gain",
    /// Gain of the acceleration of the profile.
    FeedforwardSecondGain = "Feedforward 2nd Gain",
    /// Gain of the velocity of the profile.
    FeedforwardFirstGain = "Feedforward 1st Gain",
    /// Silence after which the servo stops; 0: none; -1: it has stopped, and refuses goals until 0 is written.
    BusWatchdog = "Bus Watchdog",
    /// Goal, or bound, of the duty cycle.
    GoalPwm = "Goal PWM",
    /// Goal, or bound, of the current.
    GoalCurrent = "Goal Current",
    /// Goal of the velocity.
    GoalVelocity = "Goal Velocity",
    /// Acceleration of the profile (time, in ms, in profiles by time).
    ProfileAcceleration = "Profile Acceleration",
    /// Velocity of the profile (time, in ms, in profiles by time).
    ProfileVelocity = "Profile Velocity",
    /// Goal of the position; the range is that of one turn.
    GoalPosition = "Goal Position",
    /// Clock of the servo, which starts again at 32,768.
    RealtimeTick = "Realtime Tick",
    /// Whether it moves.
    Moving = "Moving",
    /// Bit 0: arrived; bit 1: a profile runs; bit 3: does not follow; bits 4 and 5: kind of profile.
    MovingStatus = "Moving Status",
    /// Duty cycle.
    PresentPwm = "Present PWM",
    /// Current.
    PresentCurrent = "Present Current",
    /// Velocity.
    PresentVelocity = "Present Velocity",
    /// Position.
    PresentPosition = "Present Position",
    /// Velocity that the profile asks for.
    VelocityTrajectory = "Velocity Trajectory",
    /// Position that the profile asks for.
    PositionTrajectory = "Position Trajectory",
    /// Supply voltage.
    PresentInputVoltage = "Present Input Voltage",
    /// Temperature inside.
    PresentTemperature = "Present Temperature",
    /// Whether a backup of the control table exists. For firmware 46 and newer.
    BackupReady = "Backup Ready",
    /// Addresses that "Indirect Data" stand for, one byte each. The first values count up.
    IndirectAddress = "Indirect Address",
    /// Bytes at those addresses, one behind the other.
    IndirectData = "Indirect Data",
}

impl Item {
    /// The item that the manufacturer calls so.
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|item| item.name() == name)
    }
}
