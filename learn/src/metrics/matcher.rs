//! The assignment problem of a few rows and columns with all costs given.

/// In place of the row of a column that is free.
const FREE: usize = usize::MAX;

/// Solves assignment problems one after another in memory that stays.
///
/// Each row is matched along a shortest augmenting path in reduced costs (Jonker and Volgenant, Computing 38, 1987, without
/// their reductions): `O(n^3)`. For clouds see [`emd`](super::emd), whose memory grows with the points, not with the pairs.
#[derive(Debug, Default)]
pub(crate) struct Matcher {
    /// `(n, n)`, row-major.
    costs: Vec<f64>,
    /// Dual solution: `row_prices[i] + column_prices[j] <= costs[i, j]`, equal where matched.
    row_prices: Vec<f64>,
    column_prices: Vec<f64>,
    /// Row of each column.
    row_of: Vec<usize>,
    /// Length of the shortest path known to each column, and the column before it on that path, [`FREE`] at its start.
    distance: Vec<f64>,
    previous: Vec<usize>,
    /// Columns, those first whose shortest path is certain, in its order.
    order: Vec<usize>,
    moved: Vec<f32>,
}

impl Matcher {
    /// Matches `n` rows with `n` columns such that the sum of `cost(row, column)`, finite numbers, is least.
    pub fn solve(&mut self, n: usize, cost: impl Fn(usize, usize) -> f64) {
        self.costs.clear();
        for row in 0..n {
            self.costs.extend((0..n).map(|column| cost(row, column)));
        }
        for prices in [&mut self.row_prices, &mut self.column_prices] {
            prices.clear();
            prices.resize(n, 0.0);
        }
        self.row_of.clear();
        self.row_of.resize(n, FREE);
        self.previous.resize(n, FREE);
        (0..n).for_each(|row| self.augment(row));
    }

    /// Matches `row`, and others anew, along the shortest path to a free column.
    fn augment(&mut self, row: usize) {
        let n = self.row_of.len();
        self.distance.clear();
        self.distance.resize(n, f64::INFINITY);
        self.order.clear();
        self.order.extend(0..n);
        let (mut last, mut from, mut reached) = (FREE, row, 0.0);
        let mut certain = 0;
        let end = loop {
            let nearest = self.relax(certain, from, last, reached);
            self.order.swap(certain, nearest);
            last = self.order[certain];
            (from, reached) = (self.row_of[last], self.distance[last]);
            if from == FREE {
                break last;
            }
            certain += 1;
        };
        self.row_prices[row] += reached;
        for &column in &self.order[..certain] {
            let rise = reached - self.distance[column];
            self.row_prices[self.row_of[column]] += rise;
            self.column_prices[column] -= rise;
        }
        let mut column = end;
        while self.previous[column] != FREE {
            let before = self.previous[column];
            self.row_of[column] = self.row_of[before];
            column = before;
        }
        self.row_of[column] = row;
    }

    /// Shortens the paths to the columns from place `certain` of the order on by ways through `row`, which is `reached` away
    /// over column `last`; returns the place of the nearest of them.
    fn relax(&mut self, certain: usize, row: usize, last: usize, reached: f64) -> usize {
        let n = self.row_of.len();
        let costs = &self.costs[row * n..(row + 1) * n];
        let base = reached - self.row_prices[row];
        let (mut nearest, mut least) = (certain, f64::INFINITY);
        for (place, &column) in self.order.iter().enumerate().skip(certain) {
            let through = base + costs[column] - self.column_prices[column];
            if through < self.distance[column] {
                self.distance[column] = through;
                self.previous[column] = last;
            }
            if self.distance[column] < least {
                (nearest, least) = (place, self.distance[column]);
            }
        }
        nearest
    }

    /// The row that each column is matched with, of the last problem.
    pub fn rows(&self) -> &[usize] {
        &self.row_of
    }

    /// Puts the rows of `values` `(n, width)` where the columns are that they were matched with.
    pub fn reorder(&mut self, width: usize, values: &mut [f32]) {
        self.moved.clear();
        self.moved.extend_from_slice(values);
        for (&row, place) in self.row_of.iter().zip(values.chunks_exact_mut(width)) {
            place.copy_from_slice(&self.moved[row * width..][..width]);
        }
    }
}
