//! The state of a model, and what MuJoCo computes from it.

use std::ptr::{self, NonNull};

use nalgebra::{DMatrix, Quaternion, UnitQuaternion, Vector3};

use crate::model::{LoadsError, Model, UnknownBody};
use crate::sys;

/// The state of a model (`mjData`).
///
/// The state is set through [`qpos_mut`](Self::qpos_mut), [`qvel_mut`](Self::qvel_mut),
/// [`ctrl_mut`](Self::ctrl_mut) and [`set_xfrc_applied`](Self::set_xfrc_applied). Everything else
/// that can be read is as of the last [`forward`](Self::forward), or as of the start of the last
/// [`step`](Self::step). Arrays along the joints have `nv` entries, one for each degree of freedom.
pub struct Data<'m> {
    model: &'m Model,
    data: NonNull<sys::mjData>,
}

/// How the next state depends on this one and on the controls, to first order.
///
/// The state is `(dq, qvel, act)`, where `dq` are the `nv` coordinates of the tangent space at `qpos`.
#[derive(Clone, Debug, PartialEq)]
pub struct Transition {
    /// By the state, `(2 nv + na) x (2 nv + na)`.
    pub a: DMatrix<f64>,
    /// By the controls, `(2 nv + na) x nu`.
    pub b: DMatrix<f64>,
}

