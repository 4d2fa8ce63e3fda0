//! Which of a robot's symmetries its clouds have: measured on views.

use std::fmt;

use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;
use tdcr_sim::cloud::PointCloud;
use tdcr_sim::render::BaseVisibility;
use tdcr_sim::robot::{Loads, Robot, SpecError};
use tdcr_sim::symmetry::{Symmetries, Symmetry};

use super::Reduction;
use super::reduction::with_values;
use crate::channels::Channels;
use crate::data::{Condition, Recipe, Simulator, StreamSpec};
use crate::metrics::{chamfer, color_error};

/// Conditions whose views are compared.
const CONDITIONS: usize = 6;

/// Seed of these conditions and of the phases of pixels and voxels.
const SEED: u64 = 0x5ee;

/// Largest ratio of the distance between an image of a view and the view of the image to that of two views of one robot.
///
/// The paper's ring of 8 cameras is not symmetric under turns by 120 degrees: it gives 1.2 to 1.6 (`docs/experiments.md` has the
/// table). Cameras on one side give a multiple.
const MOST_FLOORS: f64 = 1.75;

/// Largest such ratio of views that are taken for the same: what symmetric cameras give, and more than 6 conditions scatter.
const ALIKE: f64 = 1.1;

/// The symmetries that clouds of a recipe have, and why there are no more.
#[derive(Clone, Debug, PartialEq)]
pub struct SeenSymmetries {
    /// The symmetries.
    pub symmetries: Symmetries,
    /// What symmetries of the robot were lost to; `None` where none were.
    pub lost: Option<Loss>,
    /// Each symmetry of robot and base besides the identity, and how well its views agree.
    pub views: Vec<(Symmetry, Agreement)>,
}

/// How well views agree with a symmetry: ratios of distances between images of views and views of images to those of two
/// views of one robot, all in random phases of pixels and voxels; means over conditions.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Agreement {
    /// Of Chamfer distances.
    pub positions: f64,
    /// Of colour differences; `None` where they are not learned.
    pub colors: Option<f64>,
}

/// What a robot's symmetries were lost to.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub enum Loss {
    /// Clouds that are not simulated: it is not known how they were seen.
    Unknown,
    /// The robot has none.
    Robot,
    /// The base in sight has fewer.
    Base,
    /// There are obstacles around the robot.
    Scene,
    /// The robot could not be seen under too many conditions.
    Unseen,
    /// The robot whose surface flows start from has fewer.
    Prior,
    /// Views of images differ too much from images of views, in positions: the largest ratio.
    Positions(f64),
    /// The same in colours.
    Colors(f64),
}

impl fmt::Display for Loss {
    fn fmt(&self, out: &mut fmt::Formatter) -> fmt::Result {
        match self {
            Self::Unknown => {
                out.write_str("the data set does not say how its clouds were simulated")
            }
            Self::Robot => out.write_str("the robot has none"),
            Self::Base => out.write_str("the base in sight is less symmetric than the robot"),
            Self::Scene => out.write_str("there are obstacles around the robot"),
            Self::Prior => {
                out.write_str("the robot whose surface flows start from is less symmetric")
            }
            Self::Unseen => out.write_str("the robot cannot be simulated under too many commands"),
            Self::Positions(floors) => write!(
                out,
                "the cameras do not see images of the robot alike: {floors:.2} of the distance of two views, at most {MOST_FLOORS}"
            ),
            Self::Colors(floors) => write!(
                out,
                "the cameras do not see images of the robot in the same colours: {floors:.2} of the difference of two views, at most {MOST_FLOORS}"
            ),
        }
    }
}

/// One line: `6 tendon permutations (3 rotations, 3 reflections), seen in 3 views`, or `none, because ...`.
impl fmt::Display for SeenSymmetries {
    fn fmt(&self, out: &mut fmt::Formatter) -> fmt::Result {
        if self.symmetries.is_trivial() {
            out.write_str("none")?;
            return match &self.lost {
                None => Ok(()),
                Some(loss) => write!(out, ", because {loss}"),
            };
        }
        self.reduction().fmt(out)?;
        match &self.lost {
            None => Ok(()),
            Some(loss) => write!(out, "; no more because {loss}"),
        }
    }
}

