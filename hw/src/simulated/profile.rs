//! The trajectory that a servo follows to its goal.

/// How fast a trajectory may be.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Profile {
    /// Largest speed (ticks/s); infinite for none.
    pub velocity: f64,
    /// Largest acceleration (ticks/s²); infinite for none.
    pub acceleration: f64,
}

impl Profile {
    /// The profile that covers `distance` (ticks) in the time `whole` (s), of which `ramp` is spent on either ramp; at once
    /// where `whole` is 0. A ramp takes half of the whole at most. What moves at `speed` (ticks/s) already can brake in a
    /// ramp.
    pub fn timed(distance: f64, speed: f64, whole: f64, ramp: f64) -> Self {
        let ramp = ramp.min(whole / 2.0);
        let velocity = match whole > 0.0 {
            true => distance.abs() / (whole - ramp),
            false => f64::INFINITY,
        };
        let acceleration = match ramp > 0.0 {
            true => velocity.max(speed.abs()) / ramp,
            false => f64::INFINITY,
        };
        Self {
            velocity,
            acceleration,
        }
    }
}

/// A point on its way to a goal, at trapezoidal speed: it brakes in time, whatever its speed was when the goal was set.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Trajectory {
    /// Where it is (ticks).
    pub position: f64,
    /// Its speed (ticks/s).
    pub velocity: f64,
}

impl Trajectory {
    /// At rest at `position` (ticks).
    pub fn at(position: f64) -> Self {
        Self {
            position,
            velocity: 0.0,
        }
    }

    /// Goes on by `dt` (s) towards `goal` (ticks).
    pub fn step(&mut self, dt: f64, goal: f64, profile: &Profile) {
        let way = goal - self.position;
        let Profile {
            velocity: fastest,
            acceleration,
        } = *profile;
        if fastest.is_infinite() && acceleration.is_infinite() {
            *self = Self::at(goal);
            return;
        }
        // The speed from which steps of dt brake exactly at the goal.
        let braking = match acceleration.is_finite() {
            true => {
                let half = acceleration * dt / 2.0;
                (half * half + 2.0 * acceleration * way.abs()).sqrt() - half
            }
            false => way.abs() / dt,
        };
        let wanted = way.signum() * fastest.min(braking).min(way.abs() / dt);
        self.velocity = ramped(self.velocity, wanted, acceleration * dt);
        self.position += self.velocity * dt;
        if (goal - self.position).abs() < 1e-3 && self.velocity.abs() * dt < 1e-2 {
            *self = Self::at(goal);
        }
    }
}

/// `from` moved towards `to` by `step` at most.
pub(super) fn ramped(from: f64, to: f64, step: f64) -> f64 {
    from + (to - from).clamp(-step, step)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    /// Steps of 1 ms until the trajectory is at its goal.
    fn time_to(trajectory: &mut Trajectory, goal: f64, profile: &Profile) -> usize {
        let mut steps = 0;
        while trajectory.position != goal && steps < 100_000 {
            trajectory.step(1e-3, goal, profile);
            steps += 1;
        }
        steps
    }

    proptest! {
        #[test]
        fn it_arrives_and_keeps_to_its_bounds(
            start in -5000.0..5000.0, goal in -5000.0..5000.0, velocity in 50.0..3000.0, acceleration in 300.0..30000.0
        ) {
            let profile = Profile { velocity, acceleration };
            let mut at = Trajectory::at(start);
            let way: f64 = goal - start;
            let time = way.abs() / velocity + velocity / acceleration + 2.0 * (way.abs() / acceleration).sqrt();
            for _ in 0..(time * 1000.0) as usize + 20 {
                let before = at;
                at.step(1e-3, goal, &profile);
                prop_assert!(at.velocity.abs() <= velocity * (1.0 + 1e-9));
                let brakes = at.position == goal;
                prop_assert!(brakes || (at.velocity - before.velocity).abs() <= acceleration * 1e-3 * (1.0 + 1e-9));
                prop_assert!((at.position - goal).abs() <= (before.position - goal).abs() + 1e-6, "it overshoots");
            }
            prop_assert_eq!(at.position, goal);
        }

        #[test]
        fn a_timed_profile_takes_its_time(way in 10.0..6000.0, whole in 100u32..4000, share in 0.0..0.5) {
            let seconds = f64::from(whole) / 1000.0;
            let profile = Profile::timed(way, 0.0, seconds, share * seconds);
            let taken = time_to(&mut Trajectory::at(0.0), way, &profile);
            prop_assert!((taken as f64 - f64::from(whole)).abs() < 8.0 + 0.02 * f64::from(whole), "{taken} of {whole} ms");
        }
    }

    #[test]
    fn without_bounds_it_is_there_at_once() {
        let profile = Profile::timed(500.0, 0.0, 0.0, 0.0);
        assert_eq!(time_to(&mut Trajectory::at(0.0), 500.0, &profile), 1);
    }
}
