//! The inside of a tube: a hole along an axis, in a block that is as thick as needed.

mod axis;

use nalgebra::{Matrix3, Vector3};

use super::distance::{Nearest, convex, direction};
use super::shape::{Shape, ShapeError, length};
use axis::{Foot, Piece, pieces};

/// Corners of the sections of a pipe's mesh, and of a full circle of its axis.
const AROUND: u32 = 32;
const CIRCLE: f64 = 128.0;

/// The inside of a straight or bent tube, open at both ends.
///
/// ```
/// use tdcr_sim::geometry::Pipe;
///
/// let bent = Pipe::along(0.02, &[[0.0, 0.0, 0.0], [0.0, 0.0, 0.3], [0.2, 0.0, 0.3]])?;
/// let (end, direction) = bent.axis_at(bent.axis_length());
/// assert!((end.x - 0.2).abs() < 1e-9 && (direction.x - 1.0).abs() < 1e-9);
/// # Ok::<(), tdcr_sim::geometry::ShapeError>(())
/// ```
#[derive(Clone, Debug)]
pub struct Pipe {
    radius: f64,
    /// One at least, of which the first and the last are lines.
    pieces: Vec<Piece>,
}

impl Pipe {
    /// A straight pipe of a radius (m) about the z axis, from `-axis_length / 2` to `axis_length / 2` (m).
    ///
    /// # Errors
    /// [`ShapeError::Length`] unless both are finite and above 0; [`ShapeError::PathPoint`] for a length of more than 1e150.
    pub fn straight(radius: f64, axis_length: f64) -> Result<Self, ShapeError> {
        let half = length("pipe", "length", axis_length)? / 2.0;
        Self::along(radius, &[[0.0, 0.0, -half], [0.0, 0.0, half]])
    }

    /// A pipe of a radius (m) along a path of points (m). Each inner point is a corner that an arc rounds off: it begins and ends
    /// at half the length of the shorter of the two segments there from the corner, and is tangent to both, so that the axis has no
    /// kinks. Its radius is that half over the tangent of half the angle that the path turns by.
    ///
    /// # Errors
    /// [`ShapeError`] unless the radius is finite and above 0, there are two points at least, all finite and none at the position
    /// of the one before, the path nowhere turns back the way it came, and all arcs have a larger radius than the pipe.
    pub fn along(radius: f64, path: &[[f64; 3]]) -> Result<Self, ShapeError> {
        let radius = length("pipe", "radius", radius)?;
        length("pipe", "diameter", 2.0 * radius)?;
        let pieces = pieces(radius, path)?;
        Ok(Self { radius, pieces })
    }

    /// Radius of the inside (m).
    pub fn radius(&self) -> f64 {
        self.radius
    }

    /// Length of the axis (m).
    pub fn axis_length(&self) -> f64 {
        self.pieces.iter().map(|piece| piece.length).sum()
    }

    /// Position (m) and direction (unit vector) of the axis at a length from its start (m); beyond its ends, of the end.
    pub fn axis_at(&self, along: f64) -> (Vector3<f64>, Vector3<f64>) {
        let mut rest = along.max(0.0);
        let last = self.pieces.len() - 1;
        for piece in &self.pieces[..last] {
            if rest < piece.length {
                return piece.at(rest);
            }
            rest -= piece.length;
        }
        self.pieces[last].at(rest.min(self.pieces[last].length))
    }

    /// The wall nearest to a point (m): the distance is above 0 in free space and the normal leads there, away from the wall.
    ///
    /// Along the pipe the distance is its radius less the distance from the axis. Beyond an end of the axis it is that from the
    /// plane in which the block ends, or in front of the hole from its rim. Next to an end, in the block, the nearer of both counts.
    pub(crate) fn nearest(&self, point: &Vector3<f64>) -> Nearest {
        self.wall(point, |foot| self.bore(foot))
    }

