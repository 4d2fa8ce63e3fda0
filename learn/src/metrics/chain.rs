//! Where a chain of bodies lies in a cloud that shows it in another shape.
//!
//! Iterated closest points (Besl and McKay, IEEE PAMI 14, 1992) for an articulated body (Pellegrini, Schindler and Nardi,
//! BMVC 2008). Body `k` moves by `M_k = M_{k-1} R_k`, where `R_k` turns about the centre `c_k` of the joint that carries it,
//! and `M_{-1}` is the identity: the base stands still. Each step pairs points of the bodies with points of the cloud, and
//! turns the joints by the `w_j` that minimise `sum |x + sum_{j <= k} w_j × (x - c_j) - y|²` over the pairs of a point `x`
//! of body `k`, as it lies now, and its partner `y`: a Gauss-Newton step.

use nalgebra::{
    DMatrix, DVector, Isometry3, Matrix3, Point3, Translation3, UnitQuaternion, Vector3,
};

use super::kdtree::KdTree;
use super::{MetricError, Side, checked};

/// Steps after each body that has joined.
const STEPS_PER_BODY: usize = 6;
/// Steps of the whole chain at the most.
const STEPS: usize = 100;
/// Mean square (m²) of the points' moves below which the chain is still: moves of 10 um.
const STILL: f64 = 1e-10;
/// Damping of a joint's turns, relative to its block of the normal matrix.
const DAMPING: f64 = 1e-3;

/// A body of a chain.
#[derive(Clone, Debug, PartialEq)]
pub struct Link {
    /// Centre (m) of the joint that carries it.
    pub joint: [f64; 3],
    /// Points (m) of its surface; there may be none.
    pub points: Vec<[f32; 3]>,
}

/// The rigid motions (m) of the bodies of `chain`, from the base up, that lay their points onto the cloud `q` (m) while the
/// joints hold together. `base` (m) are points that stand still; there may be none.
///
/// Bodies along a chain are alike, and the points nearest to one that has moved far are those of others. Therefore three
/// fits are made: one starts where the chain is; in the others the bodies join one after another from the base, each
/// near to where it lies as those below have been found, with the joint as it is, or turned as the one below. The fit
/// with the smallest mean square distance, both ways, is taken. All find local minima. Turns about an axis of symmetry stay
/// about what they are.
///
/// # Errors
/// An empty cloud `q`, a chain without points, or a coordinate that is not finite.
pub fn lay_chain_onto(
    base: &[[f32; 3]],
    chain: &[Link],
    q: &[[f32; 3]],
) -> Result<Vec<Isometry3<f64>>, MetricError> {
    let points = || chain.iter().flat_map(|link| &link.points).copied();
    checked(&points().collect::<Vec<_>>(), Side::First)?;
    let cloud = KdTree::new(&checked(q, Side::Second)?);
    let fits = [Growth::None, Growth::Carried, Growth::Repeated].map(|growth| {
        let mut fit = ChainFit::new(base, chain, &cloud);
        while fit.motions.len() < chain.len() {
            fit.join(growth);
            if growth != Growth::None {
                (0..STEPS_PER_BODY).for_each(|_| {
                    fit.turn_joints(&fit.forward());
                });
            }
        }
        let distance = fit.settle();
        (distance, fit.motions)
    });
    let best = fits.into_iter().min_by(|a, b| a.0.total_cmp(&b.0));
    Ok(best.map(|(_, motions)| motions).unwrap_or_default())
}

/// How the bodies of a chain come to where its fit starts.
#[derive(Clone, Copy, PartialEq)]
enum Growth {
    /// They stay where they are.
    None,
    /// Each is carried along by those below once these have been found.
    Carried,
    /// And its joint is turned as the one below is.
    Repeated,
}

/// A point of body `link` as it lies now (m), and its partner (m).
struct Pair {
    link: usize,
    x: Vector3<f64>,
    y: Vector3<f64>,
}

/// State of a fit of a chain to a cloud.
struct ChainFit<'a> {
    base: Vec<[f64; 3]>,
    joints: Vec<Point3<f64>>,
    /// Body and first place of each point, in the order of the bodies.
    points: Vec<(usize, Point3<f64>)>,
    cloud: &'a KdTree,
    /// Of the bodies that have joined.
    motions: Vec<Isometry3<f64>>,
}

impl<'a> ChainFit<'a> {
    fn new(base: &[[f32; 3]], chain: &[Link], cloud: &'a KdTree) -> Self {
        let place = |point: &[f32; 3]| Point3::from(point.map(f64::from));
        let of_link = |(k, link): (usize, &'_ Link)| -> Vec<_> {
            link.points.iter().map(|point| (k, place(point))).collect()
        };
        Self {
            base: base.iter().map(|point| point.map(f64::from)).collect(),
            joints: chain.iter().map(|link| link.joint.into()).collect(),
            points: chain.iter().enumerate().flat_map(of_link).collect(),
            cloud,
            motions: Vec::with_capacity(chain.len()),
        }
    }

