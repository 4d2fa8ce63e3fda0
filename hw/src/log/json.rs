//! Messages for which Foxglove has no schema: JSON, with schemas of our own.

use std::time::Duration;

use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};

use super::record::{ServoHome, ServoStatus};
use crate::servo::{
    HardwareErrors, Identity, OperatingMode, Registers, ServoId, Ticks, Torque, WatchdogState,
};

/// A message of ours.
pub(super) trait Json: Serialize + DeserializeOwned {
    /// Name of its schema.
    const NAME: &str;
    /// Its schema, as JSON Schema.
    const SCHEMA: &str;
}

/// A robot's URDF, in the shape of the message that robots of ROS describe themselves by: viewers know it.
#[derive(Serialize, Deserialize)]
pub(super) struct Text {
    pub data: String,
}

impl Json for Text {
    const NAME: &str = "std_msgs/String";
    const SCHEMA: &str =
        r#"{"type": "object", "properties": {"data": {"type": "string"}}, "required": ["data"]}"#;
}

/// What was asked of the tendons.
#[derive(Serialize, Deserialize)]
pub(super) struct Command {
    pub values: Vec<f64>,
}

impl Json for Command {
    const NAME: &str = "tdcr.Command";
    const SCHEMA: &str = r#"{
  "type": "object",
  "properties": {
    "values": {
      "type": "array",
      "description": "one value per tendon: a length (m), or a tension (N), as the robot's own file says",
      "items": {"type": "number"}
    }
  },
  "required": ["values"]
}"#;
}

/// Where the homes of servos are.
#[derive(Serialize, Deserialize)]
pub(super) struct HomesJson {
    pub servos: Vec<HomeJson>,
}

impl Json for HomesJson {
    const NAME: &str = "tdcr.Homes";
    const SCHEMA: &str = r#"{
  "type": "object",
  "properties": {
    "servos": {
      "type": "array",
      "items": {
        "type": "object",
        "properties": {
          "id": {"type": "integer", "description": "address of the servo"},
          "home": {"type": "integer", "description": "home in the servo's own count (ticks)"},
          "last": {"type": "integer", "description": "where it was last known to stand, in its own count (ticks)"}
        },
        "required": ["id", "home", "last"]
      }
    }
  },
  "required": ["servos"]
}"#;
}

/// Where the home of a servo is.
#[derive(Serialize, Deserialize)]
pub(super) struct HomeJson {
    id: u8,
    home: i32,
    last: i32,
}

impl HomeJson {
    pub(super) fn new(home: &ServoHome) -> Self {
        Self {
            id: home.id.get(),
            home: home.home.0,
            last: home.last.0,
        }
    }

    /// `None` for an address that no servo has.
    pub(super) fn home(self) -> Option<ServoHome> {
        Some(ServoHome {
            id: ServoId::new(self.id)?,
            home: Ticks(self.home),
            last: Ticks(self.last),
        })
    }
}

/// Bytes of a control table.
#[derive(Serialize, Deserialize)]
pub(super) struct RegistersJson {
    id: u8,
    address: u16,
    bytes: Vec<u8>,
}

impl Json for RegistersJson {
    const NAME: &str = "tdcr.Registers";
    const SCHEMA: &str = r#"{
  "type": "object",
  "properties": {
    "id": {"type": "integer", "description": "address of the servo"},
    "address": {"type": "integer", "description": "address of the first byte in the servo's control table"},
    "bytes": {"type": "array", "items": {"type": "integer"}}
  },
  "required": ["id", "address", "bytes"]
}"#;
}

impl RegistersJson {
    pub(super) fn new(registers: &Registers) -> Self {
        Self {
            id: registers.id.get(),
            address: registers.address,
            bytes: registers.bytes.clone(),
        }
    }

    /// `None` for an address that no servo has.
    pub(super) fn registers(self) -> Option<Registers> {
        Some(Registers {
            id: ServoId::new(self.id)?,
            address: self.address,
            bytes: self.bytes,
        })
    }
}

/// What is known of servos.
#[derive(Serialize, Deserialize)]
pub(super) struct StatusesJson {
    pub servos: Vec<StatusJson>,
}

impl Json for StatusesJson {
    const NAME: &str = "tdcr.ServoStatus";
    const SCHEMA: &str = r#"{
  "type": "object",
  "properties": {
    "servos": {
      "type": "array",
      "description": "what was asked of each servo; other fields are absent",
      "items": {
        "type": "object",
        "properties": {
          "id": {"type": "integer", "description": "address of the servo"},
          "model": {"type": "integer", "description": "model number"},
          "firmware": {"type": "integer"},
          "torque": {"type": "string", "enum": ["off", "on"]},
          "mode": {
            "type": "string",
            "enum": ["current", "velocity", "position", "extended_position", "current_based_position", "pwm"]
          },
          "current_limit": {"type": "number", "description": "A"},
          "watchdog": {"type": "string", "enum": ["off", "armed", "tripped"]},
          "watchdog_timeout": {"type": "number", "description": "s, where it is armed"},
          "temperature": {"type": "number", "description": "degrees Celsius"},
          "voltage": {"type": "number", "description": "V"},
          "hardware_errors": {
            "type": "object",
            "properties": {
              "input_voltage": {"type": "boolean"},
              "overheating": {"type": "boolean"},
              "encoder": {"type": "boolean"},
              "electrical_shock": {"type": "boolean"},
              "overload": {"type": "boolean"}
            }
          }
        },
        "required": ["id"]
      }
    }
  },
  "required": ["servos"]
}"#;
}

