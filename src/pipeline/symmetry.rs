//! How a run's data are reduced by symmetries.

use tdcr_learn::data::{CloudSet, Condition, DataError, DataSet, Normalisation, Recipe, Split};
use tdcr_learn::net::Channels;
use tdcr_learn::prior::Prior;
use tdcr_learn::symmetry::{Loss, Reduction, SeenSymmetries, SymmetryUse};
use tdcr_learn::train::{Model, TrainSettings};
use tdcr_sim::robot::Robot;

use super::{Monitor, PipelineError};

/// How a run with `settings` reduces its clouds, which are of `recipe` where they are simulated; tells the monitor. A run that
/// starts at a model reduces them as that does, where it can.
///
/// A surface that flows start from is simulated under the representative's command: its robot must have the symmetries, too.
///
/// # Errors
/// [`PipelineError::Robot`] where a robot is refused.
pub(super) fn reduction(
    settings: &TrainSettings,
    recipe: Option<&Recipe>,
    channels: Channels,
    initial: Option<&Model>,
    monitor: &dyn Monitor,
) -> Result<Reduction, PipelineError> {
    if settings.symmetry == SymmetryUse::None {
        monitor.note("symmetry: none, as asked for");
        return Ok(Reduction::default());
    }
    let of_model = initial.map(|model| &model.provenance.reduction);
    if of_model.is_some_and(Reduction::is_trivial) {
        monitor.note("symmetry: none, as the initial model has none");
        return Ok(Reduction::default());
    }
    let mut seen = seen_symmetries(recipe, channels)?;
    if let Prior::Surface(prior) = &settings.prior {
        let of_prior = Robot::new(prior.subject.robot.clone())?.symmetries();
        seen.keep(Loss::Prior, |symmetries| {
            symmetries.subgroup(|one| of_prior.elements().iter().any(|other| other.is_alike(one)))
        });
    }
    if let Some(of_model) = of_model
        && of_model.symmetries().are_among(&seen.symmetries)
    {
        monitor.note(&format!("symmetry: {of_model}, as the initial model has"));
        return Ok(of_model.clone());
    }
    monitor.note(&format!("symmetry: {seen}"));
    Ok(seen.reduction())
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

/// A split of a data set in `units`, reduced, and the representatives that its conditions became.
///
/// # Errors
/// As [`DataSet::cloud_set_in`].
pub(super) fn reduced(
    set: &DataSet,
    split: Split,
    units: &Normalisation,
    channels: Channels,
    reduction: &Reduction,
) -> Result<(CloudSet, Vec<Condition>), DataError> {
    let mut clouds = set.cloud_set_in(split, units, channels)?;
    let mut conditions = set.conditions(split)?;
    reduction.set(&mut clouds, &mut conditions, units)?;
    Ok((clouds, conditions))
}
