//! Cutting corners off a way, and going over it again in finer steps.

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use tdcr_sim::chain::Configuration;

use super::space::{between, squared_distance};
use super::walk::{Halt, Walker};

/// Corners that are tried to cut off.
const TRIALS: usize = 120;
/// Successive ones that fail before no more are tried.
const FAILURES: usize = 40;
/// Steps between two places of a way when it is gone over again.
const FINE: usize = 8;

/// A place of a way: coordinates, and the equilibrium there.
#[derive(Clone, Debug)]
pub(super) struct Stop {
    pub at: Vec<f64>,
    pub configuration: Configuration,
}

/// All places that a robot comes by from corner to corner, the first included.
pub(super) fn trace(walker: &mut Walker, corners: &[Stop]) -> Result<Vec<Stop>, Halt> {
    let mut stops = Vec::new();
    let Some(first) = corners.first() else {
        return Ok(stops);
    };
    walker.stand(&first.at, Some(&first.configuration))?;
    stops.push(first.clone());
    for corner in &corners[1..] {
        go(walker, &corner.at, &mut stops)?;
        if !walker.is_at(&corner.configuration) {
            return Err(Halt::Jump);
        }
    }
    Ok(stops)
}

/// Goes to a place; hands over all stops on the way.
pub(super) fn go(walker: &mut Walker, to: &[f64], stops: &mut Vec<Stop>) -> Result<(), Halt> {
    walker.walk(to, |place| {
        stops.push(Stop {
            at: place.at.clone(),
            configuration: place.configuration.clone(),
        });
    })
}

/// Replaces pieces between places drawn at random by straight lines, where a robot may go there. Straight lines are the shortest
/// in shares of the tendons' ranges.
pub(super) fn shorten(walker: &mut Walker, mut way: Vec<Stop>, seed: u64) -> Vec<Stop> {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let (mut cut, mut failures) = (Vec::new(), 0);
    for _ in 0..TRIALS {
        if way.len() < 3 || failures >= FAILURES {
            break;
        }
        failures += 1;
        let ends = [0, 1].map(|_| rng.random_range(0..way.len()));
        let [from, to] = [ends[0].min(ends[1]), ends[0].max(ends[1])];
        if to - from < 2 {
            continue;
        }
        let whole: f64 = lengths(&way[from..=to]);
        let straight = squared_distance(&way[from].at, &way[to].at).sqrt();
        if straight > 0.999 * whole {
            continue;
        }
        cut.clear();
        let stood = walker.stand(&way[from].at, Some(&way[from].configuration));
        let gone = stood.and_then(|()| go(walker, &way[to].at, &mut cut));
        if gone.is_ok() && walker.is_at(&way[to].configuration) {
            way.splice(from + 1..=to, cut.drain(..));
            failures = 0;
        }
    }
    way
}

/// Length of a way (shares of the tendons' ranges).
fn lengths(way: &[Stop]) -> f64 {
    let pairs = way.windows(2);
    pairs
        .map(|pair| squared_distance(&pair[0].at, &pair[1].at).sqrt())
        .sum()
}

/// Whether a robot that goes along a way in finer steps comes by the same equilibria, as clear as before.
pub(super) fn holds(walker: &mut Walker, way: &[Stop]) -> Result<(), Halt> {
    let Some(first) = way.first() else {
        return Ok(());
    };
    walker.stand(&first.at, Some(&first.configuration))?;
    let mut at = first.at.clone();
    for pair in way.windows(2) {
        for part in 1..=FINE {
            let share = part as f64 / FINE as f64;
            between(&pair[0].at, &pair[1].at, share, &mut at);
            if part == FINE {
                at.copy_from_slice(&pair[1].at);
            }
            walker.walk(&at, |_| {})?;
        }
        if !walker.is_at(&pair[1].configuration) {
            return Err(Halt::Jump);
        }
    }
    Ok(())
}
