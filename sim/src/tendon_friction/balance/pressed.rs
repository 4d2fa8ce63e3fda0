//! The solve of one substep of a path among obstacles: the balance with the forces of contacts in it.

use super::{Balance, MAX_TURN, SlipRule};
use crate::contact::Touching;
use crate::factor::DenseLu;
use crate::solve::{Correction, Iterate, System, largest_turn, newton};
use crate::tendon_friction::TendonProfile;

/// A substep from `before`.
struct Pressed<'a> {
    balance: &'a mut Balance,
    before: &'a [TendonProfile],
    touching: &'a mut Touching,
}

impl Balance {
    /// Solves the balance from where the robot stands, the last equilibrium, among what it may touch; as [`solve`](Self::solve).
    pub fn solve_pressed(
        &mut self,
        touching: &mut Touching,
        command: &[f64],
        before: &[TendonProfile],
    ) -> (bool, usize) {
        self.assume(before);
        touching.begin();
        self.correcting(command, |balance| {
            newton(&mut Pressed {
                balance,
                before,
                touching,
            })
        })
    }

    /// The correction by the Jacobian at the start of the step, from where holes and contacts are as assumed.
    fn correct(&mut self, touching: &Touching, before: &[TendonProfile]) {
        self.evaluate(before, SlipRule::Assumed);
        self.load_rhs();
        touching.add_besides(&mut self.linear.rhs);
        self.linear.solve();
    }
}

impl System for Pressed<'_> {
    type Model = Correction;
    // Fewer than without obstacles: a shorter substep leads on sooner than a set that alternates.
    const MAX_STEPS: usize = 20;
    const MAX_TRIALS: usize = 8;

    fn iterate(&mut self) -> &mut Iterate {
        &mut self.balance.iterate
    }

    fn is_solved(&mut self) -> bool {
        let balance = &mut *self.balance;
        let pressing = self.touching.press(&balance.iterate.configuration);
        balance.pressing.clone_from(pressing);
        balance.lay();
        balance.follow(self.before);
        balance.residual() <= balance.tolerance
    }

    fn newton_step(&mut self) -> Correction {
        let (balance, touching) = (&mut *self.balance, &mut *self.touching);
        balance.pressing.clone_from(touching.begin_step());
        balance.evaluate(self.before, SlipRule::Assumed);
        let mut jacobian = balance.jacobian();
        touching.add_stiffness(&mut jacobian);
        balance.expansion.confine(&mut jacobian);
        let lu = DenseLu::new(&jacobian, &balance.expansion.hinges);
        balance.linear.take_dense(lu);
        balance.correct(touching, self.before);
        let step = &mut balance.iterate.step;
        step.copy_from_slice(&balance.linear.solution);
        let size = largest_turn(step);
        touching.keep_clear(step);
        balance.iterate.limit_step(MAX_TURN);
        let step = &balance.iterate.step;
        touching.predict(step);
        Correction::new(size, largest_turn(step))
    }

    /// As without obstacles.
    fn accepts(&mut self, model: &Correction, share: f64) -> bool {
        let (balance, touching) = (&mut *self.balance, &mut *self.touching);
        let Some(pressing) = touching.press_step(&balance.iterate.configuration, share) else {
            return false;
        };
        balance.pressing.clone_from(pressing);
        balance.lay();
        balance.correct(touching, self.before);
        let accepted = model.improves(share, largest_turn(&balance.linear.solution));
        if accepted {
            balance.revise();
            touching.revise(share);
        }
        accepted
    }
}
