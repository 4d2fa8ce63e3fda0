//! How far a model is off on configurations that are in no data set.

use std::sync::Arc;

use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use tdcr_learn::data::{Condition, Subject};
use tdcr_learn::predict::Predictor;
use tdcr_learn::train::{FlowPredictor, Model};
use tdcr_sim::cloud::{Observer, VoxelGrid};
use tdcr_sim::render::BaseVisibility;
use tdcr_sim::robot::{Command, Loads, Robot};
use tdcr_sim::scene::Scene;
use tdcr_sim::statics::Equilibrium;

use super::PipelineError;
use super::eval_settings::Scoring;
use super::measure::{distances, subset};
use super::scores::Distances;
use super::tip::tip_error;

/// A model beside a robot that it was trained on, or one like it.
pub(crate) struct Probe {
    model: Arc<Model>,
    predictor: FlowPredictor,
    robot: Robot,
    base: BaseVisibility,
    scene: Scene,
    grid: VoxelGrid,
    scoring: Scoring,
}

/// What a predicted cloud scores.
pub(crate) struct Probed {
    /// Distances from the cloud that the cameras see.
    pub distances: Distances,
    /// Those of another sample of the true surface, which no predictor can be expected to beat.
    pub floor: Distances,
    /// Distance of the predicted tip from the true one (m); `None` where the true cloud shows too little of the last disc.
    pub tip: Option<f64>,
}

impl Probe {
    /// Of `model` with the sampler that it was validated with. The clouds are those of perfect cameras that see the base or not, and among
    /// obstacles, as those of the `subject`, in voxels of `voxel_size` (m).
    pub fn new(
        model: &Arc<Model>,
        robot: &Robot,
        subject: &Subject,
        voxel_size: f64,
        scoring: Scoring,
    ) -> Self {
        Self {
            model: model.clone(),
            predictor: FlowPredictor::new(model.clone(), model.settings.sampler),
            robot: robot.clone(),
            base: subject.base,
            scene: subject.scene.clone(),
            grid: VoxelGrid::new(voxel_size),
            scoring,
        }
    }

    /// Scores the cloud that the model predicts for a command, and for the payload where it knows payloads, beside that of the
    /// robot as it `settled`. All that is random follows from the seed and `index`.
    ///
    /// # Errors
    /// [`PipelineError`] where the command does not fit the model, or no camera sees the robot.
    pub fn score(
        &self,
        command: &Command,
        loads: &Loads,
        settled: &Equilibrium,
        index: u64,
    ) -> Result<Probed, PipelineError> {
        let Scoring {
            points,
            emd_points,
            seed,
            ..
        } = self.scoring;
        let subject = self.model.provenance.subject.as_ref();
        let knows_payload = subject.is_some_and(|subject| subject.payload.is_some());
        let condition = Condition {
            motors: command
                .as_slice()
                .iter()
                .map(|&value| value as f32)
                .collect(),
            payload: knows_payload.then(|| loads.tip_payload().mass as f32),
        };
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        rng.set_stream(index);
        let mut observer = Observer::new(&self.robot, self.base, self.grid).among(&self.scene);
        let truth = observer.observe(settled).sample_or_pad(points, &mut rng);
        observer.displace(&mut rng);
        let again = observer.observe(settled).sample_or_pad(points, &mut rng);
        let seed = seed.wrapping_add(index);
        let predicted = self.predictor.predict(&condition, points, seed)?.points;
        let cloud = subset(points, &predicted, &mut rng);
        let few = emd_points.min(truth.len());
        // For earth mover's distances, as in an evaluation: other points of the same view, where there are enough.
        let second = (truth.points.get(few..2 * few)).unwrap_or(&again.points[..few]);
        Ok(Probed {
            distances: distances(
                [&cloud, &truth.points],
                [&cloud[..few], &truth.points[..few]],
            )?,
            floor: distances(
                [&again.points, &truth.points],
                [second, &truth.points[..few]],
            )?,
            tip: tip_error(&self.robot, settled, &truth.points, &cloud)?,
        })
    }
}
