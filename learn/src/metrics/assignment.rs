//! The linear assignment problem over points in space, exactly, on few candidate arcs.
//!
//! Minimise `sum_i c(x_i, y_pi(i))` over bijections `pi`. Prices `p_j` on the columns and
//! `u_i = min_j (c_ij + p_j)` are a feasible dual solution (`v_j = -p_j`, `u_i + v_j <= c_ij`); a
//! matching on arcs where equality holds is optimal. The method is that of Jonker and Volgenant
//! (Computing 38, 1987): reduce rows by bidding, then match each row left over along a shortest
//! augmenting path (Dijkstra on reduced costs). Prices only rise.
//!
//! Arcs are generated as needed. A row starts with the arcs of its cheapest columns, asks the tree
//! for more when a search runs past them, and after all rows are matched, every row is held against
//! all columns (`settle`): one that could do better is released and matched again.

use std::cmp::Ordering;
use std::collections::{BinaryHeap, VecDeque};

use super::ground_cost::GroundCost;
use super::kdtree::KdTree;
use super::priced_tree::{Offer, PricedTree};

/// Arcs asked of the tree at a time.
const ARCS_PER_QUERY: usize = 16;

/// Rounds of bidding before the searches, in bids per row.
const BIDS_PER_ROW: usize = 2;

/// How far past the value up to which a row knows its arcs a search may run before it asks for
/// more, as a multiple of the way there. Arcs missed so are found by `settle`.
const PATIENCE: f64 = 30.0;

/// The arcs of a row that have been looked at.
#[derive(Clone, Debug)]
struct Candidates {
    arcs: Vec<Arc>,
    /// All arcs below this value are listed, but for those that a search has passed by.
    known_to: f64,
}

#[derive(Clone, Copy, Debug)]
struct Arc {
    column: usize,
    cost: f64,
}

/// Rows `x` and columns `y` of equal number, partly matched.
///
/// Every matched arc is tight: its value `c_ij + p_j` is least among the row's candidates.
#[derive(Debug)]
pub(super) struct Assignment<'a> {
    rows: &'a [[f64; 3]],
    columns: PricedTree,
    column_of: Vec<Option<usize>>,
    row_of: Vec<Option<usize>>,
    candidates: Vec<Candidates>,
    search: Search,
    offers: Vec<Offer>,
}

/// Dijkstra's state; between searches `reached` is empty, distances are infinite, none is done.
#[derive(Debug)]
struct Search {
    /// Length of the shortest path known to each column, in reduced cost.
    distance: Vec<f64>,
    /// Row before each column on that path.
    previous: Vec<usize>,
    done: Vec<bool>,
    reached: Vec<usize>,
    queue: BinaryHeap<Event>,
    /// Length of the shortest path known to any free column.
    limit: f64,
}

#[derive(Clone, Copy, Debug)]
struct Event {
    distance: f64,
    target: Target,
}

/// What a search comes to next. Columns come before rows at equal distance: a row asks for arcs only
/// once the columns it knows are done.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum Target {
    Column(usize),
    /// A row whose known arcs end here.
    Row(usize),
}

impl Ord for Event {
    /// Nearest is greatest, as the heap pops the greatest.
    fn cmp(&self, other: &Self) -> Ordering {
        other
            .distance
            .total_cmp(&self.distance)
            .then(other.target.cmp(&self.target))
    }
}

impl PartialOrd for Event {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl PartialEq for Event {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other) == Ordering::Equal
    }
}

impl Eq for Event {}

impl<'a> Assignment<'a> {
    /// No row matched, and the given prices of the columns, in slot order: the nearer to optimal,
    /// the less work.
    pub(super) fn new(
        rows: &'a [[f64; 3]],
        columns: KdTree,
        prices: Vec<f64>,
        cost: GroundCost,
    ) -> Self {
        let n = rows.len();
        let unknown = Candidates {
            arcs: Vec::new(),
            known_to: f64::NEG_INFINITY,
        };
        Self {
            rows,
            columns: PricedTree::new(columns, prices, cost),
            column_of: vec![None; n],
            row_of: vec![None; n],
            candidates: vec![unknown; n],
            search: Search {
                distance: vec![f64::INFINITY; n],
                previous: vec![0; n],
                done: vec![false; n],
                reached: Vec::new(),
                queue: BinaryHeap::new(),
                limit: f64::INFINITY,
            },
            offers: Vec::new(),
        }
    }

