//! From corners in images to the poses of all cameras.

use nalgebra::{Isometry3, Point3, Vector2, Vector3};
use tdcr_base::stats::median;
use tdcr_sim::camera::{Camera, Intrinsics};

use super::adjust::{Fit, Fixed, Loss, Observation, Poses, adjust, error_of};
use super::board::Board;
use super::detect::Corner;
use super::graph::{Graph, Link, Node};
use super::outcome::{
    CalibratedCamera, Calibration, CalibrationError, FEWEST_CORNERS, PlacedBoard, RejectedCorner,
};
use super::planar::planar_pose;

/// A corner is rejected whose error is so many times the noise: of normal errors one in 3000 is.
const REJECTED: f64 = 4.0;
/// Knee of Huber's loss, in the same unit (Huber, Robust statistics, 1981: 95 % efficient on normal errors).
const KNEE: f64 = 1.5;
/// Noise to start with, and the least that is believed (pixels).
const FIRST_NOISE: f64 = 1.0;
const LEAST_NOISE: f64 = 1e-3;
/// Median length of an error whose two parts are normal with deviation 1.
const RAYLEIGH_MEDIAN: f64 = 1.177_410_022_515_474_6;
const ROUNDS: usize = 10;

/// A camera whose pose is sought.
#[derive(Clone, Debug, PartialEq)]
pub struct KnownCamera {
    /// Its serial number.
    pub serial: String,
    /// Its lens, which stays as it is.
    pub intrinsics: Intrinsics,
}

/// The board as one camera saw it in one view.
#[derive(Clone, Debug, PartialEq)]
pub struct Sighting {
    /// Number of the camera.
    pub camera: usize,
    /// Number of the view: in all sightings of a view the board stands at one place.
    pub view: usize,
    /// The corners found.
    pub corners: Vec<Corner>,
}

/// What the poses are relative to.
#[derive(Clone, Debug, PartialEq)]
pub enum World {
    /// The first camera's frame.
    FirstCamera,
    /// The world in which the board stood at a known pose in one view: mounted to the robot's base, for one.
    Board {
        /// Name of the view.
        view: String,
        /// Pose of the board's frame in the world (m).
        pose: Isometry3<f64>,
    },
}

/// The poses of `cameras` from what they see of `board`, which stood at one place in each of the `views` (names).
///
/// First poses are chained along the surest sightings; bundle adjustment with Huber's loss refines all of them together; then
/// corners whose errors are beyond the noise are left out, and the rest is adjusted by least squares until no corner comes or
/// goes.
///
/// # Errors
/// [`CalibrationError`] where the sightings do not determine all poses.
pub fn calibrate(
    board: &Board,
    cameras: &[KnownCamera],
    views: &[String],
    sightings: &[Sighting],
    world: &World,
) -> Result<Calibration, CalibrationError> {
    let problem = Problem {
        board,
        cameras,
        views,
        world: match world {
            World::FirstCamera => None,
            World::Board { view, pose } => {
                let unseen = || CalibrationError::WorldUnseen { view: view.clone() };
                let view = views.iter().position(|name| name == view);
                Some((view.ok_or_else(unseen)?, *pose))
            }
        },
    };
    problem.solve(sightings)
}

struct Problem<'a> {
    board: &'a Board,
    cameras: &'a [KnownCamera],
    views: &'a [String],
    /// The view in which the board's pose is known.
    world: Option<(usize, Isometry3<f64>)>,
}

