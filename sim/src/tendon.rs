//! Lengths of routed tendons, their derivatives, and the law that turns a length into a tension.
//!
//! Almost every tendon is a chain of straight segments between holes of neighbouring bodies, each of
//! which depends on one ball joint alone: its length is a sum over joints. Vectors are in the world
//! frame; derivatives are taken along a turn `w` of the joint, and of everything above it, about the
//! joint's centre.

use nalgebra::{DMatrix, Matrix3, Vector3};

use crate::chain::{Chain, Configuration};
use crate::robot::{Command, Drive, Pull, Robot, Segment, Span, Tendon};

/// A segment's upper hole from the joint's centre, and what lies between its holes.
#[derive(Clone, Debug)]
pub(crate) struct Stretch {
    /// The upper hole from the joint's centre (m).
    pub hole: Vector3<f64>,
    /// Unit vector from the lower to the upper hole; zero where they coincide.
    pub direction: Vector3<f64>,
    /// Length (m).
    pub length: f64,
}

impl Stretch {
    #[inline(always)]
    fn new(hole: Vector3<f64>, span: Vector3<f64>) -> Self {
        let length = span.norm();
        let inverse = if length > 0.0 { 1.0 / length } else { 0.0 };
        Self {
            hole,
            direction: span * inverse,
            length,
        }
    }

    // Inlined whatever units the crate is compiled in: the Hessian of every segment is a tenth of a solve.

    /// Gradient of the length (m/rad).
    #[inline]
    pub fn gradient(&self) -> Vector3<f64> {
        self.hole.cross(&self.direction)
    }

    /// Hessian of the length (m/rad²), symmetric: that of the norm of a vector that turns.
    #[inline]
    pub fn hessian(&self, gradient: &Vector3<f64>) -> Matrix3<f64> {
        let (h, u) = (&self.hole, &self.direction);
        let inverse = if self.length > 0.0 {
            1.0 / self.length
        } else {
            0.0
        };
        let half = h * 0.5;
        let isotropic = h.norm_squared() * inverse - h.dot(u);
        let hh = h * inverse;
        let gg = gradient * inverse;
        let entry = |i: usize, j: usize| {
            half[i] * u[j] + half[j] * u[i] - hh[i] * h[j] - gg[i] * gradient[j]
        };
        let (xy, xz, yz) = (entry(0, 1), entry(0, 2), entry(1, 2));
        Matrix3::new(
            entry(0, 0) + isotropic,
            xy,
            xz,
            xy,
            entry(1, 1) + isotropic,
            yz,
            xz,
            yz,
            entry(2, 2) + isotropic,
        )
    }
}

impl Segment {
    /// The segment in the poses of `chain`. Left alone the compiler calls it, which takes a twentieth of a step.
    #[inline(always)]
    pub fn stretch(&self, chain: &Chain) -> Stretch {
        let hole = chain.orientations[self.joint + 1] * self.to;
        let span = hole - chain.orientations[self.joint] * self.from;
        Stretch::new(hole, span)
    }
}

impl Span {
    /// The lower hole, the upper hole (m), and the piece between them seen from the joint of the
    /// upper disc.
    pub fn stretch(&self, robot: &Robot, chain: &Chain) -> (Vector3<f64>, Vector3<f64>, Stretch) {
        let lower = chain.point(robot, self.lower, &self.from);
        let upper = chain.point(robot, Some(self.upper), &self.to);
        let hole = upper - chain.centres[self.upper];
        (lower, upper, Stretch::new(hole, upper - lower))
    }
}

/// A robot in one configuration: the poses of its discs, and the paths of its tendons.
#[derive(Clone, Debug)]
pub(crate) struct Posture {
    pub chain: Chain,
    /// One for each of the robot's segments.
    pub stretches: Vec<Stretch>,
    /// Length of each tendon (m).
    pub lengths: Vec<f64>,
}

impl Posture {
    /// Storage for the postures of a robot.
    pub fn new(robot: &Robot) -> Self {
        let none = Stretch::new(Vector3::zeros(), Vector3::zeros());
        Self {
            chain: Chain::new(robot),
            stretches: vec![none; robot.segments().len()],
            lengths: vec![0.0; robot.tendons().len()],
        }
    }

