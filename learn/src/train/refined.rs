//! A network beside which another one makes the last evaluation of a prediction.

use crate::flow::{Reach, VelocityField};
use crate::net::{Channels, Network};

/// A network whose velocities point at where data are, and beside which another one may be used in the last denoising.
#[derive(Clone, Copy, Debug)]
pub(super) struct Refined<'a> {
    pub flow: &'a Network,
    /// The network of a denoising at this flow time.
    pub last: Option<(f32, &'a Network)>,
    /// Where data are, as far as that is known.
    pub reach: Option<Reach>,
}

impl Refined<'_> {
    fn velocity_by(
        &self,
        network: &Network,
        t: f32,
        condition: &[f32],
        points: &[f32],
        velocities: &mut [f32],
    ) {
        network.velocity(t, condition, points, velocities);
        if let Some(reach) = self.reach {
            reach.bound(network.channels(), t, points, velocities);
        }
    }
}

impl VelocityField for Refined<'_> {
    fn channels(&self) -> Channels {
        self.flow.channels()
    }

    fn velocity(&self, t: f32, condition: &[f32], points: &[f32], velocities: &mut [f32]) {
        self.velocity_by(self.flow, t, condition, points, velocities);
    }

    fn last_velocity(&self, t: f32, condition: &[f32], points: &[f32], velocities: &mut [f32]) {
        let last = self.last.filter(|(time, _)| *time == t);
        let network = last.map_or(self.flow, |(_, network)| network);
        self.velocity_by(network, t, condition, points, velocities);
    }
}
