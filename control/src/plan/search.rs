//! RRT-Connect (Kuffner and LaValle, ICRA 2000) through the space of commands: one tree grows from the start, one from the goals; in
//! turn each goes towards a place drawn at random, and the other towards where that came to.

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::shorten::Stop;
use super::space::{between, squared_distance};
use super::tree::Tree;
use super::walk::{Halt, Walker};

/// Longest edge (shares of the tendons' ranges).
const EDGE: f64 = 0.6;
/// Shortest way that makes a node (shares).
const PROGRESS: f64 = 0.02;
/// How often a place is drawn from all of the space; else from around the line between start and goal.
const ANYWHERE: f64 = 0.5;

/// What ended the edges that were tried.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Halts {
    /// No stable equilibrium.
    pub unsettled: usize,
    /// The branch of equilibria ends.
    pub jump: usize,
    /// An obstacle, or another disc, is too near.
    pub near: usize,
    /// A tension is beyond its limits.
    pub tension: usize,
    /// The two trees met on different branches of equilibria.
    pub other_branch: usize,
}

impl Halts {
    pub(super) fn count(&mut self, halt: Halt) {
        *match halt {
            Halt::Unsettled => &mut self.unsettled,
            Halt::Jump => &mut self.jump,
            Halt::Near => &mut self.near,
            Halt::Tension { .. } => &mut self.tension,
        } += 1;
    }
}

/// Two trees that grow towards each other.
pub(super) struct Search<'a> {
    pub walker: &'a mut Walker,
    /// From the start, and from the goals.
    pub trees: [Tree; 2],
    pub halts: Halts,
    rng: ChaCha8Rng,
    drawn: Vec<f64>,
    target: Vec<f64>,
}

impl<'a> Search<'a> {
    pub fn new(walker: &'a mut Walker, trees: [Tree; 2], seed: u64) -> Self {
        let dimensions = walker.space.dimensions();
        Self {
            walker,
            trees,
            halts: Halts::default(),
            rng: ChaCha8Rng::seed_from_u64(seed),
            drawn: vec![0.0; dimensions],
            target: vec![0.0; dimensions],
        }
    }

    /// Nodes of both trees.
    pub fn nodes(&self) -> usize {
        self.trees[0].len() + self.trees[1].len()
    }

    /// The places between a start and a goal, by the nodes where the trees met.
    pub fn corners(&self, met: [usize; 2]) -> Vec<Stop> {
        let of = |tree: &Tree, node: usize| Stop {
            at: tree.at(node).to_vec(),
            configuration: tree.configuration(node).clone(),
        };
        let [there, back] = [0, 1].map(|tree| self.trees[tree].way_to(met[tree]));
        let there = there.iter().map(|node| of(&self.trees[0], *node));
        // Both came to the place where they met.
        let back = back
            .iter()
            .rev()
            .skip(1)
            .map(|node| of(&self.trees[1], *node));
        there.chain(back).collect()
    }

    /// Tries straight lines from the start to every goal; the nodes that meet.
    pub fn straight(&mut self) -> Option<[usize; 2]> {
        (0..self.trees[1].len()).find_map(|goal| {
            let target = self.trees[1].at(goal).to_vec();
            self.join(0, 0, &target, goal)
        })
    }

    /// One extension of the tree `grown` and of the other towards it; the nodes that meet, of the tree from the start first.
    pub fn grow(&mut self, grown: usize) -> Option<[usize; 2]> {
        self.draw();
        let drawn = std::mem::take(&mut self.drawn);
        let new = self.extend(grown, self.trees[grown].nearest(&drawn), &drawn);
        self.drawn = drawn;
        let (new, _) = new?;
        let other = 1 - grown;
        let target = self.trees[grown].at(new).to_vec();
        let mut from = self.trees[other].nearest(&target);
        loop {
            let left = squared_distance(self.trees[other].at(from), &target).sqrt();
            if left <= EDGE {
                return self.join(other, from, &target, new);
            }
            match self.extend(other, from, &target) {
                Some((node, true)) => from = node,
                _ => return None,
            }
        }
    }

    /// Goes from a node of `tree` all the way to `target`, where node `met` of the other tree is.
    fn join(&mut self, tree: usize, from: usize, target: &[f64], met: usize) -> Option<[usize; 2]> {
        let last = match self.trees[tree].at(from) == target {
            true => from,
            false => self.go(tree, from, target)?,
        };
        if self.trees[tree].at(last) != target {
            return None;
        }
        let configuration = self.trees[1 - tree].configuration(met);
        if !self.walker.is_at(configuration) {
            self.halts.other_branch += 1;
            return None;
        }
        Some(if tree == 0 { [last, met] } else { [met, last] })
    }

    /// Goes from a node towards a place, an edge at most: the new node, and whether nothing was in the way.
    fn extend(&mut self, tree: usize, from: usize, towards: &[f64]) -> Option<(usize, bool)> {
        let at = self.trees[tree].at(from);
        let distance = squared_distance(at, towards).sqrt();
        let mut target = std::mem::take(&mut self.target);
        between(
            at,
            towards,
            f64::min(1.0, EDGE / distance.max(1e-12)),
            &mut target,
        );
        let new = self.go(tree, from, &target);
        let reached = new.is_some_and(|new| self.trees[tree].at(new) == target);
        self.target = target;
        new.map(|new| (new, reached))
    }

    /// Goes from a node towards a place; the node where it ended, if that is far enough.
    fn go(&mut self, tree: usize, from: usize, target: &[f64]) -> Option<usize> {
        let own = &self.trees[tree];
        let stood = self
            .walker
            .stand(own.at(from), Some(own.configuration(from)));
        let walked = stood.and_then(|()| self.walker.walk(target, |_| {}));
        if let Err(halt) = walked {
            self.halts.count(halt);
        }
        let here = self.walker.here();
        let progress = squared_distance(&here.at, own.at(from)).sqrt();
        if stood.is_err() || (walked.is_err() && progress < PROGRESS) {
            return None;
        }
        let (at, configuration) = (here.at.clone(), here.configuration.clone());
        Some(self.trees[tree].add(&at, &configuration, from))
    }

    /// Draws a place: anywhere, or around the line between a start and a goal.
    fn draw(&mut self) {
        let mut drawn = std::mem::take(&mut self.drawn);
        self.walker.space.draw(&mut self.rng, &mut drawn);
        if self.rng.random::<f64>() >= ANYWHERE {
            let goals = self.trees[1].roots();
            let goal = self.rng.random_range(0..goals.max(1));
            let along = self.rng.random::<f64>();
            let spread = self.rng.random::<f64>();
            let ends = [self.trees[0].at(0), self.trees[1].at(goal)];
            for (k, x) in drawn.iter_mut().enumerate() {
                let on_line = ends[0][k] + along * (ends[1][k] - ends[0][k]);
                *x = (on_line + spread * (*x - 0.5)).clamp(0.0, 1.0);
            }
        }
        self.drawn = drawn;
    }
}
