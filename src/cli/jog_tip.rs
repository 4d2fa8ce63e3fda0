//! `tdcr jog --tip`: the tip in the world's axes.

use nalgebra::Vector3;
use tdcr::hw::capture::{Session, SessionSettings};
use tdcr::hw::rig::{Rig, RigError};
use tdcr::pipeline::{CaptureSettings, Monitor};
use tdcr::report::counted;
use tdcr::track::TipSteer;

use super::console::{Console, Interrupted};
use super::jogged::{Jogged, save};
use super::keys::{Keys, Pressed};

/// Steers the tip as keys say, each by `step` (m), until one says to end, or a signal does. The tension is released then.
pub(super) fn obey(
    rig: &mut Rig,
    keys: &Keys,
    step: f64,
    jogged: &mut Jogged<'_>,
    console: &Console,
) -> anyhow::Result<()> {
    let mut steer = TipSteer::new(rig)?;
    let settings = SessionSettings {
        seed: 0,
        voxel_size: CaptureSettings::default().voxel,
        masks: None,
    };
    let mut go_on = || console.go_on();
    let mut session = Session::begin(rig, &settings, None, &mut go_on)?;
    let mut command = session.rig().commanded().ok_or(RigError::Released)?;
    console
        .tell("w s: along y; a d: along x; + -: along z; h: home; c: capture; q: let go and end");
    loop {
        if console.interrupted() {
            session.end()?;
            return Err(Interrupted.into());
        }
        let key = match keys.pressed() {
            Pressed::Key('q') | Pressed::End => return Ok(session.end()?),
            Pressed::Key(key) => key,
            Pressed::Nothing => {
                session.rig().poll()?;
                continue;
            }
        };
        if key == 'c' {
            let sample = session.observe(jogged.captured as u64)?;
            let (dir, number) = (jogged.dir, jogged.captured);
            (session.rig()).hold_while(|| save(dir, number, &sample))??;
            jogged.captured += 1;
            console.tell(&format!(
                "captured {}",
                counted(sample.cloud.len(), "point")
            ));
            continue;
        }
        if key == 'h' {
            session.rig().go_home()?;
            command = session.rig().commanded().ok_or(RigError::Released)?;
            jogged.moves += 1;
            continue;
        }
        let Some(by) = asked(key, step) else {
            continue;
        };
        let found = session.rig().hold_while(|| steer.moved(&command, by))?;
        match found {
            Ok(next) => {
                go(session.rig(), &command, &next)?;
                command = next;
                jogged.moves += 1;
                let tip = steer.tip(&command)?;
                console.tell(&format!(
                    "tip at {:.4}, {:.4}, {:.4} m by the model",
                    tip.x, tip.y, tip.z
                ));
            }
            Err(error) => {
                jogged.refused += 1;
                console.tell(&error.to_string());
            }
        }
    }
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

/// Goes from one command to another at the speed of the rig's motion.
fn go(rig: &mut Rig, from: &[f64], to: &[f64]) -> Result<(), RigError> {
    let motion = rig.spec().motion.clone();
    let far = (from.iter().zip(to))
        .map(|(from, to)| (to - from).abs())
        .fold(0.0, f64::max);
    let steps = (far / (motion.slew * motion.period)).ceil().max(1.0) as usize;
    for step in 1..=steps {
        let part = step as f64 / steps as f64;
        let between: Vec<f64> = (from.iter().zip(to))
            .map(|(from, to)| from + part * (to - from))
            .collect();
        rig.step(&rig.robot().command(&between)?)?;
    }
    Ok(())
}
