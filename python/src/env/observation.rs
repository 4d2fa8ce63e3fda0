//! What a policy is told of a robot.

use nalgebra::Vector3;

use super::row::Row;

/// Largest entries of an observation: places (lengths of the robot), joint rates (rad/s), the tip's velocity (lengths/s), tensions (N).
const LARGEST_PLACE: f64 = 2.0;
const LARGEST_RATE: f64 = 50.0;
const LARGEST_VELOCITY: f64 = 20.0;
const LARGEST_TENSION: f64 = 1000.0;

/// What is observed of a robot besides its command.
#[derive(Clone, Copy)]
pub struct Observed {
    /// All discs, or the tip alone.
    pub whole: bool,
    /// Also the tendons' tensions.
    pub tensions: bool,
}

/// What observations of places are measured by: an origin (m), and the length (m) that counts as 1.
#[derive(Clone, Copy)]
pub struct Scale {
    pub origin: Vector3<f64>,
    pub length: f64,
}

impl Row {
    /// Number of entries that [`Self::observe`] writes.
    pub fn width(&self, observed: Observed) -> usize {
        let (discs, tendons) = (self.own.discs().len(), self.own.tendons().len());
        let (at_rest, in_motion) = if observed.whole { (7, 3) } else { (6, 3) };
        let bodies = if observed.whole { discs } else { 1 };
        let moves = if self.duration > 0.0 { in_motion } else { 0 };
        let pulls = if observed.tensions { tendons } else { 0 };
        tendons + usize::from(self.carriage.is_some()) + bodies * (at_rest + moves) + pulls
    }

    /// Writes an observation: the command of each tendon (-1 to 1 over its range), that of a base that moves, then
    ///
    /// - of the `whole` robot the discs' places, their quaternions (w, x, y, z), and in motion the joints' rates (rad/s);
    /// - of the tip alone its place, its axis, and in motion its velocity (lengths/s);
    /// - where they are asked for, the tendons' tensions (N).
    pub fn observe(&self, scale: Scale, observed: Observed, out: &mut [f32]) {
        let (shown, moves, whole) = (&self.shown, self.duration > 0.0, observed.whole);
        let mut out = out.iter_mut();
        let mut put = |value: f64, largest: f64| {
            if let Some(out) = out.next() {
                *out = value.clamp(-largest, largest) as f32;
            }
        };
        let ranges = self.own.tendons().iter().map(|tendon| tendon.range);
        let ranges = ranges.chain(self.carriage.map(|carriage| carriage.range));
        let commands = self.command.as_slice().iter().chain([&self.insertion]);
        for ([low, high], command) in ranges.zip(commands) {
            let width = high - low;
            let share = (command - low) / if width > 0.0 { width } else { 1.0 };
            put(2.0 * share - 1.0, 1.0);
        }
        let place = |position: &Vector3<f64>| (position - scale.origin) / scale.length;
        let bodies = if whole { 0 } else { shown.positions.len() - 1 };
        for position in &shown.positions[bodies..] {
            place(position).iter().for_each(|&x| put(x, LARGEST_PLACE));
        }
        if whole {
            for q in &shown.orientations {
                [q.w, q.i, q.j, q.k].iter().for_each(|&x| put(x, 1.0));
            }
        } else if let Some(tip) = shown.orientations.last() {
            let axis = tip * Vector3::z();
            axis.iter().for_each(|&x| put(x, 1.0));
        }
        if moves && whole {
            shown.rates.iter().for_each(|&x| put(x, LARGEST_RATE));
        } else if moves {
            let velocity = shown.velocity / scale.length;
            velocity.iter().for_each(|&x| put(x, LARGEST_VELOCITY));
        }
        if observed.tensions {
            shown.tensions.iter().for_each(|&x| put(x, LARGEST_TENSION));
        }
    }
}