impl Problem<'_> {
    fn solve(&self, sightings: &[Sighting]) -> Result<Calibration, CalibrationError> {
        let found = self.cameras.len();
        if found == 0 || (found == 1 && self.world.is_none()) {
            return Err(CalibrationError::TooFewCameras { found });
        }
        let (links, observations) = self.sight(sightings);
        if links.is_empty() {
            let views = self.views.len();
            return Err(CalibrationError::NoBoard { views });
        }
        let start = self.chain(&links)?;
        let intrinsics: Vec<Intrinsics> = self.cameras.iter().map(|c| c.intrinsics).collect();
        let fixed = match self.world {
            None => Fixed::Camera(0),
            Some((view, _)) => Fixed::Placement(view),
        };
        let adjust = |seen: &[Seen], start: Poses, loss: Loss| {
            let observations: Vec<Observation> = seen.iter().map(|seen| seen.observation).collect();
            adjust(&intrinsics, &observations, start, fixed, loss)
                .ok_or(CalibrationError::Undetermined)
        };
        let mut poses = start;
        let mut noise = FIRST_NOISE;
        for _ in 0..3 {
            let fit = adjust(&observations, poses, Loss::Huber(KNEE * noise))?;
            noise = median_noise(fit.errors.iter().map(|error| Some(error.norm())));
            poses = fit.poses;
        }
        let mut kept = Vec::new();
        for _ in 0..ROUNDS {
            let errors: Vec<Option<f64>> = observations
                .iter()
                .map(|seen| error_of(&intrinsics, &poses, &seen.observation))
                .collect();
            noise = median_noise(errors.iter().copied());
            let chosen = choose(&observations, &errors, REJECTED * noise);
            if chosen == kept {
                break;
            }
            kept = chosen;
            let seen: Vec<Seen> = kept.iter().map(|&index| observations[index]).collect();
            self.related(&seen)?;
            poses = adjust(&seen, poses, Loss::Squares)?.poses;
        }
        let seen: Vec<Seen> = kept.iter().map(|&index| observations[index]).collect();
        let fit = adjust(&seen, poses, Loss::Squares)?;
        let mut rejected = vec![true; observations.len()];
        kept.iter().for_each(|&index| rejected[index] = false);
        let rejected = observations
            .iter()
            .zip(rejected)
            .filter(|(_, rejected)| *rejected);
        let rejected = rejected.map(|(seen, _)| RejectedCorner {
            serial: self.cameras[seen.observation.camera].serial.clone(),
            view: self.views[seen.observation.placement].clone(),
            corner: seen.corner,
            error: error_of(&intrinsics, &fit.poses, &seen.observation),
        });
        let rejected = rejected.collect();
        self.report(&seen, &fit, rejected)
    }

    /// What the sightings say singly: the board's pose in a camera's frame, and all corners. Those that say nothing are left out.
    fn sight(&self, sightings: &[Sighting]) -> (Vec<Link>, Vec<Seen>) {
        let (mut links, mut observations) = (Vec::new(), Vec::new());
        for sighting in sightings {
            let known = |corner: &Corner| Some((self.board.corner(corner.id)?, corner.pixel));
            let corners: Vec<(Point3<f64>, Vector2<f64>)> =
                sighting.corners.iter().filter_map(known).collect();
            if corners.len() < FEWEST_CORNERS {
                continue;
            }
            let intrinsics = &self.cameras[sighting.camera].intrinsics;
            let Some(planar) = planar_pose(intrinsics, &corners) else {
                continue;
            };
            links.push(Link {
                camera: sighting.camera,
                view: sighting.view,
                pose: planar.pose,
                variance: planar.variance,
            });
            let known = sighting.corners.iter().filter_map(|corner| {
                let point = self.board.corner(corner.id)?;
                Some(Seen {
                    corner: corner.id,
                    observation: Observation {
                        camera: sighting.camera,
                        placement: sighting.view,
                        point,
                        pixel: corner.pixel,
                    },
                })
            });
            observations.extend(known);
        }
        (links, observations)
    }

    /// First poses: from the world along the surest sightings.
    fn chain(&self, links: &[Link]) -> Result<Poses, CalibrationError> {
        let graph = Graph::new(self.cameras.len(), self.views.len(), links);
        self.check(&graph)?;
        let reached = match self.world {
            None => graph.chain(Node::Camera(0), Isometry3::identity()),
            Some((view, pose)) => graph.chain(Node::View(view), pose),
        };
        // Views that nobody sees have no observations: any pose serves.
        let pose = |pose: Option<Isometry3<f64>>| pose.unwrap_or_else(Isometry3::identity);
        Ok(Poses {
            cameras: reached.cameras.into_iter().map(pose).collect(),
            placements: reached.views.into_iter().map(pose).collect(),
        })
    }

    /// Whether corners still relate all cameras.
    fn related(&self, seen: &[Seen]) -> Result<(), CalibrationError> {
        let mut pairs: Vec<(usize, usize)> = seen
            .iter()
            .map(|seen| (seen.observation.camera, seen.observation.placement))
            .collect();
        pairs.dedup();
        let links: Vec<Link> = pairs
            .into_iter()
            .map(|(camera, view)| Link::between(camera, view))
            .collect();
        self.check(&Graph::new(self.cameras.len(), self.views.len(), &links))
    }

    fn check(&self, graph: &Graph) -> Result<(), CalibrationError> {
        let serial = |camera: &usize| self.cameras[*camera].serial.clone();
        let blind: Vec<usize> = (0..self.cameras.len())
            .filter(|&c| graph.is_blind(c))
            .collect();
        if !blind.is_empty() {
            let serials = blind.iter().map(serial).collect();
            return Err(CalibrationError::Blind { serials });
        }
        if let Some((view, _)) = self.world
            && graph.is_unseen(view)
        {
            let view = self.views[view].clone();
            return Err(CalibrationError::WorldUnseen { view });
        }
        let groups = graph.groups();
        if groups.len() > 1 {
            let groups = groups
                .iter()
                .map(|group| group.iter().map(serial).collect());
            return Err(CalibrationError::Disconnected {
                groups: groups.collect(),
            });
        }
        Ok(())
    }

    fn report(
        &self,
        seen: &[Seen],
        fit: &Fit,
        rejected: Vec<RejectedCorner>,
    ) -> Result<Calibration, CalibrationError> {
        let undetermined = || CalibrationError::Undetermined;
        let covariance = fit.camera_covariance().ok_or_else(undetermined)?;
        let mut placements: Vec<usize> = seen.iter().map(|s| s.observation.placement).collect();
        placements.sort_unstable();
        placements.dedup();
        let fixed = usize::from(self.world.is_some());
        let unknowns = covariance.nrows() + 6 * (placements.len() - fixed);
        let freedom = (2 * seen.len())
            .checked_sub(unknowns)
            .filter(|&freedom| freedom > 0);
        let noise = (fit.squares() / freedom.ok_or_else(undetermined)? as f64).sqrt();
        let errors = |of: &dyn Fn(&Observation) -> bool| {
            let chosen = seen
                .iter()
                .zip(&fit.errors)
                .filter(|(seen, _)| of(&seen.observation));
            chosen.fold((0, 0.0), |(count, sum), (_, error)| {
                (count + 1, sum + error.norm_squared())
            })
        };
        let others = |of: &dyn Fn(&Observation) -> Option<usize>| {
            let mut others: Vec<usize> = seen.iter().filter_map(|s| of(&s.observation)).collect();
            others.sort_unstable();
            others.dedup();
            others.len()
        };
        let cameras = self.cameras.iter().enumerate().map(|(index, known)| {
            let (corners, squares) = errors(&|seen| seen.camera == index);
            let deviation = |first: usize| {
                Vector3::from_fn(|axis, _| match fit.free_camera(index) {
                    None => 0.0,
                    Some(free) => {
                        let entry = 6 * free + first + axis;
                        noise * covariance[(entry, entry)].sqrt()
                    }
                })
                .into()
            };
            CalibratedCamera {
                serial: known.serial.clone(),
                camera: Camera {
                    intrinsics: known.intrinsics,
                    pose: fit.poses.cameras[index],
                },
                views: others(&|seen| (seen.camera == index).then_some(seen.placement)),
                corners,
                reprojection_rms: (squares / corners as f64).sqrt(),
                position_deviation: deviation(0),
                orientation_deviation: deviation(3),
            }
        });
        let views = placements.iter().map(|&view| {
            let (corners, squares) = errors(&|seen| seen.placement == view);
            PlacedBoard {
                view: self.views[view].clone(),
                pose: fit.poses.placements[view],
                cameras: others(&|seen| (seen.placement == view).then_some(seen.camera)),
                reprojection_rms: (squares / corners as f64).sqrt(),
            }
        });
        Ok(Calibration {
            cameras: cameras.collect(),
            views: views.collect(),
            rejected,
            corners: seen.len(),
            noise,
        })
    }
}

