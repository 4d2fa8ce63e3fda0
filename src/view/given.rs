//! What the program behind the server shows: commands, which the robot of a page follows, and poses.

use std::sync::Arc;

use tdcr_sim::cloud::PointCloud;
use tdcr_sim::robot::Robot;

use super::body::Body;
use super::cloud::{About, Role, bytes};
use super::error::RequestError;
use super::post::{Given, Marks, Output, Subject};
use super::session::{Changed, Session};

impl Session {
    /// Shows what the program gives.
    pub fn take(
        &mut self,
        given: &Given,
        answer: &mut impl FnMut(Output) -> bool,
    ) -> Result<Changed, RequestError> {
        self.hand.let_go();
        match given {
            Given::Command(command) => {
                if matches!(self.body, Body::Posed(_)) {
                    self.body = Body::AtRest;
                }
                self.follow(self.robot.command(command.as_slice())?)?;
                Ok(Changed::Pose)
            }
            Given::Pose {
                configuration,
                command,
                subject,
                marks,
            } => {
                let changed = match subject {
                    Some(subject) => self.present(subject)?,
                    None => Changed::Pose,
                };
                let command = self.robot.command(command.as_slice())?;
                self.body = Body::posed(&self.robot, configuration, &command)?;
                self.command = command;
                self.mark(marks, answer);
                Ok(changed)
            }
        }
    }

    /// Another robot and other surroundings, where the page does not have them yet.
    fn present(&mut self, subject: &Arc<Subject>) -> Result<Changed, RequestError> {
        let is_same = |known: &Arc<Subject>| Arc::ptr_eq(known, subject);
        if self.over.subject.as_ref().is_some_and(is_same) {
            return Ok(Changed::Pose);
        }
        let robot = Robot::new(subject.robot.clone())?;
        let command = robot.mean_command();
        let (scene, loads) = (subject.scene.clone(), subject.loads.clone());
        self.body = Body::AtRest;
        self.replace(Self::with(robot, scene, loads, command)?)?;
        self.over.subject = Some(subject.clone());
        Ok(Changed::Robot)
    }

    /// Sends marks, where the page has others.
    fn mark(&mut self, marks: &Marks, answer: &mut impl FnMut(Output) -> bool) {
        if self.over.marks == *marks {
            return;
        }
        let cloud = PointCloud {
            colors: vec![[0; 3]; marks.places.len()],
            points: marks.places.clone(),
        };
        let about = About {
            distance: Some(marks.radius),
            ..About::default()
        };
        answer(Output::Numbers(bytes(Role::Marked, &cloud, about)));
        self.over.marks = marks.clone();
    }
}
