//! `tdcr simulate`.

use std::fmt::Write as _;
use std::io::{BufWriter, IntoInnerError, Write};
use std::path::{Path, PathBuf};

use anyhow::Context;
use clap::{Args, ValueEnum};
use nalgebra::{DMatrix, UnitQuaternion, Vector3};
use serde::Serialize;
use tdcr::base::files::AtomicFile;
use tdcr::pipeline::Monitor;
use tdcr::report::counted;
use tdcr::sim::contact::ContactStepper;
use tdcr::sim::dynamics::{Integrator, Linearisation, Lineariser, Servos, State, Stepper};
use tdcr::sim::robot::Robot;
use tdcr::sim::scene::Scene;

use super::commands::read_commands;
use super::console::{Console, Interrupted};
use super::loads::LoadArgs;
use super::loads_file::LoadsFile;
use super::output;
use super::picture::{MotionPicture, PictureArg};
use super::scene::SceneArgs;
use super::settle_contacts::ContactJson;

/// Move a robot through a sequence of commands, from the straight pose at rest
#[derive(Debug, Args)]
pub(super) struct SimulateArgs {
    #[command(flatten)]
    robot: super::RobotArg,
    /// Commands as CSV, a line per time step with an entry per tendon (m, or N for a tension drive), optionally with a
    /// header, or as JSON, a list of lists
    #[arg(long, value_name = "FILE")]
    commands: PathBuf,
    /// Time step (s)
    #[arg(long, default_value_t = 0.002, value_name = "S", value_parser = super::positive)]
    dt: f64,
    /// How a step is taken
    #[arg(long, value_enum, default_value_t = Method::SemiImplicitEuler)]
    integrator: Method,
    #[command(flatten)]
    loads: LoadArgs,
    /// Loads that vary, as CSV whose first line names its columns: fx9, fy9, fz9 (N) and mx9, my9, mz9 (N m), world frame, on disc 9, or
    /// fxtip and so on. A row for each command; with a column time (s) rows at those times, linear between them
    #[arg(long, value_name = "FILE")]
    loads_file: Option<PathBuf>,
    /// Write the disc origins (m) after every step to this CSV file; in a scene also the contacts' force on each disc (N), and the
    /// position (m) and quaternion (w, x, y, z) of each object
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
    /// Write the derivative of a semi-implicit step from the final state under the last command to
    /// this JSON file: matrices a and b, in rows
    #[arg(long, value_name = "FILE")]
    linearise: Option<PathBuf>,
    #[command(flatten)]
    scene: SceneArgs,
    #[command(flatten)]
    picture: PictureArg,
}

#[derive(Clone, Copy, Debug, ValueEnum)]
enum Method {
    /// First order, joint damping implicit, as MuJoCo's Euler
    SemiImplicitEuler,
    /// Fourth order, explicit
    RungeKutta4,
    /// First order, stiffness implicit too: for stiff robots; damps
    ImplicitEuler,
    /// Second order, implicit, without damping of its own: for stiff robots
    ImplicitMidpoint,
}

impl From<Method> for Integrator {
    fn from(method: Method) -> Self {
        match method {
            Method::SemiImplicitEuler => Self::SemiImplicitEuler,
            Method::RungeKutta4 => Self::RungeKutta4,
            Method::ImplicitEuler => Self::ImplicitEuler,
            Method::ImplicitMidpoint => Self::ImplicitMidpoint,
        }
    }
}

#[derive(Serialize)]
struct Simulated {
    steps: usize,
    /// Simulated time (s).
    time: f64,
    /// Disc origins at the end, world frame (m).
    positions: Vec<[f64; 3]>,
    /// Rotation of each disc relative to the body below at the end: quaternions (w, x, y, z) with w >= 0.
    rotations: Vec<[f64; 4]>,
    /// Joint rates at the end, in the discs' own frames (rad/s).
    velocity: Vec<f64>,
    /// What the robot touches at the end, of a scene.
    #[serde(skip_serializing_if = "Option::is_none")]
    contacts: Option<Vec<ContactJson>>,
    /// Where the scene's objects are at the end, if it has any.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    objects: Vec<ObjectJson>,
}

/// An object of a scene: an obstacle with a mass.
#[derive(Serialize)]
struct ObjectJson {
    name: String,
    /// Origin of its frame in the world (m).
    position: [f64; 3],
    /// Quaternion (w, x, y, z) with w >= 0 of that frame in the world.
    orientation: [f64; 4],
    /// Of that origin, world axes (m/s).
    velocity: [f64; 3],
    /// World axes (rad/s).
    angular_velocity: [f64; 3],
    /// Of the robot's contacts in the last step, world axes (N).
    force: [f64; 3],
}

