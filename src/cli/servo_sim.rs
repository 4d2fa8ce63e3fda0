//! `tdcr servo-sim`.

use std::io::ErrorKind;
use std::sync::Arc;
use std::time::Duration;

use anyhow::{Context, anyhow, bail};
use clap::{Args, ValueEnum};
use serde::Serialize;
use tdcr::hw::clock::SystemClock;
use tdcr::hw::dynamixel::{BAUD_RATES, Model};
use tdcr::hw::servo::{SPOOL_RADII, ServoId};
use tdcr::hw::simulated::{
    FRICTIONS, Physics, STIFFNESSES, ScheduledFault, Simulator, SimulatorSetup, Terminal,
};
use tdcr::pipeline::Monitor;

use super::console::Console;
use super::scene::SceneArgs;

/// Serve simulated servos with a robot behind them on a pseudo-terminal, in real time
///
/// The first line on stdout is the path that programs open like the serial port of a bus of DYNAMIXEL servos: ids 1, 2, 3 are
/// those of the first module's tendons, and so on. The servos stand at tick 2048 with 2 N in every tendon, torque off; the
/// line follows the baud rate that a program sets, the servos the one of --baud. Ctrl-C ends it.
#[derive(Debug, Args)]
pub(super) struct ServoSimArgs {
    #[command(flatten)]
    robot: super::RobotArg,
    #[command(flatten)]
    scene: SceneArgs,
    /// Baud rate of the servos
    #[arg(long, default_value = "1000000", value_name = "RATE", value_parser = baud_rate)]
    baud: u32,
    /// Model of the servos
    #[arg(long, value_enum, default_value_t = ServoModel::Xc330M288)]
    model: ServoModel,
    /// Version of their firmware: up to 52 the indirect data begin at 208, later at 224
    #[arg(long, default_value_t = Model::LAST_FIRMWARE_208, value_name = "N", value_parser = clap::value_parser!(u8).range(38..))]
    firmware: u8,
    /// Radius of the spools (m)
    #[arg(long, default_value_t = 0.005, value_name = "M", value_parser = within(SPOOL_RADII))]
    spool_radius: f64,
    /// Stiffness of the tendons (N/m) [default: that of the robot file]
    #[arg(long, value_name = "K", value_parser = within(STIFFNESSES))]
    stiffness: Option<f64>,
    /// How the robot follows its tendons
    #[arg(long, value_enum, default_value_t = Motion::AtRest)]
    physics: Motion,
    /// Coefficient of friction in the holes: with --physics friction [default: 0.1], or dynamic [default: that of the robot file]
    #[arg(long, value_name = "MU", value_parser = within(FRICTIONS))]
    friction: Option<f64>,
    /// Latency timer of the simulated USB adapter (ms); 0 for none
    #[arg(long, default_value_t = 1, value_name = "MS", value_parser = clap::value_parser!(u64).range(0..=255))]
    latency: u64,
    /// Something that goes wrong, as often as wanted: lost=SHARE, corrupted=SHARE or duplicated=SHARE of the bytes, late=SHARE
    /// of the answers, silent:ID, overheated:ID, overloaded:ID, power-cycled:ID, snapped:ID, jammed:ID or unplugged; @SECONDS
    /// behind it says when, as in snapped:4@12.5
    #[arg(long = "fault", value_name = "FAULT")]
    faults: Vec<ScheduledFault>,
    /// Seed of what goes wrong by chance
    #[arg(long, default_value_t = 0)]
    seed: u64,
}

#[derive(Clone, Copy, Debug, ValueEnum)]
enum ServoModel {
    /// XL330-M288-T
    Xl330M288,
    /// XC330-M288-T
    Xc330M288,
    /// XC330-T288-T
    Xc330T288,
}

impl From<ServoModel> for Model {
    fn from(model: ServoModel) -> Self {
        match model {
            ServoModel::Xl330M288 => Self::Xl330M288,
            ServoModel::Xc330M288 => Self::Xc330M288,
            ServoModel::Xc330T288 => Self::Xc330T288,
        }
    }
}

