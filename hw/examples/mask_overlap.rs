//! Measures how well maskers find robots on a table in rendered pictures of D435 cameras: the table of `docs/masks.md`.
//!
//! ```text
//! cargo run --release -p tdcr-hw --example mask_overlap [POSES]
//! ```
#![allow(
    clippy::print_stdout,
    reason = "the table is what the example is run for"
)]

use std::collections::VecDeque;
use std::env;
use std::error::Error;
use std::sync::Arc;
use std::time::Duration;

use nalgebra::Vector3;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;
use tdcr_hw::camera::RgbdCamera;
use tdcr_hw::clock::VirtualClock;
use tdcr_hw::mask::{
    Background, BackgroundLearner, BackgroundSetting, ColorKey, Keep, Mask, Masker, Overlap, Shot,
    WorkspaceBox,
};
use tdcr_hw::simulated::camera::{CameraSetup, SimulatedCamera, Subject, table};
use tdcr_sim::camera::Camera;
use tdcr_sim::geometry::Instance;
use tdcr_sim::render::{BaseVisibility, Visuals};
use tdcr_sim::robot::{Command, Loads, Robot};
use tdcr_sim::statics::Settler;

type Failure = Box<dyn Error + Send + Sync>;

const ROBOTS: [&str; 3] = ["2m", "3m", "5m"];
/// Every other camera of the robots' rings of eight.
const VIEWS: [usize; 4] = [0, 2, 4, 6];
/// Pictures of the empty scene.
const EMPTY: usize = 30;
/// Poses of each robot, where the command line does not say how many.
const POSES: usize = 24;
const PATIENCE: Duration = Duration::from_secs(1);

/// Shows one after the other, a picture each.
struct Show(VecDeque<Visuals>);

impl Subject for Show {
    fn visuals_at(&mut self, _: Duration) -> Visuals {
        self.0.pop_front().unwrap_or_default()
    }
}

/// A robot on a table, in some poses.
struct Setting {
    robot: Robot,
    poses: Vec<Visuals>,
    surroundings: Visuals,
    workspace: WorkspaceBox,
}

impl Setting {
    fn new(name: &str, poses: usize) -> Result<Self, Failure> {
        let robot = Robot::load(name)?;
        let mut settler = Settler::new(&robot);
        let mut rng = ChaCha8Rng::seed_from_u64(1);
        let mut pose = |command: &Command| {
            let equilibrium = settler.settle(command, &Loads::default());
            Visuals::of_robot(&robot, equilibrium, BaseVisibility::Hidden)
        };
        let straight = pose(&robot.mean_command());
        let poses = (0..poses)
            .map(|_| pose(&robot.random_command(&mut rng)))
            .collect();
        // The base stands on the table and does not move.
        let mut surroundings = table(0.0)?;
        let whole = Visuals::of_robot(&robot, settler.equilibrium(), BaseVisibility::Shown);
        let base = whole
            .solids
            .into_iter()
            .filter(|solid| solid.instance == Instance::Base);
        surroundings.solids.extend(base);
        // What the robot can reach, for who knows its length: 5 cm more to the sides and above.
        let base = Vector3::from(robot.spec().base.position);
        let heights = straight.solids.iter().map(|solid| solid.pose.translation.z);
        let reach = heights.fold(0.0, f64::max) - base.z + 0.05;
        let workspace = WorkspaceBox {
            low: [base.x - reach, base.y - reach, base.z - 0.02],
            high: [base.x + reach, base.y + reach, base.z + reach],
        };
        Ok(Self {
            robot,
            poses,
            surroundings,
            workspace,
        })
    }

