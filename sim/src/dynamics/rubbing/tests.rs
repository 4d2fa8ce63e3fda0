//! The equation of a step, checked without its factors.
#![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

use nalgebra::UnitQuaternion;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::*;
use crate::dynamics::links::Link;
use crate::random_robot::{Kind, random_hinged_spec, random_spec, within};
use crate::robot::{Drive, Frame, Friction, RobotSpec, Wrench};

/// Robots with friction in all holes, with and without hinges.
fn rough_robots() -> Vec<Robot> {
    let mut rng = ChaCha8Rng::seed_from_u64(4);
    let mut robots = Vec::new();
    while robots.len() < 24 {
        let mut spec: RobotSpec = match robots.len() % 2 {
            0 => random_spec(Kind::Elastic, &mut rng),
            _ => random_hinged_spec(Kind::Elastic, &mut rng),
        };
        spec.routes.clear();
        for tendon in spec.tendon_specs_mut() {
            tendon.friction = Some(Friction {
                coefficient: within(0.05, 0.4, &mut rng),
                contact_stiffness: 1e4,
            });
            if tendon.drive == Drive::Length && !tendon.stretches() {
                tendon.drive = Drive::Tension;
                tendon.range = [0.0, 5.0];
            }
        }
        let robot = Robot::new(spec).unwrap();
        if Rubbing::new(&robot).is_ok_and(|rubbing| rubbing.is_some()) {
            robots.push(robot);
        }
    }
    robots
}

/// A state, in motion, in which the robot's hinges are at angles that they can have.
fn random_state(robot: &Robot, rng: &mut ChaCha8Rng) -> State {
    let mut state = State::straight(robot);
    for (joint, q) in state.configuration.0.iter_mut().enumerate() {
        let turn = Vector3::from_fn(|_, _| within(-0.1, 0.1, rng));
        *q = robot.discs()[joint].moved(q, &turn);
        if robot.discs()[joint].hinges.is_none() {
            *q = UnitQuaternion::from_scaled_axis(turn);
        }
    }
    for (joint, disc) in robot.discs().iter().enumerate() {
        let axes = disc.hinges.as_ref().map_or(3, |hinges| hinges.count);
        for axis in 0..axes {
            state.velocity[3 * joint + axis] = within(-1.0, 1.0, rng);
        }
    }
    state
}

#[test]
fn accelerations_solve_the_equation_of_the_step() {
    let mut rng = ChaCha8Rng::seed_from_u64(5);
    let mut slipping = 0;
    for (number, robot) in rough_robots().iter().enumerate() {
        let step = Implicitness {
            timestep: 2e-3,
            stiffness: number % 4 < 2,
        };
        let h = step.timestep;
        let armatures = Link::armatures(robot, 0.0);
        let mut equations = EquationsOfMotion::new(robot, &armatures).unwrap();
        let state = random_state(robot, &mut rng);
        let command = robot.random_command(&mut rng);
        let wrench = Wrench {
            force: [0.1, -0.2, 0.3],
            ..Wrench::none(robot.discs().len() - 1, Frame::Disc)
        };
        let loads = Loads::payload(0.02).unwrap().with_wrench(wrench).unwrap();
        equations.accept(&state, &command, &loads).unwrap();
        equations.enter(&state.configuration, &state.velocity, command.as_slice());
        let mut rubbing = Rubbing::new(robot).unwrap().unwrap();
        rubbing.begin(&equations, &state, command.as_slice());
        for assumed in rubbing.assumed.iter_mut().flatten() {
            *assumed = [
                SlipState::Sticks,
                SlipState::SlipsToServo,
                SlipState::SlipsToEnd,
            ][rng.random_range(0..3)];
            slipping += usize::from(*assumed != SlipState::Sticks);
        }
        let mut out = vec![0.0; robot.dof()];
        let q = &state.configuration;
        assert!(rubbing.accelerate(&mut equations, &loads, q, step, &mut out));
        let accelerations = rubbing.solution.clone();
        // M a + bias - tau, with the tensions of the servos in tau, damping and all else at the begin of the step.
        let n = accelerations.len();
        let mut left = vec![Vector3::zeros(); n];
        equations.residual(&accelerations, &mut left);
        for (joint, link) in equations.links.iter().enumerate() {
            let axes = equations.posture.chain.hinges(joint);
            let damping = link.damping_matrix(&equations.orientations()[joint], axes);
            left[joint] += damping * accelerations[joint] * h;
        }
        // Tensions at the end of the step in place of those of the servos.
        let rates: Vec<_> = (rubbing.rates.iter().zip(&accelerations))
            .map(|(v, a)| v + a * h)
            .collect();
        let expansion = &rubbing.blocks.expansion;
        let mut tensions = vec![0.0; rubbing.tensions.len()];
        rubbing.lu.tension_changes(expansion, &rates, &mut tensions);
        tensions.iter_mut().for_each(|tension| *tension *= h);
        for (t, places) in rubbing.places.iter().enumerate() {
            for (segment, &place) in places.iter().enumerate() {
                tensions[place] += rubbing.after[t].tensions[segment] - rubbing.servos[t].tension;
            }
        }
        rubbing.lu.pull(expansion, &tensions, &mut left);
        if step.stiffness {
            let mut stiff = vec![Vector3::zeros(); n];
            rubbing
                .blocks
                .stiffness_product(&equations, &loads, &rates, &mut stiff);
            left.iter_mut()
                .zip(&stiff)
                .for_each(|(left, stiff)| *left += stiff * h);
        }
        let mut scale: f64 = 0.0;
        equations.residual(&vec![Vector3::zeros(); n], &mut rubbing.forces);
        for force in &rubbing.forces {
            scale = scale.max(force.norm());
        }
        for (joint, left) in left.iter().enumerate() {
            let left = match equations.posture.chain.hinges(joint) {
                Some(hinges) => hinges.project(left),
                None => *left,
            };
            assert!(
                left.norm() < 1e-9 * scale,
                "robot {number}, joint {joint}: {left:?} of {scale}"
            );
        }
    }
    assert!(slipping > 100);
}