    /// Lets the next body join.
    fn join(&mut self, growth: Growth) {
        let motion = match self.motions[..] {
            [] => Isometry3::identity(),
            [.., below, last] if growth == Growth::Repeated => {
                let joint = self.joints[self.motions.len()].coords;
                last * turned_about(&joint, below.rotation.inverse() * last.rotation)
            }
            [.., last] => last,
        };
        self.motions.push(motion);
    }

    /// Steps until the whole chain is still. Returns the mean square distance (m²) of points of the bodies from the cloud,
    /// plus that of points of the cloud from the bodies.
    fn settle(&mut self) -> f64 {
        let mut distance = f64::INFINITY;
        for _ in 0..STEPS {
            let mut pairs = self.forward();
            let backward = self.backward();
            distance = mean_square(&pairs) + mean_square(&backward);
            pairs.extend(backward);
            if self.turn_joints(&pairs) < STILL {
                break;
            }
        }
        distance
    }

    /// The points of the bodies that have joined, with the nearest of the cloud.
    fn forward(&self) -> Vec<Pair> {
        let mut guess = 0;
        let joined = self
            .points
            .iter()
            .take_while(|(link, _)| *link < self.motions.len());
        let pair = |&(link, point): &(usize, Point3<f64>)| {
            let x = self.motions[link] * point;
            guess = self.cloud.nearest(&x.into(), guess).0;
            let y = Vector3::from(self.cloud.points()[guess]);
            Pair {
                link,
                x: x.coords,
                y,
            }
        };
        joined.map(pair).collect()
    }

    /// The points of the cloud, with the nearest of the bodies. Those that are nearest to the base tell nothing.
    fn backward(&self) -> Vec<Pair> {
        let moved = self
            .points
            .iter()
            .map(|(link, point)| (self.motions[*link] * point).into());
        let all: Vec<[f64; 3]> = moved.chain(self.base.iter().copied()).collect();
        let tree = KdTree::new(&all);
        let mut guess = 0;
        let pair = |y: &[f64; 3]| {
            guess = tree.nearest(y, guess).0;
            let (link, _) = *self.points.get(tree.order()[guess])?;
            let x = Vector3::from(tree.points()[guess]);
            Some(Pair {
                link,
                x,
                y: Vector3::from(*y),
            })
        };
        self.cloud.points().iter().filter_map(pair).collect()
    }

    /// Turns the joints of the bodies that have joined so that the pairs come together. Returns the mean square (m²) of the
    /// moves of their points.
    fn turn_joints(&mut self, pairs: &[Pair]) -> f64 {
        let count = self.motions.len();
        let centres: Vec<Vector3<f64>> = (self.motions.iter().zip(&self.joints))
            .map(|(motion, joint)| (motion * joint).coords)
            .collect();
        // Sums over the points that each joint moves: of its body and of those above.
        let mut sums = vec![Sums::default(); count];
        for pair in pairs {
            sums[pair.link].add(pair);
        }
        for k in (1..count).rev() {
            let above = sums[k];
            sums[k - 1].merge(&above);
        }
        // Normal equations, a block of three rows and columns for each joint.
        let mut normal = DMatrix::zeros(3 * count, 3 * count);
        let mut slope = DVector::zeros(3 * count);
        for i in 0..count {
            for j in 0..count {
                let block = sums[i.max(j)].block(&centres[i], &centres[j]);
                normal
                    .fixed_view_mut::<3, 3>(3 * i, 3 * j)
                    .copy_from(&block);
            }
            let size = normal.fixed_view::<3, 3>(3 * i, 3 * i).trace();
            let damping = (DAMPING * size).max(f64::MIN_POSITIVE);
            (3 * i..3 * i + 3).for_each(|row| normal[(row, row)] += damping);
            slope
                .fixed_rows_mut::<3>(3 * i)
                .copy_from(&sums[i].slope(&centres[i]));
        }
        let Some(cholesky) = normal.cholesky() else {
            return 0.0;
        };
        let turns = cholesky.solve(&slope);
        // What turns at a joint carries all above it.
        let mut carried = Isometry3::identity();
        let mut moves = vec![Isometry3::identity(); count];
        for (k, centre) in centres.iter().enumerate() {
            let turn = UnitQuaternion::from_scaled_axis(turns.fixed_rows::<3>(3 * k).into_owned());
            carried *= turned_about(centre, turn);
            self.motions[k] = carried * self.motions[k];
            moves[k] = carried;
        }
        let move_of = |pair: &Pair| {
            let x = Point3::from(pair.x);
            (moves[pair.link] * x - x).norm_squared()
        };
        pairs.iter().map(move_of).sum::<f64>() / pairs.len().max(1) as f64
    }
}

