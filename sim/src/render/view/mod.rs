//! Visuals as one camera sees them, row by row.
//!
//! A row is cast solid by solid into a depth buffer that stays in cache, within the columns that the solid's outline bounds;
//! then each pixel is shaded once.

use std::ops::Range;

use nalgebra::{Matrix3, Vector3};
use pulp::{Arch, Simd, WithSimd};

use super::cast::Cast;
use super::frame::Span;
use super::lanes::Lanes;

use super::Visuals;
use crate::camera::Camera;
use crate::geometry::{Instance, Kind, Solid};

/// Share of the colour that does not depend on the angle to the head light.
const AMBIENT: f64 = 0.35;
/// A solid hides another one where it is nearer by this factor of its depth. Where two faces lie in one plane, as a floor on a
/// table, rounding would choose between them pixel by pixel; so the one whose frame is nearer to the camera is seen.
const NEARER: f64 = 1.0 - 1e-9;
/// Full light in fixed point.
const FULL_LIGHT: u32 = 1 << 16;

/// A camera and the solids in its sight.
pub(super) struct View<'a> {
    camera: &'a Camera,
    solids: Vec<Seen<'a>>,
    /// Normalised x of each column, for a pinhole.
    columns: Vec<f64>,
}

/// A solid in a camera's sight.
struct Seen<'a> {
    solid: &'a Solid,
    /// The camera in the solid's frame: centre of projection (m), and its axes as columns.
    origin: Vector3<f64>,
    axes: Matrix3<f64>,
    /// Pixels that the solid can cover.
    columns: Range<u32>,
    rows: Range<u32>,
}

/// Some rows of a frame.
pub(super) struct Band<'a> {
    pub first_row: u32,
    pub color: &'a mut [[u8; 3]],
    pub depth: &'a mut [f32],
    pub mask: &'a mut [Instance],
    pub spans: &'a mut [Span],
}

/// Rows are padded to a multiple of the longest vector's lanes.
const LANES: usize = 8;

/// One row of rays and what they have met so far, from the first column of a span on.
#[derive(Default)]
struct Row {
    /// Normalised coordinates.
    x: Vec<f64>,
    y: Vec<f64>,
    /// Nearest depth (m), `|normal . direction|` there, and the solid's place in the view plus 1.
    depth: Vec<f64>,
    facing: Vec<f64>,
    solid: Vec<u64>,
    /// Share of the colour that is seen, of [`FULL_LIGHT`].
    light: Vec<u32>,
}

impl<'a> View<'a> {
    pub fn of(visuals: &'a Visuals, camera: &'a Camera) -> Self {
        let k = &camera.intrinsics;
        let columns = match k.distortion {
            None => (0..k.width).map(|u| (f64::from(u) - k.cx) / k.fx).collect(),
            Some(_) => Vec::new(),
        };
        let mut solids: Vec<Seen> = (visuals.solids.iter())
            .filter_map(|solid| Seen::of(solid, camera))
            .collect();
        // From near to far, so that few pixels are drawn twice.
        solids.sort_by(|a, b| a.origin.norm_squared().total_cmp(&b.origin.norm_squared()));
        Self {
            camera,
            solids,
            columns,
        }
    }

    /// Draws a band of the view's frame, over whatever it shows.
    pub fn draw(&self, band: &mut Band) {
        let width = self.camera.intrinsics.width as usize;
        let mut row = Row::default();
        for index in 0..band.spans.len() {
            let v = band.first_row + index as u32;
            let span = self.cast(v, &mut row);
            let pixels = index * width..(index + 1) * width;
            let (color, depth) = (
                &mut band.color[pixels.clone()],
                &mut band.depth[pixels.clone()],
            );
            let mask = &mut band.mask[pixels];
            let [from, to] = span.map(|u| u as usize);
            let [old_from, old_to] = band.spans[index].map(|u| u as usize);
            // What the frame showed outside the new span is background now.
            for stale in [old_from..old_to.min(from), old_from.max(to)..old_to] {
                if !stale.is_empty() {
                    color[stale.clone()].fill([0; 3]);
                    depth[stale.clone()].fill(0.0);
                    mask[stale].fill(Instance::Background);
                }
            }
            band.spans[index] = span;
            self.shade(
                &mut row,
                &mut color[from..to],
                &mut depth[from..to],
                &mut mask[from..to],
            );
        }
    }

    /// Casts the rays of row `v` that may meet something; returns their columns.
    fn cast(&self, v: u32, row: &mut Row) -> Span {
        let in_row = || {
            self.solids
                .iter()
                .filter(move |seen| seen.rows.contains(&v))
        };
        let from = in_row().map(|seen| seen.columns.start).min().unwrap_or(0);
        let to = in_row().map(|seen| seen.columns.end).max().unwrap_or(0);
        row.clear(to.saturating_sub(from) as usize);
        self.aim(v, from..to, row);
        for (number, seen) in self.solids.iter().enumerate() {
            if seen.rows.contains(&v) {
                let columns = match self.camera.intrinsics.distortion {
                    None => self.narrowed(seen, v),
                    Some(_) => seen.columns.clone(),
                };
                let part = (columns.start - from) as usize..(columns.end - from) as usize;
                seen.cast(number as u64 + 1, row, part);
            }
        }
        [from, to]
    }