/// Declares getters of arrays that MuJoCo computes.
macro_rules! arrays {
    ($($(#[$doc:meta])* $name:ident: $length:ident;)*) => {$(
        $(#[$doc])*
        pub fn $name(&self) -> &[f64] {
            // SAFETY: MuJoCo allocated the array with this length.
            unsafe { slice(self.fields().$name, self.model.fields().$length as usize) }
        }
    )*};
}

impl<'m> Data<'m> {
    pub(crate) fn new(model: &'m Model) -> Result<Self, LoadsError> {
        // SAFETY: the model is alive.
        let data = NonNull::new(unsafe { sys::mj_makeData(model.as_ptr()) });
        let data = data.ok_or(LoadsError::Memory)?;
        Ok(Self { model, data })
    }

    /// Computes everything but the next state (`mj_forward`).
    pub fn forward(&mut self) {
        // SAFETY: model and data are alive and belong together.
        unsafe { sys::mj_forward(self.model.as_ptr(), self.data.as_ptr()) }
    }

    /// Goes on to the next state (`mj_step`).
    pub fn step(&mut self) {
        // SAFETY: model and data are alive and belong together.
        unsafe { sys::mj_step(self.model.as_ptr(), self.data.as_ptr()) }
    }

    /// Positions of the joints, to be set: `w, x, y, z` for a ball joint, which turns its body
    /// relative to the body below.
    pub fn qpos_mut(&mut self) -> &mut [f64] {
        // SAFETY: MuJoCo allocated the array with this length.
        unsafe { slice_mut(self.fields().qpos, self.model.fields().nq as usize) }
    }

    /// Velocities of the joints, to be set.
    pub fn qvel_mut(&mut self) -> &mut [f64] {
        // SAFETY: MuJoCo allocated the array with this length.
        unsafe { slice_mut(self.fields().qvel, self.model.fields().nv as usize) }
    }

    /// Controls of the actuators, to be set.
    pub fn ctrl_mut(&mut self) -> &mut [f64] {
        // SAFETY: MuJoCo allocated the array with this length.
        unsafe { slice_mut(self.fields().ctrl, self.model.fields().nu as usize) }
    }

    /// Pulls at a body's centre of mass with a force (N) and a torque (N m), world frame, from now on.
    ///
    /// # Errors
    /// [`UnknownBody`] when the model has no body of this name.
    pub fn set_xfrc_applied(
        &mut self,
        body: &str,
        force: Vector3<f64>,
        torque: Vector3<f64>,
    ) -> Result<(), UnknownBody> {
        let index = self.model.body(body)?;
        // SAFETY: MuJoCo allocated six numbers for each body, and this body exists.
        let wrench = unsafe { slice_mut(self.fields().xfrc_applied.add(6 * index), 6) };
        wrench[..3].copy_from_slice(force.as_slice());
        wrench[3..].copy_from_slice(torque.as_slice());
        Ok(())
    }

    /// Origin of a body's frame, world frame (m).
    ///
    /// # Errors
    /// [`UnknownBody`] when the model has no body of this name.
    pub fn body_position(&self, body: &str) -> Result<Vector3<f64>, UnknownBody> {
        let index = self.model.body(body)?;
        // SAFETY: MuJoCo allocated three numbers for each body, and this body exists.
        let xpos = unsafe { slice(self.fields().xpos.add(3 * index), 3) };
        Ok(Vector3::from_column_slice(xpos))
    }

    /// Orientation of a body's frame in the world.
    ///
    /// # Errors
    /// [`UnknownBody`] when the model has no body of this name.
    pub fn body_orientation(&self, body: &str) -> Result<UnitQuaternion<f64>, UnknownBody> {
        let index = self.model.body(body)?;
        // SAFETY: MuJoCo allocated four numbers for each body, and this body exists.
        let xquat = unsafe { slice(self.fields().xquat.add(4 * index), 4) };
        let quaternion = Quaternion::new(xquat[0], xquat[1], xquat[2], xquat[3]);
        Ok(UnitQuaternion::from_quaternion(quaternion))
    }

    arrays! {
        /// Positions of the joints.
        qpos: nq;
        /// Velocities of the joints.
        qvel: nv;
        /// Accelerations of the joints.
        qacc: nv;
        /// Lengths of the tendons (m).
        ten_length: ntendon;
        /// Forces of gravity and of motion (Coriolis, centrifugal) on the joints, with the sign that
        /// they have on the left of `M qacc + qfrc_bias = ...`.
        qfrc_bias: nv;
        /// Forces of springs and dampers on the joints.
        qfrc_passive: nv;
        /// Forces of the actuators on the joints.
        qfrc_actuator: nv;
        /// All forces on the joints but those of constraints:
        /// `qfrc_passive - qfrc_bias + qfrc_actuator + J^T xfrc_applied`. At rest and without
        /// constraints, this is what would set the model in motion.
        qfrc_smooth: nv;
    }

    /// Forces of the actuators along what they act on: for tendons, positive when they push (N).
    pub fn actuator_force(&self) -> &[f64] {
        let sizes = self.model.fields();
        #[cfg(actuators_of_many_outputs)]
        let outputs = sizes.nout;
        #[cfg(not(actuators_of_many_outputs))]
        let outputs = sizes.nu;
        // SAFETY: MuJoCo allocated the array with this length.
        unsafe { slice(self.fields().actuator_force, outputs as usize) }
    }

    /// Derivative of the tendons' lengths by the joints, `ntendon x nv`.
    pub fn ten_jacobian(&self) -> DMatrix<f64> {
        let model = self.model.fields();
        let (tendons, dofs) = (model.ntendon as usize, model.nv as usize);
        #[cfg(tendon_sparsity_in_model)]
        let (pattern, entries, sparse) = (model, model.nJten as usize, true);
        #[cfg(not(tendon_sparsity_in_model))]
        let (pattern, entries, sparse) = {
            // SAFETY: the model is alive.
            let sparse = unsafe { sys::mj_isSparse(self.model.as_ptr()) } != 0;
            (self.fields(), tendons * dofs, sparse)
        };
        // SAFETY: MuJoCo allocated the array with this length.
        let values = unsafe { slice(self.fields().ten_J, entries) };
        if !sparse {
            return DMatrix::from_row_slice(tendons, dofs, values);
        }
        // SAFETY: MuJoCo allocated the arrays with these lengths.
        let (counts, starts, columns) = unsafe {
            (
                slice(pattern.ten_J_rownnz, tendons),
                slice(pattern.ten_J_rowadr, tendons),
                slice(pattern.ten_J_colind, entries),
            )
        };
        let mut jacobian = DMatrix::zeros(tendons, dofs);
        for (row, (&start, &count)) in starts.iter().zip(counts).enumerate() {
            let row_entries = start as usize..(start + count) as usize;
            for entry in row_entries {
                jacobian[(row, columns[entry] as usize)] = values[entry];
            }
        }
        jacobian
    }

    /// Mass matrix with the joints' armature, `nv x nv`.
    pub fn mass_matrix(&self) -> DMatrix<f64> {
        let dofs = self.model.fields().nv as usize;
        let identity = DMatrix::<f64>::identity(dofs, dofs);
        let mut matrix = DMatrix::zeros(dofs, dofs);
        for (unit, mut column) in identity.column_iter().zip(matrix.column_iter_mut()) {
            let (unit, column) = (unit.as_ptr(), column.as_mut_ptr());
            // SAFETY: model and data belong together, both columns are contiguous and of length nv.
            unsafe { sys::mj_mulM(self.model.as_ptr(), self.data.as_ptr(), column, unit) }
        }
        matrix
    }

    /// Derivatives of one step by central differences of width `eps` (`mjd_transitionFD`).
    ///
    /// The state is left as it was, but what was computed from it is not: call
    /// [`forward`](Self::forward) before reading on.
    pub fn transition_fd(&mut self, eps: f64) -> Transition {
        const CENTRED: bool = true;
        let sizes = self.model.fields();
        let state = 2 * sizes.nv as usize + sizes.na as usize;
        let mut a = vec![0.0; state * state];
        let mut b = vec![0.0; state * sizes.nu as usize];
        // SAFETY: model and data belong together, A and B have room for what MuJoCo writes to them,
        // and the derivatives of sensors, not asked for, may be null.
        unsafe {
            sys::mjd_transitionFD(
                self.model.as_ptr(),
                self.data.as_ptr(),
                eps,
                CENTRED as _,
                a.as_mut_ptr(),
                b.as_mut_ptr(),
                ptr::null_mut(),
                ptr::null_mut(),
            );
        }
        Transition {
            a: DMatrix::from_row_slice(state, state, &a),
            b: DMatrix::from_row_slice(state, sizes.nu as usize, &b),
        }
    }

    fn fields(&self) -> &sys::mjData {
        // SAFETY: MuJoCo made the data, and it lives as long as `self`.
        unsafe { self.data.as_ref() }
    }
}

impl Drop for Data<'_> {
    fn drop(&mut self) {
        // SAFETY: the data is ours.
        unsafe { sys::mj_deleteData(self.data.as_ptr()) }
    }
}

/// An array of MuJoCo's; the pointer may be null when it is empty.
///
/// # Safety
/// Unless `length` is 0, the pointer must lead to `length` numbers that live, unchanged, for `'a`.
unsafe fn slice<'a, T>(start: *const T, length: usize) -> &'a [T] {
    if length == 0 {
        return &[];
    }
    // SAFETY: as the caller says.
    unsafe { std::slice::from_raw_parts(start, length) }
}

/// As [`slice`], to be changed.
///
/// # Safety
/// As for [`slice`], and nothing else may read or change the numbers for `'a`.
unsafe fn slice_mut<'a>(start: *mut f64, length: usize) -> &'a mut [f64] {
    if length == 0 {
        return &mut [];
    }
    // SAFETY: as the caller says.
    unsafe { std::slice::from_raw_parts_mut(start, length) }
}
