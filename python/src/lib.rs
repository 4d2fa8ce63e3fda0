//! The native module `tdcr._tdcr` of the Python package: the libraries on NumPy arrays.
//!
//! It is thin. The Python package beside it (`python/tdcr/`) converts and names what users hand over, and documents what they
//! get; here arrays have their right types, and shapes are checked once more, as nothing may panic.
//!
//! | module | what it gives to Python |
//! |---|---|
//! | `robot` | `Robot`, from files or text |
//! | `loads` | `Loads`, and loads by rows |
//! | `statics` | equilibria, one or by rows |
//! | `scene` | `Scene`, from files or text |
//! | `contact` | equilibria among obstacles, one or by rows |
//! | `sensitivity` | derivatives of both by rows |
//! | `scene_gradient` | derivatives of the second by obstacles and base |
//! | `dynamics` | motions by rows |
//! | `steps` | how motions are computed |
//! | `dynamics_gradient` | gradients of motions by rows; linearised steps |
//! | `dynamics_tangent` | tangents of motions by rows |
//! | `moving_robot` | one robot in motion, step by step |
//! | `tendon_friction` | paths with friction in the holes |
//! | `tracking` | tips led along paths by controllers |
//! | `inverse` | commands for shapes, parameters from measurements |
//! | `plan` | motions among obstacles |
//! | `vision` | images and clouds |
//! | `metrics` | distances between clouds by rows |
//! | `data` | data sets: read, made, put together |
//! | `stream` | fresh samples, simulated as they are needed |
//! | `exchange` | clouds of other programs |
//! | `predictor` | `Predictor`: clouds by a trained model |
//! | `scoring` | scores of predicted clouds, data sets beside each other |
//! | `training` | training runs |
//! | `splat` | pictures of 3-D Gaussians, and their derivatives |
//! | `pages` | drawings of data sets, and the demo |
//! | `studies` | sweeps that one file describes |
//! | `sketch` | first robot files |
//! | `bags` | logs as bags of ROS 2 |
//! | `rig` | servos and cameras, in memory or on a desk |
//! | `env` | many simulated robots, advanced by one call |
//! | `command` | the command line |
//!
//! What they use: `run` (threads, the interpreter's lock, Ctrl-C), `stage` (the libraries' long stages),
//! `arrays` and `errors`.

mod arrays;
mod bags;
mod command;
mod contact;
mod data;
mod dynamics;
mod dynamics_gradient;
mod dynamics_tangent;
mod env;
mod errors;
mod exchange;
mod hint;
mod inverse;
mod loads;
mod metrics;
mod motions;
mod moving_robot;
mod objects;
mod options;
mod pages;
mod plan;
mod predictor;
mod recordings;
mod rig;
mod robot;
mod run;
mod scene;
mod scene_gradient;
mod scoring;
mod sensitivity;
mod sketch;
mod splat;
mod stage;
mod statics;
mod steps;
mod stiffness;
mod stream;
mod studies;
mod tendon_friction;
mod torch;
mod tracking;
mod training;
mod viewer;
mod vision;

/// The native part of the package `tdcr`.
// No interpreter without the lock has tested it yet.
#[pyo3::pymodule(gil_used = true)]
mod _tdcr {
    use pyo3::prelude::*;

    #[pymodule_export]
    use crate::bags::export_rosbag2;
    #[pymodule_export]
    use crate::command::run_command;
    #[pymodule_export]
    use crate::contact::{
        ContactRows, ContactSettler, follow_rows_among, settle_one_among, settle_rows_among,
    };
    #[pymodule_export]
    use crate::data::{Dataset, check_data, collect, merge};
    #[pymodule_export]
    use crate::dynamics::{MotionRows, rollout_rows};
    #[pymodule_export]
    use crate::dynamics_gradient::{RolloutGradientRows, linearise, rollout_vjp_rows};
    #[pymodule_export]
    use crate::dynamics_tangent::{RolloutTangentRows, rollout_jvp_rows};
    #[pymodule_export]
    use crate::env::BatchSimulation;
    #[pymodule_export]
    use crate::exchange::{export_clouds, import_clouds};
    #[pymodule_export]
    use crate::inverse::{Calibration, ShapeController, ShapePath, calibrate};
    #[pymodule_export]
    use crate::loads::Loads;
    #[pymodule_export]
    use crate::metrics::{chamfer_rows, emd_rows};
    #[pymodule_export]
    use crate::moving_robot::MovingRobot;
    #[pymodule_export]
    use crate::pages::{data_info, demo, draw_data};
    #[pymodule_export]
    use crate::plan::{follow_the_leader, plan};
    #[pymodule_export]
    use crate::predictor::Predictor;
    #[pymodule_export]
    use crate::recordings::{RecordingCalibration, ReplayedRecording, calibrate_recording};
    #[pymodule_export]
    use crate::rig::{Rig, record_background, while_released};
    #[pymodule_export]
    use crate::robot::{Robot, parameter_bounds};
    #[pymodule_export]
    use crate::run::{processors, set_threads, threads};
    #[pymodule_export]
    use crate::scene::Scene;
    #[pymodule_export]
    use crate::scene_gradient::{base_jacobian_rows, obstacle_jacobian_rows, scene_vjp_rows};
    #[pymodule_export]
    use crate::scoring::{compare, evaluate};
    #[pymodule_export]
    use crate::sensitivity::{jacobian_rows, jvp_rows, vjp_rows};
    #[pymodule_export]
    use crate::sketch::sketch;
    #[pymodule_export]
    use crate::splat::{blend_gaussians, blend_gaussians_backward};
    #[pymodule_export]
    use crate::statics::{EquilibriumRows, Settler, follow_rows, settle_one, settle_rows};
    #[pymodule_export]
    use crate::steps::Steps;
    #[pymodule_export]
    use crate::stiffness::smallest_stiffness_rows;
    #[pymodule_export]
    use crate::stream::Stream;
    #[pymodule_export]
    use crate::studies::{merge_study, study};
    #[pymodule_export]
    use crate::tendon_friction::FrictionPath;
    #[pymodule_export]
    use crate::torch::{
        presets, read_cloud_set, reduce, resolve_training, select_points, set_reduction,
        start_noise, train_settings, velocities,
    };
    #[pymodule_export]
    use crate::tracking::{TipPathOf, track_plant, track_rig, track_simulated};
    #[pymodule_export]
    use crate::training::{distill, train, train_options};
    #[pymodule_export]
    use crate::viewer::Viewer;
    #[pymodule_export]
    use crate::vision::{View, clouds, render, save_ply};

    #[pymodule_init]
    fn init(module: &Bound<'_, PyModule>) -> PyResult<()> {
        module.add("__version__", env!("CARGO_PKG_VERSION"))
    }
}
