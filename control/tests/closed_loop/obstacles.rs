//! Models among obstacles, and trials that learn.

use tdcr_control::belief::Belief;
use tdcr_control::controller::{Controller, Inverse, Predictive, ResolvedRate};
use tdcr_control::learning::Learning;
use tdcr_control::plant::{Plant, SimulatedPlant, Truth};
use tdcr_control::tracking::{Tracking, TrackingSettings, track};
use tdcr_sim::robot::Loads;
use tdcr_sim::scene::{Obstacle, Scene};
use tdcr_sim::simulation::Physics;

use super::{PERIOD, circle, first_command, hanging, settings};

/// A ball beside the robot, that it leans on where its tip is at x > 0; rough, which the model has not.
fn ball(x: f64) -> Scene {
    let ball = Obstacle::sphere("ball", 0.02).unwrap();
    let ball = ball.at([x, 0.0, 0.25]).with_friction(0.3).unwrap();
    Scene::new(vec![ball]).unwrap()
}

fn led(truth: &Truth, controller: &mut dyn Controller, settings: &TrackingSettings) -> Tracking {
    led_in(4.0, truth, controller, settings)
}

/// A run around the circle in `duration` (s).
fn led_in(
    duration: f64,
    truth: &Truth,
    controller: &mut dyn Controller,
    settings: &TrackingSettings,
) -> Tracking {
    let robot = hanging();
    let path = circle(duration);
    let start = first_command(&robot, &path);
    let mut plant = SimulatedPlant::new(truth, PERIOD, &start, 0).unwrap();
    track(
        &mut plant,
        &robot,
        &start,
        &path,
        controller,
        settings,
        &mut |_| true,
    )
    .unwrap()
}

fn smooth(scene: &Scene) -> Scene {
    let obstacles = scene.obstacles().iter().cloned();
    let smooth = obstacles.map(|obstacle| obstacle.with_friction(0.0).unwrap());
    Scene::new(smooth.collect()).unwrap()
}

#[test]
fn a_model_among_obstacles_rests_and_changes_as_the_robot_does() {
    let robot = hanging();
    let command = first_command(&robot, &circle(4.0));
    let mut belief = Belief::new(&robot, &Loads::default(), &[]).unwrap();
    let free = belief.tip(command.as_slice()).unwrap();
    let mut belief = belief.among(&ball(0.042)).unwrap();
    let linear = belief.linearise(command.as_slice()).unwrap();
    let (tip, jacobian) = linear.tip();
    assert!((tip - free).norm() > 2e-3, "the ball is touched");
    let mut around = |t: usize, step: f64| {
        let mut moved = command.as_slice().to_vec();
        moved[t] += step;
        belief.tip(&moved).unwrap()
    };
    for t in 0..command.as_slice().len() {
        let slope = (around(t, 1e-6) - around(t, -1e-6)) / 2e-6;
        let off = (slope - jacobian.column(t)).norm();
        assert!(off < 1e-4 * jacobian.norm(), "tendon {t}: {off}");
    }
}

#[test]
fn an_obstacle_in_the_model_is_one_that_errors_do_not_come_from() {
    let robot = hanging();
    let mut truth = Truth::ideal(&robot);
    truth.scene = smooth(&ball(0.045));
    let unknown = settings(&robot);
    let known = TrackingSettings {
        scene: ball(0.045),
        ..settings(&robot)
    };
    let controllers: [fn() -> Box<dyn Controller>; 3] = [
        || Box::<Inverse>::default(),
        || Box::<ResolvedRate>::default(),
        || Box::<Predictive>::default(),
    ];
    for make in controllers {
        let error = |settings: &TrackingSettings| {
            let run = led(&truth, &mut *make(), settings);
            run.rms_error().unwrap()
        };
        let [with, without] = [&known, &unknown].map(error);
        let name = make().name();
        eprintln!("{name}: {with:.6} m with the obstacle in the model, {without:.6} m without");
        assert!(
            with < 1e-3 && without > 2.0 * with,
            "{name}: {with} {without}"
        );
    }
}

