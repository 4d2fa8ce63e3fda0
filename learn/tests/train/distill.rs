//! A student comes in few steps to where its teacher comes in many.

use tdcr_learn::data::CloudSet;
use tdcr_learn::flow::{FlowPath, Method, Sampler, TimeGrid};
use tdcr_learn::net::MlpShape;
use tdcr_learn::train::{
    Feed, Model, Optimizer, Target, Teacher, TrainError, TrainSettings, Trainer,
};

use crate::toy::{LARGER, SHAPE, bars, learning, provenance, run};

/// The student's two steps.
const FEW: Sampler = Sampler {
    method: Method::Euler,
    steps: 2,
    grid: TimeGrid::Power(2.0),
    ..Sampler::PAPER
};

fn teacher(validation: &CloudSet) -> Model {
    let training = bars(64, 1);
    let settings = TrainSettings {
        validation_clouds: 2,
        ..learning(300)
    };
    let trainer = Trainer::new(LARGER, settings, &training, validation).unwrap();
    run(trainer, 300).model(provenance()).unwrap()
}

fn distillation() -> TrainSettings {
    TrainSettings {
        learning_rate: 3e-3,
        optimizer: Optimizer::Muon {
            learning_rate: 5e-3,
        },
        validation_clouds: 2,
        sampler: FEW,
        target: Target::Steps,
        ..learning(300)
    }
}

fn feed(teacher: &Model) -> Feed<'static> {
    Feed::Teacher(Box::new(Teacher::new(teacher).unwrap()))
}

/// Mean squared distance (m^2) of the clouds that two models make of the same noise.
fn apart(a: (&Model, Sampler), b: (&Model, Sampler)) -> f64 {
    let commands = [[0.01, 0.02], [0.03, 0.015], [0.02, 0.028]];
    let cloud = |(model, sampler): (&Model, Sampler), command: &[f64]| {
        model.predict(command, 100, 5, &sampler).unwrap().points
    };
    let squares = commands.iter().flat_map(|command| {
        let pairs = cloud(a, command).into_iter().zip(cloud(b, command));
        let square = |(p, q): ([f32; 3], [f32; 3])| -> f64 {
            (0..3).map(|k| f64::from(p[k] - q[k]).powi(2)).sum()
        };
        pairs.map(square).collect::<Vec<f64>>()
    });
    squares.sum::<f64>() / 300.0
}

#[test]
fn a_student_comes_in_two_steps_where_its_teacher_comes_in_many() {
    let validation = bars(3, 2);
    let teacher = teacher(&validation);
    let trainer = Trainer::new(
        &teacher.network,
        distillation(),
        feed(&teacher),
        &validation,
    )
    .unwrap();
    let student = run(trainer, 300).model(provenance()).unwrap();
    let many = Sampler {
        method: Method::Heun,
        steps: 100,
        grid: TimeGrid::Power(2.0),
        ..Sampler::PAPER
    };
    let at_first = apart((&teacher, FEW), (&teacher, many));
    let at_last = apart((&student, FEW), (&teacher, many));
    assert!(at_last < 0.1 * at_first, "{at_first:e} to {at_last:e} m^2");
}

#[test]
fn a_resumed_distillation_ends_as_if_it_had_not_been_left() {
    let validation = bars(3, 2);
    let teacher = teacher(&validation);
    let network = &teacher.network;
    let begin = || Trainer::new(network, distillation(), feed(&teacher), &validation).unwrap();
    let whole = run(begin(), 12).state(provenance());
    let half = run(begin(), 5).state(provenance());
    let again =
        Trainer::resume(half, network, distillation(), feed(&teacher), &validation).unwrap();
    let again = run(again, 12).state(provenance());
    assert_eq!(again.losses, whole.losses);
    assert!(again.params == whole.params && again.average == whole.average);
}

#[test]
fn lessons_that_do_not_suit_the_teacher_are_refused_by_name() {
    let validation = bars(3, 2);
    let teacher = teacher(&validation);
    let refused = |shape: MlpShape, settings: TrainSettings| -> TrainError {
        Trainer::new(shape, settings, feed(&teacher), &validation).unwrap_err()
    };
    let heun = TrainSettings {
        sampler: Sampler {
            method: Method::Heun,
            ..FEW
        },
        ..distillation()
    };
    let error = refused(LARGER, heun).to_string();
    assert_eq!(error, "the student's sampler is heun, expected euler");
    let elsewhere = TrainSettings {
        path: FlowPath {
            prior_deviation: 0.25,
            ..FlowPath::default()
        },
        ..distillation()
    };
    let error = refused(LARGER, elsewhere).to_string();
    assert!(error.starts_with("the student's path is"), "{error}");
    let odd = TrainSettings {
        clouds: 7,
        ..distillation()
    };
    let error = refused(LARGER, odd).to_string();
    assert_eq!(
        error,
        "clouds is 7, expected a multiple of the student's 2 learned evaluations"
    );
    let error = refused(SHAPE, distillation()).to_string();
    assert!(error.starts_with("the student's shape is"), "{error}");
    let other = TrainSettings {
        target: Target::Velocity,
        ..distillation()
    };
    let error = refused(LARGER, other).to_string();
    assert!(error.starts_with("target is velocity"), "{error}");
    let clouds = Trainer::new(LARGER, distillation(), &validation, &validation);
    let error = clouds.unwrap_err().to_string();
    assert!(error.starts_with("target is steps"), "{error}");
    let student = Model {
        settings: distillation(),
        ..teacher.clone()
    };
    let error = Teacher::new(&student).unwrap_err().to_string();
    assert!(
        error.contains("a distilled network cannot teach"),
        "{error}"
    );
}
