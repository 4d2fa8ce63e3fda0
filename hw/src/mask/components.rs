//! What hangs together.

use std::collections::BTreeMap;
use std::ops::Range;

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
///
/// A run of pixels in a row joins the runs that begin or end within the gap from it, in the rows within the gap. Each run is
/// taken once from its row, so the time is that of the runs times the rows within a gap, whatever its width.
fn number(mask: &Mask, gap: usize) -> Vec<usize> {
    let [width, height] = mask.size().map(|side| side as usize);
    let mut numbers = vec![0; mask.pixels().len()];
    let mut rows: Vec<Row> = (mask.pixels().chunks_exact(width.max(1)))
        .map(Row::of)
        .collect();
    let reach = gap.saturating_add(1);
    let mut count = 0;
    let mut waiting = Vec::new();
    for first in 0..rows.len() {
        while let Some((start, end)) = rows[first].0.pop_first() {
            count += 1;
            waiting.push((first, start..end));
            while let Some((row, run)) = waiting.pop() {
                numbers[row * width + run.start..row * width + run.end].fill(count);
                let near = row.saturating_sub(reach)
                    ..height.min(row.saturating_add(reach).saturating_add(1));
                for near in near {
                    let columns = run.start.saturating_sub(reach)..run.end.saturating_add(reach);
                    while let Some(run) = rows[near].take(columns.start, columns.end) {
                        waiting.push((near, run));
                    }
                }
            }
        }
    }
    numbers
}

/// The runs of a row that have no number yet, from the left.
struct Row(BTreeMap<usize, usize>);

impl Row {
    fn of(pixels: &[bool]) -> Self {
        let mut runs = BTreeMap::new();
        let mut column = 0;
        for run in pixels.chunk_by(|a, b| a == b) {
            if run[0] {
                runs.insert(column, column + run.len());
            }
            column += run.len();
        }
        Self(runs)
    }

    /// Takes a run that has a pixel in the columns from `start` to `end`, without that.
    fn take(&mut self, start: usize, end: usize) -> Option<Range<usize>> {
        let (&first, &last) = self.0.range(..end).next_back()?;
        (last > start).then(|| {
            self.0.remove(&first);
            first..last
        })
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    /// By the definition: pixels hang together that are no more than the gap apart, and all that hangs together with them.
    fn by_definition(mask: &Mask, gap: usize) -> Vec<usize> {
        let width = mask.size()[0] as usize;
        let apart = |a: usize, b: usize| {
            let [row, column] = [
                (a / width).abs_diff(b / width),
                (a % width).abs_diff(b % width),
            ];
            row.max(column)
        };
        let mut numbers = vec![0; mask.pixels().len()];
        let mut count = 0;
        for first in 0..numbers.len() {
            if !mask.pixels()[first] || numbers[first] > 0 {
                continue;
            }
            count += 1;
            numbers[first] = count;
            let mut waiting = vec![first];
            while let Some(at) = waiting.pop() {
                let joins = |near: &usize| {
                    mask.pixels()[*near] && numbers[*near] == 0 && apart(at, *near) <= gap + 1
                };
                let joined: Vec<usize> = (0..numbers.len()).filter(joins).collect();
                for near in joined {
                    numbers[near] = count;
                    waiting.push(near);
                }
            }
        }
        numbers
    }

    proptest! {
        #[test]
        fn components_are_those_of_the_definition(
            width in 1..14_u32, height in 1..10_u32, gap in 0..5_usize, bits in prop::collection::vec(0.0..1.0, 126), share in 0.0..1.0,
        ) {
            let mask = Mask::of_size([width, height], |index| bits[index] < share);
            prop_assert_eq!(number(&mask, gap), by_definition(&mask, gap));
        }
    }

    /// It took as many steps as the picture has pixels, squared.
    #[test]
    fn the_largest_gap_takes_no_longer_than_others() {
        let mask = Mask::of_size([640, 480], |index| index % 7 < 5);
        let numbers = number(&mask, u32::MAX as usize);
        assert!(
            numbers
                .iter()
                .zip(mask.pixels())
                .all(|(n, shown)| *n == usize::from(*shown))
        );
        assert_eq!(
            number(&Mask::of_size([0, 0], |_| true), usize::MAX),
            [0_usize; 0]
        );
    }
}
