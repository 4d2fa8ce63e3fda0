//! A spool on a servo's horn, behind the play of the gear.

use std::f64::consts::TAU;

/// Which way a horn turns to wind its tendon up.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Winding {
    /// With rising ticks: counter-clockwise, seen from the front.
    #[default]
    Counterclockwise,
    /// With falling ticks.
    Clockwise,
}

/// A spool that its horn turns through play: where the horn turns back, the spool stands until the play is taken up (the
/// play operator; Visintin, Differential Models of Hysteresis, ch. III).
#[derive(Clone, Copy, Debug)]
pub struct Spool {
    radius: f64,
    backlash: f64,
    winding: Winding,
    /// The spool's own angle (rad).
    angle: f64,
    /// Its angle at home.
    home: f64,
}

impl Spool {
    /// A spool of `radius` (m) behind play of the whole width `backlash` (rad), with nothing wound up where the horn is at
    /// `home` (rad), in the middle of the play.
    pub fn new(radius: f64, backlash: f64, winding: Winding, home: f64) -> Self {
        Self {
            radius,
            backlash,
            winding,
            angle: home,
            home,
        }
    }

    /// Follows the horn to its angle `horn` (rad).
    pub fn follow(&mut self, horn: f64) {
        let half = self.backlash / 2.0;
        self.angle = self.angle.clamp(horn - half, horn + half);
    }

    /// Length wound up since home (m); negative where it was let out.
    pub fn wound(&self) -> f64 {
        self.sign() * self.radius * (self.angle - self.home)
    }

    /// Torque about the horn (N m, positive counter-clockwise) of a tendon that pulls with `tension` (N).
    pub fn torque(&self, tension: f64) -> f64 {
        -self.sign() * self.radius * tension
    }

    /// Length wound up in a turn of the horn (m).
    pub fn circumference(&self) -> f64 {
        TAU * self.radius
    }

    fn sign(&self) -> f64 {
        match self.winding {
            Winding::Counterclockwise => 1.0,
            Winding::Clockwise => -1.0,
        }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn winding() -> impl Strategy<Value = Winding> {
        prop_oneof![Just(Winding::Counterclockwise), Just(Winding::Clockwise)]
    }

    proptest! {
        #[test]
        fn a_turn_winds_up_the_circumference(
            radius in 1e-3..0.05, backlash in 0.0..0.3, winding in winding(), home in -20.0..20.0, turns in 1..8
        ) {
            let mut spool = Spool::new(radius, backlash, winding, home);
            let sign = spool.sign();
            // The first half of the play is taken up before the spool moves.
            spool.follow(home + sign * backlash / 2.0);
            prop_assert!(spool.wound().abs() < 1e-12);
            spool.follow(home + sign * (backlash / 2.0 + TAU * f64::from(turns)));
            let expected = TAU * radius * f64::from(turns);
            prop_assert!((spool.wound() - expected).abs() < 1e-9 * expected.max(1.0));
        }

        #[test]
        fn unwinding_through_the_play_does_nothing_for_its_width(
            radius in 1e-3..0.05f64, backlash in 1e-3..0.3f64, winding in winding(), part in 0.0..1.0, beyond in 1e-3..1.0f64
        ) {
            let mut spool = Spool::new(radius, backlash, winding, 0.0);
            let sign = spool.sign();
            let top = sign * 3.0;
            spool.follow(top);
            let wound = spool.wound();
            spool.follow(top - sign * part * backlash);
            prop_assert!((spool.wound() - wound).abs() < 1e-12);
            spool.follow(top - sign * (backlash + beyond));
            prop_assert!((spool.wound() - (wound - radius * beyond)).abs() < 1e-12);
        }
    }

    #[test]
    fn a_pulling_tendon_turns_the_horn_the_way_that_lets_it_out() {
        for (winding, expected) in [
            (Winding::Counterclockwise, -0.05),
            (Winding::Clockwise, 0.05),
        ] {
            assert_eq!(Spool::new(0.005, 0.0, winding, 0.0).torque(10.0), expected);
        }
    }
}
