//! Serial ports: USB adapters such as the U2D2, and pseudo-terminals.

use std::fs;
#[cfg(unix)]
use std::fs::{File, TryLockError};
use std::io;
#[cfg(unix)]
use std::os::fd::AsFd;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;

use serial2::{CharSize, FlowControl, Parity, SerialPort, Settings, StopBits};
use thiserror::Error;

use crate::clock::Clock;
use crate::transport::Transport;

/// Where the kernel has the settings of USB adapters.
const ADAPTERS: &str = "/sys/bus/usb-serial/devices";
/// A latency timer (ms) that nobody needs to lower.
const SHORT_TIMER: u64 = 1;
/// How long a write may wait for a line that takes no bytes.
const WRITE_TIMEOUT: Duration = Duration::from_millis(500);
/// What an open port fails with that is gone (Linux, `errno.h`).
const EIO: i32 = 5;
/// The same for one that was opened by another program as its own.
const EBUSY: i32 = 16;
const ENODEV: i32 = 19;
/// The same for a file that is no terminal.
const ENOTTY: i32 = 25;

/// How a port is opened.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SerialSettings {
    /// Bits per second.
    pub baud_rate: u32,
    /// How long the computer may take to run this program once bytes have arrived. Waits for servos that do not answer last so
    /// much longer.
    pub scheduling: Duration,
}

impl Default for SerialSettings {
    /// 1 Mbaud; 10 ms.
    fn default() -> Self {
        Self {
            baud_rate: 1_000_000,
            scheduling: Duration::from_millis(10),
        }
    }
}

/// Why a port could not be opened.
#[derive(Debug, Error)]
pub enum SerialError {
    /// There is none.
    #[error("there is no serial port {}: is the adapter plugged in? {}", path.display(), found(available))]
    NoPort {
        /// Its path.
        path: PathBuf,
        /// Those that there are.
        available: Vec<PathBuf>,
    },
    /// It may not be used.
    #[error(
        "no permission to use {}: add yourself to the group that owns it (`sudo usermod -aG dialout $USER`), then log in again",
        path.display()
    )]
    NoPermission {
        /// Its path.
        path: PathBuf,
    },
    /// Another program uses it.
    #[error("{} is in use: close the other program that has it open", path.display())]
    Busy {
        /// Its path.
        path: PathBuf,
    },
    /// It is something else.
    #[error("{} is not a serial port", path.display())]
    NotAPort {
        /// Its path.
        path: PathBuf,
    },
    /// It failed otherwise.
    #[error("{} cannot be opened at {baud_rate} baud: {source}", path.display())]
    Open {
        /// Its path.
        path: PathBuf,
        /// Bits per second.
        baud_rate: u32,
        /// The device's error.
        source: io::Error,
    },
}

fn found(available: &[PathBuf]) -> String {
    match available {
        [] => "No port was found.".to_owned(),
        some => {
            let names: Vec<_> = some.iter().map(|path| path.display().to_string()).collect();
            format!("Ports found: {}.", names.join(", "))
        }
    }
}

/// A serial port that no other program may use meanwhile.
#[derive(Debug)]
pub struct Serial {
    port: SerialPort,
    /// Holds the lock.
    #[cfg(unix)]
    _lock: File,
    path: PathBuf,
    settings: SerialSettings,
    latency_timer: Option<LatencyTimer>,
    clock: Arc<dyn Clock>,
}

/// How long a USB adapter keeps bytes that have arrived, in the hope of more.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct LatencyTimer {
    /// The file by which it is read and set.
    pub path: PathBuf,
    /// How long.
    pub time: Duration,
}

impl LatencyTimer {
    /// That of the adapter `port`, such as `ttyUSB0`, in the folder of all adapters; `None` where it has none.
    fn read(adapters: &Path, port: &Path) -> Option<Self> {
        let path = adapters.join(port.file_name()?).join("latency_timer");
        let milliseconds = fs::read_to_string(&path).ok()?.trim().parse().ok()?;
        let time = Duration::from_millis(milliseconds);
        Some(Self { path, time })
    }

    /// How to lower it, where it makes each answer late.
    pub fn advice(&self) -> Option<String> {
        let milliseconds = u64::try_from(self.time.as_millis()).unwrap_or(u64::MAX);
        (milliseconds > SHORT_TIMER).then(|| {
            format!(
                "the USB adapter holds each answer back for up to {milliseconds} ms; until it is unplugged, \
                 `echo 1 | sudo tee {}` makes that 1 ms",
                self.path.display()
            )
        })
    }
}

