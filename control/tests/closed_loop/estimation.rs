//! What is told from measurements.

use nalgebra::DVector;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use tdcr_control::belief::{Belief, Unknown};
use tdcr_control::estimator::{Estimator, EstimatorSettings, Prior};
use tdcr_control::plant::{Measurement, Plant, Sighting, SimulatedPlant, Truth};
use tdcr_sim::inverse::recording::Marker;
use tdcr_sim::robot::{Axis, Frame, Loads, Robot, Wrench};

use super::{PERIOD, hanging};

fn bent(robot: &Robot) -> Vec<f64> {
    let command = [0.015, 0.022, 0.024, 0.013, 0.024, 0.021];
    assert!(robot.command(&command).is_ok());
    command.to_vec()
}

#[test]
fn derivatives_by_unknowns_agree_with_differences() {
    let robot = hanging();
    let mut unknowns = vec![Unknown::Payload, Unknown::TipForce(Axis::X)];
    unknowns.extend([Unknown::Offset(1), Unknown::Gain(3)]);
    let mut belief = Belief::new(&robot, &Loads::default(), &unknowns).unwrap();
    let command = bent(&robot);
    let values = DVector::from_vec(vec![0.01, 0.02, 1e-3, 0.03]);
    belief.set_values(&values);
    let marker = Marker {
        disc: 6,
        place: [0.01, 0.0, 0.005].into(),
    };
    let linear = belief.linearise(&command).unwrap();
    let [_, slopes] = linear.marker_jacobians(&[marker]).unwrap();
    let [[_, tensions], [_, lengths]] = linear.tendon_jacobians().unwrap();
    for column in 0..4 {
        let step = 1e-5;
        let ends = [-step, step].map(|step| {
            let mut moved = values.clone();
            moved[column] += step;
            belief.set_values(&moved);
            belief.linearise(&command).unwrap()
        });
        let slope = |a: f64, b: f64| (b - a) / (2.0 * step);
        let close = |a: f64, b: f64| (a - b).abs() < 1e-4 * (1.0 + b.abs());
        for axis in 0..3 {
            let [a, b] = [0, 1].map(|end: usize| ends[end].position(&marker)[axis]);
            assert!(
                close(slopes[(axis, column)], slope(a, b)),
                "{column} {axis}"
            );
        }
        for t in 0..6 {
            let of = |end: usize| &ends[end].equilibrium;
            let length = slope(of(0).tendon_lengths[t], of(1).tendon_lengths[t]);
            let tension = slope(of(0).tendon_tensions[t], of(1).tendon_tensions[t]);
            assert!(close(lengths[(t, column)], length), "{column} {t}");
            assert!(close(tensions[(t, column)], tension), "{column} {t}");
        }
    }
}

#[test]
fn an_unknown_payload_is_told_to_a_gram() {
    let robot = hanging();
    for mass in [0.005, 0.02] {
        let mut truth = Truth::ideal(&robot);
        truth.loads = Loads::payload(mass).unwrap();
        truth.sensors.position = 2e-4;
        truth.sensors.tension = Some(0.1);
        let command = robot.command(&bent(&robot)).unwrap();
        let mut plant = SimulatedPlant::new(&truth, PERIOD, &command, 3).unwrap();
        let settings = EstimatorSettings::for_robot(&robot);
        let mut estimator = Estimator::new(&robot, &Loads::default(), settings).unwrap();
        for _ in 0..100 {
            let measured = plant.measure().unwrap();
            estimator
                .update(command.as_slice(), &measured, PERIOD)
                .unwrap();
            plant.command(&command).unwrap();
        }
        let found = estimator.estimated()[0];
        assert_eq!(found.unknown, Unknown::Payload);
        let off = (found.value - mass).abs();
        assert!(off < 1e-3_f64.max(2.0 * found.deviation), "{found:?}");
        assert!(found.is_identified);
    }
}

