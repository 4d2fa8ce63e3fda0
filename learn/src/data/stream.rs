//! Samples made as they are needed, without files.
//!
//! A stream is a function of seed and index. Threads claim indices, a reorder buffer of fixed size hands the samples out in
//! order, and training sees a window that moves along the stream by a fixed number of clouds a step: so neither threads nor
//! interruptions show in the result. Its units are bounds, not statistics.

use std::collections::BTreeMap;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;

use serde::{Deserialize, Serialize};
use tdcr_sim::robot::{Robot, SpecError};

use super::conditions::{rng, uniform};
use super::simulator::{Recipe, SimulateError, Simulator};
use super::{Condition, Normalisation, ObstacleDraws, Sample};

/// What the samples of a stream are functions of, with their index.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct StreamSpec {
    /// Robot, cameras, base, payloads and voxels.
    pub recipe: Recipe,
    /// Points per cloud `N`.
    pub points: usize,
    /// Seed of conditions and points.
    pub seed: u64,
}

/// 2,000 points a cloud of the default recipe.
impl Default for StreamSpec {
    fn default() -> Self {
        Self {
            recipe: Recipe::default(),
            points: 2000,
            seed: 0,
        }
    }
}

/// Fresh samples of a simulated robot under uniformly drawn conditions, made by threads of its own.
///
/// Sample `i` is a function of the [`StreamSpec`] and `i` alone, whatever the number of threads, so a stream that is
/// opened at `i` goes on as one that was read up to there. At most `ahead` samples are in memory or in the making: the
/// threads wait for the reader. Dropping the stream stops them.
///
/// ```
/// use tdcr_learn::data::{Recipe, SimStream, StreamSpec, Subject};
/// use tdcr_sim::robot::{Cameras, RobotSpec};
///
/// let mut robot = RobotSpec::load("2m")?;
/// if let Cameras::Ring(ring) = &mut robot.cameras {
///     ring.resolution = [320, 180];
/// }
/// let recipe = Recipe { subject: Subject { robot, ..Subject::default() }, ..Recipe::default() };
/// let spec = StreamSpec { recipe, points: 500, ..StreamSpec::default() };
/// let mut stream = SimStream::open(&spec, 7, 2, 4)?;
/// let seventh = stream.next().expect("a stream has no end")?;
/// assert_eq!((seventh.condition.motors.len(), seventh.cloud.len()), (6, 500));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug)]
pub struct SimStream {
    shared: Arc<Shared>,
    threads: Vec<JoinHandle<()>>,
}

#[derive(Debug)]
struct Shared {
    state: Mutex<State>,
    /// Told when a sample is put where the reader may wait for it.
    made: Condvar,
    /// Told when the reader has taken a sample, or wants no more.
    taken: Condvar,
    ahead: u64,
}

/// Samples from `next_out` to `next_made` are in the making or among `ready`: at most `ahead` of them.
#[derive(Debug)]
struct State {
    next_made: u64,
    next_out: u64,
    ready: BTreeMap<u64, Result<Sample, SimulateError>>,
    stopped: bool,
}

impl SimStream {
    /// The stream from sample `first` on, made by `threads` threads that keep at most `ahead` samples; at least one of
    /// each.
    ///
    /// # Errors
    /// [`SpecError`] where the robot is refused.
    pub fn open(
        spec: &StreamSpec,
        first: u64,
        threads: usize,
        ahead: usize,
    ) -> Result<Self, SpecError> {
        let robot = Robot::new(spec.recipe.subject.robot.clone())?;
        let shared = Arc::new(Shared {
            state: Mutex::new(State {
                next_made: first,
                next_out: first,
                ready: BTreeMap::new(),
                stopped: false,
            }),
            made: Condvar::new(),
            taken: Condvar::new(),
            ahead: ahead.max(1) as u64,
        });
        let work = |_| {
            let (spec, robot, shared) = (spec.clone(), robot.clone(), shared.clone());
            std::thread::spawn(move || shared.work(&spec, &robot))
        };
        let threads = (0..threads.max(1)).map(work).collect();
        Ok(Self { shared, threads })
    }
}

impl SimStream {
    /// Samples that are ready or in the making.
    pub fn made(&self) -> usize {
        let state = self.shared.lock();
        (state.next_made - state.next_out) as usize
    }
}

impl StreamSpec {
    /// Sample `index` of the stream, made by `simulator`, which is of this recipe.
    ///
    /// # Errors
    /// As [`Simulator::sample`].
    pub fn sample(&self, simulator: &mut Simulator, index: u64) -> Result<Sample, SimulateError> {
        let condition = self.condition(simulator.robot(), index);
        simulator.sample(condition, self.points, self.seed, index)
    }