    /// Matches every row, optimally over the candidate arcs.
    pub(super) fn solve(&mut self) {
        for row in self.reduce_rows() {
            self.augment(row);
        }
    }

    /// Makes a solved assignment optimal over all arcs, and returns the sum over the rows of what
    /// each could still gain, `c_ij + p_j - u_i`: the duality gap. No row could gain above `tolerance`.
    ///
    /// Ends: each round but the last adds arcs to the candidates, and none is ever removed.
    pub(super) fn settle(&mut self, tolerance: f64) -> f64 {
        loop {
            let mut gap = 0.0;
            let mut released = Vec::new();
            for row in 0..self.rows.len() {
                let value = self.tight_offer(row).value;
                let gain = value - self.columns.lowest_value(&self.rows[row], value);
                gap += gain;
                if gain > tolerance {
                    released.push(row);
                }
            }
            if released.is_empty() {
                return gap;
            }
            for &row in &released {
                self.release(row);
                self.widen(row);
            }
            for row in released {
                self.augment(row);
            }
        }
    }

    /// Column of each row.
    ///
    /// # Panics
    /// Where `solve` has not run.
    pub(super) fn column_of(&self, row: usize) -> usize {
        self.column_of[row].expect("solve matches every row")
    }

    /// Dual variable `u_i` of a matched row.
    pub(super) fn row_potential(&self, row: usize) -> f64 {
        self.tight_offer(row).value
    }

    fn tight_offer(&self, row: usize) -> Offer {
        self.columns.offer(&self.rows[row], self.column_of(row))
    }

    fn release(&mut self, row: usize) {
        if let Some(column) = self.column_of[row].take() {
            self.row_of[column] = None;
        }
    }

    /// Adds the row's cheapest columns that no search has done to its candidates; returns where in
    /// the list the new ones start.
    fn widen(&mut self, row: usize) -> usize {
        let x = &self.rows[row];
        self.columns
            .cheapest(x, ARCS_PER_QUERY, &self.search.done, &mut self.offers);
        let Candidates { arcs, known_to } = &mut self.candidates[row];
        let old = arcs.len();
        for &Offer {
            slot: column, cost, ..
        } in &self.offers
        {
            if arcs[..old].iter().all(|arc| arc.column != column) {
                arcs.push(Arc { column, cost });
            }
        }
        *known_to = match self.offers.last() {
            Some(dearest) if self.offers.len() == ARCS_PER_QUERY => dearest.value,
            _ => f64::INFINITY,
        };
        old
    }

    /// The row's cheapest column and its value, and a lower bound of the second least value.
    fn best_two(&mut self, row: usize) -> (usize, f64, f64) {
        loop {
            let Candidates { arcs, known_to } = &self.candidates[row];
            let (mut column, mut least, mut second) = (0, f64::INFINITY, f64::INFINITY);
            for arc in arcs {
                let value = arc.cost + self.columns.prices()[arc.column];
                if value < least {
                    (column, least, second) = (arc.column, value, least);
                } else if value < second {
                    second = value;
                }
            }
            if !arcs.is_empty() && least <= *known_to {
                return (column, least, second.min(*known_to));
            }
            self.widen(row);
        }
    }

    /// Each free row takes its cheapest column from whoever holds it, and bids its price up to where
    /// the second best is as cheap. Returns the rows left free.
    fn reduce_rows(&mut self) -> Vec<usize> {
        let mut free: VecDeque<usize> = (0..self.rows.len()).collect();
        for _ in 0..BIDS_PER_ROW * self.rows.len() {
            let Some(row) = free.pop_front() else { break };
            let (column, least, second) = self.best_two(row);
            let holder = self.row_of[column];
            // Infinite where this is the only column of all.
            let rise = second - least;
            if rise > 0.0 && rise.is_finite() {
                self.columns.raise(column, rise);
            } else if holder.is_some() {
                // A tie: to take the column would only pass the matter on.
                free.push_back(row);
                continue;
            }
            if let Some(holder) = holder {
                self.column_of[holder] = None;
                free.push_back(holder);
            }
            self.row_of[column] = Some(row);
            self.column_of[row] = Some(column);
        }
        free.into()
    }

