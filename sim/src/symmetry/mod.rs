//! Symmetries: isometries that map a robot to itself, with the permutations of its tendons.
//!
//! A robot whose three tendons lie at 120 degrees in every module looks the same turned by 120 degrees, and mirrored: pulled by
//! a command whose entries are permuted alike in all modules, it settles in the turned or mirrored shape. Such isometries form
//! a group, [`Symmetries`], a cyclic or a dihedral one about the base's axis. All images of a command under it are one class;
//! [`Symmetries::canonical`] chooses one of them, so that what is known of it is known of the whole class.
//!
//! [`Robot::symmetries`](crate::robot::Robot::symmetries) finds them: candidates are the turns about the base's z axis, and
//! the reflections through it, that map the tendons' routes to each other; those stay that settling confirms.
//!
//! ```
//! use tdcr_sim::robot::{Loads, Robot};
//!
//! let robot = Robot::load("2m")?;
//! let symmetries = robot.symmetries();
//! assert_eq!(symmetries.elements().len(), 6);
//!
//! let command = [0.03, 0.01, 0.02, 0.0, 0.02, 0.015];
//! let (symmetry, smallest) = symmetries.canonical(&command);
//! assert_eq!(smallest, [0.01, 0.02, 0.03, 0.02, 0.015, 0.0]);
//! let settle = |values: &[f64]| {
//!     robot.command(values).map(|command| robot.settle(&command, &Loads::default()))
//! };
//! let (tip, image) = (settle(&command)?.positions[9], settle(&smallest)?.positions[9]);
//! let moved = symmetry.point(tip.into());
//! assert!((0..3).all(|k| (moved[k] - image[k]).abs() < 1e-5));
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod base;
mod find;

use std::iter::zip;

use nalgebra::{Matrix3, Vector3};
use serde::{Deserialize, Serialize};

/// Two matrices whose entries differ by less are the same.
const MATRIX_TOLERANCE: f64 = 1e-6;

/// An isometry of space that maps a robot to itself, and what it does to the tendons.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Symmetry {
    /// Tendon `i` is mapped to tendon `tendons[i]`.
    pub tendons: Vec<usize>,
    /// Orthogonal matrix `M` of the isometry `x -> M x + t`, world frame, row by row; its determinant is 1 for a rotation and
    /// -1 for a reflection.
    pub matrix: [[f64; 3]; 3],
    /// Translation `t` (m).
    pub translation: [f64; 3],
}

impl Symmetry {
    /// What leaves everything where it is, of a robot of so many tendons.
    pub fn identity(tendons: usize) -> Self {
        Self {
            tendons: (0..tendons).collect(),
            matrix: [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
            translation: [0.0; 3],
        }
    }

    fn new(tendons: Vec<usize>, matrix: &Matrix3<f64>, translation: &Vector3<f64>) -> Self {
        Self {
            tendons,
            matrix: matrix.transpose().into(),
            translation: (*translation).into(),
        }
    }

    fn linear(&self) -> Matrix3<f64> {
        Matrix3::from(self.matrix).transpose()
    }

    /// Whether it turns left into right.
    pub fn is_reflection(&self) -> bool {
        self.linear().determinant() < 0.0
    }

    /// The image of a command: entry `tendons[i]` is `values[i]`. Entries beyond the tendons, such as a payload, stay.
    ///
    /// # Panics
    /// If there are fewer values than tendons.
    pub fn command(&self, values: &[f64]) -> Vec<f64> {
        let mut image = values.to_vec();
        for (&to, &value) in zip(&self.tendons, values) {
            image[to] = value;
        }
        image
    }

    /// The image of a point (m, world frame).
    pub fn point(&self, point: [f64; 3]) -> [f64; 3] {
        let [x, y, z] = point;
        let row = |k: usize| {
            let [a, b, c] = self.matrix[k];
            a * x + b * y + c * z + self.translation[k]
        };
        [row(0), row(1), row(2)]
    }

    /// Moves points (world frame), in place, whose unit is `unit` metres.
    pub fn move_points(&self, points: &mut [[f32; 3]], unit: f64) {
        for point in points {
            let image = self.point(point.map(|x| unit * f64::from(x)));
            *point = image.map(|x| (x / unit) as f32);
        }
    }

    /// What undoes it.
    pub fn inverse(&self) -> Self {
        let mut tendons = vec![0; self.tendons.len()];
        for (from, &to) in self.tendons.iter().enumerate() {
            tendons[to] = from;
        }
        let matrix = self.linear().transpose();
        Self::new(
            tendons,
            &matrix,
            &-(matrix * Vector3::from(self.translation)),
        )
    }

    /// This one after `first`.
    pub fn after(&self, first: &Self) -> Self {
        let tendons = first.tendons.iter().map(|&between| self.tendons[between]);
        let translation = self.linear() * Vector3::from(first.translation);
        Self::new(
            tendons.collect(),
            &(self.linear() * first.linear()),
            &(translation + Vector3::from(self.translation)),
        )
    }

    /// Whether both do the same, but for rounding.
    pub fn is_alike(&self, other: &Self) -> bool {
        let largest = (self.linear() - other.linear()).abs().max();
        self.tendons == other.tendons && largest < MATRIX_TOLERANCE
    }

    /// Says what is wrong with it as one of a robot of at most `values` tendons, if anything.
    fn check(&self, values: usize) -> Result<(), String> {
        let mut sorted = self.tendons.clone();
        sorted.sort_unstable();
        if sorted.len() > values || sorted.iter().enumerate().any(|(k, &tendon)| k != tendon) {
            return Err(format!(
                "{:?} is no permutation of at most {values} tendons",
                self.tendons
            ));
        }
        let matrix = self.linear();
        let error = (matrix * matrix.transpose() - Matrix3::identity()).abs();
        // Comparisons with a NaN are false.
        let orthogonal = error.iter().all(|entry| *entry < MATRIX_TOLERANCE);
        if !(orthogonal && self.translation.iter().all(|x| x.is_finite())) {
            return Err(format!(
                "{:?} and {:?} are no isometry, expected an orthogonal matrix and finite numbers",
                self.matrix, self.translation
            ));
        }
        Ok(())
    }
}

/// A group of symmetries: the identity first, then the rotations by their angle, then the reflections by that of their plane.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(transparent)]
pub struct Symmetries(Vec<Symmetry>);

/// The identity alone, of a robot of any number of tendons.
impl Default for Symmetries {
    fn default() -> Self {
        Self(vec![Symmetry::identity(0)])
    }
}

impl Symmetries {
    /// All of them, the identity first.
    pub fn elements(&self) -> &[Symmetry] {
        &self.0
    }

