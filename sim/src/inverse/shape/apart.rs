//! Keeping clear of obstacles, by an augmented Lagrangian.
//!
//! Every bead's gap to every obstacle is at least the clearance, `c_i(x) = clearance - gap_i(x) <= 0`. With multipliers `2 rho s_i` the
//! augmented Lagrangian is a sum of squares again, `|errors|² + rho sum (c_i + s_i)_+²`; each round minimises it and takes over
//! `s_i <- (c_i + s_i)_+` (Nocedal and Wright, Numerical Optimization, ch. 17.3; Rockafellar 1973). Residuals are those of the pairs within
//! a band; pairs that come into it join between the rounds. The robot settles without these obstacles, so that slopes are
//! those of a robot that touches none.

use super::gap::{bead_place, gap_of};
use crate::geometry::Beads;
use crate::robot::Robot;
use crate::scene::{Nearest, Scene};
use crate::sensitivity::PoseTangent;
use crate::statics::Equilibrium;

/// `rho`: large, so that few rounds lead to the constraints.
const WEIGHT: f64 = 100.0;
/// Further distance that is kept (m), for each metre of the robot's reach: surfaces nearer than a tenth of it count as touching.
const MARGIN: f64 = 3e-5;
/// Share of the margin to which constraints are met.
const MET: f64 = 0.5;
/// Width of the band (m), for each metre of the robot's reach.
const BAND: f64 = 0.15;

/// The obstacles that a robot keeps clear of.
pub(super) struct Apart {
    beads: Beads,
    scene: Scene,
    /// Their numbers in the whole scene.
    numbers: Vec<usize>,
    pub clearance: f64,
    margin: f64,
    band: f64,
}

/// The constraints that take part, with their multipliers.
#[derive(Clone, Debug, Default)]
pub(super) struct Kept(Vec<Pair>);

/// A bead and an obstacle.
#[derive(Clone, Copy, Debug)]
struct Pair {
    bead: usize,
    obstacle: usize,
    /// `s_i` (m).
    shift: f64,
}

/// An obstacle that keeps a robot away from its targets.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Obstruction {
    /// The obstacle, by its number in the scene.
    pub obstacle: usize,
    /// The disc that would come too near, from 0.
    pub disc: usize,
    /// By how much the weighted distance from the targets would fall for each metre less of clearance from there: a multiplier.
    pub price: f64,
}

impl Apart {
    pub fn new(robot: &Robot, scene: &Scene, numbers: Vec<usize>, clearance: f64) -> Self {
        Self {
            beads: Beads::new(robot),
            scene: scene.part(&numbers),
            numbers,
            clearance,
            margin: MARGIN * robot.reach(),
            band: BAND * robot.reach(),
        }
    }

    /// Whether an obstacle of the whole scene is one of them.
    pub fn has(&self, number: usize) -> bool {
        self.numbers.contains(&number)
    }

    /// The nearest of them, by its number in the whole scene.
    pub fn nearest(&self, equilibrium: &Equilibrium) -> Option<Nearest> {
        let pose = equilibrium.pose();
        let discs = (0..pose.positions.len()).map(|disc| pose.disc(disc));
        let nearest = self.scene.nearest(&self.beads, discs)?;
        Some(Nearest {
            obstacle: self.numbers[nearest.obstacle],
            ..nearest
        })
    }

    /// Adds the pairs that are within the band.
    pub fn join(&self, kept: &mut Kept, equilibrium: &Equilibrium) {
        let reach = self.distance() + self.band;
        for (number, obstacle) in self.scene.obstacles().iter().enumerate() {
            for (disc, origin) in equilibrium.positions.iter().enumerate() {
                if obstacle.signed_distance(origin) - self.beads.enclosing(disc) >= reach {
                    continue;
                }
                for bead in self.beads.of_disc(disc) {
                    let [_, centre] = bead_place(&self.beads, equilibrium, bead);
                    let radius = self.beads.as_slice()[bead].radius;
                    let known = |pair: &Pair| [pair.bead, pair.obstacle] == [bead, number];
                    let near = obstacle.signed_distance(&centre) - radius < reach;
                    if near && !kept.0.iter().any(known) {
                        kept.0.push(Pair {
                            bead,
                            obstacle: number,
                            shift: 0.0,
                        });
                    }
                }
            }
        }
    }