/// Coefficient of friction in the holes where none is given.
const FRICTION: f64 = 0.1;

/// Time step (s) of robots in motion.
const TIMESTEP: f64 = 0.005;

#[derive(Clone, Copy, Debug, ValueEnum)]
enum Motion {
    /// From equilibrium to equilibrium
    AtRest,
    /// The same, with friction of the tendons in their holes
    Friction,
    /// With inertia and damping
    Dynamic,
}

/// What programs have to know to talk to the servos.
#[derive(Serialize)]
struct Served {
    port: String,
    baud: u32,
    ids: Vec<u8>,
}

pub(super) fn run(args: &ServoSimArgs, console: &Console) -> anyhow::Result<()> {
    let robot = args.robot.load()?;
    let tendons = robot.tendon_count();
    if tendons > usize::from(ServoId::MAX) {
        bail!(
            "robot `{}` has {tendons} tendons; a bus has ids for {} servos",
            robot.name,
            ServoId::MAX
        );
    }
    let mut setup = SimulatorSetup::of_robot(robot);
    setup.plant.stiffness = args.stiffness;
    setup.plant.scene = args.scene.load()?;
    setup.plant.physics = match (args.physics, args.friction) {
        (Motion::Friction, friction) => Physics::WithFriction {
            coefficient: friction.unwrap_or(FRICTION),
        },
        (Motion::AtRest, Some(_)) => {
            bail!("--friction acts with --physics friction and --physics dynamic alone")
        }
        (Motion::AtRest, None) => Physics::AtRest,
        (Motion::Dynamic, friction) => Physics::InMotion {
            timestep: TIMESTEP,
            friction,
        },
    };
    for servo in &mut setup.servos {
        servo.model = args.model.into();
        servo.firmware = args.firmware;
        servo.spool_radius = args.spool_radius;
    }
    setup.baud_rate = args.baud;
    setup.latency = Duration::from_millis(args.latency);
    setup.seed = args.seed;
    let ids: Vec<u8> = setup.servos.iter().map(|servo| servo.id.get()).collect();
    for fault in &args.faults {
        if let Some(id) = fault.fault.servo().filter(|id| !ids.contains(&id.get())) {
            bail!(
                "--fault {}: there is no servo {id}; the robot's {tendons} tendons have the ids 1 to {tendons}",
                fault.fault
            );
        }
    }

    let simulator = Simulator::new(&setup, Arc::new(SystemClock::new()))?;
    for fault in &args.faults {
        simulator.schedule(*fault);
    }
    let mut terminal = Terminal::open(args.baud).context("cannot open a pseudo-terminal")?;
    let served = Served {
        port: terminal.path().display().to_string(),
        baud: args.baud,
        ids,
    };
    console.result(&served, |served| served.port.clone())?;
    tracing::info!(
        "serving {} servos at {} baud; Ctrl-C ends it",
        served.ids.len(),
        served.baud
    );
    match terminal.serve(&simulator, || console.interrupted()) {
        Err(error) if error.kind() == ErrorKind::NotConnected => Err(anyhow!(error)),
        served => served.context("the pseudo-terminal failed"),
    }
}

/// Parses a number within bounds.
fn within([low, high]: [f64; 2]) -> impl Fn(&str) -> Result<f64, String> + Clone {
    move |text| match text.parse() {
        Ok(number) if (low..=high).contains(&number) => Ok(number),
        _ => Err(format!("expected {low} to {high}")),
    }
}

/// Parses a baud rate of the servos.
fn baud_rate(text: &str) -> Result<u32, String> {
    match text.parse() {
        Ok(rate) if BAUD_RATES.contains(&rate) => Ok(rate),
        _ => Err(format!(
            "expected one of {}",
            BAUD_RATES.map(|r| r.to_string()).join(", ")
        )),
    }
}
