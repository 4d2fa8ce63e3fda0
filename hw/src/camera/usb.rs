//! What cameras are plugged into.

use std::fmt;
use std::str::FromStr;

/// Version of USB that a camera and its port have agreed on.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct UsbVersion {
    /// 2 of USB 2.1.
    pub major: u8,
    /// 1 of USB 2.1.
    pub minor: u8,
}

impl UsbVersion {
    /// Why a camera at this port is slow, and what would be right; `None` where nothing is wrong.
    pub fn warning(self, serial: &str) -> Option<String> {
        (self.major < 3).then(|| {
            format!(
                "camera {serial} runs at USB {self}, which carries its pictures only at low resolution or rate; use a \
                 USB 3 port (blue, or marked SS) and the camera's own USB 3 cable, pushed in quickly and fully"
            )
        })
    }
}

impl fmt::Display for UsbVersion {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}.{}", self.major, self.minor)
    }
}

impl FromStr for UsbVersion {
    type Err = String;

    /// Reads "3.2", and "3" as "3.0".
    fn from_str(text: &str) -> Result<Self, Self::Err> {
        let (major, minor) = text.trim().split_once('.').unwrap_or((text.trim(), "0"));
        match (major.parse(), minor.parse()) {
            (Ok(major), Ok(minor)) => Ok(Self { major, minor }),
            _ => Err(format!("USB version {text:?}; expected one such as 3.2")),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_slow_ports_are_warned_of_with_what_would_be_right() {
        let usb = |text: &str| text.parse::<UsbVersion>();
        assert_eq!(usb("3.2").map(|v| v.warning("1")), Ok(None));
        let warning = usb("2.1").ok().and_then(|v| v.warning("817612071234"));
        let warning = warning.unwrap_or_default();
        assert!(
            warning.contains("817612071234") && warning.contains("2.1"),
            "{warning}"
        );
        assert!(warning.contains("USB 3 port"), "{warning}");
        assert_eq!(usb("3").map(|v| v.to_string()), Ok("3.0".to_owned()));
        assert!(usb("fast").is_err());
    }
}