    /// Normalised coordinates of the pixels of a row.
    fn aim(&self, v: u32, columns: Range<u32>, row: &mut Row) {
        let k = &self.camera.intrinsics;
        if k.distortion.is_none() {
            let columns = columns.start as usize..columns.end as usize;
            row.x.extend_from_slice(&self.columns[columns]);
            row.y.resize(row.depth.len(), (f64::from(v) - k.cy) / k.fy);
        } else {
            for u in columns {
                let seen = k.normalised(f64::from(u), f64::from(v));
                row.x.push(seen.x);
                row.y.push(seen.y);
            }
            row.y.resize(row.depth.len(), 0.0);
        }
        row.x.resize(row.depth.len(), 0.0);
    }

    /// The columns of row `v` in which a pinhole may see the solid.
    fn narrowed(&self, seen: &Seen, v: u32) -> Range<u32> {
        let k = &self.camera.intrinsics;
        let y = (f64::from(v) - k.cy) / k.fy;
        let start = seen.axes * Vector3::new(0.0, y, 1.0);
        let per_unit = seen.axes.column(0).into_owned();
        let [low, high] = match &seen.solid.shape.0 {
            Kind::Cylinder(shape) => shape.interval(&seen.origin, &start, &per_unit),
            Kind::Sphere(shape) => shape.interval(&seen.origin, &start, &per_unit),
            _ => return seen.columns.clone(),
        };
        let range = pixel_range([k.fx * low + k.cx, k.fx * high + k.cx], k.width);
        let from = range.start.clamp(seen.columns.start, seen.columns.end);
        from..range.end.clamp(from, seen.columns.end)
    }

    /// Turns what the rays have met into pixels.
    fn shade(
        &self,
        row: &mut Row,
        color: &mut [[u8; 3]],
        depth: &mut [f32],
        mask: &mut [Instance],
    ) {
        // Light of each pixel: ambient, and the cosine between ray and normal.
        row.light.resize(color.len(), 0);
        let rays = row.x.iter().zip(&row.y).zip(&row.facing);
        Arch::new().dispatch(
            #[inline(always)]
            || {
                for (light, ((x, y), facing)) in row.light.iter_mut().zip(rays) {
                    let norm = (1.0 + x * x + y * y).sqrt();
                    let share = AMBIENT + (1.0 - AMBIENT) * (facing / norm);
                    *light = (share * f64::from(FULL_LIGHT)) as u32;
                }
            },
        );
        // Runs of pixels of one solid.
        let mut from = 0;
        for run in row.solid[..color.len()].chunk_by(|a, b| a == b) {
            let pixels = from..from + run.len();
            from = pixels.end;
            let Some(seen) = (run[0] as usize).checked_sub(1).map(|k| &self.solids[k]) else {
                color[pixels.clone()].fill([0; 3]);
                depth[pixels.clone()].fill(0.0);
                mask[pixels].fill(Instance::Background);
                continue;
            };
            mask[pixels.clone()].fill(seen.solid.instance);
            for (depth, nearest) in depth[pixels.clone()]
                .iter_mut()
                .zip(&row.depth[pixels.clone()])
            {
                *depth = *nearest as f32;
            }
            let full = seen.solid.color.map(u32::from);
            for (color, light) in color[pixels.clone()].iter_mut().zip(&row.light[pixels]) {
                *color =
                    full.map(|channel| ((channel * light + FULL_LIGHT / 2) / FULL_LIGHT) as u8);
            }
        }
    }
}

impl Row {
    /// Resets the buffers for this many rays, which have met nothing.
    fn clear(&mut self, rays: usize) {
        let rays = rays.next_multiple_of(LANES);
        self.x.clear();
        self.y.clear();
        self.depth.clear();
        self.depth.resize(rays, f64::INFINITY);
        self.facing.clear();
        self.facing.resize(rays, 0.0);
        self.solid.clear();
        self.solid.resize(rays, 0);
    }
}

impl<'a> Seen<'a> {
    /// `None` where the camera cannot see the solid.
    fn of(solid: &'a Solid, camera: &Camera) -> Option<Self> {
        let (columns, rows) = pixel_bounds(solid, camera);
        if columns.is_empty() || rows.is_empty() {
            return None;
        }
        let to_solid = solid.pose.inverse() * camera.pose;
        Some(Self {
            solid,
            origin: to_solid.translation.vector,
            axes: to_solid.rotation.to_rotation_matrix().into_inner(),
            columns,
            rows,
        })
    }

