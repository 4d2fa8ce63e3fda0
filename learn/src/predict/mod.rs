//! What turns a condition into a cloud, whatever its method.
//!
//! A [`Predictor`] answers one question: what does the robot look like under this [`Condition`]? The flow's network is one
//! ([`FlowPredictor`](crate::train::FlowPredictor)), and so are the trivial methods that every other one must beat:
//! [`NearestCommand`] and [`MeanCommand`]. Whoever compares predictors takes a list of them and needs to know no method.
//!
//! # What a predictor sees
//!
//! The condition alone: the command and the payload, as the data set has them. It never sees the test cloud, so it cannot be
//! better than its method. Bounds that do look at the truth, such as the sampling floor, are no predictors: the evaluator
//! makes them itself, as *references*.
//!
//! # Cost
//!
//! What can be computed once is computed when the predictor is made; [`predict`](Predictor::predict) then takes `&self`, and
//! is called from several threads at once. A method that needs scratch memory keeps it per thread or makes it per call. How
//! much training it took stands in [`About::training`], how many evaluations of a network a cloud took in
//! [`Prediction::evaluations`].
//!
//! # A predictor of one's own
//!
//! ```
//! use tdcr_learn::data::Condition;
//! use tdcr_learn::predict::{About, PredictError, Prediction, Predictor, TrainingCost};
//!
//! /// A straight robot of one length (m), whatever the command.
//! struct Straight(f32);
//!
//! impl Predictor for Straight {
//!     fn about(&self) -> About {
//!         About {
//!             key: "straight".to_owned(),
//!             name: "straight robot".to_owned(),
//!             method: "points along the z axis".to_owned(),
//!             made_from: vec![("length (m)".to_owned(), self.0.to_string())],
//!             ..About::default()
//!         }
//!     }
//!
//!     fn predict(&self, _: &Condition, points: usize, _: u64) -> Result<Prediction, PredictError> {
//!         let height = |k: usize| self.0 * k as f32 / points as f32;
//!         Ok(Prediction {
//!             points: (0..points).map(|k| [0.0, 0.0, height(k)]).collect(),
//!             colors: None,
//!             ..Prediction::default()
//!         })
//!     }
//! }
//!
//! let methods: Vec<Box<dyn Predictor>> = vec![Box::new(Straight(0.17)), Box::new(Straight(0.2))];
//! let condition = Condition { motors: vec![0.02; 6], payload: None };
//! for method in &methods {
//!     assert_eq!(method.predict(&condition, 100, 0)?.points.len(), 100);
//!     assert_eq!(method.about().training, TrainingCost::default());
//! }
//! # Ok::<(), PredictError>(())
//! ```

mod error;
mod mean;
mod nearest;
mod prediction;
mod selection;
mod simulated;

pub use error::PredictError;
pub use mean::MeanCommand;
pub use nearest::NearestCommand;
pub use prediction::Prediction;
pub use selection::{ISOLATED, ISOLATED_CORRECTED, select};

use crate::data::{Condition, Subject};

/// A method that turns a condition into a cloud.
pub trait Predictor: Send + Sync {
    /// What it is, what it was made from and what that cost.
    fn about(&self) -> About;

    /// The cloud under `condition` (m, world frame), a function of the condition and `seed`.
    ///
    /// `points` is how many points are wanted. A method that draws points draws as many; one that holds a cloud gives all of
    /// its points, in random order, and the caller takes of them what it needs.
    ///
    /// # Errors
    /// [`PredictError`] where the condition does not fit, or no cloud comes of it.
    fn predict(
        &self,
        condition: &Condition,
        points: usize,
        seed: u64,
    ) -> Result<Prediction, PredictError>;
}

/// What a predictor is, what it was made from and what that cost.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct About {
    /// Its key in files, different from those of all predictors that it is compared with: `network`, `nearest`, ...
    pub key: String,
    /// Its name in tables, in lower case: `nearest training command`.
    pub name: String,
    /// What it does, in a few words.
    pub method: String,
    /// What its clouds depend on besides condition and seed, as `(name, value)`: whoever keeps results uses them again only
    /// for a predictor that was made from the same.
    pub made_from: Vec<(String, String)>,
    /// Robot, base and payloads that it predicts; `None` where it does not say.
    pub subject: Option<Subject>,
    /// Whether its clouds have colours.
    pub colors: bool,
    /// What making it cost.
    pub training: TrainingCost,
    /// Wall-clock time that a prediction takes (s), where whoever made the clouds measured it.
    pub prediction_seconds: Option<f64>,
}

/// What training a predictor cost: nothing by default.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct TrainingCost {
    /// Training points that it saw, each as often as it saw it.
    pub points: u64,
    /// Wall-clock time (s), where it is known.
    pub seconds: Option<f64>,
    /// Time of all processors (s), where it is known.
    pub processor_seconds: Option<f64>,
}
