//! Loads, for one equilibrium or by rows.

use numpy::{PyReadonlyArray1, PyReadonlyArray3};
use pyo3::prelude::*;
use tdcr::sim::robot::{Frame, Payload, Wrench};

use crate::arrays::contiguous;
use crate::errors::{Failure, Outcome};

/// Loads on a robot besides its own weight.
#[pyclass(frozen, module = "tdcr._tdcr")]
#[derive(Clone)]
pub struct Loads(pub tdcr::sim::robot::Loads);

/// A wrench as it comes from Python: disc, point (m), force (N), moment (N m), and whether it turns with its disc.
type WrenchTuple = (usize, [f64; 3], [f64; 3], [f64; 3], bool);

#[pymethods]
impl Loads {
    #[new]
    fn new(
        payload: f64,
        offset: [f64; 3],
        wrenches: Vec<WrenchTuple>,
        line: [f64; 3],
    ) -> Outcome<Self> {
        let payload = Payload {
            mass: payload,
            offset,
        };
        let mut loads = tdcr::sim::robot::Loads::default()
            .with_payload(payload)?
            .with_line_load(line)?;
        for (disc, point, force, moment, turns) in wrenches {
            let frame = if turns { Frame::Disc } else { Frame::World };
            loads = loads.with_wrench(Wrench {
                disc,
                point,
                force,
                moment,
                frame,
            })?;
        }
        Ok(Self(loads))
    }
}

impl Loads {
    /// These loads with another payload (kg), if one is given, and wrenches on the discs, world frame: force (N), moment (N m).
    pub fn with(
        &self,
        payload: Option<f64>,
        wrenches: &[[f64; 6]],
    ) -> Outcome<tdcr::sim::robot::Loads> {
        let mut loads = self.0.clone();
        if let Some(mass) = payload {
            let payload = Payload {
                mass,
                ..loads.tip_payload()
            };
            loads = loads.with_payload(payload)?;
        }
        for (disc, &[fx, fy, fz, mx, my, mz]) in wrenches.iter().enumerate() {
            let (force, moment) = ([fx, fy, fz], [mx, my, mz]);
            if force != [0.0; 3] || moment != [0.0; 3] {
                loads = loads.with_wrench(Wrench {
                    force,
                    moment,
                    ..Wrench::none(disc, Frame::World)
                })?;
            }
        }
        Ok(loads)
    }
}

/// Loads of each row of a batch.
pub struct LoadRows {
    /// One for all rows, or one a row.
    base: Vec<Loads>,
    /// Payload of each row (kg), in place of that of the base.
    payload: Option<Vec<f64>>,
    /// Wrench on each disc of each row, world frame: force (N), moment (N m).
    wrench: Option<Vec<[f64; 6]>>,
    discs: usize,
}

impl LoadRows {
    /// Loads of `rows` rows for robots of `discs` discs.
    pub fn new(
        base: &[PyRef<'_, Loads>],
        payload: Option<&PyReadonlyArray1<'_, f64>>,
        wrench: Option<&PyReadonlyArray3<'_, f64>>,
        rows: usize,
        discs: usize,
    ) -> Outcome<Self> {
        if !(base.len() == 1 || base.len() == rows) {
            let message = format!("{} loads, expected 1 or {rows}, one a row", base.len());
            return Err(Failure::input(message));
        }
        let payload = payload.map(|p| contiguous(p, "payload", &[rows]).map(<[f64]>::to_vec));
        let wrench = wrench.map(|w| {
            let flat = contiguous(w, "wrench", &[rows, discs, 6])?;
            Ok::<_, Failure>(flat.as_chunks::<6>().0.to_vec())
        });
        Ok(Self {
            base: base.iter().map(|loads| (*loads).clone()).collect(),
            payload: payload.transpose()?,
            wrench: wrench.transpose()?,
            discs,
        })
    }

    /// Loads of one row.
    pub fn row(&self, row: usize) -> Outcome<tdcr::sim::robot::Loads> {
        let base = &self.base[if self.base.len() == 1 { 0 } else { row }];
        let payload = self.payload.as_ref().map(|payload| payload[row]);
        let wrenches = self.wrench.as_ref().map_or(&[][..], |wrench| {
            &wrench[row * self.discs..(row + 1) * self.discs]
        });
        base.with(payload, wrenches)
    }
}
