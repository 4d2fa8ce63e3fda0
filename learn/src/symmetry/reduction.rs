//! Conditions and clouds by one representative of each class.

use std::fmt;
use std::iter::zip;

use serde::{Deserialize, Serialize};
use tdcr_sim::symmetry::{Symmetries, Symmetry};

use crate::channels::DIM;
use crate::data::{CloudSet, Condition, DataError, Normalisation, Sample};

/// How conditions are reduced to representatives of their classes, and what a network is told beside a representative.
///
/// By each symmetry, cameras see the representative's robot from where its image of the cameras stands. Where that makes a
/// difference, there are several views: a condition is followed by as many numbers, a 1 for its view among zeros, so that
/// the network learns what the views have in common from all of them, and what differs from each.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Reduction {
    symmetries: Symmetries,
    /// The number of each symmetry's view, from 0; empty where there is but one.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    views: Vec<usize>,
}

/// A reduced condition.
#[derive(Clone, Debug, PartialEq)]
pub struct Reduced<'a> {
    /// What leads from the condition to the representative, and from its cloud to the representative's.
    pub symmetry: &'a Symmetry,
    /// The representative: motors, then the payload if there is one, in physical units.
    pub values: Vec<f64>,
    /// What the network is told: the representative, dimensionless, then its view.
    pub condition: Vec<f32>,
}

impl Reduction {
    /// By `symmetries`, of which cameras see the images by the subgroup `same` alike.
    pub fn new(symmetries: Symmetries, same: &Symmetries) -> Self {
        // A view for each left coset `g same`: its symmetries turn the cameras to the same places.
        let elements = symmetries.elements();
        let mut views: Vec<usize> = Vec::with_capacity(elements.len());
        let mut firsts: Vec<&Symmetry> = Vec::new();
        for symmetry in elements {
            let is_of = |first: &&Symmetry| {
                let between = first.inverse().after(symmetry);
                same.elements().iter().any(|one| one.is_alike(&between))
            };
            let view = firsts.iter().position(is_of);
            views.push(view.unwrap_or(firsts.len()));
            if view.is_none() {
                firsts.push(symmetry);
            }
        }
        if firsts.len() == 1 {
            views.clear();
        }
        Self { symmetries, views }
    }

    /// The symmetries.
    pub fn symmetries(&self) -> &Symmetries {
        &self.symmetries
    }

    /// Whether conditions stay as they are.
    pub fn is_trivial(&self) -> bool {
        self.symmetries.is_trivial()
    }

    /// Numbers that follow a condition to tell its view: 0 where there is but one.
    pub fn view_numbers(&self) -> usize {
        self.views
            .iter()
            .max()
            .map_or(0, |last| last.saturating_add(1))
    }

    /// Whether a network that learned by this one knows all conditions of `other`, and takes them in the same form.
    pub fn suits(&self, other: &Self) -> bool {
        let same_form = self.views.is_empty() && other.views.is_empty();
        self == other || (same_form && self.symmetries.are_among(&other.symmetries))
    }