    /// The same for the centre of a ball (m), without the ridge that the distance has on the axis: within the bore, at `r` from the axis,
    /// `(c² - r²) / (2 c)` stands for the distance `c - r` of the ball, where `c` is how much narrower it is than the pipe. Both are
    /// alike at the wall, with their gradients; elsewhere this one's gradient is shorter than 1.
    pub(crate) fn nearest_to_ball(&self, centre: &Vector3<f64>, radius: f64) -> Nearest {
        let narrower = self.radius - radius;
        self.wall(centre, |foot| {
            let bore = self.bore(foot);
            if narrower <= 0.0 {
                return bore;
            }
            let t = foot.along;
            let radial = foot.away - t * t.dot(&foot.away);
            let across = Matrix3::identity() - t * t.transpose();
            let bend = t * t.transpose() * (foot.bend * radial.norm());
            Nearest {
                distance: (narrower - radial.norm_squared() / narrower) / 2.0 + radius,
                normal: -radial / narrower,
                curvature: -(across + bend) / narrower,
            }
        })
    }

    fn wall(&self, point: &Vector3<f64>, bore: impl Fn(&Foot) -> Nearest) -> Nearest {
        let feet = self.pieces.iter().map(|piece| piece.foot(point));
        let nearest = feet
            .enumerate()
            .min_by(|(_, a), (_, b)| a.away.norm_squared().total_cmp(&b.away.norm_squared()));
        let Some((index, foot)) = nearest else {
            return Nearest::flat(f64::INFINITY, Vector3::z());
        };
        let bore = bore(&foot);
        let start = Nearest::flat(foot.before, -foot.along);
        let end = Nearest::flat(foot.behind, foot.along);
        match (index == 0, index + 1 == self.pieces.len()) {
            (true, true) => convex(&[bore, start, end]),
            (true, false) => convex(&[bore, start]),
            (false, true) => convex(&[bore, end]),
            (false, false) => bore,
        }
    }

    /// The wall around a point of the axis, the pipe's radius away from a circle or a line (a torus or a cylinder).
    ///
    /// With e the direction away from the axis, t that along it and D the distance from it, the Hessian of D across the axis is
    /// `(I - ee' - tt') / D`, to which the bend of the axis adds a multiple of tt'.
    fn bore(&self, foot: &Foot) -> Nearest {
        let t = foot.along;
        let radial = foot.away - t * t.dot(&foot.away);
        let tube = Nearest::round(&radial, self.radius, Some(t), perpendicular(&t));
        let bend: Matrix3<f64> = t * t.transpose() * foot.bend;
        Nearest {
            distance: -tube.distance,
            normal: -tube.normal,
            curvature: -(tube.curvature + bend),
        }
    }

    /// The wall's inner surface as triangles, both sides of which are seen.
    pub fn mesh(&self) -> Shape {
        let stations = self.stations();
        let mut vertices = Vec::with_capacity(stations.len() * AROUND as usize);
        let mut side = perpendicular(&stations[0].1);
        for (middle, along) in &stations {
            // The last section's first corner, turned along as little as the axis turns.
            side = direction(&(side - along * along.dot(&side)), perpendicular(along));
            let other = along.cross(&side);
            vertices.extend((0..AROUND).map(|corner| {
                let (sin, cos) =
                    (std::f64::consts::TAU * f64::from(corner) / f64::from(AROUND)).sin_cos();
                <[f64; 3]>::from(middle + (side * cos + other * sin) * self.radius)
            }));
        }
        let triangles: Vec<[u32; 3]> = (0..stations.len() as u32 - 1)
            .flat_map(|section| (0..AROUND).map(move |corner| (section * AROUND, corner)))
            .flat_map(|(first, corner)| {
                let next = (corner + 1) % AROUND;
                let [a, b] = [first + corner, first + next];
                [[a, b, a + AROUND], [b, b + AROUND, a + AROUND]]
            })
            .collect();
        Shape::mesh(&vertices, &triangles).expect("positions that the pipe was checked for")
    }

    /// Positions and directions along the axis between which it is drawn straight.
    fn stations(&self) -> Vec<(Vector3<f64>, Vector3<f64>)> {
        let mut stations = Vec::new();
        for piece in &self.pieces {
            let steps = (piece.angle() / std::f64::consts::TAU * CIRCLE)
                .ceil()
                .max(1.0);
            stations.extend(
                (0..steps as usize).map(|step| piece.at(piece.length * step as f64 / steps)),
            );
        }
        stations.push(self.axis_at(f64::INFINITY));
        stations
    }
}

/// A unit vector at right angles to another.
fn perpendicular(to: &Vector3<f64>) -> Vector3<f64> {
    let mut other = Vector3::zeros();
    other[to.iamin()] = 1.0;
    direction(&to.cross(&other), Vector3::x())
}

#[cfg(test)]
mod tests;
