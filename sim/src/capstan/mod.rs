//! Friction of a tendon in the holes it goes through: the capstan law with elastic sticking, by return mapping. The law is that of
//! [`crate::tendon_friction`].

mod line;

pub(crate) use line::Line;

/// What a tendon does where it passes a hole.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SlipState {
    /// It sticks; the contact deflects elastically.
    Sticks,
    /// It slips towards the servo: the tension is higher on the servo's side.
    SlipsToServo,
    /// It slips towards the end where the tendon is fastened: the tension is lower on the servo's
    /// side.
    SlipsToEnd,
}

/// One tendon from the servo to its fastened end: a route of `n` holes has `n - 1` segments and
/// `n - 2` interior holes.
#[derive(Clone, Debug, PartialEq)]
pub struct TendonProfile {
    /// Length of each segment (m).
    pub lengths: Vec<f64>,
    /// Tension of each segment (N).
    pub tensions: Vec<f64>,
    /// Wrap angle at each interior hole, between the segments on its two sides (rad).
    pub wrap_angles: Vec<f64>,
    /// Elastic deflection of the contact at each interior hole (m), positive when the friction holds
    /// the tendon back from moving towards the servo.
    pub deflections: Vec<f64>,
    /// How the tendon moved through each interior hole in the last substep.
    pub slip_states: Vec<SlipState>,
}

/// The friction forces (N) that a contact can bear.
#[derive(Clone, Copy, Debug)]
struct Cone {
    /// Sliding away from the servo; not positive.
    low: f64,
    /// Sliding towards the servo; not negative.
    high: f64,
}

impl Cone {
    /// The cone at a hole with `mu theta` where the tension on the servo's side is `tension`. A
    /// tendon that does not pull has no friction.
    fn new(mu_theta: f64, tension: f64) -> Self {
        let tension = tension.max(0.0);
        Self {
            low: -tension * mu_theta.exp_m1(),
            high: -tension * (-mu_theta).exp_m1(),
        }
    }
}

/// Energy that one tendon takes part in during one step (J).
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Work {
    /// Done on the tendon at the servo.
    pub servo: f64,
    /// Turned into heat at the holes.
    pub dissipated: f64,
}

impl TendonProfile {
    /// Storage for the profile of a tendon.
    pub(crate) fn new(line: &Line) -> Self {
        let (segments, holes) = (line.lengths.len(), line.wrap_angles.len());
        Self {
            lengths: vec![0.0; segments],
            tensions: vec![0.0; segments],
            wrap_angles: vec![0.0; holes],
            deflections: vec![0.0; holes],
            slip_states: vec![SlipState::Sticks; holes],
        }
    }

    /// The profile along `line` under one tension (N), no contact loaded.
    pub(crate) fn relax(&mut self, line: &Line, tension: f64) {
        self.lengths.copy_from_slice(&line.lengths);
        self.wrap_angles.copy_from_slice(&line.wrap_angles);
        self.tensions.fill(tension);
        self.deflections.fill(0.0);
        self.slip_states.fill(SlipState::Sticks);
    }

    /// The profile along `line` after the step from `before`, with the tension `servo_tension` (N)
    /// at the servo: every contact sticks if it can.
    pub(crate) fn follow(&mut self, line: &Line, before: &Self, servo_tension: f64) {
        self.trace(line, before, servo_tension, |_, trial, cone| {
            if trial > cone.high {
                (cone.high, SlipState::SlipsToServo)
            } else if trial < cone.low {
                (cone.low, SlipState::SlipsToEnd)
            } else {
                (trial, SlipState::Sticks)
            }
        });
    }

    /// The same where every contact is taken to be as `assumed`, whether it can or not: a smooth
    /// function of the configuration. The contacts written say what is to be assumed next.
    pub(crate) fn assume(
        &mut self,
        line: &Line,
        before: &Self,
        servo_tension: f64,
        assumed: &[SlipState],
    ) {
        self.trace(
            line,
            before,
            servo_tension,
            |hole, trial, cone| match assumed[hole] {
                SlipState::Sticks if trial > cone.high => (trial, SlipState::SlipsToServo),
                SlipState::Sticks if trial < cone.low => (trial, SlipState::SlipsToEnd),
                SlipState::SlipsToServo if trial >= cone.high => {
                    (cone.high, SlipState::SlipsToServo)
                }
                SlipState::SlipsToEnd if trial <= cone.low => (cone.low, SlipState::SlipsToEnd),
                SlipState::Sticks => (trial, SlipState::Sticks),
                SlipState::SlipsToServo => (cone.high, SlipState::Sticks),
                SlipState::SlipsToEnd => (cone.low, SlipState::Sticks),
            },
        );
    }