    /// Whether there is but the identity.
    pub fn is_trivial(&self) -> bool {
        self.0.len() <= 1
    }

    /// Whether each of them is one of `other`.
    pub fn are_among(&self, other: &Self) -> bool {
        let is_other = |one: &Symmetry| other.0.iter().any(|element| element.is_alike(one));
        self.is_trivial() || self.0.iter().all(is_other)
    }

    /// The largest group of those that `keep` keeps, the first of several; it is asked of all but the identity, in order.
    pub fn subgroup(&self, mut keep: impl FnMut(&Symmetry) -> bool) -> Self {
        let kept: Vec<bool> = (self.0.iter().enumerate())
            .map(|(index, element)| index == 0 || keep(element))
            .collect();
        // Every subgroup of a cyclic or dihedral group is generated by one or two of its elements.
        let mut largest = vec![0];
        for (a, one) in self.0.iter().enumerate() {
            for other in &self.0[a..] {
                let generated = self.generated([one, other]);
                let group = generated.filter(|group| group.iter().all(|&index| kept[index]));
                if let Some(group) = group
                    && group.len() > largest.len()
                {
                    largest = group;
                }
            }
        }
        Self(largest.iter().map(|&index| self.0[index].clone()).collect())
    }

    /// Indices of the group that two elements generate, in order; `None` where one of it is missing.
    fn generated(&self, generators: [&Symmetry; 2]) -> Option<Vec<usize>> {
        let mut group = vec![0];
        let mut next = 0;
        while next < group.len() {
            for generator in generators {
                let product = generator.after(&self.0[group[next]]);
                let index = self.0.iter().position(|one| one.is_alike(&product))?;
                if !group.contains(&index) {
                    group.push(index);
                }
            }
            next += 1;
        }
        group.sort_unstable();
        Some(group)
    }

    /// The representative of a command's class, and the first symmetry that leads to it: of all images of `values`, the
    /// smallest in lexicographic order. The three tendons of the first module so become sorted, where all permutations of them
    /// are symmetries.
    ///
    /// # Panics
    /// If there are fewer values than tendons.
    pub fn canonical(&self, values: &[f64]) -> (&Symmetry, Vec<f64>) {
        let smaller = |a: &[f64], b: &[f64]| {
            let mut orders = zip(a, b).map(|(a, b)| a.total_cmp(b));
            orders.find(|order| order.is_ne()) == Some(std::cmp::Ordering::Less)
        };
        let mut best = (&self.0[0], values.to_vec());
        for symmetry in &self.0[1..] {
            let image = symmetry.command(values);
            if smaller(&image, &best.1) {
                best = (symmetry, image);
            }
        }
        best
    }

    /// Says what is wrong with them as those of a robot of at most `values` tendons, if anything: they may be from a file.
    pub fn check(&self, values: usize) -> Result<(), String> {
        for symmetry in &self.0 {
            symmetry.check(values)?;
        }
        let tendons = self.0.first().map_or(0, |first| first.tendons.len());
        let identity = Symmetry::identity(tendons);
        if !self
            .0
            .first()
            .is_some_and(|first| first.is_alike(&identity))
        {
            return Err("no symmetries, expected the identity first".to_owned());
        }
        match (self.0.iter()).find(|one| one.tendons.len() != tendons) {
            None => Ok(()),
            Some(other) => Err(format!(
                "symmetries of {tendons} and of {} tendons",
                other.tendons.len()
            )),
        }
    }
}

/// How many there are, such as `6 tendon permutations (3 rotations, 3 reflections)`; the identity is a rotation.
impl std::fmt::Display for Symmetries {
    fn fmt(&self, out: &mut std::fmt::Formatter) -> std::fmt::Result {
        let reflections = self.0.iter().filter(|one| one.is_reflection()).count();
        let counted = |count: usize, noun: &str| match count {
            1 => format!("1 {noun}"),
            count => format!("{count} {noun}s"),
        };
        write!(
            out,
            "{} ({}, {})",
            counted(self.0.len(), "tendon permutation"),
            counted(self.0.len() - reflections, "rotation"),
            counted(reflections, "reflection")
        )
    }
}
