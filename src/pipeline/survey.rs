//! What is in a data set.

use std::path::Path;

use rayon::prelude::*;
use tdcr_learn::data::{Condition, DataSet, Meta, Normalisation, Recipe, Sample, Simulator, Split};
use tdcr_sim::cloud::PointCloud;
use tdcr_sim::robot::{Robot, RobotSpec};

use super::{Monitor, PipelineError};

/// Share of a cloud's points whose mean stands for the tip where no robot says where it is.
const TIP_SHARE: f64 = 0.02;

/// Most clouds whose tips are estimated: each is read for it.
const MOST_ESTIMATED: usize = 2000;

/// A data set at a glance.
#[derive(Clone, Debug)]
pub struct Survey {
    /// The data set.
    pub set: DataSet,
    /// Samples of each split, in the order of [`Split::ALL`].
    pub counts: [usize; 3],
    /// Conditions of all splits.
    pub conditions: Vec<Condition>,
}

/// Where the tips are, and how that is known.
#[derive(Clone, Debug, PartialEq)]
pub enum Tips {
    /// Settled again under all conditions of all splits: world frame (m).
    Settled(Vec<[f64; 3]>),
    /// Estimated from the clouds: the mean of the points farthest from their lowest one.
    Estimated(Vec<[f64; 3]>),
}

impl Survey {
    /// Reads the conditions of the data set in the folder `dir`.
    ///
    /// # Errors
    /// [`PipelineError::Data`].
    pub fn open(dir: &Path) -> Result<Self, PipelineError> {
        let set = DataSet::open(dir)?;
        let mut conditions = Vec::new();
        let mut counts = [0; 3];
        for (split, count) in Split::ALL.into_iter().zip(&mut counts) {
            let read = set.conditions(split)?;
            *count = read.len();
            conditions.extend(read);
        }
        Ok(Self {
            set,
            counts,
            conditions,
        })
    }

    /// How the clouds were simulated; `None` where they were not.
    pub fn recipe(&self) -> Option<&Recipe> {
        self.set.meta().and_then(|meta| meta.origin.recipe())
    }

    /// The robot that the clouds show; `None` where nobody says.
    pub fn robot(&self) -> Option<&RobotSpec> {
        self.set.meta().and_then(Meta::robot)
    }

    /// The scales of motors and points.
    pub fn normalisation(&self) -> &Normalisation {
        self.set.normalisation()
    }

    /// Values of motor `motor` over all samples.
    pub fn motor(&self, motor: usize) -> Vec<f64> {
        let values = self.conditions.iter().map(|c| f64::from(c.motors[motor]));
        values.collect()
    }

    /// Number of motors, the payload left out.
    pub fn motors(&self) -> usize {
        self.conditions.first().map_or(0, |c| c.motors.len())
    }

    /// Payloads of all samples (kg); empty where there are none.
    pub fn payloads(&self) -> Vec<f64> {
        let payloads = self.conditions.iter().filter_map(|c| c.payload);
        payloads.map(f64::from).collect()
    }

    /// Up to `count` clouds of the test split, evenly spread; of the training split, where none tests.
    ///
    /// # Errors
    /// [`PipelineError::Data`].
    pub fn clouds(&self, count: usize) -> Result<Vec<PointCloud>, PipelineError> {
        let mut samples = self.set.read_split(Split::Test)?;
        if samples.is_empty() {
            samples = self.set.read_split(Split::Train)?;
        }
        let shown = spread(samples.len(), count);
        Ok(shown
            .map(|index| std::mem::take(&mut samples[index].cloud))
            .collect())
    }