    /// Reduces a condition (motors, then the payload if there is one, in physical units).
    ///
    /// # Errors
    /// [`DataError::ConditionLength`] unless there is one value per motor of `units`.
    pub fn reduce(&self, values: &[f64], units: &Normalisation) -> Result<Reduced<'_>, DataError> {
        units.condition(values)?;
        let (symmetry, _) = self.symmetries.canonical(values);
        self.reduce_by(symmetry, values, units)
    }

    /// The same by a symmetry that is given, one of [`symmetries`](Self::symmetries): that of a condition near by, so that both come to
    /// one class, and their clouds to be alike point by point.
    ///
    /// # Errors
    /// As [`reduce`](Self::reduce).
    pub fn reduce_by<'a>(
        &'a self,
        symmetry: &'a Symmetry,
        values: &[f64],
        units: &Normalisation,
    ) -> Result<Reduced<'a>, DataError> {
        units.condition(values)?;
        let values = match self.symmetries.is_trivial() {
            true => values.to_vec(),
            false => symmetry.command(values),
        };
        let mut condition = units.condition(&values)?;
        let first = condition.len();
        condition.resize(first + self.view_numbers(), 0.0);
        let elements = self.symmetries.elements().iter();
        if let Some((_, view)) = zip(elements, &self.views).find(|(one, _)| *one == symmetry) {
            condition[first + view] = 1.0;
        }
        Ok(Reduced {
            symmetry,
            values,
            condition,
        })
    }

    /// Reduces a sample: its representative, in metres, and what the network is told of it.
    ///
    /// # Errors
    /// As [`reduce`](Self::reduce).
    pub fn sample(
        &self,
        sample: Sample,
        units: &Normalisation,
    ) -> Result<(Sample, Vec<f32>), DataError> {
        let reduced = self.reduce(&sample.condition.to_vec(), units)?;
        let mut cloud = sample.cloud;
        if !self.is_trivial() {
            reduced.symmetry.move_points(&mut cloud.points, 1.0);
        }
        let condition = with_values(&sample.condition, &reduced.values);
        Ok((Sample { condition, cloud }, reduced.condition))
    }

    /// Replaces the clouds of `set`, whose conditions are `conditions`, by the representatives of their classes: conditions,
    /// clouds and the surfaces that flows start from. `units` is the set's normalisation.
    ///
    /// # Errors
    /// As [`reduce`](Self::reduce).
    ///
    /// # Panics
    /// If there is not one condition for each cloud.
    pub fn set(
        &self,
        set: &mut CloudSet,
        conditions: &mut [Condition],
        units: &Normalisation,
    ) -> Result<(), DataError> {
        assert_eq!(set.len(), conditions.len(), "one condition for each cloud");
        if self.is_trivial() {
            return Ok(());
        }
        set.conditions.clear();
        set.condition_dim = units.motor_min.len() + self.view_numbers();
        let coordinates = DIM * set.points_per_cloud;
        for (index, condition) in conditions.iter_mut().enumerate() {
            let reduced = self.reduce(&condition.to_vec(), units)?;
            *condition = with_values(condition, &reduced.values);
            set.conditions.extend(reduced.condition);
            let clouds = [Some(&mut set.points), set.starts.as_mut()];
            for points in clouds.into_iter().flatten() {
                let points = &mut points[index * coordinates..][..coordinates];
                let (points, _) = points.as_chunks_mut::<DIM>();
                reduced.symmetry.move_points(points, units.scale);
            }
        }
        Ok(())
    }

    /// Says what is wrong with it as one of conditions of so many values, if anything: it may be from a file.
    pub fn check(&self, values: usize) -> Result<(), String> {
        self.symmetries.check(values)?;
        let count = self.symmetries.elements().len();
        let known = |view: usize| self.views.contains(&view);
        if self.views.is_empty()
            || (self.views.len() == count && (0..self.view_numbers()).all(known))
        {
            return Ok(());
        }
        Err(format!(
            "views {:?} of {count} symmetries, expected one for each, numbered from 0 without gaps",
            self.views
        ))
    }
}

/// `6 tendon permutations (3 rotations, 3 reflections), seen in 3 views`.
impl fmt::Display for Reduction {
    fn fmt(&self, out: &mut fmt::Formatter) -> fmt::Result {
        self.symmetries.fmt(out)?;
        match self.view_numbers() {
            0 => Ok(()),
            views => write!(out, ", seen in {views} views"),
        }
    }
}

/// A condition with other values (motors, then the payload if it has one).
pub(super) fn with_values(condition: &Condition, values: &[f64]) -> Condition {
    // They are permuted values of a condition, which are of single precision.
    let mut values = values.iter().map(|&value| value as f32);
    Condition {
        motors: (&mut values).take(condition.motors.len()).collect(),
        payload: condition.payload,
    }
}
