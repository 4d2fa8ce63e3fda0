//! Motions of a body and what acts on it, seen from other points: a turn and the displacement of a point, a moment about it and a force.
//! Where displacements do not count there are 3 numbers, which are the same from everywhere.

use nalgebra::{SMatrix, SVector, Vector3};

/// The turn of a motion, or the moment of a moment and a force.
pub(super) fn turn_of<const D: usize>(motion: &SVector<f64, D>) -> Vector3<f64> {
    motion.fixed_rows::<3>(0).into_owned()
}

/// `X' m X` with the motion `X z` of a point at `arm` from that of `z`: the same turn, displaced by `turn x arm` more.
pub(super) fn shifted<const D: usize>(
    m: &SMatrix<f64, D, D>,
    arm: &Vector3<f64>,
) -> SMatrix<f64, D, D> {
    let mut moved = *m;
    if D == 6 {
        // Columns of turns gain those of displacements times -[arm]x, then rows alike.
        let gained = m.fixed_columns::<3>(3) * -arm.cross_matrix();
        let mut turns = moved.fixed_columns_mut::<3>(0);
        turns += gained;
        let gained = arm.cross_matrix() * moved.fixed_rows::<3>(3);
        let mut turns = moved.fixed_rows_mut::<3>(0);
        turns += gained;
    }
    moved
}

/// `X' b`: a moment and a force about the other point.
pub(super) fn shifted_back<const D: usize>(
    b: &SVector<f64, D>,
    arm: &Vector3<f64>,
) -> SVector<f64, D> {
    let mut moved = *b;
    if D == 6 {
        let force: Vector3<f64> = b.fixed_rows::<3>(3).into_owned();
        let mut moment = moved.fixed_rows_mut::<3>(0);
        moment += arm.cross(&force);
    }
    moved
}

/// `X z`.
pub(super) fn carried_to<const D: usize>(
    motion: &SVector<f64, D>,
    arm: &Vector3<f64>,
) -> SVector<f64, D> {
    let mut carried = *motion;
    if D == 6 {
        let mut displacement = carried.fixed_rows_mut::<3>(3);
        displacement += turn_of(motion).cross(arm);
    }
    carried
}