#[test]
fn an_obstacle_that_no_model_has_is_said_and_is_a_smaller_error_than_in_open_loop() {
    let robot = hanging();
    let mut truth = Truth::ideal(&robot);
    let bar = Obstacle::cylinder("bar", 0.005, 0.1).unwrap();
    let turn = 0.5_f64.sqrt();
    let along_y = [turn, turn, 0.0, 0.0];
    let bar = bar
        .at([0.025, 0.0, 0.25])
        .with_orientation(along_y)
        .unwrap();
    truth.scene = Scene::new(vec![bar]).unwrap();
    let led = |controller: &mut dyn Controller| led_in(20.0, &truth, controller, &settings(&robot));
    let open_loop = led(&mut Inverse::default()).rms_error().unwrap();
    let controllers: [&mut dyn Controller; 2] =
        [&mut ResolvedRate::default(), &mut Predictive::default()];
    let mut is_said = false;
    for controller in controllers {
        let (name, run) = (controller.name(), led(controller));
        let error = run.rms_error().unwrap();
        eprintln!("{name}: {error:.6} m, in open loop {open_loop:.6} m");
        assert!(error < 0.6 * open_loop, "{name}: {error} {open_loop}");
        assert!(
            run.rows.iter().all(|row| row.delay == 0),
            "{name}: no delay"
        );
        let mut incidents = run.incidents.iter();
        let said = "something that the model does not know of may touch the robot";
        is_said |= incidents.any(|incident| incident.reason.contains(said));
    }
    // A horizon that answers at once may not differ from its model for long enough.
    assert!(is_said);
}

#[test]
fn tendons_have_friction_among_obstacles_too() {
    let robot = hanging();
    let friction = Physics::WithFriction { coefficient: 0.1 };
    let cases = [
        (friction, smooth(&ball(0.045))),
        (friction, Scene::default()),
        (Physics::AtRest, smooth(&ball(0.045))),
    ];
    let [both, alone, without] = cases.map(|(physics, scene)| {
        let mut truth = Truth::ideal(&robot);
        (truth.physics, truth.scene) = (physics, scene);
        let run = led_in(2.0, &truth, &mut Inverse::default(), &settings(&robot));
        assert_eq!(run.stopped, None);
        run.rms_error().unwrap()
    });
    eprintln!("{both:.6} m, {alone:.6} m without the ball, {without:.6} m without friction");
    assert!((both - alone).abs() > 1e-3 && (both - without).abs() > 1e-3);
}

/// RMS errors (m) of trials that begin alike and learn from one another.
fn trials(truth: &Truth, make: fn() -> Box<dyn Controller>) -> Vec<f64> {
    let robot = hanging();
    let path = circle(4.0);
    let start = first_command(&robot, &path);
    let mut plant = SimulatedPlant::new(truth, PERIOD, &start, 0).unwrap();
    let mut settings = settings(&robot);
    let mut errors = Vec::new();
    for _ in 0..3 {
        let run = track(
            &mut plant,
            &robot,
            &start,
            &path,
            &mut *make(),
            &settings,
            &mut |_| true,
        )
        .unwrap();
        errors.push(run.rms_error().unwrap());
        Learning::default().learn(&mut settings.correction, &run, PERIOD);
        assert_eq!(settings.correction.len(), 81);
        assert!(plant.restart().unwrap());
    }
    eprintln!("{errors:?} m");
    errors
}

#[test]
fn errors_fall_from_trial_to_trial() {
    let mut truth = Truth::ideal(&hanging());
    for (t, servo) in truth.servos.iter_mut().enumerate() {
        servo.gain = [0.99, 1.01][t % 2];
        servo.backlash = 5e-5;
    }
    let open = trials(&truth, || Box::<Inverse>::default());
    assert!(open[1] < 0.7 * open[0] && open[2] < 0.7 * open[1]);
    truth.physics = Physics::WithFriction { coefficient: 0.1 };
    let closed = trials(&truth, || Box::<Predictive>::default());
    assert!(closed[2] < 0.7 * closed[0]);
}