    /// What camera `view` sees: each masker's overlap with the truth over pixels that have a depth, and over all.
    fn measure(&self, view: usize) -> Result<Vec<[Overlap; 2]>, Failure> {
        let camera = Camera::placed(&self.robot.spec().cameras).swap_remove(view);
        let setup = CameraSetup {
            number: view as u64,
            surroundings: self.surroundings.clone(),
            ..CameraSetup::d435(format!("camera{view}"), camera)
        };
        let mut shown: VecDeque<_> = (0..EMPTY).map(|_| Visuals::default()).collect();
        shown.extend(self.poses.iter().cloned());
        let mut camera =
            SimulatedCamera::new(setup, Box::new(Show(shown)), Arc::new(VirtualClock::new()));
        let mut learner = BackgroundLearner::new();
        for _ in 0..EMPTY {
            learner.add(0, &camera.grab(PATIENCE)?.value)?;
        }
        let maskers = maskers(
            &learner.finish(&BackgroundSetting::default())?,
            self.workspace,
        );
        let mut overlaps = vec![[Overlap::default(); 2]; maskers.len()];
        for sample in 0..self.poses.len() {
            let frame = camera.grab(PATIENCE)?.value;
            let truth = Mask::of_robot(camera.truth().ok_or("a picture was taken")?);
            for ((_, masker), [measured, all]) in maskers.iter().zip(&mut overlaps) {
                let mask = masker.mask(&frame, Shot { view: 0, sample })?;
                let of = |counts: &dyn Fn(usize) -> bool| {
                    mask.overlap(&truth, counts).unwrap_or_default()
                };
                measured.add(of(&|index| frame.depth[index] > 0.0));
                all.add(of(&|_| true));
            }
        }
        Ok(overlaps)
    }
}

/// The maskers, by name.
fn maskers(
    background: &Background,
    workspace: WorkspaceBox,
) -> Vec<(&'static str, Box<dyn Masker>)> {
    let near = || background.clone();
    let colors = ColorKey::saturated(0.5);
    let both = || near().and(workspace);
    vec![
        ("background", Box::new(near())),
        ("box", Box::new(workspace)),
        ("saturated colours", Box::new(colors)),
        ("box and colours", Box::new(workspace.and(colors))),
        ("background and box", Box::new(both())),
        (
            "background and box, components of 50 pixels",
            Box::new(both().keeping(Keep::AtLeast(50), 2)),
        ),
        (
            "background and box, largest component",
            Box::new(both().keeping(Keep::Largest, 2)),
        ),
        ("background and colours", Box::new(near().and(colors))),
    ]
}

fn main() -> Result<(), Failure> {
    let poses = env::args()
        .nth(1)
        .map_or(Ok(POSES), |poses| poses.parse())?;
    let mut rows: Vec<(Vec<f64>, [Overlap; 2])> = Vec::new();
    let names: Vec<_> = {
        let background = BackgroundLearner::new().finish(&BackgroundSetting::default())?;
        let workspace = WorkspaceBox {
            low: [0.0; 3],
            high: [0.0; 3],
        };
        maskers(&background, workspace)
            .into_iter()
            .map(|(name, _)| name)
            .collect()
    };
    rows.resize(names.len(), Default::default());
    for robot in ROBOTS {
        let setting = Setting::new(robot, poses)?;
        let views: Result<Vec<_>, _> = VIEWS
            .par_iter()
            .map(|view| setting.measure(*view))
            .collect();
        let mut sums = vec![[Overlap::default(); 2]; names.len()];
        for overlaps in views? {
            for (sum, overlap) in sums.iter_mut().zip(overlaps) {
                sum[0].add(overlap[0]);
                sum[1].add(overlap[1]);
            }
        }
        for ((ious, total), sum) in rows.iter_mut().zip(sums) {
            ious.push(sum[0].iou());
            total[0].add(sum[0]);
            total[1].add(sum[1]);
        }
    }
    println!(
        "| masker | {} | precision | recall | IoU of all pixels |",
        ROBOTS.join(" | ")
    );
    println!("|---|{}", "---|".repeat(ROBOTS.len() + 3));
    for (name, (ious, [measured, all])) in names.iter().zip(rows) {
        let ious: Vec<_> = ious.iter().map(|iou| format!("{iou:.3}")).collect();
        let (precision, recall) = (measured.precision(), measured.recall());
        println!(
            "| {name} | {} | {precision:.3} | {recall:.3} | {:.3} |",
            ious.join(" | "),
            all.iou()
        );
    }
    Ok(())
}
