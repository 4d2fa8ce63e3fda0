//! Clouds as the only measurement.

use nalgebra::{DVector, Vector3};
use tdcr_control::belief::{Belief, Unknown};
use tdcr_control::controller::ResolvedRate;
use tdcr_control::estimator::{Estimator, EstimatorSettings};
use tdcr_control::plant::{CloudSensor, Plant, SimulatedPlant, Truth};
use tdcr_control::tracking::track;
use tdcr_sim::inverse::recording::{Shown, Surface};
use tdcr_sim::robot::{Axis, Loads, Robot};

use super::{PERIOD, circle, first_command, hanging, settings};

/// Seen by nothing but D435 cameras.
fn blind(robot: &Robot) -> Truth {
    let mut truth = Truth::ideal(robot);
    truth.sensors.markers.clear();
    truth.sensors.tension = None;
    truth.sensors.cloud = Some(CloudSensor::d435());
    truth
}

#[test]
fn distances_from_the_surface_shrink_as_differences_say() {
    let robot = hanging();
    let unknowns = [
        Unknown::Payload,
        Unknown::TipForce(Axis::Y),
        Unknown::Offset(2),
    ];
    let mut belief = Belief::new(&robot, &Loads::default(), &unknowns).unwrap();
    let command = [0.015, 0.022, 0.024, 0.013, 0.024, 0.021];
    let values = DVector::from_vec(vec![0.01, 0.02, 5e-4]);
    belief.set_values(&values);
    let linear = belief.linearise(&command).unwrap();
    // Points 2 mm outside the rims and faces of three discs.
    let points: Vec<Vector3<f64>> = [(2, 0.022, 0.0), (6, 0.022, 1.0), (9, 0.005, 2.0)]
        .map(|(disc, out, turn): (usize, f64, f64)| {
            let high = robot.discs()[disc].half_height + if out < 0.01 { 0.002 } else { -0.004 };
            let place = Vector3::new(out * turn.cos(), out * turn.sin(), high);
            (linear.equilibrium.disc_pose(disc) * nalgebra::Point3::from(place)).coords
        })
        .to_vec();
    let shown = Shown::of(robot.spec(), false);
    let distances = |belief: &mut Belief| -> Vec<f64> {
        let settled = belief.settle(&command).unwrap().clone();
        let touches = Surface::new(&robot, &shown, &settled).touches(&robot, &settled, &points);
        touches.iter().map(|touch| touch.distance).collect()
    };
    let settled = &linear.equilibrium;
    let touches = Surface::new(&robot, &shown, settled).touches(&robot, settled, &points);
    let slopes = linear.approaches(&touches).unwrap();
    for column in 0..3 {
        let step = [1e-5, 1e-5, 1e-6][column];
        let [less, more] = [-step, step].map(|step| {
            let mut moved = values.clone();
            moved[column] += step;
            belief.set_values(&moved);
            distances(&mut belief)
        });
        for row in 0..points.len() {
            let expected = (less[row] - more[row]) / (2.0 * step);
            let found = slopes[(row, column)];
            let scale = slopes.column(column).amax();
            assert!(
                (found - expected).abs() < 1e-3 * scale,
                "{row} {column}: {found} {expected}"
            );
        }
        assert!(slopes.column(column).amax() > 1e-4);
    }
}

#[test]
fn the_tip_is_told_from_clouds_to_a_millimetre() {
    let robot = hanging();
    let mut truth = blind(&robot);
    truth.loads = Loads::payload(0.02).unwrap();
    let command = robot
        .command(&[0.015, 0.022, 0.024, 0.013, 0.024, 0.021])
        .unwrap();
    let mut plant = SimulatedPlant::new(&truth, PERIOD, &command, 3).unwrap();
    let settings = EstimatorSettings::for_robot(&robot);
    let mut estimator = Estimator::new(&robot, &Loads::default(), settings).unwrap();
    let off = |estimator: &mut Estimator| {
        let tip = estimator.belief().tip(command.as_slice()).unwrap();
        (tip - plant_tip(&plant)).norm()
    };
    fn plant_tip(plant: &SimulatedPlant) -> Vector3<f64> {
        plant.true_tip().unwrap()
    }
    let before = off(&mut estimator);
    for _ in 0..5 {
        let measured = plant.measure().unwrap();
        assert!(measured.sightings.is_empty() && measured.tensions.is_none());
        assert!(
            measured
                .cloud
                .as_ref()
                .is_some_and(|cloud| cloud.len() == 600)
        );
        estimator
            .update(command.as_slice(), &measured, PERIOD)
            .unwrap();
    }
    let tip = estimator.belief().tip(command.as_slice()).unwrap();
    let after = (tip - plant_tip(&plant)).norm();
    assert!(after < 1e-3 && before > 5.0 * after, "{before} {after}");
}

#[test]
fn a_circle_is_tracked_with_clouds_alone() {
    let robot = hanging();
    let mut truth = blind(&robot);
    truth.loads = Loads::payload(0.01).unwrap();
    let path = circle(2.0);
    let start = first_command(&robot, &path);
    let mut plant = SimulatedPlant::new(&truth, PERIOD, &start, 0).unwrap();
    let mut controller = ResolvedRate::default();
    let settings = settings(&robot);
    let run = track(
        &mut plant,
        &robot,
        &start,
        &path,
        &mut controller,
        &settings,
        &mut |_| true,
    );
    let run = run.unwrap();
    assert_eq!(run.stopped, None);
    assert!(
        run.rows
            .iter()
            .all(|row| row.measured.is_none() && row.held.is_none())
    );
    let error = run.rms_error().unwrap();
    assert!(error < 0.015 * run.length, "{error} of {}", run.length);
}