    fn trace(
        &mut self,
        line: &Line,
        before: &Self,
        servo_tension: f64,
        contact: impl Fn(usize, f64, Cone) -> (f64, SlipState),
    ) {
        self.lengths.copy_from_slice(&line.lengths);
        self.wrap_angles.copy_from_slice(&line.wrap_angles);
        // What moves through a hole towards the servo is what the tendon beyond gets shorter by.
        let mut moved = 0.0;
        for hole in (0..self.wrap_angles.len()).rev() {
            moved += before.lengths[hole + 1] - self.lengths[hole + 1];
            self.deflections[hole] = before.deflections[hole] + moved;
        }
        let stiffness = line.friction.contact_stiffness;
        self.tensions[0] = servo_tension;
        for hole in 0..self.wrap_angles.len() {
            let mu_theta = line.friction.coefficient * self.wrap_angles[hole];
            let cone = Cone::new(mu_theta, self.tensions[hole]);
            let trial = stiffness * self.deflections[hole];
            let (force, state) = contact(hole, trial, cone);
            self.slip_states[hole] = state;
            if state != SlipState::Sticks {
                self.deflections[hole] = force / stiffness;
            }
            self.tensions[hole + 1] = self.tensions[hole] - force;
        }
    }

    /// Elastic energy stored in the contacts (J).
    pub(crate) fn stored(&self, line: &Line) -> f64 {
        let squares: f64 = self.deflections.iter().map(|z| z * z).sum();
        0.5 * line.friction.contact_stiffness * squares
    }

    /// The work of the step from `before`, by the trapezoidal rule: second order in the step, and
    /// never negative at a hole.
    pub(crate) fn work(&self, line: &Line, before: &Self) -> Work {
        let change = self.lengths.iter().sum::<f64>() - before.lengths.iter().sum::<f64>();
        let mut dissipated = 0.0;
        let mut moved = 0.0;
        for hole in (0..self.wrap_angles.len()).rev() {
            moved += before.lengths[hole + 1] - self.lengths[hole + 1];
            let slip = moved - (self.deflections[hole] - before.deflections[hole]);
            let bound = |profile: &Self| {
                let mu_theta = line.friction.coefficient * profile.wrap_angles[hole];
                let cone = Cone::new(mu_theta, profile.tensions[hole]);
                match self.slip_states[hole] {
                    SlipState::Sticks => 0.0,
                    SlipState::SlipsToServo => cone.high,
                    SlipState::SlipsToEnd => cone.low,
                }
            };
            dissipated += 0.5 * (bound(before) + bound(self)) * slip;
        }
        Work {
            servo: -0.5 * (before.tensions[0] + self.tensions[0]) * change,
            dissipated,
        }
    }

    /// Derivatives of the friction force at `hole` when its contact is as `contact`: by the tension on
    /// the servo's side, by the wrap angle (N/rad), and by the length of the tendon beyond (N/m). They are those of
    /// the cone's bounds and of the return mapping (consistent tangent: Simo and Hughes, ch. 3).
    pub(crate) fn slopes(&self, line: &Line, hole: usize, contact: SlipState) -> [f64; 3] {
        let mu = line.friction.coefficient;
        let mu_theta = mu * self.wrap_angles[hole];
        let tension = self.tensions[hole].max(0.0);
        let pulls = if self.tensions[hole] > 0.0 { 1.0 } else { 0.0 };
        match contact {
            SlipState::Sticks => [0.0, 0.0, -line.friction.contact_stiffness],
            SlipState::SlipsToServo => [
                -pulls * (-mu_theta).exp_m1(),
                tension * mu * (-mu_theta).exp(),
                0.0,
            ],
            SlipState::SlipsToEnd => [
                -pulls * mu_theta.exp_m1(),
                -tension * mu * mu_theta.exp(),
                0.0,
            ],
        }
    }

    /// Derivative of the friction force at `hole` by the coefficient of friction when its contact is as `contact` (N).
    pub(crate) fn slope_by_coefficient(&self, line: &Line, hole: usize, contact: SlipState) -> f64 {
        let theta = self.wrap_angles[hole];
        let mu_theta = line.friction.coefficient * theta;
        let pull = self.tensions[hole].max(0.0) * theta;
        match contact {
            SlipState::Sticks => 0.0,
            SlipState::SlipsToServo => pull * (-mu_theta).exp(),
            SlipState::SlipsToEnd => -pull * mu_theta.exp(),
        }
    }
}
