//! What one page has: a robot that it commands, in a thread of its own.

use std::path::Path;
use std::sync::Arc;
use std::sync::mpsc::{Receiver, RecvTimeoutError};
use std::time::Instant;

use nalgebra::Vector3;
use tdcr_sim::contact::ContactSettler;
use tdcr_sim::robot::{Command, Frame as Axes, Loads, Payload, Robot, RobotSpec, Wrench};
use tdcr_sim::scene::Scene;
use tdcr_sim::simulation::Physics;
use tokio::sync::mpsc::Sender;

use super::body::{BEAT, Body, TIMESTEP};
use super::desk::RigLimits;
use super::drag::Hand;
use super::error::RequestError;
use super::exhibit::Exhibit;
use super::frame::Frame;
use super::message::{Letter, PhysicsName, Refused, Reply, Request};
use super::over::Over;
use super::pictures;
use super::post::{Input, Output};

/// A robot that a page commands.
pub(super) struct Session {
    pub(super) robot: Robot,
    pub(super) scene: Scene,
    /// What pulls at it all the time.
    pub(super) loads: Loads,
    /// What pulls at it, a push by hand among it.
    all_loads: Loads,
    /// The robot at rest, without friction of its tendons.
    pub(super) settler: ContactSettler,
    pub(super) body: Body,
    pub(super) command: Command,
    pub(super) frame: Frame,
    pub(super) over: Over,
    pub(super) hand: Hand,
}

/// What a request has changed.
pub(super) enum Changed {
    /// Where the robot is.
    Pose,
    /// The robot.
    Robot,
}

/// Whether a page could be shown an exhibit, and if not, why.
pub(super) fn check(exhibit: &Exhibit) -> Result<(), RequestError> {
    Session::new(exhibit).map(drop)
}

/// Answers a page until it is gone.
pub(super) fn run(
    exhibit: &Exhibit,
    rig: Option<Arc<RigLimits>>,
    inbox: &Receiver<Input>,
    outbox: &Sender<Output>,
) {
    // It could be shown when the server began; of a file that has changed since, only what could be shown is.
    let Ok(mut session) = Session::new(exhibit) else {
        return;
    };
    session.over = Over::new(exhibit.overlays.clone(), rig, outbox.clone());
    let recorded = &exhibit.recorded;
    let mut answer = |output| outbox.blocking_send(output).is_ok();
    let overlays = session.over.list();
    if !(answer(overlays) && answer(session.introduce(recorded)) && answer(session.show(0.0))) {
        return;
    }
    let mut beat = Instant::now();
    loop {
        let Some(mut waiting) = session.wait(inbox, beat) else {
            return;
        };
        waiting.extend(inbox.try_iter());
        let asked = !waiting.is_empty();
        let mut waiting = waiting.into_iter().peekable();
        while let Some(input) = waiting.next() {
            if waiting.peek().is_some_and(|later| overtakes(later, &input)) {
                continue;
            }
            if !session.answer(input, recorded, &mut answer) {
                return;
            }
        }
        if asked && !session.moves() {
            // A disc that was led for a frame is led on in the next one.
            beat = Instant::now() + BEAT;
        }
        if session.goes_on() && Instant::now() >= beat {
            beat = Instant::now() + BEAT;
            if !session.go_on(&mut answer) {
                return;
            }
        }
    }
}

fn overtakes(later: &Input, input: &Input) -> bool {
    match (input, later) {
        (Input::Letter(input), Input::Letter(later)) => {
            input.request.is_overtaken_by(&later.request)
        }
        (Input::Rig(..), Input::Rig(..)) | (Input::Given(_), Input::Given(_)) => true,
        _ => false,
    }
}

impl Session {
    pub(super) fn new(exhibit: &Exhibit) -> Result<Self, RequestError> {
        let robot = Robot::new(exhibit.robot.clone())?;
        let command = match &exhibit.start {
            Some(start) => robot.command(start)?,
            None => robot.mean_command(),
        };
        exhibit.loads.check(&robot)?;
        Self::with(robot, exhibit.scene.clone(), exhibit.loads.clone(), command)
    }

    pub(super) fn with(
        robot: Robot,
        scene: Scene,
        loads: Loads,
        command: Command,
    ) -> Result<Self, RequestError> {
        let mut settler = ContactSettler::new(&robot, &scene);
        let begun = Instant::now();
        settler.settle(&command, &loads)?;
        let mut session = Self {
            robot,
            scene,
            all_loads: loads.clone(),
            loads,
            settler,
            body: Body::AtRest,
            command,
            frame: Frame::default(),
            over: Over::default(),
            hand: Hand::default(),
        };
        session.frame.solve = begun.elapsed().as_secs_f64();
        Ok(session)
    }

    /// Whether the robot moves without being asked to.
    fn moves(&self) -> bool {
        matches!(self.body, Body::InMotion(_))
    }