    /// Casts the rays of a row's `part`, and up to a vector's length around it, at the solid.
    fn cast(&self, number: u64, row: &mut Row, part: Range<usize>) {
        let part = part.start / LANES * LANES..part.end.next_multiple_of(LANES);
        // Choosing the shape here, not at each ray, lets the compiler see through the cast.
        match &self.solid.shape.0 {
            Kind::Cylinder(shape) => self.cast_shape(shape, number, row, part),
            Kind::Cuboid(shape) => self.cast_shape(shape, number, row, part),
            Kind::Sphere(shape) => self.cast_shape(shape, number, row, part),
            Kind::Capsule(shape) => self.cast_shape(shape, number, row, part),
            Kind::Mesh(shape) => {
                for k in part {
                    let direction = self.axes * Vector3::new(row.x[k], row.y[k], 1.0);
                    if let Some([depth, facing]) = shape.cast(&self.origin, &direction)
                        && depth < NEARER * row.depth[k]
                    {
                        (row.depth[k], row.facing[k], row.solid[k]) = (depth, facing, number);
                    }
                }
            }
        }
    }

    fn cast_shape<T: Cast>(&self, shape: &T, number: u64, row: &mut Row, part: Range<usize>) {
        Arch::new().dispatch(CastRow {
            shape,
            seen: self,
            number,
            x: &row.x[part.clone()],
            y: &row.y[part.clone()],
            depth: &mut row.depth[part.clone()],
            facing: &mut row.facing[part.clone()],
            solid: &mut row.solid[part],
        });
    }
}

/// Rays of a row, a multiple of [`LANES`], and a shape that they are cast at.
struct CastRow<'a, T> {
    shape: &'a T,
    seen: &'a Seen<'a>,
    number: u64,
    x: &'a [f64],
    y: &'a [f64],
    depth: &'a mut [f64],
    facing: &'a mut [f64],
    solid: &'a mut [u64],
}

impl<T: Cast> WithSimd for CastRow<'_, T> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let rays = (S::as_simd_f64s(self.x).0.iter()).zip(S::as_simd_f64s(self.y).0);
        let hits = (S::as_mut_simd_f64s(self.depth).0.iter_mut())
            .zip(S::as_mut_simd_f64s(self.facing).0)
            .zip(S::as_mut_simd_u64s(self.solid).0);
        let number = simd.splat_u64s(self.number);
        let axes = &self.seen.axes;
        for ((x, y), ((depth, facing), solid)) in rays.zip(hits) {
            let (x, y) = (Lanes::new(simd, *x), Lanes::new(simd, *y));
            // The camera-frame ray has depth 1 per unit, so the hit's parameter is its depth.
            let direction = [
                x * axes[(0, 0)] + y * axes[(0, 1)] + axes[(0, 2)],
                x * axes[(1, 0)] + y * axes[(1, 1)] + axes[(1, 2)],
                x * axes[(2, 0)] + y * axes[(2, 1)] + axes[(2, 2)],
            ];
            let found = self.shape.cast(simd, &self.seen.origin, direction);
            let nearer = found.depth.less(Lanes::new(simd, *depth) * NEARER);
            *depth = nearer.select(found.depth, Lanes::new(simd, *depth)).numbers;
            *facing = nearer
                .select(found.facing, Lanes::new(simd, *facing))
                .numbers;
            *solid = simd.select_u64s(nearer.lanes, number, *solid);
        }
    }
}

/// Columns and rows that a solid can cover, from its extents along the camera's axes; all of them
/// where it reaches the camera's plane.
fn pixel_bounds(solid: &Solid, camera: &Camera) -> (Range<u32>, Range<u32>) {
    let k = &camera.intrinsics;
    let middle = solid.pose * nalgebra::Point3::from(solid.shape.middle());
    let center = camera.pose.inverse_transform_point(&middle);
    let to_camera = camera.pose.rotation.inverse() * solid.pose.rotation;
    let extents = solid.shape.extents(to_camera.to_rotation_matrix().matrix());
    let (near, far) = (center.z - extents.z, center.z + extents.z);
    if far <= 0.0 {
        return (0..0, 0..0);
    }
    if near <= 0.0 {
        return (0..k.width, 0..k.height);
    }
    // Normalised coordinates between which a box of these extents lies.
    let slopes = |middle: f64, extent: f64| {
        let (low, high) = (middle - extent, middle + extent);
        [
            low / if low < 0.0 { near } else { far },
            high / if high > 0.0 { near } else { far },
        ]
    };
    let mut bounds = [slopes(center.x, extents.x), slopes(center.y, extents.y)];
    if let Some(distortion) = &k.distortion {
        bounds = distortion.bounds(bounds);
    }
    let [columns, rows] = bounds;
    (
        pixel_range(columns.map(|x| k.fx * x + k.cx), k.width),
        pixel_range(rows.map(|y| k.fy * y + k.cy), k.height),
    )
}

/// The pixels between two places, those at their edges included.
fn pixel_range([low, high]: [f64; 2], size: u32) -> Range<u32> {
    // `as` saturates: bounds beyond the image, however far, end at its edge.
    let first = ((low - EDGE).ceil().max(0.0) as u32).min(size);
    let end = (((high + EDGE).floor() + 1.0).max(0.0) as u32).min(size);
    first..end.max(first)
}

/// Far more than bounds are off by rounding (pixels).
const EDGE: f64 = 1e-3;

#[cfg(test)]
mod tests;
