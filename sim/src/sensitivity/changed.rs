//! How an equilibrium moves when the robot becomes another one, a little different in anything.

use nalgebra::Vector3;

use super::Sensitivity;
use crate::energy::{DeadForces, Potential};
use crate::robot::Robot;
use crate::tendon::Posture;

/// A point fixed to a disc.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct DiscPoint {
    /// The disc, from 0 at the base.
    pub disc: usize,
    /// The point in the disc's frame (m).
    pub place: Vector3<f64>,
}

/// Storage for robots of one layout.
pub(crate) struct Changed {
    posture: Posture,
    dead: DeadForces,
    tensions: Vec<f64>,
    command: Vec<f64>,
    gradient: Vec<Vector3<f64>>,
    own: Vec<Vector3<f64>>,
}

impl Changed {
    pub fn new(robot: &Robot) -> Self {
        let none = vec![Vector3::zeros(); robot.discs().len()];
        Self {
            posture: Posture::new(robot),
            dead: DeadForces::new(robot),
            tensions: vec![0.0; robot.tendons().len()],
            command: vec![0.0; robot.tendons().len()],
            gradient: none.clone(),
            own: none,
        }
    }
}

impl Sensitivity {
    /// To first order, how far points move when the robot becomes `changed` and is commanded `command` (m or N), and the
    /// points' places become `to`.
    ///
    /// At the present configuration `q` the changed robot has the gradient `g'(q)` in place of `g(q) = 0`; the implicit
    /// function theorem turns the joints by `-J⁻¹ (g' - g)`. Any parameter's derivative follows from a robot in which
    /// it is a little different, exact but for the second order of that difference. Both robots have the same discs and tendons.
    pub(crate) fn towards(
        &self,
        changed: &Robot,
        command: &[f64],
        points: &[(DiscPoint, DiscPoint)],
        storage: &mut Changed,
        out: &mut [Vector3<f64>],
    ) {
        let Changed {
            posture,
            dead,
            tensions,
            command: effective,
            gradient,
            own,
        } = storage;
        // The gradient of the changed robot in the same configuration. Held lengths are constraints of the solve.
        posture.chain.orientations[0] = *changed.base_orientation().to_rotation_matrix().matrix();
        posture.place(changed, &self.q);
        dead.set(changed, &self.loads);
        effective.copy_from_slice(command);
        for &t in &self.held.tendons {
            effective[t] = self.command[t];
        }
        let potential = Potential {
            robot: changed,
            command: effective,
            dead,
        };
        potential.gradient(&self.q, posture, tensions, gradient);
        self.expansion.gradient(own);
        for (change, own) in gradient.iter_mut().zip(own.iter()) {
            *change -= own;
        }
        // How much longer the held tendons are than they should be.
        let growth: Vec<f64> = (self.held.tendons.iter())
            .map(|&t| posture.lengths[t] - command[t])
            .collect();
        let none = vec![Vector3::zeros(); gradient.len()];
        let (turns, _) = self.solve(gradient, &none, &growth, super::Side::Matrix);
        // Points move with the joints that turn below them, and with what the change does where no joint turns.
        let chain = &self.posture.chain;
        for (out, (from, to)) in out.iter_mut().zip(points) {
            let point = chain.positions[from.disc] + chain.disc(from.disc) * from.place;
            let moved = &posture.chain;
            *out = moved.positions[to.disc] + moved.disc(to.disc) * to.place - point;
            for (turn, centre) in turns.iter().zip(&chain.centres).take(from.disc + 1) {
                *out -= turn.cross(&(point - centre));
            }
        }
    }
}
