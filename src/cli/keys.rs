//! Keys as they are pressed, while something else goes on.

use std::io::{IsTerminal, Read};
use std::sync::mpsc::{Receiver, Sender, TryRecvError, channel};
use std::thread;

use console::{Key, Term};

/// Keys of the terminal, or characters of a stdin that is none.
pub(super) struct Keys(Receiver<char>);

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
        let (sender, receiver) = channel();
        super::joystick::device::listen(sender.clone())?;
        Self::read(sender);
        Ok(Self(receiver))
    }

    /// Listens from now on.
    pub fn listen() -> Self {
        let (sender, receiver) = channel();
        Self::read(sender);
        Self(receiver)
    }

    fn read(sender: Sender<char>) {
        // The thread waits in a read and ends with the process, or where nobody listens any more.
        thread::spawn(move || {
            let terminal = std::io::stdin().is_terminal();
            let term = Term::stdout();
            loop {
                let key = match terminal {
                    true => term.read_key_raw().ok().map(of_key),
                    false => {
                        let mut byte = [0];
                        let count = std::io::stdin().read(&mut byte).unwrap_or(0);
                        (count > 0).then(|| char::from(byte[0]))
                    }
                };
                if key.is_none_or(|key| sender.send(key).is_err()) {
                    break;
                }
            }
        });
    }

    /// The next key.
    pub fn pressed(&self) -> Pressed {
        match self.0.try_recv() {
            Ok(key) => Pressed::Key(key),
            Err(TryRecvError::Empty) => Pressed::Nothing,
            Err(TryRecvError::Disconnected) => Pressed::End,
        }
    }
}

fn of_key(key: Key) -> char {
    match key {
        Key::ArrowUp => 'w',
        Key::ArrowDown => 's',
        Key::ArrowLeft => 'a',
        Key::ArrowRight => 'd',
        Key::Enter => '\n',
        Key::Char(key) => key,
        Key::CtrlC | Key::Escape => 'q',
        _ => ' ',
    }
}
