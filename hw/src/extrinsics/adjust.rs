//! Bundle adjustment at fixed intrinsics: poses of cameras and of boards that minimise the reprojection errors.
//!
//! Levenberg's and Marquardt's method on the normal equations. Each error depends on one camera and one placement of the board,
//! so the placements are eliminated by Schur's complement and a system in the cameras alone is solved (Triggs et al., Bundle
//! adjustment: a modern synthesis, 2000, sec. 6). Errors are weighted by Huber's loss where asked for (iteratively reweighted
//! least squares).

use std::collections::BTreeMap;

use nalgebra::{Cholesky, DMatrix, DVector, Isometry3, Matrix6, Point3, SMatrix, Vector2, Vector6};
use tdcr_sim::camera::Intrinsics;

use super::project::{moved, project};

/// Steps tried at most: from poses of single images, ten are usual.
const MAX_STEPS: usize = 200;
const FIRST_DAMPING: f64 = 1e-4;
const LEAST_DAMPING: f64 = 1e-12;
const LARGEST_DAMPING: f64 = 1e12;
/// The minimum is found where a step promises less than this share of the cost.
const CONVERGED: f64 = 1e-12;

/// A corner of the board in an image.
#[derive(Clone, Copy, Debug)]
pub(super) struct Observation {
    /// Number of the camera.
    pub camera: usize,
    /// Number of the board's placement.
    pub placement: usize,
    /// The corner (m, the board's frame).
    pub point: Point3<f64>,
    /// Where it is seen.
    pub pixel: Vector2<f64>,
}

/// What is sought, each in one frame (m).
#[derive(Clone, Debug)]
pub(super) struct Poses {
    pub cameras: Vec<Isometry3<f64>>,
    pub placements: Vec<Isometry3<f64>>,
}

/// What stays where it is: reprojection errors do not say where the world is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Fixed {
    /// One camera.
    Camera(usize),
    /// One placement of the board.
    Placement(usize),
    /// All cameras.
    Cameras,
}

impl Fixed {
    fn camera(self, index: usize) -> bool {
        self == Self::Cameras || self == Self::Camera(index)
    }

    fn placement(self, index: usize) -> bool {
        self == Self::Placement(index)
    }
}

/// What an error costs.
#[derive(Clone, Copy, Debug)]
pub(super) enum Loss {
    /// Its square.
    Squares,
    /// Its square up to so many pixels, and beyond only linearly more.
    Huber(f64),
}

impl Loss {
    /// Cost and weight of an error of this length.
    fn of(self, error: f64) -> (f64, f64) {
        match self {
            Self::Huber(knee) if error > knee => (knee * (2.0 * error - knee), knee / error),
            _ => (error * error, 1.0),
        }
    }
}

/// Where an adjustment ended.
pub(super) struct Fit {
    pub poses: Poses,
    /// Seen minus projected, for each observation (pixels).
    pub errors: Vec<Vector2<f64>>,
    normal: Normal,
}

impl Fit {
    /// Sum of the squared errors (px²).
    pub fn squares(&self) -> f64 {
        self.errors.iter().map(Vector2::norm_squared).sum()
    }

    /// Covariance of the free cameras' (position, rotation) for errors of variance 1 px², 6 rows each in the cameras' order;
    /// `None` where the observations do not determine them.
    pub fn camera_covariance(&self) -> Option<DMatrix<f64>> {
        let (system, _) = self.normal.reduced(0.0)?;
        Cholesky::new(system).map(|factor| factor.inverse())
    }

    /// Number of a camera among the free ones.
    pub fn free_camera(&self, camera: usize) -> Option<usize> {
        self.normal.slots[camera]
    }

    /// Covariance of a placement's (position, rotation) for errors of variance 1 px², where all cameras are fixed.
    pub fn placement_covariance(&self, placement: usize) -> Option<Matrix6<f64>> {
        let block = self.normal.placements[placement]?.hessian;
        Cholesky::new(block).map(|factor| factor.inverse())
    }
}

