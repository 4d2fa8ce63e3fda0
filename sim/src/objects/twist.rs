//! Rigid bodies as a step sees them.

use nalgebra::{Matrix3, Matrix6, Vector3, Vector6};

/// Velocity of a centre of mass (m/s) and angular velocity (rad/s), world axes.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Twist {
    pub linear: Vector3<f64>,
    pub angular: Vector3<f64>,
}

impl Twist {
    /// Velocity of the point at `arm` (m) from the centre of mass (m/s).
    pub fn at(&self, arm: &Vector3<f64>) -> Vector3<f64> {
        self.linear + self.angular.cross(arm)
    }

    /// The sum of two.
    pub fn plus(&self, other: &Self) -> Self {
        Self {
            linear: self.linear + other.linear,
            angular: self.angular + other.angular,
        }
    }
}

/// An object at the begin of a step.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Body {
    /// Its number in the scene.
    pub obstacle: usize,
    /// Mass (kg), and inertia about the centre of mass, world axes (kg m²).
    pub mass: f64,
    pub inertia: Matrix3<f64>,
    /// Centre of mass in the world (m).
    pub centre: Vector3<f64>,
    /// Radius of the sphere about it that encloses the object (m).
    pub enclosing: f64,
    /// Its motion, and that at the end of a step in which nothing touches it.
    pub twist: Twist,
    pub free: Twist,
    /// The motions `[velocity of the centre of mass; angular velocity]` that its joint leaves it, as columns; zeros beyond them.
    pub basis: Matrix6<f64>,
    /// Number of these: 6 without a joint.
    pub freedoms: usize,
    /// What the damper of its joint adds to the inertia that a step feels along its one motion (kg or kg m²).
    pub resistance: f64,
}

impl Body {
    /// Its mass matrix by the coordinates of the basis, the damper of its joint in it. 1 for coordinates that there are not.
    pub fn mass_matrix(&self) -> Matrix6<f64> {
        let mut inertia = Matrix6::zeros();
        (inertia.fixed_view_mut::<3, 3>(0, 0)).copy_from(&(Matrix3::identity() * self.mass));
        inertia
            .fixed_view_mut::<3, 3>(3, 3)
            .copy_from(&self.inertia);
        let mut matrix = self.basis.tr_mul(&(inertia * self.basis));
        matrix[(0, 0)] += self.resistance;
        for axis in self.freedoms..6 {
            matrix[(axis, axis)] = 1.0;
        }
        matrix
    }

    /// What its joint makes of a motion within a step: the nearest one that it leaves, by kinetic energy, slowed down by its damper.
    pub fn confined(&self, twist: &Twist) -> Twist {
        if self.freedoms == 6 {
            return *twist;
        }
        let (linear, angular) = (twist.linear * self.mass, self.inertia * twist.angular);
        let momentum = stacked(&linear, &angular);
        let along = (self.mass_matrix().cholesky())
            .map(|matrix| self.basis * matrix.solve(&self.basis.tr_mul(&momentum)));
        let motion = along.unwrap_or_default();
        Twist {
            linear: motion.fixed_rows::<3>(0).into(),
            angular: motion.fixed_rows::<3>(3).into(),
        }
    }
}

impl Body {
    /// The motion of which the damper of its joint makes `twist` within a step.
    pub fn undamped(&self, twist: &Twist) -> Twist {
        if self.resistance == 0.0 {
            return *twist;
        }
        let damped = self.mass_matrix()[(0, 0)];
        let factor = damped / (damped - self.resistance);
        Twist {
            linear: twist.linear * factor,
            angular: twist.angular * factor,
        }
    }
}

fn stacked(linear: &Vector3<f64>, angular: &Vector3<f64>) -> Vector6<f64> {
    Vector6::new(
        linear.x, linear.y, linear.z, angular.x, angular.y, angular.z,
    )
}

/// A place where an object touches, or soon may, what is fixed or another object.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Meeting {
    /// The object, by its number among the objects.
    pub object: usize,
    /// The other one; `None` for what is fixed.
    pub other: Option<usize>,
    /// Where (m), world frame.
    pub point: Vector3<f64>,
    /// Unit normal from the other one's surface to the object.
    pub normal: Vector3<f64>,
    /// Distance of the surfaces (m), below 0 where they overlap.
    pub gap: f64,
    /// Coefficient of friction.
    pub friction: f64,
}
