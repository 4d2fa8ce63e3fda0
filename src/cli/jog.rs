//! `tdcr jog`.

use std::path::PathBuf;

use clap::Args;
use tdcr::hw::capture::{CaptureError, Session, SessionSettings};
use tdcr::hw::plan::{PlanError, Shape};
use tdcr::hw::rig::{LOG_LEAVES, Pace, Rig};
use tdcr::pipeline::lock_folder;
use tdcr::report::counted;

use super::console::Console;
use super::faults::FaultArgs;
use super::is_interruption;
use super::jog_tip;
use super::jogged::{Jogged, end};
use super::keys::Keys;

/// Bend a robot by keys, and capture chosen poses
///
/// Digits choose a module; w, a, s, d or the arrows bend it; + and - change the tension that its tendons share; h straightens the
/// robot, c captures, q lets go and ends. Commands under which a tendon would go slack or be overloaded are refused. What is
/// captured is what tdcr data import reads: a cloud and its motors (m). Without a terminal, keys are read from stdin.
#[derive(Debug, Args)]
pub(super) struct JogArgs {
    /// File of the rig
    #[arg(long, value_name = "FILE")]
    rig: PathBuf,
    /// Steer the tip in the world's axes: w and s along y, a and d along x, + and - along z, through the model in open loop; h goes
    /// home. Tensions stay within the rig's commands.tension
    #[arg(long, conflicts_with_all = ["bend", "tension"])]
    tip: bool,
    /// Way of a key of --tip (m)
    #[arg(long, default_value_t = 0.002, value_name = "M", value_parser = super::positive, requires = "tip", conflicts_with_all = ["bend", "tension"])]
    step: f64,
    /// Bend of a key (rad)
    #[arg(long, default_value_t = 0.05, value_name = "RAD", value_parser = super::positive)]
    bend: f64,
    /// Tension of a key (N)
    #[arg(long, default_value_t = 0.5, value_name = "N", value_parser = super::positive)]
    tension: f64,
    /// Bend by a game controller too: left stick or pad bends, bumpers choose a module, triggers change the tension, north
    /// straightens, south captures, east ends
    #[cfg(feature = "joystick")]
    #[arg(long)]
    joystick: bool,
    #[command(flatten)]
    faults: FaultArgs,
    /// Folder of what is captured
    #[arg(long, default_value = "jog", value_name = "DIR")]
    out: PathBuf,
    /// Write no log. Else DIR/log.mcap has all that servos and cameras did, log-2.mcap the next time
    #[arg(long)]
    no_log: bool,
}

impl JogArgs {
    fn keys(&self) -> anyhow::Result<Keys> {
        #[cfg(feature = "joystick")]
        if self.joystick {
            return Keys::listen_with_joystick();
        }
        Ok(Keys::listen())
    }
}

pub(super) fn run(args: &JogArgs, console: &Console) -> anyhow::Result<()> {
    let out = &args.out;
    super::output::folder("--out", out, "a folder for what is captured")?;
    let file = super::load_rig(&args.rig)?;
    let _lock = lock_folder(out)?;
    let keys = args.keys()?;
    // A person watches; a script of keys does not.
    let pace = match std::io::IsTerminal::is_terminal(&std::io::stdin()) {
        true => Pace::RealTime,
        false => Pace::Computed,
    };
    let mut rig = Rig::open_file(file, pace)?;
    args.faults.schedule(&rig)?;
    let mut jogged = Jogged {
        dir: out,
        log: match args.no_log {
            true => None,
            false => Some(rig.log_in(out, "log", LOG_LEAVES)?),
        },
        moves: 0,
        refused: 0,
        captured: 0,
    };
    let ended = match args.tip {
        true => jog_tip::obey(&mut rig, &keys, args.step, &mut jogged, console),
        false => obey(&mut rig, &keys, args, &mut jogged, console),
    };
    // What was captured is worth more than the log.
    if let Err(error) = rig.finish_log() {
        tracing::warn!("the log is not whole: {error}");
    }
    match ended {
        Err(error) if !is_interruption(&error) => return Err(error),
        _ => {}
    }
    console.summary(&jogged, |jogged| {
        format!(
            "{}, {} refused, {} captured in {}",
            counted(jogged.moves, "move"),
            jogged.refused,
            counted(jogged.captured, "cloud"),
            jogged.dir.display()
        )
    })?;
    ended
}

/// Does what keys say, until one says to end, or a signal does. The tension is released then.
fn obey(
    rig: &mut Rig,
    keys: &Keys,
    args: &JogArgs,
    jogged: &mut Jogged,
    console: &Console,
) -> anyhow::Result<()> {
    let mut go_on = || console.go_on();
    let mut session = Session::begin(rig, &SessionSettings::default(), None, &mut go_on)?;
    session.check_tendons()?;
    let mut module = 0;
    console.tell(
        "1 to 9: module; w a s d: bend; + -: tension; h: straight; c: capture; q: let go and end",
    );
    let rest = session.program().rest().clone();
    while let Some(key) = jogged.key(&mut session, keys, console)? {
        if let Some(chosen) = key
            .to_digit(10)
            .and_then(|digit| (digit as usize).checked_sub(1))
            && chosen < rest.0.len()
        {
            module = chosen;
            continue;
        }
        let at = session.place().shape().unwrap_or(&rest);
        let Some(shape) = turned(at, &rest, module, key, args) else {
            continue;
        };
        match session.visit(shape) {
            Ok(()) => jogged.moves += 1,
            Err(CaptureError::Plan(
                error @ (PlanError::Shape(_) | PlanError::NoCommand { .. }),
            )) => {
                return Err(error.into());
            }
            Err(CaptureError::Plan(error)) => {
                jogged.refused += 1;
                console.tell(&error.to_string());
            }
            Err(error) => return Err(error.into()),
        }
        let pulls = session.rig().last_states().unwrap_or_default().iter();
        let pulls: Vec<String> = pulls.map(|state| format!("{:.2}", state.pull)).collect();
        console.tell(&format!(
            "module {}: pulling with {} A",
            module + 1,
            pulls.join(", ")
        ));
    }
    end(session, console)
}

/// The shape that a key asks for; `None` for a key without meaning.
fn turned(at: &Shape, rest: &Shape, module: usize, key: char, args: &JogArgs) -> Option<Shape> {
    let mut shape = at.clone();
    let bend = shape.0.get_mut(module)?;
    match key {
        'w' => bend.toward[1] += args.bend,
        's' => bend.toward[1] -= args.bend,
        'd' => bend.toward[0] += args.bend,
        'a' => bend.toward[0] -= args.bend,
        '+' | '=' => bend.tension += args.tension,
        '-' => bend.tension = (bend.tension - args.tension).max(0.0),
        'h' => shape = rest.clone(),
        _ => return None,
    }
    Some(shape)
}
