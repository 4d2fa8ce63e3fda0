//! Keys as they are pressed, while something else goes on.

use std::io::{ErrorKind, IsTerminal, Read};
use std::sync::mpsc::{Receiver, Sender, TryRecvError, channel};
use std::thread;

use super::terminal::Unbuffered;

/// Keys of the terminal, or characters of a stdin that is none.
pub(super) struct Keys {
    pressed: Receiver<char>,
    _terminal: Unbuffered,
}

/// What came since one last asked.
pub(super) enum Pressed {
    /// A key; arrows are `w`, `a`, `s` and `d`.
    Key(char),
    /// None.
    Nothing,
    /// None, and none will come.
    End,
}

impl Keys {
    /// Listens from now on: to keys, and to those that a game controller stands for.
    #[cfg(feature = "joystick")]
    pub fn listen_with_joystick() -> anyhow::Result<Self> {
        let (sender, pressed) = channel();
        super::joystick::device::listen(sender.clone())?;
        Ok(Self::read(sender, pressed))
    }

    /// Listens from now on.
    pub fn listen() -> Self {
        let (sender, pressed) = channel();
        Self::read(sender, pressed)
    }

    fn read(sender: Sender<char>, pressed: Receiver<char>) -> Self {
        let terminal = Unbuffered::begin();
        let of_bytes = match std::io::stdin().is_terminal() {
            true => keys_of_terminal,
            false => characters,
        };
        // The thread waits in a read and ends with the process, or where nobody listens any more.
        thread::spawn(move || {
            let mut bytes = [0; 64];
            loop {
                // A terminal gives the bytes of a key at once.
                let count = match std::io::stdin().lock().read(&mut bytes) {
                    Err(error) if error.kind() == ErrorKind::Interrupted => continue,
                    count => count.unwrap_or(0),
                };
                let mut keys = of_bytes(&bytes[..count]).into_iter();
                if count == 0 || keys.any(|key| sender.send(key).is_err()) {
                    break;
                }
            }
        });
        Self {
            pressed,
            _terminal: terminal,
        }
    }

    /// The next key.
    pub fn pressed(&self) -> Pressed {
        match self.pressed.try_recv() {
            Ok(key) => Pressed::Key(key),
            Err(TryRecvError::Empty) => Pressed::Nothing,
            Err(TryRecvError::Disconnected) => Pressed::End,
        }
    }
}

fn characters(bytes: &[u8]) -> Vec<char> {
    bytes.iter().copied().map(char::from).collect()
}

/// What Ctrl-\ and Ctrl-Z send where they send no signal.
const CTRL_BACKSLASH: u8 = 0x1c;
const CTRL_Z: u8 = 0x1a;

/// Keys of what a terminal sends: an arrow is an escape sequence of three bytes; an escape alone, Ctrl-\ and Ctrl-Z are `q`.
fn keys_of_terminal(mut bytes: &[u8]) -> Vec<char> {
    let mut keys = Vec::new();
    loop {
        let (key, rest) = match bytes {
            [] => return keys,
            [0x1b, b'[' | b'O', b'A', rest @ ..] => ('w', rest),
            [0x1b, b'[' | b'O', b'B', rest @ ..] => ('s', rest),
            [0x1b, b'[' | b'O', b'C', rest @ ..] => ('d', rest),
            [0x1b, b'[' | b'O', b'D', rest @ ..] => ('a', rest),
            [0x1b, b'[' | b'O', _, rest @ ..] => (' ', rest),
            [0x1b | CTRL_BACKSLASH | CTRL_Z, rest @ ..] => ('q', rest),
            [key, rest @ ..] => (char::from(*key), rest),
        };
        keys.push(key);
        bytes = rest;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn arrows_bend_and_keys_that_end_programs_let_go() {
        assert_eq!(
            keys_of_terminal(b"2w\x1b[A\x1b[B\x1bOC\x1b[Dc"),
            ['2', 'w', 'w', 's', 'd', 'a', 'c']
        );
        assert_eq!(keys_of_terminal(b"\x1b"), ['q']);
        assert_eq!(keys_of_terminal(b"d\x1c\x1a"), ['d', 'q', 'q']);
        assert_eq!(keys_of_terminal(b"w\x1b["), ['w', 'q', '[']);
        assert_eq!(characters(b"+\n"), ['+', '\n']);
    }
}