/// The objects as a stepper has them.
fn objects_of(stepper: &ContactStepper) -> Vec<ObjectJson> {
    let objects = stepper.scene().objects().zip(stepper.objects());
    let objects = objects.map(|((number, obstacle), state)| {
        let own = stepper.contacts().iter();
        let own = own.filter(|contact| contact.partner.obstacle() == Some(number));
        let force: Vector3<f64> = own.map(|contact| -contact.force).sum();
        ObjectJson {
            name: obstacle.name.clone(),
            position: state.pose.translation.vector.into(),
            orientation: upward(&state.pose.rotation),
            velocity: state.velocity.into(),
            angular_velocity: state.angular_velocity.into(),
            force: force.into(),
        }
    });
    objects.collect()
}

/// A rotation as a quaternion (w, x, y, z) with w >= 0.
fn upward(q: &UnitQuaternion<f64>) -> [f64; 4] {
    [q.w, q.i, q.j, q.k].map(|x| if q.w < 0.0 { -x } else { x })
}

pub(super) fn run(args: &SimulateArgs, console: &Console) -> anyhow::Result<()> {
    if let Some(out) = &args.out {
        output::format("--out", out, &["csv"])?;
    }
    if let Some(file) = &args.linearise {
        output::format("--linearise", file, &["json"])?;
    }
    let robot = Robot::new(args.robot.load()?)?;
    let commands = read_commands(&args.commands, |row| Ok(robot.command(&row.unloaded()?)?))?;
    let constant = args.loads.on(&robot)?;
    let varying = (args.loads_file.as_deref())
        .map(|file| LoadsFile::read(file, &robot))
        .transpose()?;
    if let Some(varying) = &varying {
        varying.check_rows(commands.len())?;
    }
    let loads_in = |step: usize| match &varying {
        Some(varying) => varying.beside(&constant, step, (step + 1) as f64 * args.dt),
        None => Ok(constant.clone()),
    };
    let scene = args.scene.load()?;
    let touches = !scene.is_empty();
    let stepper = Stepper::new(&robot, args.dt, args.integrator.into())?;
    let mut stepper = ContactStepper::new(stepper, &scene)?;
    // Before the motion, as not every robot and scene has one.
    let mut lineariser = match (&args.linearise, touches) {
        (None, _) => None,
        (Some(_), true) => Some(stepper.lineariser()?),
        (Some(_), false) => Some(Lineariser::new(&robot, args.dt)?),
    };
    let mut path = args
        .out
        .as_deref()
        .map(|file| PathFile::create(file, &robot, &scene))
        .transpose()?;
    let mut picture = (args.picture.wanted_of_motion()?)
        .map(|to| MotionPicture::new(to, &robot, &constant, &scene, (commands.len(), args.dt)))
        .transpose()?;
    let mut state = State::straight(&robot);
    let first = commands
        .first()
        .cloned()
        .unwrap_or_else(|| robot.mean_command());
    let mut servos = Servos::at(&robot, &first);
    if let Some(first) = commands.first() {
        stepper.check_start(&state)?;
        (stepper.stepper()).check_stable(&state, first, &loads_in(0)?)?;
    }
    for (step, command) in commands.iter().enumerate() {
        if console.interrupted() {
            return Err(Interrupted.into());
        }
        (stepper.step(
            &mut state,
            servos.follow(command, args.dt),
            &loads_in(step)?,
        ))
        .with_context(|| format!("step {step}, at {:.6} s", step as f64 * args.dt))?;
        if let Some(path) = &mut path {
            path.write((step + 1) as f64 * args.dt, &state, &stepper)?;
        }
        if let Some(picture) = &mut picture {
            picture.move_objects(stepper.scene());
            picture.add(step, (step + 1) as f64 * args.dt, &state.configuration)?;
        }
    }
    if let Some(path) = path {
        path.finish()?;
    }
    if let Some(picture) = picture {
        picture.finish()?;
    }
    if let (Some(file), Some(lineariser), Some(command)) =
        (&args.linearise, &mut lineariser, commands.last())
    {
        let linear = lineariser.linearise(&state, command, &loads_in(commands.len() - 1)?)?;
        write_matrices(file, &linear)?;
    }
    let simulated = Simulated {
        steps: commands.len(),
        time: commands.len() as f64 * args.dt,
        positions: state
            .positions(&robot)
            .iter()
            .map(|p| [p.x, p.y, p.z])
            .collect(),
        rotations: (state.configuration.0.iter()).map(upward).collect(),
        velocity: state.velocity,
        objects: objects_of(&stepper),
        contacts: touches.then(|| {
            let contacts = stepper.contacts().iter();
            (contacts.map(|contact| ContactJson::of(contact, &scene))).collect()
        }),
    };
    console.result(&simulated, table)
}