/// What is known of a servo.
#[derive(Serialize, Deserialize)]
pub(super) struct StatusJson {
    id: u8,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    model: Option<u16>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    firmware: Option<u8>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    torque: Option<TorqueJson>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    mode: Option<ModeJson>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    current_limit: Option<f64>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    watchdog: Option<WatchdogJson>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    watchdog_timeout: Option<f64>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    temperature: Option<f64>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    voltage: Option<f64>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    hardware_errors: Option<ErrorsJson>,
}

impl StatusJson {
    pub(super) fn new(status: &ServoStatus) -> Self {
        Self {
            id: status.id.get(),
            model: status.identity.map(|identity| identity.model),
            firmware: status.identity.map(|identity| identity.firmware),
            torque: status.torque.map(TorqueJson::new),
            mode: status.mode.map(ModeJson::new),
            current_limit: status.current_limit,
            watchdog: status.watchdog.map(WatchdogJson::new),
            watchdog_timeout: match status.watchdog {
                Some(WatchdogState::Armed(timeout)) => Some(timeout.as_secs_f64()),
                _ => None,
            },
            temperature: status.temperature,
            voltage: status.voltage,
            hardware_errors: status.hardware_errors.map(ErrorsJson::new),
        }
    }

    /// `None` for an address that no servo has.
    pub(super) fn status(self) -> Option<ServoStatus> {
        let identity = self.model.zip(self.firmware);
        Some(ServoStatus {
            id: ServoId::new(self.id)?,
            identity: identity.map(|(model, firmware)| Identity { model, firmware }),
            torque: self.torque.map(TorqueJson::torque),
            mode: self.mode.map(ModeJson::mode),
            current_limit: self.current_limit,
            watchdog: (self.watchdog).and_then(|state| state.state(self.watchdog_timeout)),
            temperature: self.temperature,
            voltage: self.voltage,
            hardware_errors: self.hardware_errors.map(ErrorsJson::errors),
        })
    }
}

#[derive(Clone, Copy, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
enum TorqueJson {
    Off,
    On,
}

impl TorqueJson {
    fn new(torque: Torque) -> Self {
        match torque {
            Torque::Off => Self::Off,
            Torque::On => Self::On,
        }
    }

    fn torque(self) -> Torque {
        match self {
            Self::Off => Torque::Off,
            Self::On => Torque::On,
        }
    }
}

#[derive(Clone, Copy, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
enum ModeJson {
    Current,
    Velocity,
    Position,
    ExtendedPosition,
    CurrentBasedPosition,
    Pwm,
}

impl ModeJson {
    fn new(mode: OperatingMode) -> Self {
        match mode {
            OperatingMode::Current => Self::Current,
            OperatingMode::Velocity => Self::Velocity,
            OperatingMode::Position => Self::Position,
            OperatingMode::ExtendedPosition => Self::ExtendedPosition,
            OperatingMode::CurrentBasedPosition => Self::CurrentBasedPosition,
            OperatingMode::Pwm => Self::Pwm,
        }
    }

    fn mode(self) -> OperatingMode {
        match self {
            Self::Current => OperatingMode::Current,
            Self::Velocity => OperatingMode::Velocity,
            Self::Position => OperatingMode::Position,
            Self::ExtendedPosition => OperatingMode::ExtendedPosition,
            Self::CurrentBasedPosition => OperatingMode::CurrentBasedPosition,
            Self::Pwm => OperatingMode::Pwm,
        }
    }
}

#[derive(Clone, Copy, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
enum WatchdogJson {
    Off,
    Armed,
    Tripped,
}

impl WatchdogJson {
    fn new(state: WatchdogState) -> Self {
        match state {
            WatchdogState::Off => Self::Off,
            WatchdogState::Armed(_) => Self::Armed,
            WatchdogState::Tripped => Self::Tripped,
        }
    }

    /// `None` for an armed one without the time (s) after which it trips.
    fn state(self, timeout: Option<f64>) -> Option<WatchdogState> {
        Some(match self {
            Self::Off => WatchdogState::Off,
            Self::Armed => WatchdogState::Armed(Duration::try_from_secs_f64(timeout?).ok()?),
            Self::Tripped => WatchdogState::Tripped,
        })
    }
}

#[derive(Clone, Copy, Default, Serialize, Deserialize)]
#[serde(default)]
struct ErrorsJson {
    input_voltage: bool,
    overheating: bool,
    encoder: bool,
    electrical_shock: bool,
    overload: bool,
}

impl ErrorsJson {
    fn new(errors: HardwareErrors) -> Self {
        Self {
            input_voltage: errors.input_voltage,
            overheating: errors.overheating,
            encoder: errors.encoder,
            electrical_shock: errors.electrical_shock,
            overload: errors.overload,
        }
    }

    fn errors(self) -> HardwareErrors {
        HardwareErrors {
            input_voltage: self.input_voltage,
            overheating: self.overheating,
            encoder: self.encoder,
            electrical_shock: self.electrical_shock,
            overload: self.overload,
        }
    }
}
