//! Tangents of motions beside gradients, whose adjoints they are.

use nalgebra::Vector3;
use rand_chacha::ChaCha8Rng;
use tdcr_sim::dynamics::{DynamicsError, RolloutDirection, StateTangent, rollout_tangent};
use tdcr_sim::pose::PoseTangent;

use super::case::{Case, TIMESTEP};

impl Case {
    pub fn tangents(
        &self,
        direction: &RolloutDirection,
    ) -> Result<Vec<StateTangent>, DynamicsError> {
        let (robot, states) = self.states();
        let (rollout, states) = (&self.rollout, &states[1..]);
        match &self.scene {
            Some(scene) => (self.among(scene)).rollout_tangent(rollout, states, direction),
            None => rollout_tangent(&robot, TIMESTEP, rollout, states, direction),
        }
    }

    /// Change of the cost of all states but the start along a direction, by the tangent of the motion.
    pub fn along(&self, direction: &RolloutDirection) -> f64 {
        let tangents = self.tangents(direction).unwrap();
        assert_eq!(tangents.len(), self.rollout.commands.len());
        let mut change = 0.0;
        for (weights, tangent) in self.weights[1..].iter().zip(&tangents) {
            change += dot(&weights.coordinates, &tangent.coordinates);
            for (weight, pose) in weights.poses.iter().zip(&tangent.poses) {
                change += weight.position.dot(&pose.position) + weight.rotation.dot(&pose.rotation);
            }
        }
        change
    }

    /// The same cost without what it has of the start.
    fn without_start(&self) -> Self {
        let mut after = self.with(self.rollout.clone());
        after.weights.clone_from(&self.weights);
        after.weights[0].coordinates.fill(0.0);
        after.weights[0].poses.fill(PoseTangent::default());
        after
    }
}

/// The tangent along a direction of everything, weighted, is the gradient of the weighted sum along it.
pub fn assert_adjoint(case: &Case, rng: &mut ChaCha8Rng, label: &str) {
    let direction = case.direction(rng);
    let forward = case.along(&direction);
    let (named, rates): (Vec<_>, Vec<f64>) = direction.parameters.iter().copied().unzip();
    let gradient = case.without_start().gradient(&named);
    assert_eq!(gradient.obstacles.len(), direction.obstacles.len());
    let parts = [
        dot(&gradient.commands.concat(), &direction.commands.concat()),
        dot(&gradient.start, &direction.start),
        vectors(&gradient.forces, &direction.forces),
        vectors(&gradient.moments, &direction.moments),
        dot(&gradient.parameters, &rates),
        gradient.base.position.dot(&direction.base.position)
            + gradient.base.rotation.dot(&direction.base.rotation),
        (gradient.wrenches.iter().flatten())
            .zip(direction.wrenches.iter().flatten())
            .map(|(by, change)| vectors(by, change))
            .sum(),
        (gradient.obstacles.iter().zip(&direction.obstacles))
            .map(|(by, change)| {
                by.pose.position.dot(&change.pose.position)
                    + by.pose.rotation.dot(&change.pose.rotation)
                    + by.compliance * change.compliance
            })
            .sum(),
    ];
    let scale: f64 = parts.iter().map(|part| part.abs()).sum();
    let backward: f64 = parts.iter().sum();
    assert!(
        (forward - backward).abs() <= 1e-9 * scale,
        "{label}: {forward} and {backward} of {scale}"
    );
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

fn vectors(a: &[Vector3<f64>], b: &[Vector3<f64>]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a.dot(b)).sum()
}