/// An observation and its corner's number.
#[derive(Clone, Copy, Debug)]
struct Seen {
    corner: u32,
    observation: Observation,
}

/// Standard deviation of errors each way from the median of their lengths, which wrong corners hardly move.
fn median_noise(lengths: impl Iterator<Item = Option<f64>>) -> f64 {
    let mut lengths: Vec<f64> = lengths
        .map(|length| length.unwrap_or(f64::INFINITY))
        .collect();
    // Of no lengths too.
    (median(&mut lengths) / RAYLEIGH_MEDIAN).max(LEAST_NOISE)
}

/// The observations with errors up to `largest`; of sightings with too few of them none. Sightings are runs of observations.
fn choose(observations: &[Seen], errors: &[Option<f64>], largest: f64) -> Vec<usize> {
    let sighting = |index: usize| {
        let seen = &observations[index].observation;
        (seen.camera, seen.placement)
    };
    let mut chosen = Vec::new();
    let mut begin = 0;
    while begin < observations.len() {
        let run =
            (begin..observations.len()).take_while(|&index| sighting(index) == sighting(begin));
        let run: Vec<usize> = run.collect();
        begin += run.len();
        let right = |index: &usize| errors[*index].is_some_and(|error| error <= largest);
        let right: Vec<usize> = run.into_iter().filter(right).collect();
        if right.len() >= FEWEST_CORNERS {
            chosen.extend(right);
        }
    }
    chosen
}
