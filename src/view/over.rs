//! What a session shows over its robot.

use std::sync::Arc;

use tdcr_sim::pose::Pose;
use tdcr_sim::robot::Robot;
use tdcr_sim::scene::Scene;
use tokio::sync::mpsc::Sender;

use super::desk::RigLimits;
use super::error::RequestError;
use super::message::Reply;
use super::overlays::Overlays;
use super::post::{Marks, Output, Subject};
use super::twin::Twin;

/// Overlays, and what is shown of them.
#[derive(Default)]
pub(super) struct Over {
    pub overlays: Overlays,
    outbox: Option<Sender<Output>>,
    /// Whether the network's clouds are wanted.
    predicts: bool,
    /// The thread that predicts; made anew for another robot.
    twin: Option<Twin>,
    /// What was last predicted for: command and payload, and the tip (m).
    last: Option<(Vec<f64>, f64, [f64; 3])>,
    /// Number of the cloud of the recording that the page has.
    pub recorded: Option<usize>,
    /// Numbers of the recording's pictures that the page has, of each camera.
    pub taken: Vec<Option<usize>>,
    /// The robot that the program shows, where the page shows that one.
    pub subject: Option<Arc<Subject>>,
    /// What the program marks.
    pub marks: Marks,
    /// What may be asked of the rig that the robot is of.
    rig: Option<Arc<RigLimits>>,
    /// Number of the look at the rig that the page has.
    pub measured: Option<u64>,
}

impl Over {
    pub fn new(overlays: Overlays, rig: Option<Arc<RigLimits>>, outbox: Sender<Output>) -> Self {
        Self {
            overlays,
            rig,
            outbox: Some(outbox),
            ..Self::default()
        }
    }

    /// What there is, for the page.
    pub fn list(&self) -> Output {
        let list = self.overlays.list(self.rig.as_deref().cloned());
        Output::Words(Reply::Overlays(Box::new(list)))
    }

    /// Whether the robot is where a rig's servos are.
    pub fn is_of_rig(&self) -> bool {
        self.rig.is_some()
    }

    /// Another robot is shown.
    pub fn forget_robot(&mut self) {
        self.twin = None;
        self.last = None;
        self.subject = None;
    }

    /// Wants the network's cloud of a robot, where clouds are wanted and it is another one than before.
    pub fn want(
        &mut self,
        robot: &Robot,
        scene: &Scene,
        command: &[f64],
        payload: f64,
        pose: Pose<'_>,
    ) {
        let (Some(model), Some(outbox), true) = (&self.overlays.model, &self.outbox, self.predicts)
        else {
            return;
        };
        let tip = pose.positions.last().copied().unwrap_or_default().into();
        let now = (command.to_vec(), payload, tip);
        if self.last.as_ref() == Some(&now) {
            return;
        }
        self.last = Some(now);
        let make = || Twin::new(model.clone(), robot, scene, outbox.clone());
        let wanted = (self.twin.get_or_insert_with(make)).want(command, payload, pose);
        // A robot that the network is not of has been refused, and came in its place later.
        self.predicts = wanted.is_ok();
    }

    /// Switches the network's clouds on or off.
    ///
    /// # Errors
    /// [`RequestError::Nothing`] without a network, [`RequestError::Twin`] for a robot that it is not of.
    pub fn predict(
        &mut self,
        on: bool,
        (robot, scene): (&Robot, &Scene),
        (command, payload): (&[f64], f64),
        pose: Pose<'_>,
    ) -> Result<(), RequestError> {
        let (Some(model), Some(outbox)) = (&self.overlays.model, &self.outbox) else {
            return Err(RequestError::Nothing("model"));
        };
        (self.predicts, self.twin, self.last) = (false, None, None);
        if on {
            let twin = Twin::new(model.clone(), robot, scene, outbox.clone());
            twin.want(command, payload, pose)?;
            (self.predicts, self.twin) = (true, Some(twin));
        }
        Ok(())
    }
}
