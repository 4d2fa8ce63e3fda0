//! Derivatives of where a path comes to by the command, beside differences of paths.

use tdcr_sim::robot::{Loads, Robot};
use tdcr_sim::scene::{Obstacle, Scene};
use tdcr_sim::tendon_friction::{ContactPath, SlipState};

use super::rough_robot;

/// A path that has gone one way before, and the command that it is led to next, with contacts that slip and others that stick.
fn led(robot: &Robot) -> (ContactPath, Vec<f64>) {
    let mut path = ContactPath::new(robot, &Scene::default());
    for values in [
        [0.03, 0.03, 0.03, 0.03, 0.03, 0.03],
        [0.018, 0.033, 0.03, 0.024, 0.03, 0.031],
    ] {
        let command = robot.command(&values).unwrap();
        path.advance(&command, &Loads::default()).unwrap();
    }
    (path, vec![0.016, 0.0335, 0.0305, 0.026, 0.029, 0.031])
}

#[test]
fn derivatives_by_the_command_are_differences_of_paths() {
    let robot = rough_robot(0.2);
    let (path, goal) = led(&robot);
    let mut there = path.clone();
    let command = robot.command(&goal).unwrap();
    let jacobian = there.advance_differentiated(&command, &Loads::default());
    let jacobian = jacobian.unwrap().unwrap();
    let states = there.state().tendons.iter().flat_map(|t| &t.slip_states);
    let sticks = states.clone().filter(|state| **state == SlipState::Sticks);
    let (sticking, all) = (sticks.count(), states.count());
    assert!(sticking > 0 && sticking < all, "{sticking} of {all} stick");
    for t in 0..goal.len() {
        let at = |step: f64| {
            let mut moved = goal.clone();
            moved[t] += step;
            let command = robot.command(&moved).unwrap();
            let mut path = path.clone();
            let state = path.advance(&command, &Loads::default()).unwrap();
            state.equilibrium.positions.clone()
        };
        let (above, below) = (at(1e-6), at(-1e-6));
        for (disc, (above, below)) in above.iter().zip(&below).enumerate() {
            let slope = (above - below) / 2e-6;
            let moved = jacobian.fixed_view::<3, 1>(6 * disc, t);
            let off = (slope - moved).norm();
            assert!(
                off < 1e-4 * jacobian.column(t).norm(),
                "tendon {t}, disc {disc}: {off}"
            );
        }
    }
}

#[test]
fn among_obstacles_a_path_says_that_it_has_no_derivatives() {
    let robot = rough_robot(0.2);
    let post = Obstacle::cylinder("post", 0.01, 0.4).unwrap();
    let scene = Scene::new(vec![post.at([-0.2, 0.0, 0.25])]).unwrap();
    let mut path = ContactPath::new(&robot, &scene);
    let jacobian = path.advance_differentiated(&robot.mean_command(), &Loads::default());
    assert!(jacobian.unwrap().is_none() && path.state().equilibrium.converged);
}
