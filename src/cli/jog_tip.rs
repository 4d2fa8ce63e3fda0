//! `tdcr jog --tip`: the tip in the world's axes.

use nalgebra::Vector3;
use tdcr::hw::capture::{CaptureError, Session, SessionSettings};
use tdcr::hw::rig::{Rig, RigError};
use tdcr::track::TipSteer;

use super::console::Console;
use super::jogged::{Jogged, end};
use super::keys::Keys;

/// Steers the tip as keys say, each by `step` (m), until one says to end, or a signal does. The tension is released then.
pub(super) fn obey(
    rig: &mut Rig,
    keys: &Keys,
    step: f64,
    jogged: &mut Jogged<'_>,
    console: &Console,
) -> anyhow::Result<()> {
    let mut steer = TipSteer::new(rig)?;
    let mut go_on = || console.go_on();
    let mut session = Session::begin(rig, &SessionSettings::default(), None, &mut go_on)?;
    session.check_tendons()?;
    let mut command = session.rig().commanded().ok_or(RigError::Released)?;
    console
        .tell("w s: along y; a d: along x; + -: along z; h: home; c: capture; q: let go and end");
    while let Some(key) = jogged.key(&mut session, keys, console)? {
        if key == 'h' {
            let home = session.program().rest().clone();
            session.visit(home)?;
            command = session.rig().commanded().ok_or(RigError::Released)?;
            jogged.moves += 1;
            continue;
        }
        let Some(by) = asked(key, step) else {
            continue;
        };
        let found = session.rig().hold_while(|| steer.moved(&command, by))?;
        // By the session's plan: clear of obstacles, and with what its servos should pull there known.
        let found: Result<_, String> = match found {
            Err(error) => Err(error.to_string()),
            Ok(next) => {
                let to = session.rig().robot().command(&next)?;
                match session.visit(to) {
                    Err(CaptureError::Plan(error)) => Err(error.to_string()),
                    visited => visited.map(|()| Ok(next))?,
                }
            }
        };
        match found {
            Ok(next) => {
                command = next;
                jogged.moves += 1;
                let tip = steer.tip(&command)?;
                console.tell(&format!(
                    "tip at {:.4}, {:.4}, {:.4} m by the model",
                    tip.x, tip.y, tip.z
                ));
            }
            Err(reason) => {
                jogged.refused += 1;
                console.tell(&reason);
            }
        }
    }
    end(session, console)
}

/// What a key asks the tip to move by (m, world frame); `None` for a key without meaning.
fn asked(key: char, step: f64) -> Option<Vector3<f64>> {
    let way = match key {
        'w' => Vector3::y(),
        's' => -Vector3::y(),
        'd' => Vector3::x(),
        'a' => -Vector3::x(),
        '+' | '=' => Vector3::z(),
        '-' => -Vector3::z(),
        _ => return None,
    };
    Some(way * step)
}