    /// Places the discs in configuration `q`, and the tendons through their holes.
    pub fn place(&mut self, robot: &Robot, q: &Configuration) {
        self.chain.place(robot, q);
        for (length, tendon) in self.lengths.iter_mut().zip(robot.tendons()) {
            *length = tendon.fixed_length;
        }
        for (stretch, segment) in self.stretches.iter_mut().zip(robot.segments()) {
            *stretch = segment.stretch(&self.chain);
            self.lengths[segment.tendon] += stretch.length;
        }
        for span in robot.spans() {
            self.lengths[span.tendon] += span.stretch(robot, &self.chain).2.length;
        }
    }
}

impl Robot {
    /// Tension of each tendon (N) at its length of `lengths` (m) under `command`, and how it grows with the length (N/m). With the command of
    /// a drive by gain or length it falls as much; of a drive by tension it is the command.
    pub fn tendon_tensions(&self, lengths: &[f64], command: &Command) -> Vec<[f64; 2]> {
        let each = self.tendons().iter().zip(lengths).zip(command.as_slice());
        each.map(|((tendon, &length), &command)| {
            let state = tendon.state(length, command);
            [state.tension, state.stiffness]
        })
        .collect()
    }

    /// Lengths of the tendons in configuration `q` (m), and their Jacobian by the joint coordinates:
    /// one row per tendon, `3 n` columns (m/rad), turns in the discs' own frames or hinges' angles.
    ///
    /// # Panics
    /// If `q` has fewer joints than the robot.
    pub fn tendon_kinematics(&self, q: &Configuration) -> (Vec<f64>, DMatrix<f64>) {
        let mut posture = Posture::new(self);
        posture.place(self, q);
        let chain = &posture.chain;
        let mut jacobian = DMatrix::zeros(self.tendons().len(), self.dof());
        let mut add = |tendon: usize, joint: usize, gradient: &Vector3<f64>| {
            let own_axes = chain.axes(joint).tr_mul(gradient);
            for axis in 0..3 {
                jacobian[(tendon, 3 * joint + axis)] += own_axes[axis];
            }
        };
        for (segment, stretch) in self.segments().iter().zip(&posture.stretches) {
            add(segment.tendon, segment.joint, &stretch.gradient());
        }
        for span in self.spans() {
            let (_, upper, stretch) = span.stretch(self, chain);
            for joint in span.lower.map_or(0, |disc| disc + 1)..=span.upper {
                let arm = upper - chain.centres[joint];
                add(span.tendon, joint, &arm.cross(&stretch.direction));
            }
        }
        (posture.lengths, jacobian)
    }
}

/// What a tendon of some length does under some command.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct TendonState {
    /// Energy (J), its own and its drive's.
    pub energy: f64,
    /// Tension (N), the energy's derivative by the length.
    pub tension: f64,
    /// Stiffness (N/m), its second derivative.
    pub stiffness: f64,
}

/// Stiffness (N/m) that stands for that of an inextensible tendon on a length drive; the statics
/// move the rest length until the tendon has the commanded length.
pub(crate) const LENGTH_PENALTY: f64 = 1e4;

impl Tendon {
    /// Whether a command is the tendon's length, by whatever tension it takes.
    pub(crate) fn holds_length(&self) -> bool {
        self.stiffness.is_infinite()
    }

    /// Stiffness used in the energy (N/m): finite.
    pub(crate) fn spring(&self) -> f64 {
        if self.holds_length() {
            LENGTH_PENALTY
        } else {
            self.stiffness
        }
    }

    /// Tension per stiffness (m) at a stretch (m): the stretch, and what a tendon that stiffens adds.
    pub(crate) fn per_stiffness(&self, stretch: f64) -> f64 {
        stretch * (1.0 + self.stiffening * stretch.max(0.0))
    }

    /// Stretch (m) at which the tendon pulls with `tension` (N), not negative: the inverse of the law of its energy.
    pub fn stretch_under(&self, tension: f64) -> f64 {
        let linear = tension / self.stiffness;
        2.0 * linear / (1.0 + (1.0 + 4.0 * self.stiffening * linear).sqrt())
    }

