//! How alike the samples of one command are.

use nalgebra::Vector3;

use super::record::Entry;
use super::settings::CaptureSettings;

/// Sums over the samples of each command under each payload, from which their spread follows.
pub(super) struct Repeats {
    /// Commands of a payload.
    commands: usize,
    /// Samples of a payload.
    samples: usize,
    sums: Vec<Sums>,
}

/// Welford's recurrence: the mean stays exact where the spread is far smaller than the distance from the origin.
#[derive(Clone, Copy, Default)]
struct Sums {
    count: usize,
    /// Mean of the centres (m).
    mean: Vector3<f64>,
    /// Sum of the squared distances from it (m²).
    squares: f64,
}

impl Repeats {
    /// Of what is captured.
    pub(super) fn new(settings: &CaptureSettings) -> Self {
        let commands = settings.distinct();
        Self {
            commands,
            samples: settings.samples_of_part(),
            sums: vec![Sums::default(); commands * settings.parts()],
        }
    }

    pub(super) fn count(&mut self, entry: &Entry) {
        if let Entry::Sample(record) = entry
            && let Some(centroid) = record.centroid
            && !self.sums.is_empty()
        {
            let index = record.index as usize;
            let (part, command) = (index / self.samples, index % self.commands);
            // Of a journal with more samples than are wanted now, the others count with none.
            if let Some(sums) = self.sums.get_mut(part * self.commands + command) {
                sums.add(centroid.into());
            }
        }
    }

    /// Root mean square distance (m) of a centre from the mean of its command, with one degree of freedom less for each command;
    /// `None` where none was captured twice.
    pub(super) fn spread(&self) -> Option<f64> {
        let repeated = self.sums.iter().filter(|sums| sums.count > 1);
        let [free, squares] = repeated.fold([0.0; 2], |[free, squares], sums| {
            [free + (sums.count - 1) as f64, squares + sums.squares]
        });
        (free > 0.0).then(|| (squares / free).sqrt())
    }
}

impl Sums {
    fn add(&mut self, centre: Vector3<f64>) {
        self.count += 1;
        let before = centre - self.mean;
        self.mean += before / self.count as f64;
        self.squares += before.dot(&(centre - self.mean));
    }
}
