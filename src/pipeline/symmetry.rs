//! By which symmetries a run's data are reduced.

use tdcr_learn::data::{CloudSet, Condition, DataError, DataSet, Normalisation, Recipe, Split};
use tdcr_learn::net::Channels;
use tdcr_learn::prior::Prior;
use tdcr_learn::symmetry::{Loss, SeenSymmetries, SymmetryUse, to_representatives};
use tdcr_learn::train::TrainSettings;
use tdcr_sim::robot::Robot;
use tdcr_sim::symmetry::Symmetries;

use super::{Monitor, PipelineError};

/// The symmetries of a run with `settings` on clouds of `recipe`, where they are simulated, in one line; tells the monitor.
///
/// A surface that flows start from is simulated under the representative's command: its robot must have the symmetries, too.
///
/// # Errors
/// [`PipelineError::Robot`] where a robot is refused.
pub(super) fn symmetries(
    settings: &TrainSettings,
    recipe: Option<&Recipe>,
    channels: Channels,
    monitor: &dyn Monitor,
) -> Result<Symmetries, PipelineError> {
    if settings.symmetry == SymmetryUse::None {
        monitor.note("symmetry: none, as asked for");
        return Ok(Symmetries::default());
    }
    let mut seen = seen_symmetries(recipe, channels)?;
    if let Prior::Surface(prior) = &settings.prior {
        let of_prior = Robot::new(prior.subject.robot.clone())?.symmetries();
        seen.keep(Loss::Prior, |symmetries| {
            symmetries.subgroup(|one| of_prior.elements().iter().any(|other| other.is_alike(one)))
        });
    }
    monitor.note(&format!("symmetry: {seen}"));
    Ok(seen.symmetries)
}

/// The symmetries that clouds of `recipe` have; none where they are not simulated.
///
/// # Errors
/// [`PipelineError::Robot`] where the robot is refused.
pub fn seen_symmetries(
    recipe: Option<&Recipe>,
    channels: Channels,
) -> Result<SeenSymmetries, PipelineError> {
    Ok(match recipe {
        Some(recipe) => recipe.symmetries(channels)?,
        None => SeenSymmetries::none(Loss::Unknown),
    })
}

/// A split of a data set in `units`, each cloud the representative of its class.
///
/// # Errors
/// As [`DataSet::cloud_set_in`].
pub(super) fn representatives(
    set: &DataSet,
    split: Split,
    units: &Normalisation,
    channels: Channels,
    symmetries: &Symmetries,
) -> Result<(CloudSet, Vec<Condition>), DataError> {
    let mut clouds = set.cloud_set_in(split, units, channels)?;
    let mut conditions = set.conditions(split)?;
    to_representatives(&mut clouds, &mut conditions, symmetries, units)?;
    Ok((clouds, conditions))
}
