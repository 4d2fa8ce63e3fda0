//! The line of one tendon through its holes: lengths, directions, wrap angles, and their derivatives
//! along turns of the joints in world axes.

use nalgebra::Vector3;

use crate::chain::Chain;
use crate::robot::{Body, Friction, Robot, Tendon};

/// A hole on the line: the number of joints below its body, and where it is seen from the body's
/// joint centre (base origin), in the body's frame (m).
#[derive(Clone, Debug)]
struct Hole {
    joints: usize,
    local: Vector3<f64>,
}

/// One tendon laid straight from hole to hole.
#[derive(Clone, Debug)]
pub(crate) struct Line {
    /// Its friction; a coefficient of 0 where the tendon has none.
    pub friction: Friction,
    route: Vec<Hole>,
    /// The holes in the world (m).
    points: Vec<Vector3<f64>>,
    /// Unit vector of each segment, away from the servo; zero for a segment of no length.
    directions: Vec<Vector3<f64>>,
    /// Length of each segment (m).
    pub lengths: Vec<f64>,
    /// Angle between the segments at each interior hole (rad).
    pub wrap_angles: Vec<f64>,
}

impl Line {
    pub fn new(robot: &Robot, tendon: &Tendon) -> Self {
        let hole = |waypoint: &_| Hole {
            local: robot.hole(*waypoint),
            joints: match waypoint.0 {
                Body::Base => 0,
                Body::Disc(disc) => disc + 1,
            },
        };
        let count = tendon.route.len();
        Self {
            friction: tendon.friction.unwrap_or(Friction {
                coefficient: 0.0,
                contact_stiffness: 1.0,
            }),
            route: tendon.route.iter().map(hole).collect(),
            points: vec![Vector3::zeros(); count],
            directions: vec![Vector3::zeros(); count - 1],
            lengths: vec![0.0; count - 1],
            wrap_angles: vec![0.0; count - 2],
        }
    }

    /// Lays the line in the poses of `chain`.
    pub fn lay(&mut self, robot: &Robot, chain: &Chain) {
        for (point, hole) in self.points.iter_mut().zip(&self.route) {
            *point = chain.point(robot, hole.joints.checked_sub(1), &hole.local);
        }
        for (segment, ends) in self.points.windows(2).enumerate() {
            let span = ends[1] - ends[0];
            let length = span.norm();
            self.lengths[segment] = length;
            self.directions[segment] = if length > 0.0 {
                span / length
            } else {
                Vector3::zeros()
            };
        }
        for (angle, pair) in self.wrap_angles.iter_mut().zip(self.directions.windows(2)) {
            *angle = pair[0].cross(&pair[1]).norm().atan2(pair[0].dot(&pair[1]));
        }
    }

    /// Length of the whole tendon (m).
    pub fn length(&self) -> f64 {
        self.lengths.iter().sum()
    }

    /// The joints that a segment's length depends on.
    pub fn joints(&self, segment: usize) -> std::ops::Range<usize> {
        let [a, b] = [segment, segment + 1].map(|hole| self.route[hole].joints);
        a.min(b)..a.max(b)
    }

    /// Adds to `out` the derivative of a segment's length by the turn of each joint (m/rad).
    pub fn add_length_slope(&self, chain: &Chain, segment: usize, out: &mut [Vector3<f64>]) {
        self.add_slope(chain, segment, &self.directions[segment], out);
    }

    /// The derivative of the length of a segment that passes one joint, from below it, by the turn of that (m/rad).
    pub fn length_slope(&self, chain: &Chain, segment: usize) -> Vector3<f64> {
        let centre = &chain.centres[self.route[segment].joints];
        (self.points[segment + 1] - centre).cross(&self.directions[segment])
    }

    /// Adds to `out` the derivative of the wrap angle between segments `place` and `place + 1` by
    /// the turn of each joint. Where the tendon goes straight on the angle has a kink, like the norm
    /// of a vector at zero; there the derivative 0 is taken.
    pub fn add_wrap_slope(&self, chain: &Chain, place: usize, out: &mut [Vector3<f64>]) {
        if let Some([by_first, by_second]) = self.wrap_by_ends(place) {
            self.add_slope(chain, place, &by_first, out);
            self.add_slope(chain, place + 1, &by_second, out);
        }
    }

    /// The same where both segments pass one joint each, that of the second above that of the first: by the turns of those two.
    /// A turn of what is below carries both along.
    pub fn wrap_slopes(&self, chain: &Chain, place: usize) -> [Vector3<f64>; 2] {
        let Some([by_first, by_second]) = self.wrap_by_ends(place) else {
            return [Vector3::zeros(); 2];
        };
        let [hole, above] = [place + 1, place + 2].map(|hole| &self.points[hole]);
        let [first, second] =
            [place, place + 1].map(|hole| &chain.centres[self.route[hole].joints]);
        [
            (hole - first).cross(&by_first) + (above - hole).cross(&by_second),
            (above - second).cross(&by_second),
        ]
    }

    /// Unit vector of a segment, away from the servo; zero for a segment of no length.
    pub fn direction(&self, segment: usize) -> &Vector3<f64> {
        &self.directions[segment]
    }

    /// Derivatives of the wrap angle by the spans of the two segments (rad/m); none where the tendon goes straight on.
    pub fn wrap_by_ends(&self, place: usize) -> Option<[Vector3<f64>; 2]> {
        let (u, v) = (&self.directions[place], &self.directions[place + 1]);
        let (sin, cos) = (u.cross(v).norm(), u.dot(v));
        // d theta = -(v - cos u) / sin . du - (u - cos v) / sin . dv.
        let by_first = (u * cos - v) / (sin * self.lengths[place]);
        let by_second = (v * cos - u) / (sin * self.lengths[place + 1]);
        (sin != 0.0).then_some([by_first, by_second])
    }

    /// Adds the derivative of `along . (b - a)`, `a` and `b` the ends of a segment.
    fn add_slope(
        &self,
        chain: &Chain,
        segment: usize,
        along: &Vector3<f64>,
        out: &mut [Vector3<f64>],
    ) {
        let (a, b) = (&self.points[segment], &self.points[segment + 1]);
        let between = self.joints(segment);
        let forward = self.route[segment].joints <= self.route[segment + 1].joints;
        let turned = (b - a).cross(along);
        for slope in &mut out[..between.start] {
            *slope += turned;
        }
        for joint in between {
            let arm = if forward {
                b - chain.centres[joint]
            } else {
                chain.centres[joint] - a
            };
            out[joint] += arm.cross(along);
        }
    }
}