    /// Matches the free row `source` along a shortest augmenting path.
    fn augment(&mut self, source: usize) {
        let source_value = self.best_two(source).1;
        self.search.limit = f64::INFINITY;
        let (mut row, mut first_arc) = (source, 0);
        let (end, length) = loop {
            // Length of the path to the row, and what turns an arc's value into a path's length.
            let (start, value) = match self.column_of[row] {
                Some(column) => (self.search.distance[column], self.tight_offer(row).value),
                None => (0.0, source_value),
            };
            self.relax(row, first_arc, start, start - value);
            let Event { distance, target } = self.next_event();
            match target {
                Target::Column(column) => {
                    let Some(holder) = self.row_of[column] else {
                        break (column, distance);
                    };
                    self.search.done[column] = true;
                    (row, first_arc) = (holder, 0);
                }
                Target::Row(known) => (row, first_arc) = (known, self.widen(known)),
            }
        };
        self.raise_prices(length);
        self.flip(end, source);
    }

    /// Extends paths over the candidates of `row` from `first_arc` on; an arc of value `c + p` leads
    /// to a path of length `c + p + offset`.
    fn relax(&mut self, row: usize, first_arc: usize, start: f64, offset: f64) {
        let search = &mut self.search;
        let Candidates { arcs, known_to } = &self.candidates[row];
        for &Arc { column, cost } in &arcs[first_arc..] {
            let distance = (cost + self.columns.prices()[column]) + offset;
            if distance < search.distance[column] && distance < search.limit && !search.done[column]
            {
                if search.distance[column] == f64::INFINITY {
                    search.reached.push(column);
                }
                if self.row_of[column].is_none() {
                    search.limit = distance;
                }
                search.distance[column] = distance;
                search.previous[column] = row;
                search.queue.push(Event {
                    distance,
                    target: Target::Column(column),
                });
            }
        }
        let known_to = known_to + offset;
        let distance = known_to + (PATIENCE - 1.0) * (known_to - start).max(0.0);
        if distance < search.limit {
            search.queue.push(Event {
                distance,
                target: Target::Row(row),
            });
        }
    }

    /// The nearest event that no shorter path has overtaken.
    fn next_event(&mut self) -> Event {
        let search = &mut self.search;
        loop {
            let event = search
                .queue
                .pop()
                .expect("a search ends at a free column before it runs dry");
            match event.target {
                Target::Column(column)
                    if search.done[column] || event.distance > search.distance[column] => {}
                _ => return event,
            }
        }
    }

    /// Raises the prices of the done columns so that the shortest path, of `length`, becomes tight and
    /// what was tight stays so; then clears the search.
    fn raise_prices(&mut self, length: f64) {
        let search = &mut self.search;
        for column in search.reached.drain(..) {
            if search.done[column] {
                self.columns.raise(column, length - search.distance[column]);
            }
            search.done[column] = false;
            search.distance[column] = f64::INFINITY;
        }
        search.queue.clear();
    }

    /// Matches along the path from `source` to the free column `end`.
    fn flip(&mut self, end: usize, source: usize) {
        let mut column = end;
        loop {
            let row = self.search.previous[column];
            self.row_of[column] = Some(row);
            let left = self.column_of[row].replace(column);
            match left {
                Some(left) if row != source => column = left,
                _ => return,
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn cloud(n: usize) -> impl Strategy<Value = Vec<[f64; 3]>> {
        prop::collection::vec(prop::array::uniform3(-1.0f64..1.0), n)
    }

    proptest! {
        #[test]
        fn potentials_of_a_settled_assignment_are_feasible_on_all_pairs(
            (rows, columns) in (1usize..120).prop_flat_map(|n| (cloud(n), cloud(n))),
            distance in prop::bool::ANY,
        ) {
            let cost = if distance { GroundCost::Distance } else { GroundCost::SquaredDistance };
            let tree = KdTree::new(&columns);
            let mut assignment = Assignment::new(&rows, tree, vec![0.0; rows.len()], cost);
            assignment.solve();
            assignment.settle(1e-12);
            for (row, x) in rows.iter().enumerate() {
                let potential = assignment.row_potential(row);
                for slot in 0..columns.len() {
                    let value = assignment.columns.offer(x, slot).value;
                    prop_assert!(potential <= value + 1e-12);
                }
            }
        }
    }
}
