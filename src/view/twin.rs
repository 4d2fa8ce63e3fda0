//! What a network says of the robot that is shown, in a thread of its own: while it predicts, frames go on, and of the robots that
//! come meanwhile the newest is next.

use std::sync::{Arc, Condvar, Mutex, PoisonError};
use std::thread;
use std::time::Instant;

use nalgebra::{UnitQuaternion, Vector3};
use tdcr_learn::data::Recipe;
use tdcr_learn::metrics::{MetricError, nearest_distances};
use tdcr_learn::predict::PredictError;
use tdcr_learn::train::Model;
use tdcr_sim::chain::Configuration;
use tdcr_sim::cloud::{Observer, VoxelGrid};
use tdcr_sim::pose::Pose;
use tdcr_sim::render::BaseVisibility;
use tdcr_sim::robot::Robot;
use tdcr_sim::scene::Scene;
use thiserror::Error;
use tokio::sync::mpsc::Sender;

use super::cloud::{About, Role, bytes};
use super::message::{Refused, Reply};
use super::post::Output;

/// Points of a predicted cloud.
const POINTS: usize = 1024;
/// Colour of predicted points that have none of their own, 8-bit RGB.
const COLOR: [u8; 3] = [214, 51, 108];

/// A thread that predicts.
pub(super) struct Twin {
    shelf: Arc<Shelf>,
    has_payload: bool,
    condition: usize,
}

/// Where the newest robot waits.
#[derive(Default)]
struct Shelf {
    state: Mutex<State>,
    came: Condvar,
}

#[derive(Default)]
struct State {
    wanted: Option<Wanted>,
    ended: bool,
}

/// A robot that a cloud is wanted of.
#[derive(Clone, PartialEq)]
struct Wanted {
    condition: Vec<f64>,
    configuration: Configuration,
    positions: Vec<Vector3<f64>>,
    orientations: Vec<UnitQuaternion<f64>>,
    lengths: Vec<f64>,
    tensions: Vec<f64>,
}

/// Why there is no prediction.
#[derive(Debug, Error)]
pub enum TwinError {
    /// The model takes another number of values than the robot that is shown has.
    #[error(
        "the model takes {expected} values ({}), and the robot that is shown has {found}",
        if *.has_payload { "tendons and a payload" } else { "tendons" }
    )]
    Condition {
        /// Those of the model.
        expected: usize,
        /// Those of the robot.
        found: usize,
        /// Whether the model's last value is a payload.
        has_payload: bool,
    },
    /// What the model says.
    #[error(transparent)]
    Predict(#[from] PredictError),
    /// The clouds have no distance.
    #[error(transparent)]
    Distance(#[from] MetricError),
}

impl Twin {
    /// Predicts clouds of `robot`, and sends them to a page.
    pub fn new(model: Arc<Model>, robot: &Robot, scene: &Scene, outbox: Sender<Output>) -> Self {
        let subject = model.provenance.subject.as_ref();
        let has_payload = subject.is_some_and(|subject| subject.payload.is_some());
        let base = subject.map_or(BaseVisibility::Hidden, |subject| subject.base);
        let condition = model.provenance.normalisation.motor_min.len();
        let grid = VoxelGrid::new(Recipe::default().voxel_size);
        let mut observer = Observer::new(robot, base, grid).among(scene);
        let shelf = Arc::new(Shelf::default());
        let found = shelf.clone();
        thread::spawn(move || {
            while let Some(wanted) = found.next() {
                let output = match predict(&model, &mut observer, &wanted) {
                    Ok(message) => Output::Numbers(message),
                    Err(error) => Output::Words(Reply::Refused {
                        of: Refused::Prediction,
                        reason: error.to_string(),
                    }),
                };
                if outbox.blocking_send(output).is_err() {
                    return;
                }
            }
        });
        Self {
            shelf,
            has_payload,
            condition,
        }
    }

    /// Wants a cloud of the robot in a pose, under a command (m or N) and with a payload (kg).
    ///
    /// # Errors
    /// [`TwinError::Condition`] for a robot that the model is not of.
    pub fn want(&self, command: &[f64], payload: f64, pose: Pose<'_>) -> Result<(), TwinError> {
        let mut condition = command.to_vec();
        if self.has_payload {
            condition.push(payload);
        }
        if condition.len() != self.condition {
            return Err(TwinError::Condition {
                expected: self.condition,
                found: condition.len(),
                has_payload: self.has_payload,
            });
        }
        self.shelf.put(Wanted {
            condition,
            configuration: pose.configuration.clone(),
            positions: pose.positions.to_vec(),
            orientations: pose.orientations.to_vec(),
            lengths: pose.tendon_lengths.to_vec(),
            tensions: pose.tendon_tensions.to_vec(),
        });
        Ok(())
    }
}

impl Drop for Twin {
    fn drop(&mut self) {
        self.shelf.end();
    }
}

impl Shelf {
    /// Puts a robot there in place of the one that still waits.
    fn put(&self, wanted: Wanted) {
        let mut state = self.state.lock().unwrap_or_else(PoisonError::into_inner);
        state.wanted = Some(wanted);
        self.came.notify_one();
    }

    fn end(&self) {
        let mut state = self.state.lock().unwrap_or_else(PoisonError::into_inner);
        state.ended = true;
        self.came.notify_one();
    }

    /// The robot that waits, once there is one; `None` at the end.
    fn next(&self) -> Option<Wanted> {
        let mut state = self.state.lock().unwrap_or_else(PoisonError::into_inner);
        loop {
            if state.ended {
                return None;
            }
            if let Some(wanted) = state.wanted.take() {
                return Some(wanted);
            }
            state = (self.came.wait(state)).unwrap_or_else(PoisonError::into_inner);
        }
    }
}

/// A predicted cloud as a message, with the mean distance between its points and those that cameras see of the robot.
fn predict(model: &Model, observer: &mut Observer, wanted: &Wanted) -> Result<Vec<u8>, TwinError> {
    let begun = Instant::now();
    let sampler = &model.settings.sampler;
    let predicted = model.predict(&wanted.condition, POINTS, 0, sampler)?;
    let seconds = begun.elapsed().as_secs_f64();
    let truth = observer.observe(Pose {
        configuration: &wanted.configuration,
        positions: &wanted.positions,
        orientations: &wanted.orientations,
        tendon_lengths: &wanted.lengths,
        tendon_tensions: &wanted.tensions,
    });
    let cloud = predicted.into_cloud(COLOR);
    let distance = match truth.is_empty() {
        true => None,
        false => Some(apart(&cloud.points, &truth.points)?),
    };
    let about = About { distance, seconds };
    Ok(bytes(Role::Prediction, &cloud, about))
}

/// Mean distance (m) from the points of each cloud to the nearest of the other, both ways alike.
pub(super) fn apart(one: &[[f32; 3]], other: &[[f32; 3]]) -> Result<f64, MetricError> {
    let mean = |values: Vec<f64>| values.iter().sum::<f64>() / values.len() as f64;
    let there = mean(nearest_distances(one, other)?);
    Ok(f64::midpoint(there, mean(nearest_distances(other, one)?)))
}