    /// Energy, tension and stiffness at `length` (m) under `command` (m or N).
    pub(crate) fn state(&self, length: f64, command: f64) -> TendonState {
        if let Drive::Tension = self.drive {
            return TendonState {
                energy: command * length,
                tension: command,
                stiffness: 0.0,
            };
        }
        let stretch = length - command;
        if stretch < 0.0 && self.pull == Pull::TensionOnly {
            return TendonState::default();
        }
        let elastic = self.stretched(stretch);
        match self.servo.largest_force {
            Some(force) if elastic.tension.abs() > force => self.saturated(stretch, force),
            _ => elastic,
        }
    }

    /// The tendon at a stretch (m), its servo strong enough.
    fn stretched(&self, stretch: f64) -> TendonState {
        let stiffness = self.spring();
        let growth = self.stiffening * stretch.max(0.0);
        TendonState {
            energy: stiffness * stretch * stretch * (0.5 + growth / 3.0),
            tension: stiffness * self.per_stiffness(stretch),
            stiffness: stiffness * (1.0 + 2.0 * growth),
        }
    }

    /// The tendon at a stretch (m) at which its servo gives way: it holds `force` (N), pulling or pushing.
    fn saturated(&self, stretch: f64, force: f64) -> TendonState {
        let (limit, tension) = match stretch > 0.0 {
            true => (self.stretch_under(force), force),
            false => (-force / self.spring(), -force),
        };
        TendonState {
            energy: self.stretched(limit).energy + tension * (stretch - limit),
            tension,
            stiffness: 0.0,
        }
    }
}

#[cfg(test)]
mod tests {
    use crate::robot::{Drive, Pull, Robot, RobotSpec, ServoSpec};

    #[test]
    fn a_tendon_that_stiffens_pulls_by_the_slopes_of_its_energy() {
        let mut spec = RobotSpec::standard("2m").expect("a standard robot");
        for tendons in spec.modules.iter_mut().filter_map(|m| m.tendons.as_mut()) {
            tendons.drive = Drive::Gain(2000.0);
            tendons.stiffening = 250.0;
            tendons.pull = Pull::TensionOnly;
        }
        let robot = Robot::new(spec).expect("a valid robot");
        let tendon = &robot.tendons()[0];
        let (rest, h) = (0.05, 1e-6);
        for stretch in [1e-3, 4e-3, 0.02] {
            let at = |by: f64| tendon.state(rest + stretch + by, rest);
            let (low, here, high) = (at(-h), at(0.0), at(h));
            let expected = 2000.0 * stretch * (1.0 + 250.0 * stretch);
            assert!((here.tension - expected).abs() < 1e-9 * expected);
            let slope = (high.energy - low.energy) / (2.0 * h);
            assert!((slope - here.tension).abs() < 1e-6 * here.tension);
            let slope = (high.tension - low.tension) / (2.0 * h);
            assert!((slope - here.stiffness).abs() < 1e-6 * here.stiffness);
            assert!((tendon.stretch_under(here.tension) - stretch).abs() < 1e-12);
        }
        assert_eq!(tendon.state(rest - 1e-3, rest).tension, 0.0);
    }

    #[test]
    fn a_servo_gives_way_at_its_largest_force_and_its_energy_goes_on_smoothly() {
        let mut spec = RobotSpec::standard("2m").expect("a standard robot");
        for tendons in spec.modules.iter_mut().filter_map(|m| m.tendons.as_mut()) {
            tendons.drive = Drive::Gain(2000.0);
            tendons.stiffening = 250.0;
            tendons.servo = Some(ServoSpec {
                largest_force: Some(6.0),
                ..ServoSpec::default()
            });
        }
        let robot = Robot::new(spec).expect("a valid robot");
        let tendon = &robot.tendons()[0];
        let (rest, h) = (0.05, 1e-6);
        for (stretch, tension) in [(0.01, 6.0), (-0.01, -6.0), (-0.001, -2.0)] {
            let at = |by: f64| tendon.state(rest + stretch + by, rest);
            assert!((at(0.0).tension - tension).abs() < 1e-12);
            let slope = (at(h).energy - at(-h).energy) / (2.0 * h);
            assert!((slope - tension).abs() < 1e-6, "{slope}");
        }
        let limit = tendon.stretch_under(6.0);
        let energy = |by: f64| tendon.state(rest + limit + by, rest).energy;
        assert!((energy(1e-9) - energy(-1e-9)).abs() < 2e-8);
    }
}
