//! What is read through this crate, against closed forms and finite differences.
#![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

use std::path::PathBuf;

use nalgebra::{DMatrix, Matrix2, UnitQuaternion, Vector2, Vector3};
use tdcr_mujoco::{LoadsError, Model, UnknownBody, version};

const GRAVITY: f64 = 9.81;

#[test]
fn the_library_is_the_one_that_was_asked_for() {
    let debian = format!("/usr/lib/{}-linux-gnu", std::env::consts::ARCH);
    let folder = PathBuf::from(std::env::var_os("MUJOCO_DIR").unwrap_or(debian.into()));
    let name = format!("libmujoco.so.{}", version());
    assert!(
        folder.join(&name).exists() || folder.join("lib").join(&name).exists(),
        "no {name} in {}",
        folder.display()
    );
}

#[test]
fn a_refused_model_comes_with_mujocos_own_words() {
    let refusal = |text: &str| match Model::from_xml(text) {
        Err(LoadsError::Refused(message)) => message,
        Err(other) => panic!("{other}"),
        Ok(_) => panic!("accepted {text}"),
    };
    let misspelt = "<mujoco>\n<worldbody><body nam='disc'/></worldbody></mujoco>";
    let message = refusal(misspelt);
    assert!(message.contains("'nam'"), "{message}");
    let message = refusal("<mujoco><actuator><motor joint='none'/></actuator></mujoco>");
    assert!(message.contains("'none'"), "{message}");
}

#[test]
fn an_unknown_body_is_named() {
    let model = Model::from_xml("<mujoco/>").unwrap();
    let mut data = model.data().unwrap();
    for name in ["disc", "", "wor\0ld"] {
        let unknown = UnknownBody(name.to_owned());
        assert_eq!(data.body_position(name), Err(unknown.clone()));
        assert_eq!(data.body_orientation(name), Err(unknown.clone()));
        let zero = Vector3::zeros();
        assert_eq!(data.set_xfrc_applied(name, zero, zero), Err(unknown));
    }
    assert!(data.body_position("world").is_ok());
}

#[test]
fn a_pendulum_has_the_forces_of_a_pendulum() {
    let [mass, arm, inertia, armature, damping, stiffness] = [2.0, 0.5, 0.03, 0.01, 0.3, 0.7];
    let model = Model::from_xml(&format!(
        "<mujoco><option gravity='0 0 -{GRAVITY}'/>
         <worldbody><body name='bob' pos='0 0 1'>
           <joint name='hinge' axis='0 1 0' damping='{damping}' armature='{armature}'
                  stiffness='{stiffness}'/>
           <inertial pos='0 0 -{arm}' mass='{mass}' diaginertia='{inertia} {inertia} {inertia}'/>
         </body></worldbody>
         <actuator><motor joint='hinge'/></actuator></mujoco>"
    ))
    .unwrap();
    let mut data = model.data().unwrap();
    let (angle, speed, motor, pull, twist) = (0.6, 1.3, 0.9, 0.4, 0.2);
    data.qpos_mut().copy_from_slice(&[angle]);
    data.qvel_mut().copy_from_slice(&[speed]);
    data.ctrl_mut().copy_from_slice(&[motor]);
    data.set_xfrc_applied("bob", Vector3::x() * pull, Vector3::y() * twist)
        .unwrap();
    data.forward();

    let total = inertia + mass * arm * arm + armature;
    let bias = mass * GRAVITY * arm * angle.sin();
    let passive = -damping * speed - stiffness * angle;
    let smooth = motor + passive - bias - pull * arm * angle.cos() + twist;
    let close = |found: &[f64], expected: f64| {
        assert_eq!(found.len(), 1);
        assert!((found[0] - expected).abs() < 1e-12, "{found:?} {expected}");
    };
    close(data.mass_matrix().as_slice(), total);
    close(data.qfrc_bias(), bias);
    close(data.qfrc_passive(), passive);
    close(data.qfrc_actuator(), motor);
    close(data.actuator_force(), motor);
    close(data.qfrc_smooth(), smooth);
    close(data.qacc(), smooth / total);
    assert_eq!(data.body_position("bob").unwrap(), Vector3::z());
    let turn = UnitQuaternion::from_axis_angle(&Vector3::y_axis(), angle);
    assert!(data.body_orientation("bob").unwrap().angle_to(&turn) < 1e-12);

    // One step of 0.002 s, damping implicit: the speed's derivatives by angle, speed and control.
    let push = 0.002 / (total + 0.002 * damping);
    let by_angle = pull * arm * angle.sin() - mass * GRAVITY * arm * angle.cos() - stiffness;
    let transition = data.transition_fd(1e-4);
    assert!((transition.a[(1, 0)] - push * by_angle).abs() < 1e-9);
    assert!((transition.a[(1, 1)] - (1.0 - push * damping)).abs() < 1e-9);
    assert!((transition.b[(1, 0)] - push).abs() < 1e-9);
}

