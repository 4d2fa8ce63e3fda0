//! What a rate and its mode leave of the equations of motion.

use nalgebra::{Complex, Vector3};

use super::SmallMotionRates;
use crate::factor::dot;
use crate::robot::Loads;

/// What the equations of motion say of a rate and its mode.
pub(super) struct Mode {
    /// What resists it, for each unit of its size (N m/rad): of inertia and damping, without regard to signs.
    pub resistance: f64,
    /// What is left of the equations, as a share of their terms.
    pub error: f64,
}

impl Mode {
    /// Of a mode's real and imaginary part.
    pub fn new(
        rates: &mut SmallMotionRates,
        loads: &Loads,
        damped: bool,
        rate: Complex<f64>,
        mode: [&[Vector3<f64>]; 2],
    ) -> Self {
        let mass = mode.map(|part| rates.mass(part));
        let mut damping = mode.map(|part| rates.damping(part));
        if !damped {
            damping
                .iter_mut()
                .flatten()
                .for_each(|entry| *entry = Vector3::zeros());
        }
        let stiffness = mode.map(|part| rates.stiffness(loads, part));
        let size = dot(mode[0], mode[0]) + dot(mode[1], mode[1]);
        let form =
            |image: &[Vec<Vector3<f64>>; 2]| dot(mode[0], &image[0]) + dot(mode[1], &image[1]);
        let resistance = (rate.norm_sqr() * form(&mass) + rate.norm() * form(&damping)) / size;
        // Each number of the sum of the terms, and the sum of their sizes.
        let (mut left, mut terms) = (0.0, 0.0);
        for joint in 0..mode[0].len() {
            for axis in 0..3 {
                let number = |image: &[Vec<Vector3<f64>>; 2]| {
                    Complex::new(image[0][joint][axis], image[1][joint][axis])
                };
                let parts = [
                    number(&mass) * rate * rate,
                    number(&damping) * rate,
                    number(&stiffness),
                ];
                left += parts.iter().sum::<Complex<f64>>().norm_sqr();
                terms += parts.iter().map(Complex::norm_sqr).sum::<f64>();
            }
        }
        Self {
            resistance,
            error: (left / terms).sqrt(),
        }
    }
}
