//! Which beads of a robot are near beads of its other discs, in one posture.

use nalgebra::{Matrix3, Vector3};

use crate::chain::{Chain, Configuration};
use crate::energy::{DiscPoint, Pair};
use crate::geometry::{Bead, Beads};
use crate::robot::Robot;

use super::law::Response;

/// Beads of two discs whose surfaces are near each other.
#[derive(Clone, Copy, Debug)]
pub(super) struct NearPair {
    pub beads: [Bead; 2],
    /// Their centres (m).
    pub centres: [Vector3<f64>; 2],
    /// From the second's centre to the first's, of length 1.
    pub normal: Vector3<f64>,
    /// Distance of the surfaces (m), below 0 where they overlap.
    pub gap: f64,
}

impl NearPair {
    /// Two beads, given their centres (m).
    fn new(beads: [Bead; 2], centres: [Vector3<f64>; 2]) -> Self {
        let between = centres[0] - centres[1];
        let distance = between.norm();
        Self {
            beads,
            centres,
            // Of points that coincide any direction leads apart.
            normal: between.try_normalize(0.0).unwrap_or(Vector3::x()),
            gap: distance - beads[0].radius - beads[1].radius,
        }
    }

    /// Two beads where a chain has them.
    pub fn at(beads: [Bead; 2], chain: &Chain) -> Self {
        Self::new(
            beads,
            beads.map(|bead| chain.carried(bead.disc, &bead.centre)),
        )
    }

    /// The discs.
    pub fn discs(&self) -> [usize; 2] {
        self.beads.map(|bead| bead.disc)
    }

    /// Midway between the surfaces (m): where friction acts.
    pub fn meeting(&self) -> Vector3<f64> {
        self.centres[0] - self.normal * (self.beads[0].radius + 0.5 * self.gap)
    }

    /// Distance of the centres (m).
    pub fn distance(&self) -> f64 {
        (self.centres[0] - self.centres[1]).norm()
    }

    /// Second derivative of the gap by a displacement of the first centre from the second (1/m).
    pub fn curvature(&self) -> Matrix3<f64> {
        (Matrix3::identity() - self.normal * self.normal.transpose()) / self.distance()
    }

    /// How the two press each other.
    pub fn pressed(&self, response: &Response) -> Pair {
        let point = |i: usize| DiscPoint {
            disc: self.beads[i].disc,
            local: self.beads[i].centre,
            position: self.centres[i],
        };
        Pair {
            points: [point(0), point(1)],
            axis: self.normal,
            // The force turns with the line between the points, whose curvature is that of a sphere.
            stiffness: [response.stiffness, -response.force / self.distance()],
        }
    }
}

/// Two discs, and a lower bound of the distance of their beads that are not in the list (m).
#[derive(Clone, Copy, Debug)]
pub(super) struct Apart {
    pub discs: [usize; 2],
    pub distance: f64,
}

/// The pairs of discs that can touch, and the beads of them that are near each other.
#[derive(Clone, Debug, Default)]
pub(super) struct PairNeighbourhood {
    pub near: Vec<NearPair>,
    pub apart: Vec<Apart>,
    /// For each disc the first above it that it can touch.
    first: Vec<usize>,
    /// What the beads of each disc are within, in its frame.
    bounds: Vec<Bound>,
}

/// A cylinder about a disc's axis, the surface of which is `margin` away.
#[derive(Clone, Copy, Debug, Default)]
struct Bound {
    radius: f64,
    half_height: f64,
    margin: f64,
}

impl Bound {
    fn of(beads: &[Bead]) -> Self {
        let mut bound = Self::default();
        for bead in beads {
            bound.radius = bound.radius.max(bead.centre.xy().norm());
            bound.half_height = bound.half_height.max(bead.centre.z.abs());
            bound.margin = bound.margin.max(bead.radius);
        }
        bound
    }

    /// How far it reaches along a direction that has the component `cos` along the axis (m).
    fn reach(&self, cos: f64) -> f64 {
        let sin = (1.0 - cos * cos).max(0.0).sqrt();
        self.radius * sin + self.half_height * cos.abs() + self.margin
    }
}

