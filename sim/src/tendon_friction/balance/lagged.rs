//! The balance as a minimum of an energy, with the cones of friction given: how it is solved among obstacles.
//!
//! Within given cones the force at hole `h` is a function of its deflection alone, `f_h = min(max(sigma z_h, low), high)`, and `z_h` one of
//! the length of the tendon beyond. So tendons have the potential `V(L) + sum_h phi_h(z_h)`, `V` that of the drive and `phi_h' = f_h`.

use faer::Mat;
use nalgebra::Vector3;

use super::{Balance, SlipRule, add_scaled};
use crate::chain::Configuration;
use crate::contact::Elastic;
use crate::energy::{Potential, Pressing, add_block, following};
use crate::robot::HingeAxes;
use crate::tendon_friction::{SlipState, TendonProfile};

/// The balance of a step from `before`, within the cones that it has taken over last.
pub(in crate::tendon_friction) struct Lagged<'a> {
    pub balance: &'a mut Balance,
    pub before: &'a [TendonProfile],
}

impl Elastic for Lagged<'_> {
    fn place(&mut self, q: &Configuration) {
        self.balance.start_at(q);
    }

    fn renew(&mut self, share: f64) {
        let balance = &mut *self.balance;
        balance.evaluate(self.before, SlipRule::Capstan);
        let profiles = balance.lines.iter().zip(&balance.profiles);
        for (cones, (line, profile)) in balance.cones.iter_mut().zip(profiles) {
            for (cone, own) in cones.iter_mut().zip(profile.cones(line)) {
                cone.approach(&own, share);
            }
        }
    }

    fn residual(&mut self, pressing: &Pressing) -> f64 {
        self.balance.pressing.clone_from(pressing);
        self.balance.follow(self.before);
        self.balance.residual()
    }

    fn energy(&self) -> f64 {
        let balance = &*self.balance;
        let (q, posture) = (&balance.iterate.configuration, &balance.iterate.posture);
        let potential = Potential {
            robot: &balance.robot,
            command: &balance.rest,
            dead: &balance.weight,
        };
        let holes: f64 = (balance.lines.iter().zip(self.before).zip(&balance.cones))
            .map(|((line, before), cones)| TendonProfile::energy_within(line, before, cones))
            .sum();
        let drag = balance.drag.as_ref().map_or(0.0, |drag| drag.energy(q));
        potential.energy(q, posture) + holes + drag
    }

    fn expand(&mut self, pressing: &Pressing) -> f64 {
        self.balance.pressing.clone_from(pressing);
        self.balance.evaluate(self.before, SlipRule::Lagged);
        self.balance.residual()
    }

    fn gradient(&self, out: &mut [Vector3<f64>]) {
        self.balance.expansion.gradient(out);
    }

    fn hessian(&self) -> Mat<f64> {
        let balance = &*self.balance;
        let posture = &balance.iterate.posture;
        let mut hessian = following::jacobian(&balance.loads, 1.0, posture, &balance.expansion);
        for tendon in 0..balance.lines.len() {
            balance.add_stiffness(tendon, &mut hessian);
        }
        hessian
    }

    fn jacobian(&mut self) -> Mat<f64> {
        let balance = &mut *self.balance;
        for (assumed, profile) in balance.assumed.iter_mut().zip(&balance.profiles) {
            assumed.copy_from_slice(&profile.slip_states);
        }
        balance.jacobian()
    }

    fn confine(&self, hessian: &mut Mat<f64>) {
        self.balance.expansion.confine(hessian);
    }

    fn hinges(&self) -> &[Option<HingeAxes>] {
        &self.balance.expansion.hinges
    }
}

impl Balance {
    /// Adds the second derivatives of one tendon's potential by its lengths: of its drive, and of its holes that stick.
    fn add_stiffness(&self, tendon: usize, hessian: &mut Mat<f64>) {
        let (line, profile) = (&self.lines[tendon], &self.profiles[tendon]);
        let chain = &self.iterate.posture.chain;
        let n = chain.centres.len();
        let mut beyond = vec![Vector3::zeros(); n];
        for segment in (0..line.lengths.len()).rev() {
            let mut own = vec![Vector3::zeros(); n];
            line.add_length_slope(chain, segment, &mut own);
            add_scaled(&mut beyond, 1.0, &own);
            let stiffness = match segment.checked_sub(1) {
                None => {
                    let drive = &self.robot.tendons()[tendon];
                    drive.state(line.length(), self.rest[tendon]).stiffness
                }
                Some(hole) if profile.slip_states[hole] == SlipState::Sticks => {
                    line.friction.contact_stiffness
                }
                Some(_) => 0.0,
            };
            if stiffness == 0.0 {
                continue;
            }
            for (i, row) in beyond.iter().enumerate() {
                for (j, column) in beyond.iter().enumerate() {
                    add_block(hessian, i, j, &(row * column.transpose() * stiffness));
                }
            }
        }
    }
}