fn write_matrices(file: &Path, linear: &Linearisation) -> anyhow::Result<()> {
    let rows = |matrix: &DMatrix<f64>| -> Vec<Vec<f64>> {
        matrix
            .row_iter()
            .map(|row| row.iter().copied().collect())
            .collect()
    };
    let matrices = serde_json::json!({ "a": rows(&linear.a), "b": rows(&linear.b) });
    output::write(file, matrices.to_string())
}

/// The CSV file of the discs' path, which takes its place when the path is whole.
struct PathFile {
    out: BufWriter<AtomicFile>,
    name: PathBuf,
    /// Whether rows have the contacts' forces.
    has_forces: bool,
}

impl PathFile {
    fn create(file: &Path, robot: &Robot, scene: &Scene) -> anyhow::Result<Self> {
        let has_forces = !scene.is_empty();
        let created = AtomicFile::create(file)
            .with_context(|| format!("cannot create {}", file.display()))?;
        let mut path = Self {
            out: BufWriter::new(created),
            name: file.to_owned(),
            has_forces,
        };
        let mut header = String::from("time (s)");
        for disc in 0..robot.discs().len() {
            // Writing to a string cannot fail.
            let _ = write!(header, ",x{disc} (m),y{disc} (m),z{disc} (m)");
        }
        for disc in (0..robot.discs().len()).filter(|_| has_forces) {
            let _ = write!(header, ",fx{disc} (N),fy{disc} (N),fz{disc} (N)");
        }
        for (_, object) in scene.objects() {
            for column in ["x (m)", "y (m)", "z (m)", "qw", "qx", "qy", "qz"] {
                let _ = write!(header, ",{}", quoted(&format!("{} {column}", object.name)));
            }
        }
        path.line(&header)?;
        Ok(path)
    }

    fn write(&mut self, time: f64, state: &State, stepper: &ContactStepper) -> anyhow::Result<()> {
        let mut row = time.to_string();
        for position in state.positions(stepper.robot()) {
            let _ = write!(row, ",{},{},{}", position.x, position.y, position.z);
        }
        if self.has_forces {
            let mut forces = vec![Vector3::zeros(); stepper.robot().discs().len()];
            for contact in stepper.contacts() {
                forces[contact.disc] += contact.force;
                if let Some(other) = contact.partner.disc() {
                    forces[other] -= contact.force;
                }
            }
            for force in forces {
                let _ = write!(row, ",{},{},{}", force.x, force.y, force.z);
            }
        }
        for object in stepper.objects() {
            let (at, q) = (object.pose.translation.vector, object.pose.rotation);
            for number in [at.x, at.y, at.z, q.w, q.i, q.j, q.k] {
                let _ = write!(row, ",{number}");
            }
        }
        self.line(&row)
    }

    fn line(&mut self, text: &str) -> anyhow::Result<()> {
        writeln!(self.out, "{text}")
            .with_context(|| format!("cannot write to {}", self.name.display()))
    }

    fn finish(self) -> anyhow::Result<()> {
        let written = self.out.into_inner().map_err(IntoInnerError::into_error);
        written
            .and_then(AtomicFile::commit)
            .with_context(|| format!("cannot write to {}", self.name.display()))
    }
}

/// A cell of CSV: in quotes where it must be.
fn quoted(text: &str) -> String {
    match text.contains([',', '"', '\n', '\r']) {
        true => format!("\"{}\"", text.replace('"', "\"\"")),
        false => text.to_owned(),
    }
}

fn table(simulated: &Simulated) -> String {
    let mut text = String::from("disc       x (m)      y (m)      z (m)\n");
    for (disc, [x, y, z]) in simulated.positions.iter().enumerate() {
        let _ = writeln!(text, "{disc:4}  {x:10.6} {y:10.6} {z:10.6}");
    }
    let fastest = simulated
        .velocity
        .iter()
        .fold(0.0, |fastest: f64, v| fastest.max(v.abs()));
    let _ = writeln!(
        text,
        "\n{}, {:.3} s; the fastest joint turns at {fastest:.3e} rad/s",
        counted(simulated.steps, "step"),
        simulated.time
    );
    if let Some(contacts) = &simulated.contacts {
        let strongest = (contacts.iter().map(ContactJson::strength)).fold(0.0, f64::max);
        let _ = writeln!(
            text,
            "{} in the last step; the largest force is {strongest:.5} N",
            counted(contacts.len(), "contact")
        );
    }
    for object in &simulated.objects {
        let [x, y, z] = object.position;
        let speed = Vector3::from(object.velocity).norm();
        let _ = writeln!(
            text,
            "object `{}` at {x:.6} {y:.6} {z:.6} m, {speed:.3e} m/s",
            object.name
        );
    }
    text
}