impl PairNeighbourhood {
    /// The discs that can touch: those whose beads are more than `reach` (m) apart while the robot is straight, neighbours excluded.
    pub fn new(robot: &Robot, beads: &Beads, reach: f64) -> Self {
        let n = robot.discs().len();
        let mut chain = Chain::new(robot);
        chain.place(robot, &Configuration::straight(robot));
        let mut pairs = Self {
            bounds: (0..n)
                .map(|disc| Bound::of(&beads.as_slice()[beads.of_disc(disc)]))
                .collect(),
            ..Self::default()
        };
        pairs.first = (0..n)
            .map(|disc| {
                let mut above = disc + 2;
                while above < n && pairs.nearest(beads, &chain, [disc, above]) <= reach {
                    above += 1;
                }
                above
            })
            .collect();
        pairs
    }

    /// For each disc the first above it that it can touch.
    pub fn first(&self) -> &[usize] {
        &self.first
    }

    /// Finds all pairs of beads whose surfaces are within the `reach` (m) of their discs, whose distance (m) is at least that given.
    pub fn find(&mut self, beads: &Beads, chain: &Chain, reach: impl Fn([usize; 2], f64) -> f64) {
        self.near.clear();
        self.apart.clear();
        for disc in 0..self.first.len() {
            for other in self.first[disc]..self.first.len() {
                let discs = [disc, other];
                let distance = self.lower_bound(beads, chain, discs);
                let reach = reach(discs, distance);
                let distance = match distance >= reach {
                    true => distance,
                    false => self.add(beads, chain, discs, reach),
                };
                self.apart.push(Apart { discs, distance });
            }
        }
    }

    /// Whether beads of discs that can touch overlap.
    pub fn overlaps(&mut self, beads: &Beads, chain: &Chain) -> bool {
        self.find(beads, chain, |_, _| 0.0);
        !self.near.is_empty()
    }

    /// A lower bound of the distance of two discs' beads (m): by the spheres about them, and by planes across the bisector of
    /// their axes.
    fn lower_bound(&self, beads: &Beads, chain: &Chain, [i, j]: [usize; 2]) -> f64 {
        let between = chain.positions[j] - chain.positions[i];
        let enclosing = beads.enclosing(i) + beads.enclosing(j);
        let by_spheres = between.norm() - enclosing;
        // Far enough for steps of a usual size.
        if by_spheres > 0.5 * enclosing {
            return by_spheres;
        }
        let axis = |disc: usize| -> Vector3<f64> { chain.disc(disc).column(2).into() };
        let axes = [axis(i), axis(j)];
        let Some(across) = (axes[0] + axes[1]).try_normalize(1e-3) else {
            return by_spheres;
        };
        let [below, above] = [i, j].map(|disc| &self.bounds[disc]);
        let by_planes = between.dot(&across).abs()
            - below.reach(axes[0].dot(&across))
            - above.reach(axes[1].dot(&across));
        by_spheres.max(by_planes)
    }

    /// Adds the pairs of two discs' beads that are within `reach`; the distance of the others (m).
    fn add(&mut self, beads: &Beads, chain: &Chain, discs: [usize; 2], reach: f64) -> f64 {
        let mut farther = f64::INFINITY;
        for_pairs(beads, chain, discs, |pair| match pair.gap < reach {
            true => self.near.push(pair),
            false => farther = farther.min(pair.gap),
        });
        farther
    }

    /// The distance of two discs' beads (m).
    fn nearest(&self, beads: &Beads, chain: &Chain, discs: [usize; 2]) -> f64 {
        let mut nearest = f64::INFINITY;
        for_pairs(beads, chain, discs, |pair| nearest = nearest.min(pair.gap));
        nearest
    }
}

fn for_pairs(beads: &Beads, chain: &Chain, discs: [usize; 2], mut take: impl FnMut(NearPair)) {
    let own = discs.map(|disc| &beads.as_slice()[beads.of_disc(disc)]);
    let turns = discs.map(|disc| chain.disc(disc));
    for &first in own[0] {
        let centre = chain.positions[discs[0]] + turns[0] * first.centre;
        for &second in own[1] {
            let other = chain.positions[discs[1]] + turns[1] * second.centre;
            take(NearPair::new([first, second], [centre, other]));
        }
    }
}