    /// Whether there is something to do without being asked: a motion, or a disc that is on its way.
    fn goes_on(&self) -> bool {
        self.moves() || self.hand.leads()
    }

    /// What comes next: nothing, where the robot goes on by itself and its time to do so has come. `None` once the page is gone.
    fn wait(&self, inbox: &Receiver<Input>, beat: Instant) -> Option<Vec<Input>> {
        if !self.goes_on() {
            return inbox.recv().ok().map(|input| vec![input]);
        }
        let left = beat.saturating_duration_since(Instant::now());
        match inbox.recv_timeout(left) {
            Ok(input) => Some(vec![input]),
            Err(RecvTimeoutError::Timeout) => Some(Vec::new()),
            Err(RecvTimeoutError::Disconnected) => None,
        }
    }

    /// Lets the robot go on in time, and shows it; whether the page is still there.
    fn go_on(&mut self, answer: &mut impl FnMut(Output) -> bool) -> bool {
        let begun = Instant::now();
        if self.hand.leads() {
            // Where the disc can be led no further it stays.
            drop(self.lead());
        }
        if let Err(error) = self.body.go_on(&self.command, &self.all_loads) {
            let reason = format!("{error}; the robot is shown at rest from here");
            let of = Refused::Request;
            if !answer(Output::Words(Reply::Refused { of, reason })) {
                return false;
            }
            self.body = Body::AtRest;
            // Where it cannot settle either, it stays where it was.
            drop(self.settler.settle(&self.command, &self.all_loads));
        }
        self.frame.solve = begun.elapsed().as_secs_f64();
        let stamp = self.frame.stamp;
        answer(self.show(stamp))
    }

    /// Answers one input; whether the page is still there.
    fn answer(
        &mut self,
        input: Input,
        recorded: &[Vec<f64>],
        answer: &mut impl FnMut(Output) -> bool,
    ) -> bool {
        let refuse = |of, reason| Output::Words(Reply::Refused { of, reason });
        match input {
            Input::Rig(page, seen) => self.show_rig(page, &seen, answer),
            Input::Given(given) => {
                let stamp = self.frame.stamp;
                match self.take(&given, answer) {
                    Err(error) => answer(refuse(Refused::Request, error.to_string())),
                    Ok(Changed::Robot) => {
                        answer(self.introduce(recorded)) && answer(self.show(stamp))
                    }
                    Ok(Changed::Pose) => answer(self.show(stamp)),
                }
            }
            Input::Unread(reason) => answer(refuse(Refused::Letter, reason)),
            Input::File(file) => match &*file {
                Err(reason) => answer(refuse(Refused::Robot, reason.clone())),
                Ok(spec) => match self.change_robot(spec.clone()) {
                    Err(error) => answer(refuse(Refused::Robot, error.to_string())),
                    Ok(()) => answer(self.introduce(recorded)) && answer(self.show(0.0)),
                },
            },
            Input::Letter(Letter { stamp, request }) => {
                if matches!(request, Request::Pictures) {
                    let pose = self.body.show(&self.settler).pose;
                    let payload = self.loads.tip_payload();
                    let seen = pictures::of(&self.robot, &self.scene, pose, &payload);
                    return seen
                        .into_iter()
                        .all(|picture| answer(Output::Numbers(picture)));
                }
                let is_robot = matches!(request, Request::Robot { .. });
                match self.act(request, answer) {
                    Err(error) => {
                        let of = match is_robot {
                            true => Refused::Robot,
                            false => Refused::Request,
                        };
                        answer(refuse(of, error.to_string()))
                    }
                    Ok(Changed::Robot) => {
                        answer(self.introduce(recorded)) && answer(self.show(stamp))
                    }
                    Ok(Changed::Pose) => answer(self.show(stamp)),
                }
            }
        }
    }

