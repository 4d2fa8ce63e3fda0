//! Objects of a scene, as rows of numbers: position (3), quaternion (w, x, y, z), velocity (3), angular velocity (3), force (3).

use nalgebra::{Isometry3, Quaternion, UnitQuaternion, Vector3};
use numpy::PyReadonlyArray2;
use tdcr::sim::contact::Contact;
use tdcr::sim::objects::ObjectState;
use tdcr::sim::scene::Scene;
use tdcr::sim::simulation::MovingRobot;

use crate::arrays::contiguous;
use crate::errors::Outcome;

/// Numbers of an object's state, and of an object beside its robot.
pub const STATE: usize = 13;
pub const WIDTH: usize = STATE + 3;

/// Number of objects of a scene.
pub fn count(scene: &Scene) -> usize {
    scene.objects().count()
}

/// Writes the objects of a robot in motion to rows of [`WIDTH`].
pub fn write(moving: &MovingRobot, out: &mut [f64]) {
    let objects = moving.scene().objects().zip(moving.objects());
    for (((number, _), state), out) in objects.zip(out.as_chunks_mut::<WIDTH>().0) {
        *out = row(state, &force_on(moving.contacts(), number));
    }
}

/// What the robot's contacts put on an obstacle (N).
fn force_on(contacts: &[Contact], obstacle: usize) -> Vector3<f64> {
    let own = contacts.iter();
    let own = own.filter(|contact| contact.partner.obstacle() == Some(obstacle));
    own.map(|contact| -contact.force).sum()
}

fn row(state: &ObjectState, force: &Vector3<f64>) -> [f64; WIDTH] {
    let (at, turn) = (state.pose.translation.vector, state.pose.rotation);
    let (v, w) = (state.velocity, state.angular_velocity);
    [
        at.x, at.y, at.z, turn.w, turn.i, turn.j, turn.k, v.x, v.y, v.z, w.x, w.y, w.z, force.x,
        force.y, force.z,
    ]
}

/// States of objects as they come from Python, shape (objects, 13). Quaternions are as they were left: of unit length.
pub fn states(rows: &PyReadonlyArray2<'_, f64>, count: usize) -> Outcome<Vec<ObjectState>> {
    let numbers = contiguous(rows, "objects", &[count, STATE])?;
    let rows = numbers.as_chunks::<STATE>().0.iter();
    Ok(rows.map(state).collect())
}

/// The states of rows that [`write`] wrote.
pub fn written(rows: &[f64]) -> Vec<ObjectState> {
    let rows = rows.as_chunks::<WIDTH>().0.iter();
    rows.filter_map(|row| row.first_chunk().map(state))
        .collect()
}

fn state(&[x, y, z, qw, qx, qy, qz, vx, vy, vz, wx, wy, wz]: &[f64; STATE]) -> ObjectState {
    let turn = UnitQuaternion::new_unchecked(Quaternion::new(qw, qx, qy, qz));
    ObjectState {
        pose: Isometry3::from_parts(Vector3::new(x, y, z).into(), turn),
        velocity: Vector3::new(vx, vy, vz),
        angular_velocity: Vector3::new(wx, wy, wz),
    }
}
