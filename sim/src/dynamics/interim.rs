//! The potential's world-frame interface over the module `energy` of today; to be replaced by it.

use nalgebra::{Matrix3, Vector3};

use crate::chain::{Chain, Configuration};
use crate::robot::{Drive, Frame, Loads, Pull, Robot, Tendon};

/// Forces that keep their size and direction.
#[derive(Clone, Debug)]
pub(crate) struct DeadForces {
    at_origin: Vec<Vector3<f64>>,
    payload: Vector3<f64>,
    payload_arm: Vector3<f64>,
}

impl DeadForces {
    pub fn new(robot: &Robot) -> Self {
        Self {
            at_origin: vec![Vector3::zeros(); robot.discs.len()],
            payload: Vector3::zeros(),
            payload_arm: Vector3::zeros(),
        }
    }

    pub fn set(&mut self, robot: &Robot, loads: &Loads) {
        let line = loads.line_load();
        for (i, (force, disc)) in self.at_origin.iter_mut().zip(&robot.discs).enumerate() {
            let above = robot
                .discs
                .get(i + 1)
                .map_or(0.0, |next| next.offset.norm());
            *force = robot.gravity * disc.mass + line * (0.5 * (disc.offset.norm() + above));
        }
        for wrench in loads.wrenches() {
            if wrench.frame == Frame::World {
                self.at_origin[wrench.disc] += Vector3::from(wrench.force);
            }
        }
        let payload = loads.tip_payload();
        self.payload = robot.gravity * payload.mass;
        let origin = robot
            .discs
            .last()
            .map_or(Vector3::zeros(), |disc| disc.origin);
        self.payload_arm = origin + Vector3::from(payload.offset);
    }
}

pub(crate) struct Potential<'a> {
    pub robot: &'a Robot,
    pub command: &'a [f64],
    pub dead: &'a DeadForces,
}

fn tension(tendon: &Tendon, length: f64, command: f64) -> f64 {
    let stretch = length + tendon.fixed_length - command;
    match (tendon.drive, tendon.pull) {
        (Drive::Tension, _) => command,
        (_, Pull::TensionOnly) if stretch < 0.0 => 0.0,
        _ => tendon.stiffness * stretch,
    }
}

/// Orientations of the discs.
pub(crate) fn discs(chain: &Chain) -> &[Matrix3<f64>] {
    &chain.orientations
}

/// Origins of the discs.
pub(crate) fn origins(robot: &Robot, chain: &Chain) -> Vec<Vector3<f64>> {
    let discs = chain.orientations.iter().zip(&robot.discs);
    (chain.positions.iter().zip(discs))
        .map(|(p, (r, disc))| p + r * disc.origin)
        .collect()
}

/// Centres of the joints.
pub(crate) fn centres(chain: &Chain) -> &[Vector3<f64>] {
    &chain.positions
}

/// Scratch.
#[derive(Clone, Debug)]
pub(crate) struct Slopes {
    lengths: Vec<f64>,
    slopes: Vec<Vector3<f64>>,
}

impl Slopes {
    pub fn new(robot: &Robot) -> Self {
        Self {
            lengths: vec![0.0; robot.tendons.len()],
            slopes: vec![Vector3::zeros(); robot.segments.len()],
        }
    }
}

impl Potential<'_> {
    pub fn energy(&self, chain: &Chain) -> f64 {
        let mut lengths = vec![0.0; self.robot.tendons.len()];
        crate::tendon::tendon_lengths(self.robot, chain, &mut lengths);
        let stretched: f64 = (self.robot.tendons.iter().zip(&lengths).zip(self.command))
            .map(|((tendon, length), command)| match tendon.drive {
                Drive::Tension => command * length,
                _ => tension(tendon, *length, *command).powi(2) / (2.0 * tendon.stiffness),
            })
            .sum();
        let lifted: f64 = (origins(self.robot, chain).iter().zip(&self.dead.at_origin))
            .map(|(p, f)| p.dot(f))
            .sum();
        let tip = chain.positions.len() - 1;
        let hung = chain.positions[tip] + chain.orientations[tip] * self.dead.payload_arm;
        stretched - lifted - self.dead.payload.dot(&hung)
    }

    /// Gradient by the turn of each joint and of everything above it, world axes (N m).
    pub fn gradient(
        &self,
        _q: &Configuration,
        chain: &Chain,
        base: &Matrix3<f64>,
        scratch: &mut Slopes,
        out: &mut [Vector3<f64>],
    ) {
        use super::symmetric::times;
        let n = out.len();
        scratch.lengths.fill(0.0);
        for (segment, slope) in self.robot.segments.iter().zip(&mut scratch.slopes) {
            let below = match segment.joint.checked_sub(1) {
                None => base,
                Some(below) => &chain.orientations[below],
            };
            let hole = times(&chain.orientations[segment.joint], &segment.to);
            let span = hole - times(below, &segment.from);
            let length = span.norm();
            scratch.lengths[segment.tendon] += length;
            *slope = hole.cross(&span) / length;
        }
        for ((length, command), tendon) in
            (scratch.lengths.iter_mut().zip(self.command)).zip(&self.robot.tendons)
        {
            *length = tension(tendon, *length, *command);
        }
        let mut above = self.dead.payload;
        let mut moment = -(chain.orientations[n - 1] * self.dead.payload_arm).cross(&above);
        for k in (0..n).rev() {
            let arm = times(&chain.orientations[k], &self.robot.discs[k].origin);
            let force = &self.dead.at_origin[k];
            moment -= arm.cross(force);
            above += force;
            out[k] = moment;
            if k > 0 {
                let arm = chain.positions[k] - chain.positions[k - 1];
                moment -= arm.cross(&above);
            }
        }
        for (segment, slope) in self.robot.segments.iter().zip(&scratch.slopes) {
            out[segment.joint] += slope * scratch.lengths[segment.tendon];
        }
    }
}

/// `q exp(turn)`, normalised.
#[inline(always)]
pub(crate) fn turned(
    q: &nalgebra::UnitQuaternion<f64>,
    turn: &Vector3<f64>,
) -> nalgebra::UnitQuaternion<f64> {
    let squared = turn.norm_squared();
    let (cos, sinc) = if squared < 1e-4 {
        let x = squared / 4.0;
        (
            1.0 - x * (0.5 - x * (1.0 / 24.0 - x * (1.0 / 720.0))),
            0.5 - x * (1.0 / 12.0 - x * (1.0 / 240.0 - x * (1.0 / 10080.0))),
        )
    } else {
        let angle = squared.sqrt();
        let (sin, cos) = (0.5 * angle).sin_cos();
        (cos, sin / angle)
    };
    let (w, v) = (q.w, q.imag());
    let u = turn * sinc;
    let product =
        nalgebra::Quaternion::from_parts(w * cos - v.dot(&u), u * w + v * cos + v.cross(&u));
    nalgebra::UnitQuaternion::new_normalize(product)
}
