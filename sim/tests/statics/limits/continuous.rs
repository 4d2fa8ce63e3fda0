//! A Cosserat rod, inextensible and unshearable, with tendons along it, by shooting.
//!
//! With `N`, `M` the force and moment that the part above `s` puts on the part below, tendons
//! included, and `f` the load per length (Antman, Nonlinear Problems of Elasticity, ch. 8):
//! `p' = R e3`, `R' = R [u]x`, `N' = -f`, `M' = -p' x N`. The curvature `u` in the section's axes
//! follows from `R' M = K u + sum_i r_i x T_i t_i`, tendon `i` pulling with `T_i` at `r_i` along the
//! unit tangent `t_i` of its path, `e3 + u x r_i` (Rucker and Webster, Statics and Dynamics of
//! Continuum Robots with General Tendon Routing, 2011).

use nalgebra::{Matrix6, Quaternion, UnitQuaternion, Vector3, Vector6};
use tdcr_sim::robot::Frame;

use super::rod::{Rod, TipLoad};

/// Steps along the rod: the error, of fourth order, is far below those of the chains.
const STEPS: usize = 200;

/// A section of the rod.
#[derive(Clone, Copy)]
struct Section {
    position: Vector3<f64>,
    orientation: Quaternion<f64>,
    force: Vector3<f64>,
    moment: Vector3<f64>,
}

impl Section {
    fn moved(&self, rate: &Self, step: f64) -> Self {
        Self {
            position: self.position + rate.position * step,
            orientation: self.orientation + rate.orientation * step,
            force: self.force + rate.force * step,
            moment: self.moment + rate.moment * step,
        }
    }
}

impl Rod {
    /// Tip of the continuous rod under a load at its tip (m).
    pub fn continuous_tip(&self, tip: &TipLoad) -> Vector3<f64> {
        let mut base = Vector6::zeros();
        // The loads grow, so that Newton's method starts near.
        for tenths in 1..=10 {
            base = self.shoot(tip, f64::from(tenths) / 10.0, base);
        }
        self.integrate(1.0, &base).position
    }

    /// Force and moment at the base with which a share of the load is met at the tip.
    fn shoot(&self, tip: &TipLoad, share: f64, start: Vector6<f64>) -> Vector6<f64> {
        let miss = |base: &Vector6<f64>| {
            let end = self.integrate(share, base);
            let turn = match tip.frame {
                Frame::World => UnitQuaternion::identity(),
                Frame::Disc => UnitQuaternion::from_quaternion(end.orientation),
            };
            let force = end.force - turn * tip.force * share;
            let moment = end.moment - turn * tip.moment * share;
            Vector6::new(force.x, force.y, force.z, moment.x, moment.y, moment.z)
        };
        let mut base = start;
        for _ in 0..50 {
            let missed = miss(&base);
            if missed.amax() < 1e-12 {
                return base;
            }
            let h = 1e-6;
            let columns = [0, 1, 2, 3, 4, 5].map(|axis| {
                let nudge = Vector6::ith(axis, h);
                (miss(&(base + nudge)) - miss(&(base - nudge))) / (2.0 * h)
            });
            base -= Matrix6::from_columns(&columns).lu().solve(&missed).unwrap();
        }
        panic!("no force and moment at the base leave {share} of {tip:?} at the tip");
    }

    /// From the base to the tip by the classical Runge-Kutta method.
    fn integrate(&self, share: f64, base: &Vector6<f64>) -> Section {
        let h = self.length / STEPS as f64;
        let mut section = Section {
            position: Vector3::zeros(),
            orientation: Quaternion::identity(),
            force: base.fixed_rows::<3>(0).into(),
            moment: base.fixed_rows::<3>(3).into(),
        };
        for step in 0..STEPS {
            let middle = h * (step as f64 + 0.5);
            let rate = |section: &Section| self.rate(section, middle, share);
            let k1 = rate(&section);
            let k2 = rate(&section.moved(&k1, h / 2.0));
            let k3 = rate(&section.moved(&k2, h / 2.0));
            let k4 = rate(&section.moved(&k3, h));
            section = section
                .moved(&k1, h / 6.0)
                .moved(&k2, h / 3.0)
                .moved(&k3, h / 3.0)
                .moved(&k4, h / 6.0);
            section.orientation = section.orientation.normalize();
        }
        section
    }

    /// Derivatives along the rod, within the step around `middle`.
    fn rate(&self, section: &Section, middle: f64, share: f64) -> Section {
        let turn = UnitQuaternion::from_quaternion(section.orientation);
        let curvature = self.curvature(&(turn.inverse() * section.moment), middle, share);
        let tangent = turn * Vector3::z();
        Section {
            position: tangent,
            orientation: section.orientation * Quaternion::from_imag(curvature) * 0.5,
            force: Vector3::from(self.gravity) * (-self.line_density * share),
            moment: -tangent.cross(&section.force),
        }
    }

    /// Curvature (1/m) of the section at `s` under a moment in the section's axes.
    fn curvature(&self, moment: &Vector3<f64>, s: f64, share: f64) -> Vector3<f64> {
        let mut curvature = Vector3::zeros();
        // The tendons' directions depend little on the curvature: a few rounds settle it.
        for _ in 0..100 {
            let mut left = *moment;
            for tendon in self.tendons.iter().filter(|tendon| tendon.end > s) {
                let hole = Vector3::new(tendon.hole[0], tendon.hole[1], 0.0);
                let tangent = (Vector3::z() + curvature.cross(&hole)).normalize();
                left -= hole.cross(&tangent) * (tendon.tension * share);
            }
            let next = left.component_div(&self.stiffness);
            if (next - curvature).amax() <= 1e-13 * next.amax() {
                return next;
            }
            curvature = next;
        }
        panic!("the curvature at {s} m does not settle");
    }
}
