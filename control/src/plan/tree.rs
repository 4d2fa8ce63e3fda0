//! Places that were reached, and from where.

use tdcr_sim::chain::Configuration;

use super::space::squared_distance;

/// Trees of places, each on one branch of equilibria with its root.
#[derive(Clone, Debug)]
pub(super) struct Tree {
    dimensions: usize,
    /// Coordinates of all nodes, one after another.
    at: Vec<f64>,
    configurations: Vec<Configuration>,
    parents: Vec<usize>,
}

impl Tree {
    /// One without places of so many coordinates.
    pub fn new(dimensions: usize) -> Self {
        Self {
            dimensions,
            at: Vec::new(),
            configurations: Vec::new(),
            parents: Vec::new(),
        }
    }

    /// Adds a root.
    pub fn plant(&mut self, at: &[f64], configuration: &Configuration) {
        self.add(at, configuration, self.len());
    }

    /// Number of roots, which are the first nodes.
    pub fn roots(&self) -> usize {
        let nodes = self.parents.iter().enumerate();
        nodes.take_while(|(node, parent)| node == *parent).count()
    }

    pub fn len(&self) -> usize {
        self.parents.len()
    }

    pub fn add(&mut self, at: &[f64], configuration: &Configuration, parent: usize) -> usize {
        self.at.extend_from_slice(at);
        self.configurations.push(configuration.clone());
        self.parents.push(parent);
        self.len() - 1
    }

    pub fn at(&self, node: usize) -> &[f64] {
        &self.at[node * self.dimensions..(node + 1) * self.dimensions]
    }

    pub fn configuration(&self, node: usize) -> &Configuration {
        &self.configurations[node]
    }

    /// The node nearest to coordinates.
    pub fn nearest(&self, at: &[f64]) -> usize {
        let mut nearest = (f64::INFINITY, 0);
        // A robot without tendons has no coordinates, and one node is as near as another.
        for (node, other) in self.at.chunks_exact(self.dimensions.max(1)).enumerate() {
            let distance = squared_distance(at, other);
            if distance < nearest.0 {
                nearest = (distance, node);
            }
        }
        nearest.1
    }

    /// The nodes from their root to a node.
    pub fn way_to(&self, node: usize) -> Vec<usize> {
        let mut way = vec![node];
        let mut at = node;
        while at != self.parents[at] {
            at = self.parents[at];
            way.push(at);
        }
        way.reverse();
        way
    }
}
