//! Derivatives of pressed robots by all that they are made of, beside central differences.

use nalgebra::{DMatrix, UnitQuaternion, Vector3};
use tdcr_sim::contact::{Activity, Contact, ContactEquilibrium, ContactSettler};
use tdcr_sim::pose::PoseTangent;
use tdcr_sim::robot::{Backbone, PerDisc, Robot};
use tdcr_sim::robot::{Command, Loads, Parameter, RobotSpec, RodDamping, RodSpec};
use tdcr_sim::scene::{Obstacle, Scene, SelfContact};

/// A robot under a command among obstacles.
struct Pressed {
    robot: Robot,
    scene: Scene,
    command: Command,
}

impl Pressed {
    fn settled(&self, robot: &Robot, from: Option<&ContactEquilibrium>) -> ContactEquilibrium {
        let mut settler = ContactSettler::new(robot, &self.scene);
        let loads = Loads::default();
        let found = match from {
            Some(from) => {
                let start = &from.equilibrium.configuration;
                settler.settle_from(start, &self.command, &loads)
            }
            None => settler.settle(&self.command, &loads),
        };
        let found = found.unwrap().clone();
        assert!(found.equilibrium.converged && !found.contacts.is_empty());
        let strict = |contact: &Contact| contact.activity == Activity::Strict;
        assert!(found.contacts.iter().all(strict), "{:?}", found.contacts);
        found
    }

    /// Compares the derivatives by parameters of the robot with differences, and their transpose with themselves.
    fn check(&self, parameters: &[Parameter]) {
        let found = self.settled(&self.robot, None);
        let mut settler = ContactSettler::new(&self.robot, &self.scene);
        let loads = Loads::default();
        settler.settle(&self.command, &loads).unwrap();
        let sensitivity = settler.sensitivity(&self.command, &loads).unwrap();
        let sensitivity = sensitivity.parameters();
        let spec = self.robot.spec();
        let n = self.robot.discs().len();
        let cotangents: Vec<PoseTangent> = (0..n)
            .map(|disc| PoseTangent {
                position: Vector3::new((disc as f64).sin(), 0.5, (disc as f64).cos()),
                rotation: Vector3::new(0.02, 0.03 * (disc as f64).sin(), -0.01),
            })
            .collect();
        for &parameter in parameters {
            let value = spec.value(parameter).unwrap();
            let size = 1e-5 * value.abs().max(1e-3);
            let poses = sensitivity.jvp(&[(parameter, 1.0)]).unwrap();
            let [below, above] = [-size, size].map(|by| {
                let spec = spec.with(&[(parameter, value + by)]).unwrap();
                let moved = self.settled(&Robot::new(spec).unwrap(), Some(&found));
                assert_eq!(moved.contacts.len(), found.contacts.len());
                moved.equilibrium
            });
            let turned = |disc: usize| {
                let [from, to] = [&below, &above].map(|at| at.orientations[disc]);
                let turn: UnitQuaternion<f64> = to * from.inverse();
                turn.scaled_axis()
            };
            let ours = DMatrix::from_fn(6, n, |row, disc| match row {
                0..3 => poses[disc].position[row],
                _ => poses[disc].rotation[row - 3],
            });
            let differences = DMatrix::from_fn(6, n, |row, disc| match row {
                0..3 => (above.positions[disc] - below.positions[disc])[row],
                _ => turned(disc)[row - 3],
            }) / (2.0 * size);
            for rows in [0, 3] {
                let [ours, differences] =
                    [&ours, &differences].map(|all| all.rows(rows, 3).into_owned());
                let error = (&ours - &differences).amax();
                assert!(
                    error < 2e-5 * differences.amax() + 1e-9 / size,
                    "{parameter}: {error:e} of {:e}",
                    differences.amax()
                );
            }
            let along: f64 = (poses.iter().zip(&cotangents))
                .map(|(pose, own)| {
                    pose.position.dot(&own.position) + pose.rotation.dot(&own.rotation)
                })
                .sum();
            let back = sensitivity.vjp(&cotangents, &[parameter]).unwrap()[0];
            assert!(
                (back - along).abs() <= 1e-9 * along.abs() + 1e-12,
                "{back} {along}"
            );
        }
        // The same of the tendons' lengths.
        let pitch = Parameter::Pitch(0);
        let lengths = sensitivity.tendon_jacobians(&[pitch]).unwrap().lengths;
        let value = spec.value(pitch).unwrap();
        let [below, above] = [-1e-7, 1e-7].map(|by| {
            let spec = spec.with(&[(pitch, value + by)]).unwrap();
            self.settled(&Robot::new(spec).unwrap(), Some(&found))
        });
        for (t, ours) in lengths.column(0).iter().enumerate() {
            let [below, above] = [&below, &above].map(|at| at.equilibrium.tendon_lengths[t]);
            let change = (above - below) / 2e-7;
            assert!(
                (ours - change).abs() < 1e-4 * (1.0 + change.abs()),
                "{t}: {ours} {change}"
            );
        }
    }
}

