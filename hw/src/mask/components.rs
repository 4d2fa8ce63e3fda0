//! What hangs together.

use tdcr_sim::render::RgbdFrame;

use super::{Mask, MaskError, Masker, Shot};

/// Which components are kept.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Keep {
    /// The one of the most pixels.
    Largest,
    /// Those of so many pixels at least.
    AtLeast(usize),
}

/// The components that are kept of what another masker takes for the robot.
#[derive(Clone, Debug)]
pub struct Components<M> {
    /// The masker.
    pub of: M,
    /// Which are kept.
    pub keep: Keep,
    /// Pixels hang together over gaps of so many others, in the row, the column and between: 0 for the eight neighbours. Lost
    /// depth parts the discs of a robot.
    pub gap: u32,
}

impl<M: Masker> Masker for Components<M> {
    fn mask(&self, frame: &RgbdFrame, shot: Shot) -> Result<Mask, MaskError> {
        let mask = self.of.mask(frame, shot)?;
        let numbers = number(&mask, self.gap as usize);
        let mut counts = vec![0_usize; numbers.iter().copied().max().unwrap_or(0) + 1];
        for &component in &numbers {
            counts[component] += 1;
        }
        // Of equally large components the first, from above, is the largest.
        let largest = (1..counts.len())
            .max_by_key(|&component| (counts[component], counts.len() - component));
        Ok(Mask::of_size(mask.size(), |index| {
            let component = numbers[index];
            component > 0
                && match self.keep {
                    Keep::Largest => Some(component) == largest,
                    Keep::AtLeast(least) => counts[component] >= least,
                }
        }))
    }
}

/// Numbers the components of a mask from 1, from above; 0 for pixels that are not in it.
fn number(mask: &Mask, gap: usize) -> Vec<usize> {
    let [width, height] = mask.size().map(|side| side as usize);
    let mut numbers = vec![0; mask.pixels().len()];
    let mut count = 0;
    let mut waiting = Vec::new();
    for first in 0..numbers.len() {
        if !mask.pixels()[first] || numbers[first] > 0 {
            continue;
        }
        count += 1;
        numbers[first] = count;
        waiting.push(first);
        while let Some(index) = waiting.pop() {
            let (u, v) = (index % width, index / width);
            for row in v.saturating_sub(gap + 1)..height.min(v + gap + 2) {
                for column in u.saturating_sub(gap + 1)..width.min(u + gap + 2) {
                    let near = row * width + column;
                    if mask.pixels()[near] && numbers[near] == 0 {
                        numbers[near] = count;
                        waiting.push(near);
                    }
                }
            }
        }
    }
    numbers
}