/// The motion that turns about a centre (m).
fn turned_about(centre: &Vector3<f64>, turn: UnitQuaternion<f64>) -> Isometry3<f64> {
    Isometry3::from_parts(Translation3::from(centre - turn * centre), turn)
}

/// Mean square distance (m²) of partners.
fn mean_square(pairs: &[Pair]) -> f64 {
    let sum: f64 = pairs
        .iter()
        .map(|pair| (pair.y - pair.x).norm_squared())
        .sum();
    sum / pairs.len().max(1) as f64
}

/// Sums over pairs, with `r = y - x`.
#[derive(Clone, Copy, Default)]
struct Sums {
    count: f64,
    /// `sum x`.
    first: Vector3<f64>,
    /// `sum x xᵀ`.
    second: Matrix3<f64>,
    /// `sum r`.
    pull: Vector3<f64>,
    /// `sum x × r`.
    moment: Vector3<f64>,
}

impl Sums {
    fn add(&mut self, pair: &Pair) {
        let r = pair.y - pair.x;
        self.count += 1.0;
        self.first += pair.x;
        self.second += pair.x * pair.x.transpose();
        self.pull += r;
        self.moment += pair.x.cross(&r);
    }

    fn merge(&mut self, other: &Self) {
        self.count += other.count;
        self.first += other.first;
        self.second += other.second;
        self.pull += other.pull;
        self.moment += other.moment;
    }

    /// `sum (a·b I - b aᵀ)` with `a = x - c_i` and `b = x - c_j`: the normal matrix's block of joints `i` and `j`.
    fn block(&self, c_i: &Vector3<f64>, c_j: &Vector3<f64>) -> Matrix3<f64> {
        let outer = self.second - self.first * c_i.transpose() - c_j * self.first.transpose()
            + c_j * c_i.transpose() * self.count;
        Matrix3::identity() * outer.trace() - outer
    }

    /// `sum (x - centre) × r`.
    fn slope(&self, centre: &Vector3<f64>) -> Vector3<f64> {
        self.moment - centre.cross(&self.pull)
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]
mod tests {
    use super::*;

    const LINKS: usize = 10;
    const PITCH: f64 = 0.02;

    /// Tubes of radius 15 mm and length 14 mm with caps, one above another, joined 3 mm below each.
    fn chain(phase: f64) -> Vec<Link> {
        let link = |k: usize| {
            let foot = PITCH * k as f64;
            // Even, and without rows on which another cloud's points would catch (Roberts' sequence, 2018).
            let point = |i: usize| {
                let share = |step: f64| (phase + step * (i + 397 * k) as f64).fract();
                let (u, v) = (share(0.754_877_666), share(0.569_840_291));
                let (sin, cos) = (std::f64::consts::TAU * u).sin_cos();
                let (radius, z) = match i % 4 {
                    0 => (0.015 * v.sqrt(), 0.014),
                    _ => (0.015, 0.014 * v),
                };
                [radius * cos, radius * sin, foot + z].map(|x| x as f32)
            };
            Link {
                joint: [0.0, 0.0, foot - 0.003],
                points: (0..400).map(point).collect(),
            }
        };
        (0..LINKS).map(link).collect()
    }

    /// The motions of bodies whose joints all turn by `turn`.
    fn bent(chain: &[Link], turn: Vector3<f64>) -> Vec<Isometry3<f64>> {
        let mut carried = Isometry3::identity();
        let motion = |link: &Link| {
            carried *= turned_about(&link.joint.into(), UnitQuaternion::from_scaled_axis(turn));
            carried
        };
        chain.iter().map(motion).collect()
    }

    /// The tip moves by up to half of the chain's length.
    #[test]
    fn a_chain_is_found_where_it_bends_to() {
        let (first, other) = (chain(0.5), chain(0.0));
        for turn in [
            [0.0, 0.0, 0.0],
            [0.02, 0.0, 0.0],
            [0.0, -0.06, 0.0],
            [0.1, 0.06, 0.0],
        ] {
            let motions = bent(&first, Vector3::from(turn));
            let moved = |(link, motion): (&Link, &Isometry3<f64>)| -> Vec<[f32; 3]> {
                let place = |p: &[f32; 3]| motion * Point3::from(p.map(f64::from));
                link.points
                    .iter()
                    .map(|p| place(p).map(|x| x as f32).into())
                    .collect()
            };
            let cloud: Vec<_> = other.iter().zip(&motions).flat_map(moved).collect();
            let found = lay_chain_onto(&[], &first, &cloud).unwrap();
            for (found, expected) in found.iter().zip(&motions) {
                let top = Point3::new(0.0, 0.0, PITCH * LINKS as f64);
                let [a, b] = [found, expected].map(|motion| motion * top);
                assert!((a - b).norm() < 4e-3, "{turn:?}: {a} {b}");
            }
        }
    }
}
