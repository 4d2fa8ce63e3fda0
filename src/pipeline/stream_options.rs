//! What a training run on a stream is asked for.

use std::path::PathBuf;

use clap::Args;
use serde::Deserialize;
use tdcr_learn::data::{ObstacleVariation, PayloadRange, Recipe, StreamSpec, Subject};
use tdcr_learn::options::cli::{amount, positive};
use tdcr_sim::robot::RobotSpec;
use tdcr_sim::scene::Scene;

use super::collect_settings::{Noise, noise, obstacle_variation, payload_range, visibility};
use super::training_data::StreamSettings;

/// What a stream is made of, beside its robot, its scene and its seed. The one list of these options: the command line
/// (`tdcr train --stream`) and Python (`tdcr.train`) take their names and types from it, and the former its documentation.
/// In JSON a field has the name of its option.
#[derive(Clone, Debug, PartialEq, Args, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct StreamOptions {
    /// Show the robot's base to the stream's cameras
    #[arg(long, requires = "stream")]
    pub base: bool,
    /// Payloads of the stream (kg)
    #[arg(long, value_name = "MIN:MAX", value_parser = payload_range, requires = "stream", allow_hyphen_values = true)]
    pub payload: Option<PayloadRange>,
    /// Move the scene's obstacles anew for each sample of the stream, by up to SHIFT along each axis (m) and, where it is given, TURN
    /// about each (degrees); where they are is part of the condition. Half spaces stay
    #[arg(long, value_name = "SHIFT[:TURN]", value_parser = obstacle_variation, requires = "stream")]
    pub vary_obstacles: Option<ObstacleVariation>,
    /// Points per cloud of the stream
    #[arg(long, default_value_t = Self::default().stream_points, value_name = "N", value_parser = amount, requires = "stream")]
    pub stream_points: usize,
    /// Edge of the voxels that thin the stream's clouds (m)
    #[arg(long, default_value_t = Self::default().voxel, value_name = "M", value_parser = positive, requires = "stream")]
    pub voxel: f64,
    /// Simulate the noise of a real depth camera in the stream's clouds
    #[arg(long, value_enum, requires = "stream")]
    #[serde(deserialize_with = "noise")]
    pub noise: Option<Noise>,
    /// Clouds of the stream that a step draws from
    #[arg(long, default_value_t = Self::default().window, value_name = "N", value_parser = amount, requires = "stream")]
    pub window: usize,
    /// Clouds of the window that are replaced by fresh ones after each step
    #[arg(long, default_value_t = Self::default().fresh, value_name = "N", value_parser = amount, requires = "stream")]
    pub fresh: usize,
    /// Folder of a data set whose val split validates; by default clouds of the stream that no step sees
    #[arg(long, value_name = "DIR", requires = "stream")]
    pub validation: Option<PathBuf>,
}

impl Default for StreamOptions {
    fn default() -> Self {
        let StreamSettings {
            spec,
            window,
            fresh,
            validation,
        } = StreamSettings::default();
        Self {
            base: false,
            payload: None,
            vary_obstacles: None,
            stream_points: spec.points,
            voxel: spec.recipe.voxel_size,
            noise: None,
            window,
            fresh,
            validation,
        }
    }
}

impl StreamOptions {
    /// The stream of a robot in a scene.
    pub fn settings(&self, robot: RobotSpec, scene: Scene, seed: u64) -> StreamSettings {
        let subject = Subject {
            robot,
            base: visibility(self.base),
            payload: self.payload,
            scene,
            obstacles: self.vary_obstacles,
        };
        let recipe = Recipe {
            subject,
            voxel_size: self.voxel,
            sensor: self.noise.map(Noise::sensor),
        };
        StreamSettings {
            spec: StreamSpec {
                recipe,
                points: self.stream_points,
                seed,
            },
            window: self.window,
            fresh: self.fresh,
            validation: self.validation.clone(),
        }
    }
}