#[test]
fn a_tip_force_is_told_to_five_millinewtons() {
    let robot = hanging();
    let force = [0.03, -0.02, 0.05];
    let mut truth = Truth::ideal(&robot);
    truth.loads = (Loads::default())
        .with_wrench(Wrench {
            force,
            ..Wrench::none(9, Frame::World)
        })
        .unwrap();
    let command = robot.command(&bent(&robot)).unwrap();
    let mut plant = SimulatedPlant::new(&truth, PERIOD, &command, 3).unwrap();
    let priors = Axis::ALL.map(|axis| Prior {
        unknown: Unknown::TipForce(axis),
        deviation: 0.3,
        time: 1000.0,
    });
    let settings = EstimatorSettings {
        priors: priors.to_vec(),
        ..EstimatorSettings::for_robot(&robot)
    };
    let mut estimator = Estimator::new(&robot, &Loads::default(), settings).unwrap();
    for _ in 0..50 {
        let measured = plant.measure().unwrap();
        estimator
            .update(command.as_slice(), &measured, PERIOD)
            .unwrap();
    }
    for (found, force) in estimator.estimated().iter().zip(force) {
        let off = (found.value - force).abs();
        assert!(off < 5e-3_f64.max(found.deviation), "{found:?}");
    }
}

/// A tip that is seen from a straight robot tells nothing of a force along the axis.
#[test]
fn what_cannot_be_told_is_said_by_name() {
    let robot = hanging();
    let command = robot.mean_command();
    let settled = robot.settle(&command, &Loads::default());
    let seen = Measurement {
        sightings: vec![Sighting {
            marker: Marker {
                disc: 9,
                place: [0.0; 3].into(),
            },
            position: settled.positions[9],
        }],
        ..Measurement::default()
    };
    let priors = Axis::ALL.map(|axis| Prior {
        unknown: Unknown::TipForce(axis),
        deviation: 0.3,
        time: 1000.0,
    });
    let settings = EstimatorSettings {
        priors: priors.to_vec(),
        ..EstimatorSettings::for_robot(&robot)
    };
    let mut estimator = Estimator::new(&robot, &Loads::default(), settings).unwrap();
    for _ in 0..20 {
        estimator.update(command.as_slice(), &seen, PERIOD).unwrap();
    }
    assert_eq!(estimator.unidentified(), ["tip force z"]);
}

/// Normalised squares of the estimation error: over 200 runs their mean is within the 95 % band of chi squared
/// (Bar-Shalom, Li and Kirubarajan, Estimation with Applications, ch. 5.4). The priors are narrow enough for equilibria to be linear in them.
#[test]
fn the_covariance_is_that_of_the_errors() {
    let robot = hanging();
    let command = bent(&robot);
    let priors = [Unknown::Payload, Unknown::Offset(0), Unknown::Offset(4)].map(|unknown| Prior {
        unknown,
        deviation: if unknown == Unknown::Payload {
            1e-3
        } else {
            1.5e-4
        },
        time: 1e6,
    });
    let settings = EstimatorSettings {
        priors: priors.to_vec(),
        ..EstimatorSettings::for_robot(&robot)
    };
    let unknowns = priors.map(|prior| prior.unknown);
    let mut truth = Belief::new(&robot, &Loads::default(), &unknowns).unwrap();
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let mut normal = move |deviation: f64| -> f64 {
        let normal: f64 = StandardNormal.sample(&mut rng);
        deviation * normal
    };
    let runs = 200;
    let mut sum = 0.0;
    for _ in 0..runs {
        let values = DVector::from_fn(3, |place, _| normal(priors[place].deviation));
        truth.set_values(&values);
        let settled = truth.settle(&command).unwrap().clone();
        let mut estimator = Estimator::new(&robot, &Loads::default(), settings.clone()).unwrap();
        for _ in 0..5 {
            let seen = Measurement {
                cloud: None,
                sightings: vec![Sighting {
                    marker: Marker {
                        disc: 9,
                        place: [0.0; 3].into(),
                    },
                    position: settled.positions[9].map(|x| x + normal(settings.position)),
                }],
                tensions: Some(
                    (settled.tendon_tensions.iter())
                        .map(|x| x + normal(settings.tension))
                        .collect(),
                ),
                lengths: None,
            };
            estimator.update(&command, &seen, PERIOD).unwrap();
        }
        let found = estimator.estimated();
        let off = DVector::from_fn(3, |place, _| found[place].value - values[place]);
        let inverse = estimator.covariance().clone().try_inverse().unwrap();
        sum += off.dot(&(inverse * &off));
    }
    // Chi squared of 3 * 200 degrees, by the number of runs.
    let (mean, spread) = (3.0, 1.96 * (2.0 * 3.0 / f64::from(runs)).sqrt());
    let found = sum / f64::from(runs);
    assert!(
        (found - mean).abs() < spread,
        "{found}, expected {mean} +- {spread}"
    );
}
