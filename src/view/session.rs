//! What one page has: a robot that it commands, in a thread of its own.

use std::path::Path;
use std::sync::Arc;
use std::time::Instant;

use nalgebra::Vector3;
use tdcr_sim::contact::{ContactError, ContactSettler};
use tdcr_sim::formats::RobotFileError;
use tdcr_sim::robot::{
    Command, CommandError, Frame as Axes, Loads, LoadsError, Payload, Robot, RobotSpec, SpecError,
    Wrench,
};
use tdcr_sim::scene::Scene;
use thiserror::Error;
use tokio::sync::mpsc::{Sender, UnboundedReceiver};

use super::drag::lead;
use super::drawing::Layout;
use super::exhibit::Exhibit;
use super::frame::Frame;
use super::message::{Letter, Refused, Reply, Request};

/// What comes to a session.
pub(super) enum Input {
    /// A page's letter.
    Letter(Letter),
    /// A page's letter that could not be read, and why.
    Unread(String),
    /// The file of the robot changed: what is in it now, or why it is refused.
    File(Arc<Result<RobotSpec, String>>),
}

/// What goes to a page.
pub(super) enum Output {
    /// JSON.
    Words(Reply),
    /// A frame.
    Numbers(Vec<u8>),
}

/// Why a request changes nothing.
#[derive(Debug, Error)]
pub enum RequestError {
    /// A command that the robot cannot take.
    #[error(transparent)]
    Command(#[from] CommandError),
    /// Loads that it cannot take.
    #[error(transparent)]
    Loads(#[from] LoadsError),
    /// Nothing to settle among the obstacles.
    #[error(transparent)]
    Contact(#[from] ContactError),
    /// A text that is no robot.
    #[error(transparent)]
    File(#[from] RobotFileError),
    /// A robot that is not valid.
    #[error(transparent)]
    Robot(#[from] SpecError),
    /// A disc that the robot does not have.
    #[error("the robot has {discs} discs, from 0; disc {disc} is asked for")]
    Disc {
        /// The disc.
        disc: usize,
        /// Number of discs.
        discs: usize,
    },
    /// A place that is none.
    #[error("the place is {0:?}; expected finite numbers (m)")]
    Place([f64; 3]),
}

/// A robot that a page commands.
struct Session {
    robot: Robot,
    scene: Scene,
    /// What pulls at it all the time.
    loads: Loads,
    /// What pulls at it, a push by hand among it.
    all_loads: Loads,
    settler: ContactSettler,
    command: Command,
    frame: Frame,
}

/// Whether a page could be shown an exhibit, and if not, why.
pub(super) fn check(exhibit: &Exhibit) -> Result<(), RequestError> {
    Session::new(exhibit).map(drop)
}

/// Answers a page until it is gone.
pub(super) fn run(
    exhibit: &Exhibit,
    inbox: &mut UnboundedReceiver<Input>,
    outbox: &Sender<Output>,
) {
    // It could be shown when the server began; of a file that has changed since, only what could be shown is.
    let Ok(mut session) = Session::new(exhibit) else {
        return;
    };
    let recorded = &exhibit.recorded;
    let mut answer = |output| outbox.blocking_send(output).is_ok();
    if !(answer(session.introduce(recorded)) && answer(session.show(0.0))) {
        return;
    }
    while let Some(first) = inbox.blocking_recv() {
        let mut waiting = vec![first];
        while let Ok(next) = inbox.try_recv() {
            waiting.push(next);
        }
        let mut waiting = waiting.into_iter().peekable();
        while let Some(input) = waiting.next() {
            if waiting.peek().is_some_and(|later| overtakes(later, &input)) {
                continue;
            }
            if !session.answer(input, recorded, &mut answer) {
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
        _ => false,
    }
}

impl Session {
    fn new(exhibit: &Exhibit) -> Result<Self, RequestError> {
        let robot = Robot::new(exhibit.robot.clone())?;
        let command = match &exhibit.start {
            Some(start) => robot.command(start)?,
            None => robot.mean_command(),
        };
        exhibit.loads.check(&robot)?;
        Self::with(robot, exhibit.scene.clone(), exhibit.loads.clone(), command)
    }

    fn with(
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
            command,
            frame: Frame::default(),
        };
        session.frame.solve = begun.elapsed().as_secs_f64();
        Ok(session)
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
            Input::Unread(reason) => answer(refuse(Refused::Letter, reason)),
            Input::File(file) => match &*file {
                Err(reason) => answer(refuse(Refused::Robot, reason.clone())),
                Ok(spec) => match self.change_robot(spec.clone()) {
                    Err(error) => answer(refuse(Refused::Robot, error.to_string())),
                    Ok(()) => answer(self.introduce(recorded)) && answer(self.show(0.0)),
                },
            },
            Input::Letter(Letter { stamp, request }) => {
                let is_robot = matches!(request, Request::Robot { .. });
                match self.act(request) {
                    Err(error) => {
                        let of = match is_robot {
                            true => Refused::Robot,
                            false => Refused::Request,
                        };
                        answer(refuse(of, error.to_string()))
                    }
                    Ok(()) if is_robot => {
                        answer(self.introduce(recorded)) && answer(self.show(stamp))
                    }
                    Ok(()) => answer(self.show(stamp)),
                }
            }
        }
    }

    /// Does what is asked for. What is refused changes nothing.
    fn act(&mut self, request: Request) -> Result<(), RequestError> {
        let begun = Instant::now();
        match request {
            Request::Command { command } => {
                let command = self.robot.command(&command)?;
                self.settler.follow(&command, &self.all_loads)?;
                self.command = command;
            }
            Request::Settle { command } => {
                let command = self.robot.command(&command)?;
                self.settler.settle(&command, &self.all_loads)?;
                self.command = command;
            }
            Request::Drag { disc, to } => {
                self.check_disc(disc)?;
                if !to.iter().all(|x| x.is_finite()) {
                    return Err(RequestError::Place(to));
                }
                let (command, to) = (self.command.clone(), Vector3::from(to));
                self.command = lead(&mut self.settler, command, &self.all_loads, disc, to)?;
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
            Request::Payload { mass } => {
                let payload = Payload {
                    mass,
                    ..self.loads.tip_payload()
                };
                let loads = self.loads.clone().with_payload(payload)?;
                self.load(loads.clone())?;
                self.loads = loads;
            }
            Request::Robot { toml } => {
                self.change_robot(RobotSpec::from_toml(&toml, Path::new("in the editor"))?)?;
            }
        }
        self.frame.solve = begun.elapsed().as_secs_f64();
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
        self.settler.follow(&self.command, &loads)?;
        self.all_loads = loads;
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
        *self = Self::with(robot, self.scene.clone(), loads, command)?;
        Ok(())
    }

    /// What stays the same while this robot is shown.
    fn introduce(&self, recorded: &[Vec<f64>]) -> Output {
        let fits = |values: &&Vec<f64>| self.robot.command(values).is_ok();
        let recorded: Vec<Vec<f64>> = recorded.iter().filter(fits).cloned().collect();
        let pose = self.settler.found().equilibrium.pose();
        let layout = Layout::new(&self.robot, &self.scene, pose, &recorded);
        Output::Words(Reply::Robot(Box::new(layout)))
    }

    /// Where the robot is, as the answer to the request of this number.
    fn show(&mut self, stamp: f64) -> Output {
        let found = self.settler.found();
        let equilibrium = &found.equilibrium;
        let frame = &mut self.frame;
        frame.stamp = stamp;
        frame.residual = equilibrium.residual;
        frame.iterations = equilibrium.iterations as f64;
        frame.converged = f64::from(u8::from(equilibrium.converged));
        frame.tell_stability(equilibrium.stability);
        frame.payload = self.loads.tip_payload().mass;
        frame.tip = equilibrium
            .positions
            .last()
            .copied()
            .unwrap_or_default()
            .into();
        frame.command = self.command.as_slice().to_vec();
        frame.tensions.clone_from(&equilibrium.tendon_tensions);
        frame.lengths.clone_from(&equilibrium.tendon_lengths);
        frame.draw(&self.robot, equilibrium.pose());
        frame.contacts = found
            .contacts
            .iter()
            .map(|contact| {
                let partner = match (contact.partner.obstacle(), contact.partner.disc()) {
                    (Some(obstacle), _) => obstacle as f64,
                    (None, disc) => -1.0 - disc.unwrap_or_default() as f64,
                };
                let (at, normal, force) = (contact.point, contact.normal, contact.force);
                [
                    contact.disc as f64,
                    partner,
                    at.x,
                    at.y,
                    at.z,
                    normal.x,
                    normal.y,
                    normal.z,
                    force.x,
                    force.y,
                    force.z,
                    contact.gap,
                ]
            })
            .collect();
        Output::Numbers(frame.bytes())
    }
}