/// The changes of the tensions that the step takes implicitly are those of the law, by central differences.
#[test]
fn tensions_change_as_the_law_says() {
    let mut rng = ChaCha8Rng::seed_from_u64(6);
    let step = Implicitness {
        timestep: 1e-3,
        stiffness: true,
    };
    for robot in rough_robots() {
        let armatures = Link::armatures(&robot, 0.0);
        let mut equations = EquationsOfMotion::new(&robot, &armatures).unwrap();
        let state = random_state(&robot, &mut rng);
        // Far from slack.
        let lows: Vec<f64> = robot
            .tendons()
            .iter()
            .map(|tendon| match tendon.drive {
                Drive::Tension => tendon.range[1],
                _ => tendon.range[0],
            })
            .collect();
        let command = robot.command(&lows).unwrap();
        equations
            .accept(&state, &command, &Loads::default())
            .unwrap();
        equations.enter(&state.configuration, &state.velocity, command.as_slice());
        let mut rubbing = Rubbing::new(&robot).unwrap().unwrap();
        rubbing.begin(&equations, &state, command.as_slice());
        let assumed = [
            SlipState::Sticks,
            SlipState::SlipsToServo,
            SlipState::SlipsToEnd,
        ];
        for (number, contact) in rubbing.assumed.iter_mut().flatten().enumerate() {
            *contact = assumed[number % 3];
        }
        let mut out = vec![0.0; robot.dof()];
        let q = &state.configuration;
        assert!(rubbing.accelerate(&mut equations, &Loads::default(), q, step, &mut out));
        let turns: Vec<Vector3<f64>> = (0..robot.discs().len())
            .map(|joint| {
                let turn = Vector3::from_fn(|_, _| within(-1.0, 1.0, &mut rng));
                equations
                    .posture
                    .chain
                    .hinges(joint)
                    .map_or(turn, |hinges| hinges.project(&turn))
            })
            .collect();
        let mut changes = vec![0.0; rubbing.tensions.len()];
        let expansion = &rubbing.blocks.expansion;
        rubbing.lu.tension_changes(expansion, &turns, &mut changes);
        let mut shifted = |by: f64| {
            let mut q = state.configuration.clone();
            for (joint, turn) in turns.iter().enumerate() {
                let chain = &equations.posture.chain;
                let own = chain.dual(joint).tr_mul(&(turn * by));
                q.0[joint] = robot.discs()[joint].moved(&q.0[joint], &own);
            }
            rubbing.chain.place(&robot, &q);
            let (mut lines, mut servos) = (rubbing.lines.clone(), rubbing.servos.clone());
            lay(
                (&mut lines, &mut servos),
                &robot,
                &rubbing.chain,
                command.as_slice(),
            );
            let mut tensions = changes.clone();
            for (t, places) in rubbing.places.iter().enumerate() {
                let mut profile = rubbing.before[t].clone();
                profile.assume(
                    &lines[t],
                    &rubbing.before[t],
                    servos[t].tension,
                    &rubbing.assumed[t],
                );
                places
                    .iter()
                    .zip(&profile.tensions)
                    .for_each(|(&place, t)| tensions[place] = *t);
            }
            tensions
        };
        let by = 1e-6;
        let (up, down) = (shifted(by), shifted(-by));
        let largest = changes
            .iter()
            .fold(1.0, |most: f64, change| most.max(change.abs()));
        for &place in rubbing.places.iter().flatten() {
            let slope = (up[place] - down[place]) / (2.0 * by);
            let off = (slope - changes[place]).abs();
            assert!(off < 1e-5 * largest, "{off:.1e} of {largest:.1e}");
        }
    }
}
