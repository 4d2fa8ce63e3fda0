//! The simulated robot of a data set, which shows true shapes again.

use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use tdcr_learn::data::{CloudSet, Condition, DataSet, Recipe, SimulateError, Simulator};
use tdcr_sim::cloud::PointCloud;
use tdcr_sim::robot::Robot;
use tdcr_sim::statics::Equilibrium;

use super::PipelineError;

/// The robot of a data set, and how it is seen.
pub(super) struct Simulation {
    pub robot: Robot,
    recipe: Recipe,
    /// Points of a cloud.
    points: usize,
    /// Cloud of the mean training command.
    pub mean: PointCloud,
}

/// Other samples of the surface that a test cloud is a sample of.
pub(super) struct Again {
    /// The same cameras and voxels in a random phase.
    pub view: PointCloud,
    /// Points that are independent of each other, as a perfect predictor draws them.
    pub independent: PointCloud,
}

/// The random streams of what is seen again, away from those of the subsets of points.
const STREAMS: u64 = 1 << 63;

impl Simulation {
    /// Of the data set `set`, with training clouds `training`; `seed` chooses the points of the mean command's cloud.
    pub fn new(
        recipe: Recipe,
        set: &DataSet,
        training: &CloudSet,
        seed: u64,
    ) -> Result<Self, PipelineError> {
        let robot = Robot::new(recipe.subject.robot.clone())?;
        let normalisation = set.normalisation();
        let mean_of = |value: usize| -> f32 {
            let sum: f64 = (0..training.len())
                .map(|k| f64::from(training.condition(k)[value]))
                .sum();
            let (low, high) = (
                normalisation.motor_min[value],
                normalisation.motor_max[value],
            );
            (low + (high - low) * sum / training.len() as f64) as f32
        };
        let mut motors: Vec<f32> = (0..training.condition_dim).map(mean_of).collect();
        let payload = match recipe.subject.payload {
            Some(_) => motors.pop(),
            None => None,
        };
        let condition = Condition { motors, payload };
        let points = training.points_per_cloud;
        let mut simulator = Simulator::new(&robot, &recipe);
        let mean = simulator.cloud(&condition, points, &mut ChaCha8Rng::seed_from_u64(seed))?;
        Ok(Self {
            robot,
            recipe,
            points,
            mean,
        })
    }

    /// Where the discs are under a condition.
    pub fn settle(&self, condition: &Condition) -> Result<Equilibrium, SimulateError> {
        Simulator::new(&self.robot, &self.recipe)
            .settle(condition)
            .cloned()
    }

    /// Other samples of the surface of test command `index`, a function of `seed` and `index`.
    pub fn see_again(
        &self,
        condition: &Condition,
        seed: u64,
        index: usize,
    ) -> Result<Again, SimulateError> {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        rng.set_stream(STREAMS | index as u64);
        let mut simulator = Simulator::new(&self.robot, &self.recipe);
        simulator.displace(&mut rng);
        Ok(Again {
            view: simulator.cloud(condition, self.points, &mut rng)?,
            independent: simulator.independent_points(condition, self.points, &mut rng)?,
        })
    }
}
