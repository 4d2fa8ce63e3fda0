//! The axis of a pipe: straight lines and the circular arcs between them, which continue each other's direction.

use nalgebra::{Unit, UnitQuaternion, Vector3};

use super::super::distance::inverse;
use super::super::shape::ShapeError;

/// A path that turns by less than this (rad) is straight: the arc's centre would be too far away for its numbers.
const STRAIGHT: f64 = 1e-6;
/// A path that turns by nearly 180 degrees, up to this (rad), turns back.
const FOLD: f64 = 1e-9;
/// Coordinates (m) of points are less: products of two of them are finite.
const FARTHEST: f64 = 1e150;

/// A piece of the axis, of a length (m), from a point (m) along a unit vector.
#[derive(Clone, Debug)]
pub(super) struct Piece {
    from: Vector3<f64>,
    along: Vector3<f64>,
    pub length: f64,
    bend: Option<Bend>,
}

/// What makes a piece an arc: its centre and radius (m), and the unit vector that it turns about.
#[derive(Clone, Debug)]
struct Bend {
    centre: Vector3<f64>,
    radius: f64,
    about: Unit<Vector3<f64>>,
}

/// The point of a piece that is nearest to another point.
#[derive(Clone, Copy, Debug)]
pub(super) struct Foot {
    /// From it to the other point (m).
    pub away: Vector3<f64>,
    /// The axis' direction there.
    pub along: Vector3<f64>,
    /// Second derivative of the distance from the piece along the axis (1/m): 0 of a line.
    pub bend: f64,
    /// How far the other point lies before the piece's start, by the direction there (m).
    pub before: f64,
    /// How far it lies behind the piece's end (m).
    pub behind: f64,
}

impl Piece {
    fn line(from: Vector3<f64>, along: Vector3<f64>, length: f64) -> Self {
        Self {
            from,
            along,
            length,
            bend: None,
        }
    }

    /// Position (m) and direction after a length along the piece (m).
    pub fn at(&self, s: f64) -> (Vector3<f64>, Vector3<f64>) {
        match &self.bend {
            None => (self.from + self.along * s, self.along),
            Some(bend) => {
                let turn = UnitQuaternion::from_axis_angle(&bend.about, s / bend.radius);
                (
                    bend.centre + turn * (self.from - bend.centre),
                    turn * self.along,
                )
            }
        }
    }

    /// The angle that it turns by (rad).
    pub fn angle(&self) -> f64 {
        (self.bend.as_ref()).map_or(0.0, |bend| self.length / bend.radius)
    }

    /// Its point nearest to `point` (m).
    pub fn foot(&self, point: &Vector3<f64>) -> Foot {
        let s = match &self.bend {
            None => self.along.dot(&(point - self.from)),
            Some(bend) => {
                let (outward, half) = (self.from - bend.centre, self.angle() / 2.0);
                let from_centre = point - bend.centre;
                let angle =
                    (from_centre.dot(&self.along) * bend.radius).atan2(from_centre.dot(&outward));
                // From the arc's middle, so that what is beyond an end is nearer to that one.
                let from_middle = match angle - half {
                    turned if turned < -std::f64::consts::PI => turned + std::f64::consts::TAU,
                    turned => turned,
                };
                (half + from_middle) * bend.radius
            }
        };
        let (foot, along) = self.at(s.clamp(0.0, self.length));
        let away = point - foot;
        Foot {
            away,
            along,
            bend: self.bend_of_distance(&away, point),
            before: -s,
            behind: s - self.length,
        }
    }

    /// Second derivative along an arc of the distance from it: of a function of the distance from its axis (`across`) alone, whose
    /// derivative by that is `d`, it is `d / across`.
    fn bend_of_distance(&self, away: &Vector3<f64>, point: &Vector3<f64>) -> f64 {
        let Some(bend) = &self.bend else {
            return 0.0;
        };
        let from_centre = point - bend.centre;
        let across = from_centre - bend.about.scale(bend.about.dot(&from_centre));
        let derivative = (across.norm() - bend.radius) * inverse(away.norm());
        derivative * inverse(across.norm())
    }
}

/// The axis along a path of points (m): see [`super::Pipe::along`].
pub(super) fn pieces(radius: f64, path: &[[f64; 3]]) -> Result<Vec<Piece>, ShapeError> {
    if path.len() < 2 {
        return Err(ShapeError::Path { count: path.len() });
    }
    for (index, &position) in path.iter().enumerate() {
        if !position.iter().all(|x| x.abs() < FARTHEST) {
            return Err(ShapeError::PathPoint { index, position });
        }
    }
    let points: Vec<Vector3<f64>> = path.iter().map(|&point| point.into()).collect();
    let segments: Vec<(Vector3<f64>, f64)> = (points.windows(2).enumerate())
        .map(|(index, ends)| {
            Unit::try_new_and_get(ends[1] - ends[0], 0.0)
                .map(|(along, length)| (along.into_inner(), length))
                .ok_or(ShapeError::PathRepeats { index: index + 1 })
        })
        .collect::<Result<_, _>>()?;
    let mut pieces = Vec::with_capacity(2 * path.len());
    let mut from = points[0];
    for (corner, meeting) in segments.windows(2).enumerate() {
        let [(before, shorter), (after, other)] = [meeting[0], meeting[1]];
        let index = corner + 1;
        let arc = rounded(
            points[index],
            [before, after],
            shorter.min(other) / 2.0,
            index,
        )?;
        let Some(arc) = arc else {
            push_line(&mut pieces, from, before, points[index]);
            from = points[index];
            continue;
        };
        if let Some(Bend { radius: bend, .. }) = arc.bend
            && bend <= radius
        {
            return Err(ShapeError::Bend {
                index,
                bend,
                radius,
                segment: shorter.min(other) * radius / bend,
            });
        }
        push_line(&mut pieces, from, before, arc.from);
        from = arc.at(arc.length).0;
        pieces.push(arc);
    }
    push_line(
        &mut pieces,
        from,
        segments[segments.len() - 1].0,
        points[points.len() - 1],
    );
    Ok(pieces)
}

fn push_line(pieces: &mut Vec<Piece>, from: Vector3<f64>, along: Vector3<f64>, to: Vector3<f64>) {
    // Two arcs may meet at the middle of a segment.
    let length = along.dot(&(to - from));
    if length > 0.0 {
        pieces.push(Piece::line(from, along, length));
    }
}

/// The arc that touches both segments at a corner at a distance from it (m); none where they go on straight.
fn rounded(
    corner: Vector3<f64>,
    [before, after]: [Vector3<f64>; 2],
    distance: f64,
    index: usize,
) -> Result<Option<Piece>, ShapeError> {
    let normal = before.cross(&after);
    let angle = normal.norm().atan2(before.dot(&after));
    if angle < STRAIGHT {
        return Ok(None);
    }
    let fold = ShapeError::PathFolds { index };
    let about = Unit::try_new(normal, 0.0).ok_or(fold.clone())?;
    if angle > std::f64::consts::PI - FOLD {
        return Err(fold);
    }
    let radius = distance / (angle / 2.0).tan();
    let from = corner - before * distance;
    let bend = Bend {
        centre: from + about.cross(&before) * radius,
        radius,
        about,
    };
    Ok(Some(Piece {
        from,
        along: before,
        length: radius * angle,
        bend: Some(bend),
    }))
}
