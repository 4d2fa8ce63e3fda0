//! Models whose tendons have friction, at rest.

use tdcr_control::controller::{Controller, Inverse, Predictive, ResolvedRate};
use tdcr_control::plant::{SimulatedPlant, Truth};
use tdcr_control::tip_path::{Shape, TipPath};
use tdcr_control::tracking::track;
use tdcr_sim::robot::Robot;
use tdcr_sim::simulation::Physics;

use super::{PERIOD, circle, first_command, hanging, settings};

/// A figure of eight beside the axis, in 10 s.
fn eight() -> TipPath {
    let frame = nalgebra::Isometry3::translation(0.0, 0.03, 0.324);
    TipPath::closed(Shape::Eight, &frame, 0.06, 10.0).unwrap()
}

/// RMS error (m) on a path of a robot whose tendons have friction of 0.2, by a model that has `coefficient`.
fn error(coefficient: f64, controller: &mut dyn Controller, path: &TipPath) -> f64 {
    let mut spec = hanging().spec().clone();
    for tendon in spec.tendon_specs_mut() {
        tendon.set_friction(coefficient);
    }
    let model = Robot::new(spec).unwrap();
    let mut truth = Truth::ideal(&hanging());
    truth.physics = Physics::WithFriction { coefficient: 0.2 };
    let start = first_command(&model, path);
    let mut plant = SimulatedPlant::new(&truth, PERIOD, &start, 0).unwrap();
    let run = track(
        &mut plant,
        &model,
        &start,
        path,
        controller,
        &settings(&model),
        &mut |_| true,
    );
    run.unwrap().rms_error().unwrap()
}

#[test]
fn friction_in_the_model_is_an_error_that_controllers_do_not_make() {
    let controllers: [fn() -> Box<dyn Controller>; 3] = [
        || Box::<Inverse>::default(),
        || Box::<ResolvedRate>::default(),
        || Box::<Predictive>::default(),
    ];
    for make in controllers {
        for path in [circle(4.0), eight()] {
            let [with, near, without] =
                [0.2, 0.25, 0.0].map(|coefficient| error(coefficient, &mut *make(), &path));
            let name = make().name();
            eprintln!(
                "{name}: {with:.6} m with friction, {near:.6} m with more, {without:.6} m without"
            );
            assert!(with < 0.5 * without && near < 0.8 * without, "{name}");
        }
    }
}