    /// Residuals (m) of the constraints that take part, with the disc and the gradient by its pose.
    pub fn residuals<'k>(
        &'k self,
        kept: &'k Kept,
        equilibrium: &'k Equilibrium,
    ) -> impl Iterator<Item = (f64, usize, PoseTangent)> + 'k {
        kept.0.iter().map(|pair| {
            let ends = [pair.bead, pair.obstacle];
            let (gap, gradient) = gap_of(&self.beads, &self.scene, equilibrium, ends);
            let shifted = self.distance() - gap + pair.shift;
            let slope = match shifted > 0.0 {
                true => -WEIGHT.sqrt(),
                false => 0.0,
            };
            let gradient = PoseTangent {
                position: gradient.position * slope,
                rotation: gradient.rotation * slope,
            };
            let disc = self.beads.as_slice()[pair.bead].disc;
            (WEIGHT.sqrt() * shifted.max(0.0), disc, gradient)
        })
    }

    /// Whether all pairs that take part are apart.
    pub fn is_met(&self, kept: &Kept, equilibrium: &Equilibrium) -> bool {
        (self.excesses(kept, equilibrium)).all(|(_, excess)| excess <= MET * self.margin)
    }

    /// Whether an equilibrium that minimises the augmented Lagrangian minimises the errors among those that are apart; else takes over the
    /// multipliers, and pairs that have come into the band.
    pub fn is_settled(&self, kept: &mut Kept, equilibrium: &Equilibrium) -> bool {
        self.join(kept, equilibrium);
        let excesses: Vec<f64> = (self.excesses(kept, equilibrium))
            .map(|(_, excess)| excess)
            .collect();
        let off = |(pair, excess): (&Pair, &f64)| excess.max(-pair.shift).abs();
        let worst = kept.0.iter().zip(&excesses).map(off).fold(0.0, f64::max);
        if worst <= MET * self.margin {
            return true;
        }
        for (pair, excess) in kept.0.iter_mut().zip(excesses) {
            pair.shift = (pair.shift + excess).max(0.0);
        }
        false
    }

    /// What keeps the robot away from targets that it misses by a weighted distance (m), the most expensive first.
    pub fn obstructions(
        &self,
        kept: &Kept,
        equilibrium: &Equilibrium,
        error: f64,
    ) -> Vec<Obstruction> {
        let mut found: Vec<Obstruction> = Vec::new();
        for (pair, excess) in self.excesses(kept, equilibrium) {
            let price = WEIGHT * (pair.shift + excess).max(0.0) / error;
            let (obstacle, disc) = (
                self.numbers[pair.obstacle],
                self.beads.as_slice()[pair.bead].disc,
            );
            let known = (found.iter_mut()).find(|one| (one.obstacle, one.disc) == (obstacle, disc));
            match known {
                Some(one) => one.price += price,
                None if price > 0.0 => found.push(Obstruction {
                    obstacle,
                    disc,
                    price,
                }),
                None => {}
            }
        }
        found.sort_by(|a, b| b.price.total_cmp(&a.price));
        found
    }

    /// `c_i` (m).
    fn excesses<'k>(
        &'k self,
        kept: &'k Kept,
        equilibrium: &'k Equilibrium,
    ) -> impl Iterator<Item = (&'k Pair, f64)> + 'k {
        kept.0.iter().map(|pair| {
            let ends = [pair.bead, pair.obstacle];
            let (gap, _) = gap_of(&self.beads, &self.scene, equilibrium, ends);
            (pair, self.distance() - gap)
        })
    }

    /// The clearance that is aimed at (m).
    fn distance(&self) -> f64 {
        self.clearance + self.margin
    }
}

impl Kept {
    pub fn len(&self) -> usize {
        self.0.len()
    }
}