#[test]
fn what_a_disc_presses_moves_with_all_that_the_robot_is_made_of() {
    let mut spec = RobotSpec::standard("2m").unwrap();
    for module in &mut spec.modules {
        module.backbone = Some(PerDisc::Uniform(Backbone::isotropic(0.2)));
    }
    let robot = Robot::new(spec).unwrap();
    let post = Obstacle::cylinder("post", 0.01, 0.4).unwrap();
    let post = post
        .at([-0.045, 0.01, 0.25])
        .with_orientation([0.98, 0.15, 0.1, 0.0]);
    let pressed = Pressed {
        command: robot
            .command(&[0.034, 0.007, 0.001, 0.026, 0.015, 0.019])
            .unwrap(),
        scene: Scene::new(vec![post.unwrap()]).unwrap(),
        robot,
    };
    pressed.check(&pressed.robot.spec().parameters());
}

/// One module of rods from disc to disc, thin beside its discs.
fn on_rods(discs: usize, youngs: f64) -> RobotSpec {
    let mut spec = RobotSpec::standard("2m").unwrap();
    spec.modules.truncate(1);
    let module = &mut spec.modules[0];
    module.discs = discs;
    (module.first_offset, module.pitch, module.joint_below) = (0.03, 0.032, 0.01);
    (module.half_height, module.radius) = (0.001, 0.014);
    module.rod = Some(RodSpec {
        youngs,
        poisson: 0.3,
        radius: 1.5e-3,
        density: 7870.0,
        damping: RodDamping::default(),
    });
    module.tendons.as_mut().unwrap().range = [0.0, 0.6];
    spec
}

/// A bar presses a rod between two discs, where the beads move with the pitch.
#[test]
fn what_a_rod_presses_moves_with_the_pitch_of_its_discs() {
    let robot = Robot::new(on_rods(5, 60e9)).unwrap();
    let bar = Obstacle::capsule("bar", 0.004, 0.05).unwrap();
    let height = 0.174 + 0.03 + 2.0 * 0.032 + 0.011;
    let bar = bar.at([-0.0052, 0.0, height]);
    let pressed = Pressed {
        command: robot.command(&[0.010, 0.004, 0.004]).unwrap(),
        scene: Scene::new(vec![
            bar.with_orientation([0.71, 0.704, 0.02, 0.03]).unwrap(),
        ])
        .unwrap(),
        robot,
    };
    let found = pressed.settled(&pressed.robot, None);
    for contact in &found.contacts {
        let above = contact.point - found.equilibrium.positions[contact.disc];
        assert!((0.003..0.02).contains(&above.norm()), "not on a rod");
    }
    pressed.check(&pressed.robot.spec().parameters());
}

/// The same of a robot that presses its own rods.
#[test]
fn what_a_rod_presses_of_its_own_robot_moves_with_the_pitch() {
    let robot = Robot::new(on_rods(14, 1e9)).unwrap();
    let pressed = Pressed {
        command: robot.command(&[0.295, 0.51, 0.504]).unwrap(),
        scene: Scene::new(Vec::new())
            .and_then(|scene| {
                scene.with_self_contact(SelfContact::Touching {
                    compliance: 1e-4,
                    friction: 0.0,
                })
            })
            .unwrap(),
        robot,
    };
    pressed.check(&[Parameter::Pitch(0)]);
}
