//! The elastic backbone and the soft limit of one joint.

use nalgebra::{Matrix3, UnitQuaternion, Vector3};

use crate::robot::{Backbone, Disc, Hinges, Limit};

/// Energy of a joint's backbone and limit with its derivatives along `q exp(xi)`, disc frame.
pub(crate) struct JointElasticity {
    /// Energy (J).
    pub energy: f64,
    /// Gradient (N m).
    pub gradient: Vector3<f64>,
    /// Symmetric second derivative (N m/rad).
    pub hessian: Matrix3<f64>,
}

impl Disc {
    /// The elasticity of the disc's joint at rotation `q`; `None` where it turns freely.
    pub(crate) fn elasticity(&self, q: &UnitQuaternion<f64>) -> Option<JointElasticity> {
        if self.backbone.is_none() && self.limit.is_none() && self.hinges.is_none() {
            return None;
        }
        let mut sum = JointElasticity {
            energy: 0.0,
            gradient: Vector3::zeros(),
            hessian: Matrix3::zeros(),
        };
        if let Some(backbone) = &self.backbone {
            backbone.add(q, &mut sum);
        }
        if let Some(limit) = &self.limit {
            limit.add(q, &mut sum);
        }
        if let Some(hinges) = &self.hinges {
            hinges.add(q, &mut sum);
        }
        Some(sum)
    }

    /// Change of the energy's gradient (N m, disc frame) at rotation `q` for a change of the stiffness of the joint's backbone about the
    /// disc's axes, or of its hinges.
    pub(crate) fn gradient_by_stiffness(
        &self,
        q: &UnitQuaternion<f64>,
        change: &Vector3<f64>,
    ) -> Vector3<f64> {
        match (&self.hinges, &self.backbone) {
            (Some(hinges), _) => hinges.axes_at(q).dual * change.component_mul(&hinges.strain(q)),
            (None, Some(backbone)) => backbone.gradient_by_stiffness(q, change),
            (None, None) => Vector3::zeros(),
        }
    }

    /// Derivative by the stiffness of the work of the energy's gradient along a turn (rad, disc frame) at rotation `q`.
    pub(crate) fn work_by_stiffness(
        &self,
        q: &UnitQuaternion<f64>,
        turn: &Vector3<f64>,
    ) -> Vector3<f64> {
        match (&self.hinges, &self.backbone) {
            (Some(hinges), _) => {
                let step = hinges.axes_at(q).dual.tr_mul(turn);
                step.component_mul(&hinges.strain(q))
            }
            (None, Some(backbone)) => backbone.work_by_stiffness(q, turn),
            (None, None) => Vector3::zeros(),
        }
    }
}

impl Hinges {
    /// Angles from the rest (rad).
    fn strain(&self, q: &UnitQuaternion<f64>) -> Vector3<f64> {
        self.angles(q) - self.rest
    }

    /// `V = 1/2 k' (t - t0)^2` of the angles `t`. The second derivative along turns is that along the angles, but for what turns
    /// along several axes do to second order.
    fn add(&self, q: &UnitQuaternion<f64>, sum: &mut JointElasticity) {
        if self.stiffness == Vector3::zeros() {
            return;
        }
        let strain = self.strain(q);
        let moments = self.stiffness.component_mul(&strain);
        let axes = self.axes_at(q);
        let gradient = axes.dual * moments;
        sum.energy += 0.5 * strain.dot(&moments);
        sum.gradient += gradient;
        sum.hessian += axes.form(&self.stiffness) - axes.curving(&gradient);
    }
}

impl Backbone {
    /// Stiffness about the disc's axes (N m/rad).
    pub(crate) fn stiffness(&self) -> Vector3<f64> {
        Vector3::new(self.bending[0], self.bending[1], self.torsion)
    }

    /// Rotation vector from the rest bend to `q` (rad).
    pub(crate) fn strain(&self, q: &UnitQuaternion<f64>) -> Vector3<f64> {
        let rest = UnitQuaternion::from_scaled_axis(Vector3::from(self.rest));
        rotation_vector(&(rest.inverse() * q))
    }

    /// Change of the energy's gradient (N m, disc frame) at rotation `q` for a change of the stiffness.
    fn gradient_by_stiffness(
        &self,
        q: &UnitQuaternion<f64>,
        change: &Vector3<f64>,
    ) -> Vector3<f64> {
        let phi = self.strain(q);
        inverse_right_jacobian(&phi)
            .0
            .tr_mul(&change.component_mul(&phi))
    }

