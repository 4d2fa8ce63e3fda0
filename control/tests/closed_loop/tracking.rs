//! Paths tracked by each controller, on robots that are not as their models say.

use tdcr_control::controller::{Controller, Inverse, Predictive, ResolvedRate};
use tdcr_control::plant::{SimulatedPlant, Truth};
use tdcr_control::tracking::{Tracking, track};
use tdcr_sim::robot::{Loads, Robot};
use tdcr_sim::simulation::Physics;

use super::{PERIOD, circle, first_command, hanging, settings};

fn tracked(
    robot: &Robot,
    controller: &mut dyn Controller,
    change: impl Fn(&mut Truth),
) -> Tracking {
    let path = circle(5.0);
    let start = first_command(robot, &path);
    let mut truth = Truth::ideal(robot);
    change(&mut truth);
    let mut plant = SimulatedPlant::new(&truth, PERIOD, &start, 0).unwrap();
    let settings = settings(robot);
    track(
        &mut plant,
        robot,
        &start,
        &path,
        controller,
        &settings,
        &mut |_| true,
    )
    .unwrap()
}

/// RMS error in percent of the length.
fn percent(run: &Tracking) -> f64 {
    assert_eq!(run.stopped, None);
    100.0 * run.rms_error().unwrap() / run.length
}

#[test]
fn a_robot_as_modelled_is_led_along_a_circle() {
    let robot = hanging();
    let inverse = percent(&tracked(&robot, &mut Inverse::default(), |_| {}));
    let resolved = percent(&tracked(&robot, &mut ResolvedRate::default(), |_| {}));
    let predictive = percent(&tracked(&robot, &mut Predictive::default(), |_| {}));
    for (name, error) in [
        ("inverse", inverse),
        ("resolved", resolved),
        ("mpc", predictive),
    ] {
        assert!(error < 0.05, "{name}: {error} %");
    }
}

#[test]
fn an_unknown_payload_is_made_up_for_and_told() {
    let robot = hanging();
    let payload = |truth: &mut Truth| truth.loads = Loads::payload(0.02).unwrap();
    let open = percent(&tracked(&robot, &mut Inverse::default(), payload));
    assert!(open > 3.0, "{open} %");
    let closed: [Box<dyn Controller>; 2] =
        [Box::<ResolvedRate>::default(), Box::<Predictive>::default()];
    for mut controller in closed {
        let run = tracked(&robot, &mut *controller, payload);
        assert!(
            percent(&run) < 0.1,
            "{}: {} %",
            controller.name(),
            percent(&run)
        );
        let last = run.rows.last().unwrap();
        assert!((last.estimated[0].value - 0.02).abs() < 1e-3);
    }
}

#[test]
fn an_unknown_delay_is_told_and_made_up_for() {
    let robot = hanging();
    let late = |truth: &mut Truth| truth.delay = 2;
    for mut controller in [
        Box::<ResolvedRate>::default() as Box<dyn Controller>,
        Box::<Predictive>::default(),
    ] {
        let run = tracked(&robot, &mut *controller, late);
        let name = controller.name();
        // The first command of the path moves the tip 0.15 s later.
        let mut later = run.rows.iter().filter(|row| row.time > 0.2);
        assert!(later.all(|row| row.delay == 2), "{name}");
        assert!(percent(&run) < 0.7, "{name}: {} %", percent(&run));
    }
}

#[test]
fn friction_backlash_and_wrong_spools_are_made_up_for() {
    let robot = hanging();
    let wrong = |truth: &mut Truth| {
        truth.physics = Physics::WithFriction { coefficient: 0.2 };
        for (t, servo) in truth.servos.iter_mut().enumerate() {
            servo.gain = if t % 2 == 0 { 1.02 } else { 0.98 };
            servo.backlash = 5e-5;
        }
    };
    let open = percent(&tracked(&robot, &mut Inverse::default(), wrong));
    let closed = percent(&tracked(&robot, &mut ResolvedRate::default(), wrong));
    assert!(
        closed < 0.2 * open && closed < 2.0,
        "{closed} % and {open} %"
    );
}

#[test]
fn a_run_is_a_function_of_its_seed() {
    let robot = hanging();
    let noisy = |truth: &mut Truth| truth.sensors.position = 5e-4;
    let runs = [(); 2].map(|()| tracked(&robot, &mut ResolvedRate::default(), noisy));
    let [a, b] = runs.map(|run| {
        let commands = run.rows.into_iter().map(|row| row.command);
        commands.collect::<Vec<_>>()
    });
    assert_eq!(a, b);
}

/// The horizon's first command is that of a longer horizon where no bound is met: without disturbance both are at the target.
#[test]
fn co_contraction_is_kept() {
    let robot = hanging();
    let run = tracked(&robot, &mut ResolvedRate::default(), |_| {});
    let mean = |row: &tdcr_control::tracking::TrackingRow| row.command.iter().sum::<f64>() / 6.0;
    let (first, last) = (mean(&run.rows[0]), mean(run.rows.last().unwrap()));
    assert!((first - last).abs() < 0.004, "{first} {last}");
    let tensions = run.rows.iter().filter_map(|row| row.tensions.as_ref());
    assert!(tensions.flatten().all(|&tension| tension > 0.0));
}
