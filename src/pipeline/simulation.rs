//! The simulated robot of a data set, which samples true shapes again.

use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use tdcr_learn::data::{Condition, Recipe, SimulateError, Simulator};
use tdcr_learn::flow::Sampler;
use tdcr_sim::cloud::PointCloud;
use tdcr_sim::robot::Robot;
use tdcr_sim::statics::Equilibrium;

use super::PipelineError;

/// The robot of a data set, and how it is seen.
pub(super) struct Simulation {
    pub robot: Robot,
    pub recipe: Recipe,
    /// Points of a cloud.
    points: usize,
}

/// Other samples of the surface that a test cloud is a sample of.
pub(super) struct Again {
    /// The same cameras and voxels in a random phase.
    pub view: PointCloud,
    /// Points that are independent of each other, as a perfect predictor draws them: with the spare ones of
    /// [`Sampler::DEFAULT`].
    pub independent: PointCloud,
}

/// Points that are drawn for a cloud of `points`, of which a selection is to be left.
pub(super) fn with_spare(points: usize) -> usize {
    Sampler::DEFAULT.drawn(points)
}

/// First random stream of the second samples, apart from the streams of the subsets of points.
const STREAMS: u64 = 1 << 63;

impl Simulation {
    /// Of a data set made by `recipe`, with `points` points a cloud.
    pub fn new(recipe: Recipe, points: usize) -> Result<Self, PipelineError> {
        Ok(Self {
            robot: Robot::new(recipe.subject.robot.clone())?,
            recipe,
            points,
        })
    }

    /// Where the discs are under a condition.
    pub fn settle(&self, condition: &Condition) -> Result<Equilibrium, SimulateError> {
        Simulator::new(&self.robot, &self.recipe)
            .settle(condition)
            .cloned()
    }

    /// Points of a cloud.
    pub fn points(&self) -> usize {
        self.points
    }

    /// What the cameras see under a condition, in a phase of pixels and voxels of its own: a function of `seed` and `index`.
    pub fn view(
        &self,
        condition: &Condition,
        seed: u64,
        index: usize,
    ) -> Result<PointCloud, SimulateError> {
        let (mut simulator, mut rng) = self.displaced(seed, index);
        simulator.cloud(condition, self.points, &mut rng)
    }

    /// A simulator with its pixels and voxels in a random phase, and what drew it.
    fn displaced(&self, seed: u64, index: usize) -> (Simulator, ChaCha8Rng) {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        rng.set_stream(STREAMS | index as u64);
        let mut simulator = Simulator::new(&self.robot, &self.recipe);
        simulator.displace(&mut rng);
        (simulator, rng)
    }

    /// Other samples of the surface of test command `index`, a function of `seed` and `index`.
    pub fn see_again(
        &self,
        condition: &Condition,
        seed: u64,
        index: usize,
    ) -> Result<Again, SimulateError> {
        let (mut simulator, mut rng) = self.displaced(seed, index);
        Ok(Again {
            view: simulator.cloud(condition, self.points, &mut rng)?,
            independent: simulator.independent_points(
                condition,
                with_spare(self.points),
                &mut rng,
            )?,
        })
    }
}
