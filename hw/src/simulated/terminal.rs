//! The simulated line on a pseudo-terminal, for programs that open serial ports.

use std::io;
use std::path::{Path, PathBuf};
use std::time::Duration;

use serial2::SerialPort;

use super::Simulator;

/// Longest wait for bytes, after which somebody may want it to end.
const PATIENCE: Duration = Duration::from_millis(5);
/// What the operating system waits for exactly only by sleeping: below the millisecond that `poll` counts in.
const SHORT: Duration = Duration::from_micros(1500);

/// A pseudo-terminal in raw mode whose path other programs open as they would a serial port. They may come and go. Linux only.
#[derive(Debug)]
pub struct Terminal {
    ours: SerialPort,
    /// Kept open: else the line would hang up when a program closes it.
    theirs: SerialPort,
    path: PathBuf,
}

impl Terminal {
    /// A new pseudo-terminal, set to `baud_rate`.
    ///
    /// # Errors
    /// The operating system's.
    pub fn open(baud_rate: u32) -> io::Result<Self> {
        let (mut ours, mut theirs, path) = pair()?;
        let mut settings = theirs.get_configuration()?;
        settings.set_raw();
        settings.set_baud_rate(baud_rate)?;
        theirs.set_configuration(&settings)?;
        // What nobody reads is lost, as on a serial port.
        ours.set_write_timeout(Duration::ZERO)?;
        Ok(Self { ours, theirs, path })
    }

    /// What other programs open.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Carries bytes between the line of `simulator`, which runs on a [`SystemClock`](crate::clock::SystemClock), and the
    /// terminal until `stop` says so. The line has the baud rate that the terminal is set to.
    ///
    /// # Errors
    /// The operating system's; [`io::ErrorKind::NotConnected`] when the simulated cable is pulled.
    pub fn serve(&mut self, simulator: &Simulator, stop: impl Fn() -> bool) -> io::Result<()> {
        let clock = simulator.clock();
        let mut buffer = [0; 4096];
        while !stop() {
            let settings = self.theirs.get_configuration()?;
            let mut world = simulator.now();
            if world.unplugged {
                return Err(io::Error::new(
                    io::ErrorKind::NotConnected,
                    "the cable of the simulated bus is unplugged",
                ));
            }
            if let Ok(baud_rate) = settings.get_baud_rate() {
                world.wire.set_baud_rate(baud_rate);
            }
            let now = clock.now();
            let count = world.wire.receive(now, &mut buffer);
            let next = world.next_event();
            drop(world);
            self.hand_on(&buffer[..count])?;
            let wait = next.map_or(PATIENCE, |next| next.saturating_sub(clock.now()));
            if wait < SHORT {
                clock.wait(wait);
            } else {
                let count = self.await_bytes(wait.min(PATIENCE), &mut buffer)?;
                simulator.now().wire.send(clock.now(), &buffer[..count]);
            }
        }
        Ok(())
    }

    fn hand_on(&self, mut bytes: &[u8]) -> io::Result<()> {
        while !bytes.is_empty() {
            match self.ours.write(bytes) {
                Ok(count) => bytes = &bytes[count..],
                Err(error) if is_idle(&error) => return Ok(()),
                Err(error) => return Err(error),
            }
        }
        Ok(())
    }

    /// Bytes that programs have written; none after `patience`.
    fn await_bytes(&mut self, patience: Duration, buffer: &mut [u8]) -> io::Result<usize> {
        self.ours.set_read_timeout(patience)?;
        match self.ours.read(buffer) {
            Err(error) if is_idle(&error) => Ok(0),
            read => read,
        }
    }
}

/// Both ends of a new pseudo-terminal, and the path of the second.
#[cfg(unix)]
fn pair() -> io::Result<(SerialPort, SerialPort, PathBuf)> {
    use std::os::fd::AsRawFd;

    let (ours, theirs) = SerialPort::pair()?;
    let path = std::fs::read_link(format!("/proc/self/fd/{}", theirs.as_raw_fd()))?;
    Ok((ours, theirs, path))
}

/// There are none.
#[cfg(not(unix))]
fn pair() -> io::Result<(SerialPort, SerialPort, PathBuf)> {
    let message = "there are no pseudo-terminals on this system, expected Linux";
    Err(io::Error::new(io::ErrorKind::Unsupported, message))
}

fn is_idle(error: &io::Error) -> bool {
    use io::ErrorKind::{Interrupted, TimedOut, WouldBlock};
    matches!(error.kind(), TimedOut | WouldBlock | Interrupted)
}
