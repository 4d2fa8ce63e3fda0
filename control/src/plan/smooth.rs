//! Rounding off a way's corners: gradient steps on the squares of its second differences, as a motion at a constant rate accelerates
//! by them, each round of which the robot has to be able to go.

use tdcr_sim::chain::Configuration;

use super::shorten::{Stop, go};
use super::walk::{Halt, Walker};

/// Rounds at most: each goes along the way once.
const ROUNDS: usize = 6;
/// Gradient steps of a round, and how long they are: half of those of which the cost is sure to fall, as the largest eigenvalue of the second
/// differences' square is 16.
const STEPS: usize = 800;
const LENGTH: f64 = 1.0 / 16.0;
/// Share by which the cost has to fall in a round for there to be another.
const WORTH: f64 = 0.05;

/// A way with the same ends that turns more gently, where there is one next to it that the robot may go.
///
/// The places of a way move together. Where the robot may not go between two of them, these stay where they are from then on.
pub(super) fn smooth(walker: &mut Walker, way: Vec<Stop>) -> Vec<Stop> {
    let [Some(first), Some(last)] = [way.first(), way.last()].map(Option::<&Stop>::cloned) else {
        return way;
    };
    let mut places: Vec<Vec<f64>> = way.iter().map(|stop| stop.at.clone()).collect();
    let mut held = vec![false; places.len()];
    let mut cost = cost_of(&places);
    let mut gone = way;
    for _ in 0..ROUNDS {
        let moved = descended(&places, &held);
        let lower = cost_of(&moved);
        if lower >= (1.0 - WORTH) * cost {
            break;
        }
        match along(walker, &first, &moved, &last.configuration) {
            Ok(stops) => (places, cost, gone) = (moved, lower, stops),
            Err(at) => held[at.saturating_sub(1)..=at].fill(true),
        }
    }
    gone
}

/// All places that the robot comes by, or the one that it does not get to.
fn along(
    walker: &mut Walker,
    first: &Stop,
    places: &[Vec<f64>],
    end: &Configuration,
) -> Result<Vec<Stop>, usize> {
    let mut stops = vec![first.clone()];
    let mut gone: Result<(), Halt> = walker.stand(&first.at, Some(&first.configuration));
    for (at, place) in places.iter().enumerate().skip(1) {
        gone = gone.and_then(|()| go(walker, place, &mut stops));
        gone.map_err(|_| at)?;
    }
    match walker.is_at(end) {
        true => Ok(stops),
        false => Err(places.len() - 1),
    }
}

/// Places after the gradient steps of a round, within the box of the coordinates. The ends stay, and those that are `held`.
fn descended(places: &[Vec<f64>], held: &[bool]) -> Vec<Vec<f64>> {
    let mut moved = places.to_vec();
    let mut bends = vec![0.0; places.len()];
    for k in 0..places.first().map_or(0, Vec::len) {
        let mut line: Vec<f64> = places.iter().map(|place| place[k]).collect();
        for _ in 0..STEPS {
            for (bend, three) in bends.iter_mut().skip(1).zip(line.windows(3)) {
                *bend = three[0] - 2.0 * three[1] + three[2];
            }
            let slopes = bends.windows(3).map(|b| b[0] - 2.0 * b[1] + b[2]);
            for ((x, slope), held) in line.iter_mut().skip(1).zip(slopes).zip(&held[1..]) {
                if !held {
                    *x = (*x - LENGTH * slope).clamp(0.0, 1.0);
                }
            }
        }
        for (place, x) in moved.iter_mut().zip(line) {
            place[k] = x;
        }
    }
    moved
}

/// Sum of the squared second differences.
fn cost_of(places: &[Vec<f64>]) -> f64 {
    let bend = |three: &[Vec<f64>], k: usize| three[0][k] - 2.0 * three[1][k] + three[2][k];
    let squares =
        |three: &[Vec<f64>]| -> f64 { (0..three[1].len()).map(|k| bend(three, k).powi(2)).sum() };
    places.windows(3).map(squares).sum()
}
