//! Requests on what is shown over the robot.

use std::iter;

use tdcr_learn::data::Recipe;
use tdcr_sim::cloud::{Observer, VoxelGrid};
use tdcr_sim::render::BaseVisibility;

use super::cloud::{About, Role, bytes};
use super::desk::{PageId, Seen};
use super::error::RequestError;
use super::message::{Armed, Reply};
use super::pictures;
use super::post::Output;
use super::recording::Recording;
use super::session::Session;
use super::twin::apart;

impl Session {
    /// Shows a sample of the data set: brings the robot to its command, and sends its cloud.
    pub fn show_sample(
        &mut self,
        split: &str,
        index: usize,
        answer: &mut impl FnMut(Output) -> bool,
    ) -> Result<(), RequestError> {
        let clouds = self.over.overlays.clouds.clone();
        let clouds = clouds.ok_or(RequestError::Nothing("data set"))?;
        let sample = clouds.sample(split, index);
        let sample = sample.ok_or_else(|| RequestError::Split(split.to_owned()))??;
        let command = sample.condition.command(&self.robot)?;
        if let Some(mass) = sample.condition.payload {
            self.hang(f64::from(mass))?;
        }
        // A sample settles from the straight pose.
        self.settle(command)?;
        let pose = self.body.show(&self.settler).pose;
        let mut observer = clouds.observer(&self.robot, &self.scene);
        let seen = observer.observe(pose);
        let about = About {
            distance: apart(&sample.cloud.points, &seen.points).ok(),
            ..About::default()
        };
        answer(Output::Numbers(bytes(Role::Sample, &sample.cloud, about)));
        Ok(())
    }

    /// Switches the network's clouds on or off.
    pub fn predict(&mut self, on: bool) -> Result<(), RequestError> {
        let pose = self.body.show(&self.settler).pose;
        let under = (self.command.as_slice(), self.loads.tip_payload().mass);
        (self.over).predict(on, (&self.robot, &self.scene), under, pose)
    }

    /// Shows a moment (s) of the recording: brings the robot to its command, and sends what servos did and the cloud, where it is
    /// another one than before.
    pub fn show_moment(
        &mut self,
        time: f64,
        answer: &mut impl FnMut(Output) -> bool,
    ) -> Result<(), RequestError> {
        let log = self.over.overlays.log.clone();
        let log = log.ok_or(RequestError::Nothing("recording"))?;
        let moment = log.at(time);
        let command = moment
            .command
            .and_then(|values| self.robot.command(values).ok());
        if let Some(command) = &command {
            self.follow(command.clone())?;
        }
        answer(Output::Words(Reply::Moment {
            time,
            command: command.map(|command| command.as_slice().to_vec()),
            servos: moment.servos.to_vec(),
        }));
        if let Some((number, cloud)) = moment.cloud
            && self.over.recorded != Some(number)
        {
            self.over.recorded = Some(number);
            answer(Output::Numbers(bytes(
                Role::Recorded,
                cloud,
                About::default(),
            )));
        }
        self.show_pictures(&log, time, answer);
        Ok(())
    }

    /// Sends the pictures of a recording at a time (s) that the page does not have yet.
    fn show_pictures(
        &mut self,
        log: &Recording,
        time: f64,
        answer: &mut impl FnMut(Output) -> bool,
    ) {
        let wanted = log.pictures_at(time);
        let count = wanted.len();
        self.over.taken.resize(count, None);
        for (camera, &number) in wanted.iter().enumerate() {
            let is_new = self.over.taken[camera] != number;
            let picture = number.filter(|_| is_new);
            if let Some(image) = picture.and_then(|number| log.picture(camera, number)) {
                let size = [image.width, image.height];
                let message = pictures::thinned([camera, count], size, |at| image.pixels[at]);
                answer(Output::Numbers(message));
            }
        }
        self.over.taken = wanted;
    }

    /// Shows the rig: the robot where its servos stand, what they do, and its cloud where it is another one than before; whether the
    /// page is still there.
    pub fn show_rig(
        &mut self,
        page: PageId,
        seen: &Seen,
        answer: &mut impl FnMut(Output) -> bool,
    ) -> bool {
        let said = seen.said.as_ref();
        let said = said.filter(|(_, to, _)| to.is_none_or(|to| to == page));
        let told = answer(Output::Words(Reply::Rig {
            armed: match seen.armed {
                None => Armed::No,
                Some(holder) if holder == page => Armed::Here,
                Some(_) => Armed::Elsewhere,
            },
            moving: seen.moving,
            servos: seen.servos.clone(),
            said: said.map(|(number, _, text)| (*number, text.clone())),
        }));
        // Where the servos stand may be beyond a tendon's range by what a tick is.
        let within = |values: &Vec<f64>| {
            let tendons = values.iter().zip(self.robot.tendons());
            let values: Vec<f64> = tendons
                .map(|(value, tendon)| value.clamp(tendon.range[0], tendon.range[1]))
                .collect();
            self.robot.command(&values).ok()
        };
        let command = seen.command.as_ref().and_then(within);
        if let Some(command) = command {
            // Where it does not settle, the frame says so.
            drop(self.follow(command));
        }
        let stamp = self.frame.stamp;
        if !(told && answer(self.show(stamp))) {
            return false;
        }
        match &seen.look {
            Some((number, look)) if self.over.measured != Some(*number) => {
                self.over.measured = Some(*number);
                let cloud = &look.cloud;
                let grid = VoxelGrid::new(Recipe::default().voxel_size);
                let mut observer = Observer::new(&self.robot, BaseVisibility::Hidden, grid);
                let simulated = observer.observe(self.body.show(&self.settler).pose);
                let about = About {
                    distance: apart(&cloud.points, &simulated.points).ok(),
                    ..About::default()
                };
                let mut messages =
                    iter::once(bytes(Role::Measured, cloud, about)).chain(look.pictures.clone());
                messages.all(|message| answer(Output::Numbers(message)))
            }
            _ => true,
        }
    }

    /// Shows the robot of a row of the study, under its command, loads and obstacles.
    pub fn show_row(&mut self, row: usize) -> Result<(), RequestError> {
        let study = self.over.overlays.study.clone();
        let study = study.ok_or(RequestError::Nothing("study"))?;
        let found = study.configuration(row)?;
        self.replace(Self::with(
            found.robot,
            found.scene,
            found.loads,
            found.command,
        )?)
    }
}