#[test]
fn a_spring_and_damper_step_by_semi_implicit_euler() {
    let [h, mass, damping, stiffness] = [0.002, 0.5, 3.0, 40.0];
    let model = Model::from_xml(&format!(
        "<mujoco><option timestep='{h}' gravity='0 0 0'/>
         <worldbody><body>
           <joint name='slide' type='slide' damping='{damping}' stiffness='{stiffness}'/>
           <inertial pos='0 0 0' mass='{mass}' diaginertia='1 1 1'/>
         </body></worldbody>
         <actuator><motor joint='slide'/></actuator></mujoco>"
    ))
    .unwrap();
    // Damping is implicit: v' = v + h (u - k x - d v) / (m + h d), x' = x + h v'.
    let push = h / (mass + h * damping);
    let (x_to_v, v_to_v) = (-push * stiffness, 1.0 - push * damping);
    let a = Matrix2::new(1.0 + h * x_to_v, h * v_to_v, x_to_v, v_to_v);
    let b = Vector2::new(h * push, push);

    let mut data = model.data().unwrap();
    let (state, control) = (Vector2::new(0.1, -0.7), 2.0);
    data.qpos_mut().copy_from_slice(&state.as_slice()[..1]);
    data.qvel_mut().copy_from_slice(&state.as_slice()[1..]);
    data.ctrl_mut().copy_from_slice(&[control]);
    let transition = data.transition_fd(1e-4);
    assert!((transition.a - a).amax() < 1e-10);
    assert!((transition.b - b).amax() < 1e-10);
    data.step();
    let stepped = Vector2::new(data.qpos()[0], data.qvel()[0]);
    assert!((stepped - (a * state + b * control)).amax() < 1e-14);
}

/// A chain of three hinges, a tendon across all of them and one across the last alone.
fn tendons(storage: &str) -> Model {
    Model::from_xml(&format!(
        "<mujoco><option jacobian='{storage}'/><default><geom size='0.1'/></default>
         <worldbody><site name='a' pos='0.1 0.2 0'/>
           <body><joint axis='0 1 0'/><geom/>
           <body pos='0 0 1'><joint axis='1 0 0'/><geom/><site name='b' pos='0.1 0 0.3'/>
           <body pos='0 0 1'><joint axis='1 1 0'/><geom/><site name='c' pos='0.3 0.1 0.5'/>
           </body></body></body></worldbody>
         <tendon><spatial><site site='a'/><site site='c'/></spatial>
                 <spatial><site site='b'/><site site='c'/></spatial></tendon></mujoco>"
    ))
    .unwrap()
}

#[test]
fn tendon_jacobians_are_the_derivatives_of_lengths_dense_or_sparse() {
    for storage in ["dense", "sparse"] {
        let model = tendons(storage);
        let mut data = model.data().unwrap();
        let mut lengths = |qpos: [f64; 3]| {
            data.qpos_mut().copy_from_slice(&qpos);
            data.forward();
            [data.ten_length()[0], data.ten_length()[1]]
        };
        let (qpos, width) = ([0.3, -0.8, 1.1], 1e-6);
        let mut expected = DMatrix::zeros(2, 3);
        for joint in 0..3 {
            let mut turned = [qpos; 2];
            turned[0][joint] += width;
            turned[1][joint] -= width;
            let [ahead, behind] = turned.map(&mut lengths);
            for tendon in 0..2 {
                expected[(tendon, joint)] = (ahead[tendon] - behind[tendon]) / (2.0 * width);
            }
        }
        lengths(qpos);
        let jacobian = data.ten_jacobian();
        assert!((&jacobian - expected).amax() < 1e-9, "{storage}");
        assert!(jacobian[(1, 0)].abs() < 1e-15 && jacobian[(1, 2)].abs() > 0.1);
    }
}