impl Serial {
    /// Opens a port: 8 data bits, no parity, 1 stop bit. Deadlines are times of `clock`, which is the system's.
    ///
    /// # Errors
    /// [`SerialError`].
    pub fn open(
        path: &Path,
        settings: SerialSettings,
        clock: Arc<dyn Clock>,
    ) -> Result<Self, SerialError> {
        let explain = |error: io::Error| explain(path, settings.baud_rate, error);
        let configure = |mut raw: Settings| {
            raw.set_raw();
            raw.set_baud_rate(settings.baud_rate)?;
            raw.set_char_size(CharSize::Bits8);
            raw.set_parity(Parity::None);
            raw.set_stop_bits(StopBits::One);
            raw.set_flow_control(FlowControl::None);
            Ok(raw)
        };
        let mut port = SerialPort::open(path, configure).map_err(explain)?;
        port.set_write_timeout(WRITE_TIMEOUT).map_err(explain)?;
        // Elsewhere ports are opened by one program at a time.
        #[cfg(unix)]
        let lock = {
            let lock = File::from(port.as_fd().try_clone_to_owned().map_err(explain)?);
            lock.try_lock().map_err(|error| match error {
                TryLockError::WouldBlock => SerialError::Busy {
                    path: path.to_owned(),
                },
                TryLockError::Error(error) => explain(error),
            })?;
            lock
        };
        // The path may be a link, such as those in /dev/serial/by-id.
        let device = fs::canonicalize(path).map_err(explain)?;
        let latency_timer = LatencyTimer::read(Path::new(ADAPTERS), &device);
        if let Some(advice) = latency_timer.as_ref().and_then(LatencyTimer::advice) {
            tracing::warn!("{}: {advice}", path.display());
        }
        Ok(Self {
            port,
            #[cfg(unix)]
            _lock: lock,
            path: path.to_owned(),
            settings,
            latency_timer,
            clock,
        })
    }

    /// The adapter's latency timer; `None` where it has none, as pseudo-terminals and many boards.
    pub fn latency_timer(&self) -> Option<&LatencyTimer> {
        self.latency_timer.as_ref()
    }

    /// An error of the open port, with its path and what may have happened.
    fn explain(&self, error: io::Error) -> io::Error {
        let gone = matches!(error.raw_os_error(), Some(EIO | ENODEV))
            || error.kind() == io::ErrorKind::UnexpectedEof;
        let hint = if gone {
            ": was the cable unplugged?"
        } else {
            ""
        };
        io::Error::new(
            error.kind(),
            format!("{}: {error}{hint}", self.path.display()),
        )
    }
}

fn explain(path: &Path, baud_rate: u32, source: io::Error) -> SerialError {
    let path = path.to_owned();
    match (source.kind(), source.raw_os_error()) {
        (io::ErrorKind::NotFound, _) => SerialError::NoPort {
            path,
            available: SerialPort::available_ports().unwrap_or_default(),
        },
        (io::ErrorKind::PermissionDenied, _) => SerialError::NoPermission { path },
        (_, Some(EBUSY)) => SerialError::Busy { path },
        (_, Some(ENOTTY)) => SerialError::NotAPort { path },
        _ => SerialError::Open {
            path,
            baud_rate,
            source,
        },
    }
}

impl Transport for Serial {
    fn write(&mut self, bytes: &[u8]) -> io::Result<()> {
        self.port
            .write_all(bytes)
            .map_err(|error| self.explain(error))
    }

    fn read(&mut self, buffer: &mut [u8], deadline: Duration) -> io::Result<usize> {
        loop {
            // The port counts whole milliseconds.
            let wait = deadline.saturating_sub(self.clock.now());
            let wait = Duration::from_millis(wait.as_micros().div_ceil(1000) as u64);
            self.port.set_read_timeout(wait)?;
            return match self.port.read(buffer) {
                Ok(0) if !buffer.is_empty() => {
                    Err(self.explain(io::ErrorKind::UnexpectedEof.into()))
                }
                Ok(count) => Ok(count),
                Err(error) => match error.kind() {
                    io::ErrorKind::TimedOut => Ok(0),
                    io::ErrorKind::Interrupted | io::ErrorKind::WouldBlock
                        if self.clock.now() < deadline =>
                    {
                        continue;
                    }
                    io::ErrorKind::Interrupted | io::ErrorKind::WouldBlock => Ok(0),
                    _ => Err(self.explain(error)),
                },
            };
        }
    }

    fn discard_input(&mut self) -> io::Result<()> {
        let discarded = self.port.discard_input_buffer();
        discarded.map_err(|error| self.explain(error))
    }

    fn clock(&self) -> &Arc<dyn Clock> {
        &self.clock
    }

    fn baud_rate(&self) -> u32 {
        self.settings.baud_rate
    }