    /// The condition of sample `index`; `robot` is compiled from the recipe's.
    pub(crate) fn condition(&self, robot: &Robot, index: u64) -> Condition {
        let subject = &self.recipe.subject;
        let draws = |obstacles| ObstacleDraws::new(obstacles, &subject.scene, robot);
        let obstacles = subject.obstacles.map(draws).and_then(Result::ok);
        let rng = &mut rng(self.seed, index);
        uniform(robot, subject.payload, obstacles.as_ref(), rng)
    }

    /// A normalisation that holds for every sample of the stream without looking at any: commands and payloads by their
    /// ranges, points by the reach of the straight robot, rounded to `f32` as in data sets.
    ///
    /// # Errors
    /// [`SpecError`] where the robot is refused.
    pub fn normalisation(&self) -> Result<Normalisation, SpecError> {
        let subject = &self.recipe.subject;
        let robot = Robot::new(subject.robot.clone())?;
        let payload = subject.payload.map(|range| [0.0, range.max]);
        let ranges = robot.tendons().iter().map(|tendon| tendon.range);
        let obstacles = (subject.obstacles).map_or_else(Vec::new, |one| one.ranges(&subject.scene));
        let ranges: Vec<[f64; 2]> = ranges.chain(obstacles).chain(payload).collect();
        Ok(Normalisation {
            motor_min: ranges.iter().map(|range| range[0]).collect(),
            motor_max: ranges.iter().map(|range| range[1]).collect(),
            scale: f64::from(reach(subject) as f32),
        })
    }
}

/// How far from the world's origin the robot reaches at most (m): to the outermost rim of its last disc.
fn reach(subject: &super::Subject) -> f64 {
    let spec = &subject.robot;
    let norm = |v: [f64; 3]| v.iter().map(|x| x * x).sum::<f64>().sqrt();
    let modules = spec.modules.iter().map(|module| {
        let pitches = module.discs.saturating_sub(1) as f64 * module.pitch;
        module.first_offset.abs() + pitches.abs()
    });
    let rims = spec.modules.iter();
    let rim = rims.map(|module| module.radius.hypot(module.half_height));
    norm(spec.base.position) + modules.sum::<f64>() + rim.fold(0.0, f64::max)
}

impl Shared {
    /// What a thread does until the stream is dropped.
    fn work(&self, spec: &StreamSpec, robot: &Robot) {
        let mut simulator = Simulator::new(robot, &spec.recipe);
        while let Some(index) = self.claim() {
            let mut slot = Slot {
                shared: self,
                index,
                made: Err(SimulateError::Panicked),
            };
            slot.made = spec.sample(&mut simulator, index);
        }
    }

    /// The index of the next sample to make, when there is room for it; `None` when no more are wanted.
    fn claim(&self) -> Option<u64> {
        let full =
            |state: &mut State| !state.stopped && state.next_made - state.next_out >= self.ahead;
        let waited = self.taken.wait_while(self.lock(), full);
        let mut state = waited.unwrap_or_else(PoisonError::into_inner);
        if state.stopped {
            return None;
        }
        state.next_made += 1;
        Some(state.next_made - 1)
    }

    /// The state. No thread leaves it half changed, so one that panicked does not spoil it.
    fn lock(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// The place of a claimed sample: dropped, it delivers, be it that the thread panicked.
struct Slot<'a> {
    shared: &'a Shared,
    index: u64,
    made: Result<Sample, SimulateError>,
}

impl Drop for Slot<'_> {
    fn drop(&mut self) {
        let made = std::mem::replace(&mut self.made, Err(SimulateError::Panicked));
        let mut state = self.shared.lock();
        state.ready.insert(self.index, made);
        if std::thread::panicking() {
            state.stopped = true;
            self.shared.taken.notify_all();
        }
        self.shared.made.notify_one();
    }
}

impl Iterator for SimStream {
    type Item = Result<Sample, SimulateError>;

    /// The next sample, in the order of indices; never `None`. A sample that cannot be made is an error, and the stream
    /// goes on after it, unless a thread panicked: then nothing more is made.
    fn next(&mut self) -> Option<Self::Item> {
        let missing =
            |state: &mut State| !state.stopped && !state.ready.contains_key(&state.next_out);
        let waited = (self.shared.made).wait_while(self.shared.lock(), missing);
        let mut state = waited.unwrap_or_else(PoisonError::into_inner);
        let index = state.next_out;
        state.next_out += 1;
        let sample = state.ready.remove(&index);
        self.shared.taken.notify_all();
        Some(sample.unwrap_or(Err(SimulateError::Panicked)))
    }
}

impl Drop for SimStream {
    fn drop(&mut self) {
        self.shared.lock().stopped = true;
        self.shared.taken.notify_all();
        for thread in self.threads.drain(..) {
            // One that panicked has said so in its sample.
            let _ = thread.join();
        }
    }
}