    /// Derivative by the stiffness of the work of the energy's gradient along a turn (rad, disc frame) at rotation `q`.
    fn work_by_stiffness(&self, q: &UnitQuaternion<f64>, turn: &Vector3<f64>) -> Vector3<f64> {
        let phi = self.strain(q);
        (inverse_right_jacobian(&phi).0 * turn).component_mul(&phi)
    }

    /// `V = 1/2 phi' K phi`. A turn `xi` moves `phi` by `F xi`, `F` the inverse right Jacobian of
    /// the exponential map (Sola et al., A micro Lie theory, eq. 144), and by `1/2 DF[F xi] xi` to
    /// second order.
    fn add(&self, q: &UnitQuaternion<f64>, sum: &mut JointElasticity) {
        let stiffness = self.stiffness();
        let phi = self.strain(q);
        let moment = stiffness.component_mul(&phi);
        let (f, c, slope) = inverse_right_jacobian(&phi);
        sum.energy += 0.5 * phi.dot(&moment);
        sum.gradient += f.tr_mul(&moment);
        // The bilinear form `moment . DF[eta] xi` as the matrix of `eta' B xi`.
        let cross = phi.cross_matrix();
        let b = moment.cross_matrix() * -0.5 + phi * (cross * (cross * moment)).transpose() * slope
            - (moment.cross_matrix() * cross + moment.cross(&phi).cross_matrix()) * c;
        let bent = f.tr_mul(&b);
        let stretched = f.tr_mul(&Matrix3::from_diagonal(&stiffness)) * f;
        sum.hessian += stretched + (bent + bent.transpose()) * 0.5;
    }
}

impl Limit {
    /// `V = 1/2 k (theta - limit)^2` beyond the limit; `theta`'s Hessian is
    /// `1/2 cot(theta/2) (I - n n')`, `n` the axis.
    fn add(&self, q: &UnitQuaternion<f64>, sum: &mut JointElasticity) {
        let phi = rotation_vector(q);
        let angle = phi.norm();
        let excess = angle - self.angle;
        if excess <= 0.0 {
            return;
        }
        let axis = phi / angle;
        let along = axis * axis.transpose();
        let across = Matrix3::identity() - along;
        let moment = self.stiffness * excess;
        sum.energy += 0.5 * moment * excess;
        sum.gradient += axis * moment;
        sum.hessian += along * self.stiffness + across * (0.5 * moment / (0.5 * angle).tan());
    }
}

/// `log(q)` (rad), of norm at most pi.
pub(crate) fn rotation_vector(q: &UnitQuaternion<f64>) -> Vector3<f64> {
    let sign = if q.w < 0.0 { -1.0 } else { 1.0 };
    let (w, v) = (sign * q.w, q.imag() * sign);
    let sin = v.norm();
    if sin < 1e-4 {
        // 2 asin(s) / s to fourth order: exact to rounding here.
        let s2 = sin * sin;
        return v * (2.0 + s2 * (1.0 / 3.0 + s2 * (3.0 / 20.0)));
    }
    v * (2.0 * sin.atan2(w) / sin)
}

/// The inverse right Jacobian `F = I + 1/2 [phi]x + c [phi]x^2` of the exponential map, `c`, and
/// `c'(theta) / theta`.
pub(crate) fn inverse_right_jacobian(phi: &Vector3<f64>) -> (Matrix3<f64>, f64, f64) {
    let squared = phi.norm_squared();
    let (c, slope) = if squared < 2.5e-3 {
        // Series of (1 - theta/2 cot(theta/2)) / theta^2 (Bernoulli numbers), and its derivative.
        let c =
            1.0 / 12.0 + squared * (1.0 / 720.0 + squared * (1.0 / 30240.0 + squared / 1209600.0));
        let slope = 1.0 / 360.0 + squared * (1.0 / 7560.0 + squared * (6.0 / 1209600.0));
        (c, slope)
    } else {
        let theta = squared.sqrt();
        let half = 0.5 * theta;
        let cot = 1.0 / half.tan();
        let c = (1.0 - half * cot) / squared;
        // d/dtheta (theta/2 cot(theta/2)) = cot/2 - theta/4 (1 + cot^2).
        let derivative = 0.5 * cot - 0.5 * half * (1.0 + cot * cot);
        (c, -(derivative / theta + 2.0 * c) / squared)
    };
    let cross = phi.cross_matrix();
    (
        Matrix3::identity() + cross * 0.5 + cross * cross * c,
        c,
        slope,
    )
}