    fn latency(&self) -> Duration {
        let timer = self.latency_timer.as_ref();
        timer.map_or(Duration::ZERO, |timer| timer.time) + self.settings.scheduling
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

    use std::os::fd::AsRawFd;

    use super::*;
    use crate::clock::SystemClock;

    /// The near end of a pseudo-terminal, and the path of its far end.
    fn terminal() -> (SerialPort, PathBuf) {
        let (near, far) = SerialPort::pair().unwrap();
        let path = fs::read_link(format!("/proc/self/fd/{}", far.as_fd().as_raw_fd())).unwrap();
        (near, path)
    }

    fn open(path: &Path) -> Result<Serial, SerialError> {
        Serial::open(
            path,
            SerialSettings::default(),
            Arc::new(SystemClock::new()),
        )
    }

    #[test]
    fn bytes_pass_both_ways_unchanged() {
        let (near, path) = terminal();
        let mut serial = open(&path).unwrap();
        let bytes: Vec<u8> = (0..=255).collect();
        serial.write(&bytes).unwrap();
        let mut received = [0; 256];
        near.read_exact(&mut received).unwrap();
        assert_eq!(received[..], bytes);
        near.write_all(&bytes).unwrap();
        let mut buffer = [0; 100];
        let mut received = Vec::new();
        // Time to spare: only a defect waits for this long.
        let deadline = serial.clock().now() + Duration::from_secs(60);
        while received.len() < bytes.len() {
            let count = serial.read(&mut buffer, deadline).unwrap();
            assert!(count > 0);
            received.extend_from_slice(&buffer[..count]);
        }
        assert_eq!(received, bytes);
    }

    #[test]
    fn a_line_on_which_nothing_comes_is_silent_until_the_deadline() {
        let (_near, path) = terminal();
        let mut serial = open(&path).unwrap();
        let deadline = serial.clock().now() + Duration::from_millis(3);
        assert_eq!(serial.read(&mut [0; 8], deadline).unwrap(), 0);
        assert!(serial.clock().now() >= deadline);
        assert_eq!(serial.read(&mut [0; 8], Duration::ZERO).unwrap(), 0);
    }

    #[test]
    fn what_was_discarded_is_not_read() {
        let (near, path) = terminal();
        let mut serial = open(&path).unwrap();
        near.write_all(b"late").unwrap();
        let deadline = serial.clock().now() + Duration::from_secs(60);
        let mut buffer = [0; 1];
        assert_eq!(serial.read(&mut buffer, deadline).unwrap(), 1);
        serial.discard_input().unwrap();
        assert_eq!(serial.read(&mut buffer, Duration::ZERO).unwrap(), 0);
    }

    #[test]
    fn a_port_is_one_programs_at_a_time() {
        let (_near, path) = terminal();
        let serial = open(&path).unwrap();
        let error = open(&path).unwrap_err();
        assert!(matches!(error, SerialError::Busy { .. }), "{error}");
        drop(serial);
        open(&path).unwrap();
    }

    #[test]
    fn an_unplugged_port_is_an_error_that_says_so() {
        let (near, path) = terminal();
        let mut serial = open(&path).unwrap();
        drop(near);
        let deadline = serial.clock().now() + Duration::from_secs(60);
        let error = serial.read(&mut [0; 8], deadline).unwrap_err().to_string();
        assert!(
            error.contains("unplugged") && error.contains("/dev/pts"),
            "{error}"
        );
        let error = serial.write(&[1]).unwrap_err().to_string();
        assert!(error.contains("unplugged"), "{error}");
    }

    #[test]
    fn paths_that_are_no_port_are_named() {
        let folder = tempfile::tempdir().unwrap();
        let missing = folder.path().join("ttyUSB7");
        let error = open(&missing).unwrap_err();
        assert!(matches!(error, SerialError::NoPort { .. }));
        assert!(error.to_string().contains("ttyUSB7"), "{error}");
        fs::write(&missing, "").unwrap();
        let error = open(&missing).unwrap_err();
        assert!(matches!(error, SerialError::NotAPort { .. }), "{error}");
    }

    #[test]
    fn a_long_latency_timer_comes_with_advice() {
        let adapters = tempfile::tempdir().unwrap();
        let port = Path::new("/dev/ttyUSB3");
        assert_eq!(LatencyTimer::read(adapters.path(), port), None);
        let folder = adapters.path().join("ttyUSB3");
        fs::create_dir(&folder).unwrap();
        fs::write(folder.join("latency_timer"), "16\n").unwrap();
        let timer = LatencyTimer::read(adapters.path(), port).unwrap();
        assert_eq!(timer.time, Duration::from_millis(16));
        let advice = timer.advice().unwrap();
        assert!(
            advice.contains("16 ms") && advice.contains("ttyUSB3/latency_timer"),
            "{advice}"
        );
        fs::write(folder.join("latency_timer"), "1\n").unwrap();
        let timer = LatencyTimer::read(adapters.path(), port).unwrap();
        assert_eq!(timer.advice(), None);
    }
}