/// Minimises the loss of the errors from `start`; `None` where a corner is not before its camera there.
pub(super) fn adjust(
    intrinsics: &[Intrinsics],
    observations: &[Observation],
    start: Poses,
    fixed: Fixed,
    loss: Loss,
) -> Option<Fit> {
    let (mut cost, mut fit) = evaluate(intrinsics, observations, start, fixed, loss)?;
    let mut damping = FIRST_DAMPING;
    for _ in 0..MAX_STEPS {
        if damping > LARGEST_DAMPING {
            break;
        }
        let Some(step) = fit.normal.step(damping) else {
            damping *= 10.0;
            continue;
        };
        if step.promise <= CONVERGED * cost {
            break;
        }
        let moved = step.applied(&fit.poses);
        match evaluate(intrinsics, observations, moved, fixed, loss) {
            Some((lower, next)) if lower < cost => {
                (cost, fit) = (lower, next);
                damping = (damping / 10.0).max(LEAST_DAMPING);
            }
            _ => damping *= 10.0,
        }
    }
    Some(fit)
}

/// Distance from where a corner is seen to where it should be (pixels); `None` where that is behind the camera.
pub(super) fn error_of(
    intrinsics: &[Intrinsics],
    poses: &Poses,
    observation: &Observation,
) -> Option<f64> {
    let projection = project(
        &intrinsics[observation.camera],
        &poses.cameras[observation.camera],
        &poses.placements[observation.placement],
        &observation.point,
    )?;
    Some((observation.pixel - projection.pixel).norm())
}

/// Gradient and Hessian of half the cost by one pose.
#[derive(Clone, Copy, Debug)]
struct Block {
    gradient: Vector6<f64>,
    hessian: Matrix6<f64>,
}

impl Block {
    const ZERO: Self = Self {
        gradient: Vector6::new(0.0, 0.0, 0.0, 0.0, 0.0, 0.0),
        hessian: Matrix6::from_array_storage(nalgebra::ArrayStorage([[0.0; 6]; 6])),
    };

    fn add(&mut self, jacobian: &SMatrix<f64, 2, 6>, error: &Vector2<f64>, weight: f64) {
        self.gradient -= jacobian.tr_mul(error) * weight;
        self.hessian += jacobian.tr_mul(jacobian) * weight;
    }

    /// Its Hessian with a larger diagonal.
    fn damped(&self, damping: f64) -> Matrix6<f64> {
        let diagonal = self.hessian.diagonal() * damping;
        self.hessian + Matrix6::from_diagonal(&diagonal)
    }
}

/// The normal equations at some poses.
struct Normal {
    /// By camera, the number among the free ones.
    slots: Vec<Option<usize>>,
    /// By camera.
    cameras: Vec<Block>,
    /// By placement; `None` where it is fixed or never seen.
    placements: Vec<Option<Block>>,
    /// By (placement, camera), both free: second derivatives by camera (rows) and placement.
    cross: BTreeMap<(usize, usize), Matrix6<f64>>,
}

struct Step {
    cameras: Vec<Vector6<f64>>,
    placements: Vec<Vector6<f64>>,
    /// By how much the quadratic model of the cost falls.
    promise: f64,
}

impl Step {
    fn applied(&self, poses: &Poses) -> Poses {
        let moved = |poses: &[Isometry3<f64>], steps: &[Vector6<f64>]| {
            poses
                .iter()
                .zip(steps)
                .map(|(pose, step)| moved(pose, step))
                .collect()
        };
        Poses {
            cameras: moved(&poses.cameras, &self.cameras),
            placements: moved(&poses.placements, &self.placements),
        }
    }
}

impl Normal {
    /// The damped equations of the free cameras alone, matrix and right side.
    fn reduced(&self, damping: f64) -> Option<(DMatrix<f64>, DVector<f64>)> {
        let free = self.slots.iter().flatten().count();
        let mut system = DMatrix::zeros(6 * free, 6 * free);
        let mut right = DVector::zeros(6 * free);
        for (camera, slot) in self.slots.iter().enumerate() {
            if let Some(slot) = slot {
                let block = &self.cameras[camera];
                system
                    .fixed_view_mut::<6, 6>(6 * slot, 6 * slot)
                    .copy_from(&block.damped(damping));
                right
                    .fixed_rows_mut::<6>(6 * slot)
                    .copy_from(&-block.gradient);
            }
        }
        for (placement, block) in self.placements.iter().enumerate() {
            let Some(block) = block else { continue };
            let inverse = Cholesky::new(block.damped(damping))?.inverse();
            let coupled: Vec<_> = self.coupled(placement).collect();
            for &(row, first) in &coupled {
                let product = first * inverse;
                let mut entry = right.fixed_rows_mut::<6>(6 * row);
                entry += product * block.gradient;
                for &(column, second) in &coupled {
                    let mut entry = system.fixed_view_mut::<6, 6>(6 * row, 6 * column);
                    entry -= product * second.transpose();
                }
            }
        }
        Some((system, right))
    }

