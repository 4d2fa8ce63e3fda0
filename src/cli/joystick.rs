//! A game controller in place of keys.

/// What the controls of a game controller stand for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Control {
    /// Bend toward a key of `w`, `a`, `s` and `d`.
    Bend(char),
    /// More of the tension that a module's tendons share.
    Tighten,
    /// Less of it.
    Loosen,
    /// The module after the chosen one.
    Next,
    /// The module before it.
    Previous,
    /// Straight again.
    Straight,
    /// See the robot as it is.
    Capture,
    /// Let go and end.
    LetGo,
}

/// Turns controls into the keys that mean the same.
#[derive(Debug, Default)]
pub(super) struct Pad {
    /// The chosen module, from 0.
    module: u32,
}

impl Pad {
    /// Modules that a digit can choose.
    const MODULES: u32 = 9;

    /// The key for a control.
    pub fn key(&mut self, control: Control) -> char {
        match control {
            Control::Bend(key) => key,
            Control::Tighten => '+',
            Control::Loosen => '-',
            Control::Next => self.choose((self.module + 1).min(Self::MODULES - 1)),
            Control::Previous => self.choose(self.module.saturating_sub(1)),
            Control::Straight => 'h',
            Control::Capture => 'c',
            Control::LetGo => 'q',
        }
    }

    fn choose(&mut self, module: u32) -> char {
        self.module = module;
        char::from_digit(module + 1, 10).unwrap_or('1')
    }
}

/// The bend that a stick at `(x, y)`, each in [-1, 1], asks for: along its larger axis, where it is more than half out.
pub(super) fn bend(x: f32, y: f32) -> Option<Control> {
    const OUT: f32 = 0.5;
    let key = match (x.abs() > y.abs(), x, y) {
        (true, x, _) if x > OUT => 'd',
        (true, x, _) if x < -OUT => 'a',
        (false, _, y) if y > OUT => 'w',
        (false, _, y) if y < -OUT => 's',
        _ => return None,
    };
    Some(Control::Bend(key))
}

/// Game controllers of this computer.
#[cfg(feature = "joystick")]
pub(super) mod device {
    use std::sync::mpsc::{Sender, channel};
    use std::thread;
    use std::time::{Duration, Instant};

    use anyhow::{Context, anyhow, bail};
    use gilrs::{Axis, Button, EventType, Gilrs};

    use super::{Control, Pad, bend};

    /// A stick that is held out bends again after this time, as a key that is held down does.
    const REPEAT: Duration = Duration::from_millis(150);

    /// Sends the keys that the controls of all controllers stand for, from now on. The thread ends where nobody listens any more.
    ///
    /// # Errors
    /// Where controllers cannot be read, or none is connected.
    pub fn listen(keys: Sender<char>) -> anyhow::Result<()> {
        let (opened, outcome) = channel();
        thread::spawn(move || {
            let mut controllers = match Gilrs::new() {
                Ok(controllers) => controllers,
                Err(error) => {
                    drop(opened.send(Err(anyhow!("cannot read game controllers: {error}"))));
                    return;
                }
            };
            let found = controllers
                .gamepads()
                .next()
                .map(|(_, pad)| pad.name().to_owned());
            let any = found.is_some();
            drop(opened.send(Ok(found)));
            if any {
                read(&mut controllers, &keys);
            }
        });
        match outcome
            .recv()
            .context("the reader of game controllers ended")??
        {
            Some(name) => super::super::console::say(&format!("listening to {name}")),
            None => bail!(
                "no game controller found: connect one that the system lists (Linux: /dev/input/js0, readable for you), or use keys"
            ),
        }
        Ok(())
    }

    fn read(controllers: &mut Gilrs, keys: &Sender<char>) {
        let (mut pad, mut stick, mut bent) = (Pad::default(), [0.0; 2], Instant::now());
        loop {
            let event = controllers.next_event_blocking(Some(REPEAT));
            let pressed = match event.map(|event| event.event) {
                Some(EventType::ButtonPressed(button, _)) => control(button),
                Some(EventType::AxisChanged(axis, value, _)) => {
                    match axis {
                        Axis::LeftStickX => stick[0] = value,
                        Axis::LeftStickY => stick[1] = value,
                        _ => {}
                    }
                    None
                }
                Some(EventType::Disconnected) => Some(Control::LetGo),
                _ => None,
            };
            let held = bend(stick[0], stick[1]).filter(|_| bent.elapsed() >= REPEAT);
            if held.is_some() {
                bent = Instant::now();
            }
            for control in [pressed, held].into_iter().flatten() {
                if keys.send(pad.key(control)).is_err() {
                    return;
                }
            }
        }
    }

    fn control(button: Button) -> Option<Control> {
        Some(match button {
            Button::DPadUp => Control::Bend('w'),
            Button::DPadLeft => Control::Bend('a'),
            Button::DPadDown => Control::Bend('s'),
            Button::DPadRight => Control::Bend('d'),
            Button::RightTrigger2 => Control::Tighten,
            Button::LeftTrigger2 => Control::Loosen,
            Button::RightTrigger => Control::Next,
            Button::LeftTrigger => Control::Previous,
            Button::North => Control::Straight,
            Button::South => Control::Capture,
            Button::East => Control::LetGo,
            _ => return None,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::{Control, Pad, bend};

    #[test]
    fn bumpers_choose_modules_as_digits_do() {
        let mut pad = Pad::default();
        let turns = [
            Control::Previous,
            Control::Next,
            Control::Next,
            Control::Previous,
        ];
        assert_eq!(turns.map(|control| pad.key(control)), ['1', '2', '3', '2']);
        let last = (0..20).map(|_| pad.key(Control::Next)).last();
        assert_eq!(last, Some('9'));
    }

    #[test]
    fn other_controls_stand_for_the_keys_of_jog() {
        let controls = [
            Control::Tighten,
            Control::Loosen,
            Control::Straight,
            Control::Capture,
            Control::LetGo,
        ];
        let keys = controls.map(|control| Pad::default().key(control));
        assert_eq!(keys, ['+', '-', 'h', 'c', 'q']);
    }

    #[test]
    fn a_stick_bends_along_its_larger_axis_once_it_is_half_out() {
        let key = |x, y| bend(x, y).map(|control| Pad::default().key(control));
        assert_eq!(key(0.3, -0.4), None);
        assert_eq!(key(0.9, 0.6), Some('d'));
        assert_eq!(key(-0.9, 0.6), Some('a'));
        assert_eq!(key(0.1, 0.6), Some('w'));
        assert_eq!(key(0.1, -0.6), Some('s'));
        assert_eq!(key(f32::NAN, 0.0), None);
    }
}