    /// Where the tips are: by settling the robot again, or for data of unknown robots by a look at the clouds.
    ///
    /// # Errors
    /// [`PipelineError`] where the robot does not settle, the clouds cannot be read, or the monitor asks to stop.
    pub fn tips(&self, monitor: &dyn Monitor) -> Result<Tips, PipelineError> {
        let Some(recipe) = self.recipe() else {
            return self.estimated_tips(monitor).map(Tips::Estimated);
        };
        let robot = Robot::new(recipe.subject.robot.clone())?;
        monitor.begin("settle", self.conditions.len() as u64, 0);
        let tips = self.conditions.par_iter().map_init(
            || Simulator::new(&robot, recipe),
            |simulator, condition| {
                if monitor.interrupted() {
                    return Err(PipelineError::Abandoned);
                }
                let settled = simulator.settle(condition)?;
                monitor.advance(1);
                let tip = settled.positions.last().expect("a robot has a disc");
                Ok([tip.x, tip.y, tip.z])
            },
        );
        let tips: Result<_, PipelineError> = tips.collect();
        monitor.end();
        Ok(Tips::Settled(tips?))
    }

    /// Tips of the clouds of all splits, or of some evenly spread over them.
    fn estimated_tips(&self, monitor: &dyn Monitor) -> Result<Vec<[f64; 3]>, PipelineError> {
        let total: usize = self.counts.iter().sum();
        let stride = total.div_ceil(MOST_ESTIMATED).max(1);
        monitor.begin("find tips", total.div_ceil(stride) as u64, 0);
        let (mut tips, mut first) = (Vec::new(), 0);
        for split in Split::ALL {
            let samples = self.set.samples(split)?;
            for index in (first..samples.len()).step_by(stride) {
                if monitor.interrupted() {
                    return Err(PipelineError::Abandoned);
                }
                tips.extend(samples.read(index..index + 1)?.iter().map(estimated_tip));
                monitor.advance(1);
            }
            // Where the next split's first one is, for even distances.
            first = (stride - (samples.len() - first) % stride) % stride;
        }
        monitor.end();
        Ok(tips)
    }
}

/// Up to `count` of the indices below `length`, evenly spread, the first and the last among them.
fn spread(length: usize, count: usize) -> impl Iterator<Item = usize> {
    let count = count.min(length);
    (0..count).map(move |k| k * (length - 1) / (count.max(2) - 1))
}

/// The mean of the points of a cloud that are farthest from its lowest point.
fn estimated_tip(sample: &Sample) -> [f64; 3] {
    let mut points: Vec<[f64; 3]> = (sample.cloud.points.iter())
        .map(|p| p.map(f64::from))
        .collect();
    let lowest = points.iter().copied().min_by(|a, b| a[2].total_cmp(&b[2]));
    let lowest = lowest.unwrap_or_default();
    let squared = |p: &[f64; 3]| -> f64 { (0..3).map(|k| (p[k] - lowest[k]).powi(2)).sum() };
    points.sort_by(|a, b| squared(b).total_cmp(&squared(a)));
    points.truncate(((points.len() as f64 * TIP_SHARE) as usize).max(1));
    let count = points.len().max(1) as f64;
    std::array::from_fn(|k| points.iter().map(|p| p[k]).sum::<f64>() / count)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn as_many_clouds_are_shown_as_asked_for_where_there_are_as_many() {
        for (length, count) in [(200, 8), (20, 8), (12, 8), (8, 8), (3, 8), (7, 1), (0, 8)] {
            let shown: Vec<usize> = spread(length, count).collect();
            assert_eq!(shown.len(), count.min(length), "{count} of {length}");
            assert!(shown.is_sorted_by(|a, b| a < b) && shown.iter().all(|&k| k < length));
        }
        assert_eq!(spread(10, 4).collect::<Vec<_>>(), [0, 3, 6, 9]);
    }

    #[test]
    fn the_tip_of_a_column_is_estimated_at_its_top() {
        let cloud = PointCloud {
            points: (0..1000).map(|k| [0.1, 0.2, k as f32 / 1000.0]).collect(),
            colors: vec![[0; 3]; 1000],
        };
        let condition = Condition {
            motors: vec![0.0],
            payload: None,
        };
        let [x, y, z] = estimated_tip(&Sample { condition, cloud });
        assert!((x - 0.1).abs() < 1e-6 && (y - 0.2).abs() < 1e-6);
        assert!((z - 0.9895).abs() < 1e-6, "{z}");
    }
}
