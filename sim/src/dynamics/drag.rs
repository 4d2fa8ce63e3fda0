//! Drag of a fluid at rest around the discs.
//!
//! A disc whose origin moves at `v` is held back by `1/2 rho C A |v|`, times `v` (the drag equation; White, Fluid Mechanics, ch. 7), where
//! `A` is the area that its cylinder shows along `v`: `A |v| = pi r² |v_z| + 2 r l |v_xy|` with the radius `r`, the height `l` and the
//! velocity in the disc's frame. In a step by `h` that factor, `b`, is taken at its begin and the velocity at its end: `v+ = v* - h A^-1 J'
//! b J v+` of the rates `v*` without drag, so that drag takes energy out whatever the time step.

use nalgebra::{Matrix3, Vector3};

use super::acceleration::EquationsOfMotion;
use super::pushes::Push;
use super::reaction::Reaction;
use crate::robot::Robot;

/// The drag of one robot's discs in a step.
#[derive(Clone, Debug)]
pub(super) struct Drag {
    /// Of each disc, `1/2 rho C` times its areas along its axis and across (N s²/m²).
    factors: Vec<[f64; 2]>,
    /// Impulses at the rates without drag, and what changes of the rates take of them.
    pub reactions: Vec<Reaction>,
    /// The latter alone, with those of others added.
    forms: Vec<Reaction>,
    /// What drag changes of the rates (rad/s, world axes).
    pub change: Vec<Vector3<f64>>,
}

impl Drag {
    /// Of a robot in a fluid.
    pub fn new(robot: &Robot) -> Option<Box<Self>> {
        let fluid = robot.spec().fluid?;
        let half = 0.5 * fluid.density * fluid.drag_coefficient;
        let n = robot.discs().len();
        let discs = robot.discs().iter();
        let factors = discs.map(|disc| {
            let (r, height) = (disc.radius, 2.0 * disc.half_height);
            [half * std::f64::consts::PI * r * r, half * 2.0 * r * height]
        });
        Some(Box::new(Self {
            factors: factors.collect(),
            reactions: vec![Reaction::default(); n],
            forms: vec![Reaction::default(); n],
            change: vec![Vector3::zeros(); n],
        }))
    }

    /// Sets the reactions in a step by `h` (s) that was begun with the joints' coordinates' `rates` (rad/s) and has `accelerations` of these
    /// without drag (rad/s²).
    pub fn set(
        &mut self,
        equations: &EquationsOfMotion,
        rates: &[f64],
        accelerations: &[f64],
        h: f64,
    ) {
        let moving = Moving::all(equations, rates, accelerations, h);
        let discs = self.reactions.iter_mut().zip(&self.factors).zip(moving);
        for ((reaction, [along, across]), Moving { arm, own, end, .. }) in discs {
            let inertance = h * (along * own.z.abs() + across * own.xy().norm());
            let form = Matrix3::from_diagonal_element(inertance);
            *reaction = Reaction::default();
            reaction.push(&arm, &(end * -inertance), &form);
        }
    }

    /// Adds what drag does in a step by `h` (s) with these `accelerations` (rad/s²) that have it.
    pub fn add_pushes(
        &self,
        equations: &EquationsOfMotion,
        (rates, accelerations): (&[f64], &[f64]),
        h: f64,
        out: &mut Vec<Push>,
    ) {
        let chain = &equations.posture.chain;
        let moving = Moving::all(equations, rates, accelerations, h);
        for (disc, ([along, across], moving)) in self.factors.iter().zip(moving).enumerate() {
            let Moving {
                own, begin, end, ..
            } = moving;
            let sideways = own.xy().norm();
            let inertance = h * (along * own.z.abs() + across * sideways);
            // By the velocity in the disc's frame, which turns with the disc.
            let mut slope = Vector3::zeros();
            if own.z != 0.0 {
                slope.z = along * own.z.signum();
            }
            if sideways > 0.0 {
                slope += Vector3::new(own.x, own.y, 0.0) * (across / sideways);
            }
            let slope = chain.disc(disc) * slope * h;
            out.push(Push {
                disc,
                carried: chain.positions[disc],
                arm: Vector3::zeros(),
                slides: Matrix3::zeros(),
                impulse: end * -inertance,
                inertance: Matrix3::from_diagonal_element(inertance),
                by_place: Matrix3::zeros(),
                by_begin: -end * slope.transpose(),
                by_turn: -end * slope.cross(&begin).transpose(),
                opposite: None,
                obstacle: None,
            });
        }
    }

    /// The `others` with how drag answers to changes of the rates; drag alone where there are none.
    pub fn with(&mut self, others: &[Reaction]) -> &[Reaction] {
        for (disc, (form, own)) in self.forms.iter_mut().zip(&self.reactions).enumerate() {
            *form = others.get(disc).copied().unwrap_or_default();
            form.add_form(own);
        }
        &self.forms
    }
}

/// How a disc moves in a step.
struct Moving {
    /// Its origin from the centre of its joint (m).
    arm: Vector3<f64>,
    /// Velocity of its origin at the begin and at the end (m/s); the former in the disc's frame, too.
    begin: Vector3<f64>,
    end: Vector3<f64>,
    own: Vector3<f64>,
}

impl Moving {
    /// All discs, in a step by `h` (s) that was begun with the joints' coordinates' `rates` and has these `accelerations`.
    fn all(
        equations: &EquationsOfMotion,
        rates: &[f64],
        accelerations: &[f64],
        h: f64,
    ) -> impl Iterator<Item = Self> {
        let chain = &equations.posture.chain;
        // Turn of the disc, and velocity of its joint's centre, at the begin and at the end.
        let mut moving = [(Vector3::zeros(), Vector3::zeros()); 2];
        let mut below = chain.centres.first().copied().unwrap_or_default();
        let joints = rates.as_chunks::<3>().0.iter();
        let joints = joints.zip(accelerations.as_chunks::<3>().0);
        joints.enumerate().map(move |(disc, (rate, acceleration))| {
            let (axes, centre) = (chain.axes(disc), chain.centres[disc]);
            let rate = Vector3::from(*rate);
            let ends = [rate, rate + Vector3::from(*acceleration) * h];
            for ((turn, shift), rate) in moving.iter_mut().zip(ends) {
                *shift += turn.cross(&(centre - below));
                *turn += axes * rate;
            }
            below = centre;
            let arm = chain.positions[disc] - centre;
            let [begin, end] = moving.map(|(turn, shift)| shift + turn.cross(&arm));
            let own = chain.disc(disc).tr_mul(&begin);
            Self {
                arm,
                begin,
                end,
                own,
            }
        })
    }
}