    /// Does what is asked for. What is refused changes nothing.
    fn act(
        &mut self,
        request: Request,
        answer: &mut impl FnMut(Output) -> bool,
    ) -> Result<Changed, RequestError> {
        let begun = Instant::now();
        let mut changed = Changed::Pose;
        if self.over.is_of_rig() && !matches!(request, Request::Predict { .. }) {
            return Err(RequestError::OfRig);
        }
        // A robot that was placed by the program goes on at rest when the page moves it.
        if matches!(self.body, Body::Posed(_)) && !matches!(request, Request::Predict { .. }) {
            self.body = Body::AtRest;
        }
        if !matches!(request, Request::Pictures | Request::Predict { .. }) {
            self.hand.let_go();
        }
        match request {
            Request::Command { command } => {
                self.follow(self.robot.command(&command)?)?;
            }
            Request::Settle { command } => {
                self.settle(self.robot.command(&command)?)?;
            }
            Request::Drag { disc, to } => {
                self.check_disc(disc)?;
                if !to.iter().all(|x| x.is_finite()) {
                    return Err(RequestError::Place(to));
                }
                self.hand.take(disc, Vector3::from(to));
                self.lead()?;
            }
            Request::Push { disc, force } => {
                self.check_disc(disc)?;
                let wrench = Wrench {
                    force,
                    ..Wrench::none(disc, Axes::World)
                };
                let pushed = self.loads.clone().with_wrench(wrench)?;
                self.load(pushed)?;
            }
            Request::Payload { mass } => self.hang(mass)?,
            Request::Robot { toml } => {
                self.change_robot(RobotSpec::from_toml(&toml, Path::new("in the editor"))?)?;
                changed = Changed::Robot;
            }
            Request::Physics {
                physics,
                coefficient,
            } => {
                let physics = match physics {
                    PhysicsName::AtRest => Physics::AtRest,
                    PhysicsName::WithFriction => Physics::WithFriction { coefficient },
                    PhysicsName::InMotion => Physics::InMotion {
                        timestep: TIMESTEP,
                        friction: None,
                    },
                };
                self.obey(physics)?;
            }
            Request::Pictures => {}
            Request::Sample { split, index } => self.show_sample(&split, index, answer)?,
            Request::Predict { on } => self.predict(on)?,
            Request::Moment { time } => self.show_moment(time, answer)?,
            Request::Row { row } => {
                self.show_row(row)?;
                changed = Changed::Robot;
            }
            Request::Arm | Request::Disarm | Request::Here | Request::Shape { .. } => {
                return Err(RequestError::Nothing("rig"));
            }
        }
        self.frame.solve = begun.elapsed().as_secs_f64();
        Ok(changed)
    }

    /// Leads the disc that is dragged for a frame.
    fn lead(&mut self) -> Result<(), RequestError> {
        if self.moves() {
            self.settler.follow(&self.command, &self.all_loads)?;
        }
        let command = self.command.clone();
        match (self.hand).lead(&mut self.settler, command, &self.all_loads) {
            Ok(led) => self.command = led,
            Err(error) => {
                self.hand.let_go();
                return Err(error.into());
            }
        }
        self.body.advance(&self.command, &self.all_loads)
    }

    /// Brings the robot to a command, settled from the straight pose.
    pub(super) fn settle(&mut self, command: Command) -> Result<(), RequestError> {
        self.settler.settle(&command, &self.all_loads)?;
        self.body.reset(&command, &self.all_loads)?;
        self.command = command;
        Ok(())
    }

    /// Brings the robot to a command, followed from where it is.
    pub(super) fn follow(&mut self, command: Command) -> Result<(), RequestError> {
        if !self.moves() {
            self.settler.follow(&command, &self.all_loads)?;
        }
        self.body.advance(&command, &self.all_loads)?;
        self.command = command;
        Ok(())
    }

    /// Another payload (kg).
    pub(super) fn hang(&mut self, mass: f64) -> Result<(), RequestError> {
        let payload = Payload {
            mass,
            ..self.loads.tip_payload()
        };
        let loads = self.loads.clone().with_payload(payload)?;
        self.load(loads.clone())?;
        self.loads = loads;
        Ok(())
    }

    fn check_disc(&self, disc: usize) -> Result<(), RequestError> {
        let discs = self.robot.discs().len();
        match disc < discs {
            true => Ok(()),
            false => Err(RequestError::Disc { disc, discs }),
        }
    }

    fn load(&mut self, loads: Loads) -> Result<(), RequestError> {
        if !self.moves() {
            self.settler.follow(&self.command, &loads)?;
        }
        self.body.advance(&self.command, &loads)?;
        self.all_loads = loads;
        Ok(())
    }

    /// Begins anew by another physics, at rest under the command as it is.
    fn obey(&mut self, physics: Physics) -> Result<(), RequestError> {
        let under = (&self.command, &self.all_loads);
        let body = Body::new(physics, &self.robot, &self.scene, under)?;
        if self.moves() {
            self.settler.follow(&self.command, &self.all_loads)?;
        }
        self.body = body;
        Ok(())
    }

    /// Shows another robot, under the same command where it has such tendons.
    fn change_robot(&mut self, spec: RobotSpec) -> Result<(), RequestError> {
        let robot = Robot::new(spec)?;
        let command = robot.command(self.command.as_slice());
        let command = command.unwrap_or_else(|_| robot.mean_command());
        let loads = match self.loads.check(&robot) {
            Ok(()) => self.loads.clone(),
            Err(_) => Loads::default().with_payload(self.loads.tip_payload())?,
        };
        self.replace(Self::with(robot, self.scene.clone(), loads, command)?)
    }

    /// Takes another robot, its surroundings and its loads in place of these, by the same physics.
    pub(super) fn replace(&mut self, mut changed: Self) -> Result<(), RequestError> {
        changed.obey(self.body.physics())?;
        changed.frame.stamp = self.frame.stamp;
        changed.over = std::mem::take(&mut self.over);
        *self = changed;
        self.over.forget_robot();
        Ok(())
    }
}