impl Recipe {
    /// The symmetries that the clouds of this recipe have: those of the robot under its payloads
    /// ([`Robot::symmetries_under`]), of the base where it is seen, and of what the cameras see of it, in `channels`.
    ///
    /// Of the last, the Chamfer distance between the image of a view and the view of the image is at most 1.75 of that
    /// between two views of the same robot, in the mean over 6 random conditions, and so is the difference of colours where
    /// there are any.
    ///
    /// # Errors
    /// [`SpecError`] where the robot is refused.
    pub fn symmetries(&self, channels: Channels) -> Result<SeenSymmetries, SpecError> {
        let robot = Robot::new(self.subject.robot.clone())?;
        let payload = self.subject.payload.map(|range| Loads::payload(range.max));
        let payload = payload.and_then(Result::ok);
        let loads: Vec<Loads> = [Loads::default()].into_iter().chain(payload).collect();
        let of_robot = robot.symmetries_under(&loads);
        let mut seen = SeenSymmetries {
            lost: of_robot.is_trivial().then_some(Loss::Robot),
            symmetries: of_robot,
            views: Vec::new(),
        };
        if seen.symmetries.is_trivial() {
            return Ok(seen);
        }
        if !self.subject.scene.is_empty() {
            seen.keep(Loss::Scene, |_| Symmetries::default());
            return Ok(seen);
        }
        if self.subject.base == BaseVisibility::Shown {
            seen.keep(Loss::Base, |symmetries| symmetries.of_base(&robot));
        }
        let Some(views) = Views::new(&robot, self, channels) else {
            seen.keep(Loss::Unseen, |_| Symmetries::default());
            return Ok(seen);
        };
        let others = seen.symmetries.elements()[1..].iter();
        let found = others.map(|symmetry| (symmetry.clone(), views.agreement(symmetry)));
        seen.views = found.collect();
        let positions = |agreement: &Agreement| agreement.positions;
        seen.require(positions, Loss::Positions);
        let colors = |agreement: &Agreement| agreement.colors.unwrap_or(0.0);
        seen.require(colors, Loss::Colors);
        Ok(seen)
    }
}

impl SeenSymmetries {
    /// None, for this reason.
    pub fn none(loss: Loss) -> Self {
        Self {
            symmetries: Symmetries::default(),
            lost: Some(loss),
            views: Vec::new(),
        }
    }

    /// Goes on with what `choose` leaves; the first that takes some is what they were lost to.
    pub fn keep(&mut self, loss: Loss, choose: impl Fn(&Symmetries) -> Symmetries) {
        let left = choose(&self.symmetries);
        if left.elements().len() < self.symmetries.elements().len() {
            self.lost = self.lost.or(Some(loss));
        }
        self.symmetries = left;
    }

    /// Goes on with those whose views agree, by a ratio of theirs.
    fn require(&mut self, ratio: impl Fn(&Agreement) -> f64, loss: impl Fn(f64) -> Loss) {
        let largest = (self.views.iter()).fold(0.0, |largest, (_, one)| ratio(one).max(largest));
        let views = self.views.clone();
        self.keep(loss(largest), |symmetries| {
            symmetries.subgroup(|symmetry| agree(&views, symmetry, |one| ratio(one) <= MOST_FLOORS))
        });
    }

    /// How conditions are reduced by them.
    pub fn reduction(&self) -> Reduction {
        let same = self.symmetries.subgroup(|symmetry| {
            agree(&self.views, symmetry, |one| {
                one.positions <= ALIKE && one.colors.unwrap_or(0.0) <= ALIKE
            })
        });
        Reduction::new(self.symmetries.clone(), &same)
    }
}

/// Whether the views of a symmetry agree well enough; the identity's do.
fn agree(
    views: &[(Symmetry, Agreement)],
    symmetry: &Symmetry,
    enough: impl Fn(&Agreement) -> bool,
) -> bool {
    let mut of_symmetry = views.iter().filter(|(other, _)| other.is_alike(symmetry));
    of_symmetry.all(|(_, agreement)| enough(agreement))
}