    /// The free cameras that see a placement, with their blocks.
    fn coupled(&self, placement: usize) -> impl Iterator<Item = (usize, &Matrix6<f64>)> {
        let range = self.cross.range((placement, 0)..(placement + 1, 0));
        range.filter_map(|(&(_, camera), block)| Some((self.slots[camera]?, block)))
    }

    fn step(&self, damping: f64) -> Option<Step> {
        let (system, right) = self.reduced(damping)?;
        let solved = match right.is_empty() {
            true => right,
            false => Cholesky::new(system)?.solve(&right),
        };
        let of_slot = |slot: usize| solved.fixed_rows::<6>(6 * slot).into_owned();
        let cameras: Vec<Vector6<f64>> = self
            .slots
            .iter()
            .map(|slot| slot.map_or(Vector6::zeros(), of_slot))
            .collect();
        let mut placements = vec![Vector6::zeros(); self.placements.len()];
        let mut promise = 0.0;
        let mut count = |block: &Block, step: &Vector6<f64>| {
            let damped = block.hessian.diagonal().component_mul(step) * damping;
            promise += step.dot(&(damped - block.gradient));
        };
        for (placement, block) in self.placements.iter().enumerate() {
            let Some(block) = block else { continue };
            let mut right = -block.gradient;
            for (slot, cross) in self.coupled(placement) {
                right -= cross.tr_mul(&of_slot(slot));
            }
            placements[placement] = Cholesky::new(block.damped(damping))?.solve(&right);
            count(block, &placements[placement]);
        }
        for (camera, step) in cameras.iter().enumerate() {
            count(&self.cameras[camera], step);
        }
        Some(Step {
            cameras,
            placements,
            promise,
        })
    }
}

/// Cost, errors and normal equations at some poses; `None` where a corner is not before its camera.
fn evaluate(
    intrinsics: &[Intrinsics],
    observations: &[Observation],
    poses: Poses,
    fixed: Fixed,
    loss: Loss,
) -> Option<(f64, Fit)> {
    let mut free = 0;
    let mut slot = |camera| {
        (!fixed.camera(camera)).then(|| {
            free += 1;
            free - 1
        })
    };
    let mut normal = Normal {
        slots: (0..poses.cameras.len()).map(&mut slot).collect(),
        cameras: vec![Block::ZERO; poses.cameras.len()],
        placements: vec![None; poses.placements.len()],
        cross: BTreeMap::new(),
    };
    let mut errors = Vec::with_capacity(observations.len());
    let mut cost = 0.0;
    for seen in observations {
        let &Observation {
            camera, placement, ..
        } = seen;
        let projection = project(
            &intrinsics[camera],
            &poses.cameras[camera],
            &poses.placements[placement],
            &seen.point,
        )?;
        let error = seen.pixel - projection.pixel;
        let (this, weight) = loss.of(error.norm());
        cost += this;
        let camera_free = !fixed.camera(camera);
        if camera_free {
            normal.cameras[camera].add(&projection.by_camera, &error, weight);
        }
        if !fixed.placement(placement) {
            let block = normal.placements[placement].get_or_insert(Block::ZERO);
            block.add(&projection.by_placement, &error, weight);
            if camera_free {
                let cross = normal
                    .cross
                    .entry((placement, camera))
                    .or_insert_with(Matrix6::zeros);
                *cross += projection.by_camera.tr_mul(&projection.by_placement) * weight;
            }
        }
        errors.push(error);
    }
    cost.is_finite().then_some((
        cost,
        Fit {
            poses,
            errors,
            normal,
        },
    ))
}
