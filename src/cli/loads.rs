//! Loads as options.

use clap::Args;
use serde::Serialize;
use tdcr::sim::robot::{Frame, Loads, Robot, Wrench};

/// Loads on the robot besides its own weight.
#[derive(Debug, Args)]
pub(super) struct LoadArgs {
    /// Mass hung from the tip disc (kg)
    #[arg(long, default_value_t = 0.0, value_name = "KG")]
    pub payload: f64,
    /// Force (N) and moment (N m) on a disc, a number from 0 at the base or `tip`: in the world's frame, or with @disc in
    /// the disc's, turning with it. The force acts on the disc's origin, or on the point @X,Y,Z of its frame (m). May be given several
    /// times
    #[arg(
        long = "wrench",
        value_name = "DISC[@X,Y,Z]:FX,FY,FZ[,MX,MY,MZ][@disc|@world]",
        value_parser = wrench
    )]
    wrenches: Vec<DiscWrench>,
    /// Force per length of the backbone (N/m), world frame
    #[arg(long, value_name = "FX,FY,FZ", value_parser = vector, allow_hyphen_values = true)]
    line_load: Option<[f64; 3]>,
}

/// A wrench whose disc may be the tip's; its own number is then 0.
#[derive(Clone, Copy, Debug)]
struct DiscWrench {
    at_tip: bool,
    wrench: Wrench,
}

/// Loads as results say them.
#[derive(Serialize)]
pub(super) struct LoadsJson {
    /// Mass hung from the tip (kg).
    payload: f64,
    wrenches: Vec<WrenchJson>,
    /// Force per length of the backbone (N/m), world frame.
    line_load: [f64; 3],
}

#[derive(Serialize)]
struct WrenchJson {
    disc: usize,
    /// In the disc's frame (m).
    point: [f64; 3],
    /// N.
    force: [f64; 3],
    /// N m.
    moment: [f64; 3],
    frame: &'static str,
}

impl LoadArgs {
    /// The loads on `robot`.
    pub fn on(&self, robot: &Robot) -> anyhow::Result<Loads> {
        self.with_payload(self.payload, robot)
    }

    /// The same with another payload (kg).
    pub fn with_payload(&self, payload: f64, robot: &Robot) -> anyhow::Result<Loads> {
        let mut loads = Loads::payload(payload)?;
        for DiscWrench { at_tip, wrench } in &self.wrenches {
            let disc = match at_tip {
                true => robot.discs().len() - 1,
                false => wrench.disc,
            };
            loads = loads.with_wrench(Wrench { disc, ..*wrench })?;
        }
        if let Some(force) = self.line_load {
            loads = loads.with_line_load(force)?;
        }
        loads.check(robot)?;
        Ok(loads)
    }
}

impl LoadsJson {
    pub fn new(loads: &Loads) -> Self {
        let wrench_json = |wrench: &Wrench| WrenchJson {
            disc: wrench.disc,
            point: wrench.point,
            force: wrench.force,
            moment: wrench.moment,
            frame: match wrench.frame {
                Frame::World => "world",
                Frame::Disc => "disc",
            },
        };
        Self {
            payload: loads.tip_payload().mass,
            wrenches: loads.wrenches().iter().map(wrench_json).collect(),
            line_load: loads.line_load().into(),
        }
    }
}

/// Parses `DISC[@X,Y,Z]:FX,FY,FZ[,MX,MY,MZ][@disc|@world]`.
fn wrench(text: &str) -> Result<DiscWrench, String> {
    let (place, rest) =
        (text.split_once(':')).ok_or("expected DISC:FX,FY,FZ, a disc's number and a force in N")?;
    let (place, point) = match place.split_once('@') {
        None => (place, [0.0; 3]),
        Some((place, point)) => {
            let point = vector(point).map_err(|wrong| format!("the point of the disc: {wrong}"))?;
            (place, point)
        }
    };
    let (numbers, frame) = match rest.split_once('@') {
        None | Some((_, "world")) => (rest.split('@').next().unwrap_or(rest), Frame::World),
        Some((numbers, "disc")) => (numbers, Frame::Disc),
        Some((_, frame)) => return Err(format!("the frame is @{frame}; expected @disc or @world")),
    };
    let at_tip = place == "tip";
    let disc = match at_tip {
        true => 0,
        false => (place.parse()).map_err(|_| {
            format!("`{place}` is no disc; expected its number, from 0 at the base, or tip")
        })?,
    };
    let (force, moment) = match numbers_of(numbers)?.as_slice() {
        &[x, y, z] => ([x, y, z], [0.0; 3]),
        &[x, y, z, a, b, c] => ([x, y, z], [a, b, c]),
        other => {
            return Err(format!(
                "expected 3 numbers (N), or 6 with a moment (N m), found {}",
                other.len()
            ));
        }
    };
    let wrench = Wrench {
        point,
        force,
        moment,
        ..Wrench::none(disc, frame)
    };
    Ok(DiscWrench { at_tip, wrench })
}

/// Parses three finite numbers, separated by commas.
pub(super) fn vector(text: &str) -> Result<[f64; 3], String> {
    let numbers = numbers_of(text)?;
    let found = numbers.len();
    (numbers.try_into()).map_err(|_| format!("expected 3 numbers, found {found}"))
}

fn numbers_of(text: &str) -> Result<Vec<f64>, String> {
    let numbers = super::numbers(text)?.into_vec();
    match numbers.iter().find(|number| !number.is_finite()) {
        Some(number) => Err(format!("`{number}` is not a finite number")),
        None => Ok(numbers),
    }
}