/// Views of a robot under a few conditions.
struct Views<'a> {
    robot: &'a Robot,
    recipe: &'a Recipe,
    channels: Channels,
    /// Index of the condition, the condition, and what is seen of it.
    seen: Vec<(u64, Condition, PointCloud)>,
    /// Mean distances of two views of one condition.
    floor: Agreement,
}

impl<'a> Views<'a> {
    /// `None` where the robot is seen under fewer than half of the conditions.
    fn new(robot: &'a Robot, recipe: &'a Recipe, channels: Channels) -> Option<Self> {
        let stream = StreamSpec {
            recipe: recipe.clone(),
            seed: SEED,
            ..StreamSpec::default()
        };
        let mut views = Self {
            robot,
            recipe,
            channels,
            seen: Vec::new(),
            floor: mean(&[]),
        };
        let conditions = (0..CONDITIONS as u64).into_par_iter();
        let seen: Vec<_> = conditions
            .filter_map(|index| {
                let condition = stream.condition(robot, index);
                let view = views.view(&condition, 2 * index)?;
                let again = views.view(&condition, 2 * index + 1)?;
                let floor = views.difference(&view, &again)?;
                Some(((index, condition, view), floor))
            })
            .collect();
        if 2 * seen.len() < CONDITIONS {
            return None;
        }
        let floors: Vec<Agreement>;
        (views.seen, floors) = seen.into_iter().unzip();
        views.floor = mean(&floors);
        Some(views)
    }

    /// What is seen under a condition, in phases of its own; `None` where it cannot be.
    fn view(&self, condition: &Condition, phase: u64) -> Option<PointCloud> {
        let mut simulator = Simulator::new(self.robot, self.recipe);
        let mut rng = ChaCha8Rng::seed_from_u64(SEED);
        rng.set_stream(phase);
        simulator.view(condition, &mut rng).ok()
    }

    /// How well the views agree with a symmetry; infinite where an image cannot be seen.
    fn agreement(&self, symmetry: &Symmetry) -> Agreement {
        let found: Option<Vec<Agreement>> = (self.seen.par_iter())
            .map(|(index, condition, view)| {
                let mut image = view.clone();
                symmetry.move_points(&mut image.points, 1.0);
                let of_image = self.view(&image_of(symmetry, condition), 2 * index + 1)?;
                self.difference(&image, &of_image)
            })
            .collect();
        let Some(found) = found.map(|found| mean(&found)) else {
            return Agreement {
                positions: f64::INFINITY,
                colors: None,
            };
        };
        Agreement {
            positions: found.positions / self.floor.positions,
            // Robots of one colour differ in none.
            colors: (found.colors.zip(self.floor.colors))
                .map(|(found, floor)| found / floor.max(f64::MIN_POSITIVE)),
        }
    }

    /// Chamfer distance (m²) and colour difference of two clouds.
    fn difference(&self, a: &PointCloud, b: &PointCloud) -> Option<Agreement> {
        let positions = chamfer(&a.points, &b.points).ok()?;
        let colors = match self.channels {
            Channels::Xyz => None,
            Channels::XyzRgb => {
                let [a, b] = [a, b].map(|cloud| (&*cloud.points, &*cloud.colors));
                Some(color_error(a, b).ok()?)
            }
        };
        Some(Agreement { positions, colors })
    }
}

/// Means of each; 0 of none.
fn mean(of: &[Agreement]) -> Agreement {
    let count = of.len().max(1) as f64;
    let colors: Option<f64> = of.iter().map(|one| one.colors).sum();
    Agreement {
        positions: of.iter().map(|one| one.positions).sum::<f64>() / count,
        colors: colors.map(|sum| sum / count),
    }
}

/// The image of a condition; its payload stays.
fn image_of(symmetry: &Symmetry, condition: &Condition) -> Condition {
    with_values(condition, &symmetry.command(&condition.to_vec()))
}
