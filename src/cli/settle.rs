//! `tdcr settle`.

use std::f64::consts::TAU;
use std::fmt::Write;
use std::path::PathBuf;
use std::time::Instant;

use anyhow::bail;
use clap::Args;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use serde::Serialize;
use serde_json::Value;
use tdcr::base::stats::quantile;
use tdcr::pipeline::Monitor;
use tdcr::report::counted;
use tdcr::sim::contact::ContactSettler;
use tdcr::sim::robot::{Axis, Command, Loads, Parameter, Robot};
use tdcr::sim::scene::Scene;
use tdcr::sim::sensitivity::SensitivityError;
use tdcr::sim::statics::{Examined, Growth, Stability};

use super::base::BaseArg;
use super::console::{Console, Interrupted};
use super::loads::{LoadArgs, LoadsJson};
use super::picture::{PictureArg, of_robot};
use super::scene::SceneArgs;
use super::settle_contacts::Surroundings;
use super::units::units;
use super::{settle_many, settle_path};

/// Settle a robot under a command: where its discs come to rest
#[derive(Debug, Args)]
pub(super) struct SettleArgs {
    #[command(flatten)]
    robot: super::RobotArg,
    /// Command of every tendon (m, or N for a tension drive), separated by commas; none for a robot without tendons
    #[arg(
        long = "command",
        value_parser = super::numbers,
        conflicts_with_all = ["random", "commands", "path"],
        allow_hyphen_values = true,
        value_name = "C,C,..."
    )]
    command: Option<Box<[f64]>>,
    /// Settle every command in this file, each from the straight pose: CSV, one per line, optionally with a header, or JSON, a list of
    /// lists. A column `payload` (kg) replaces --payload
    #[arg(long, value_name = "FILE", group = "file", conflicts_with_all = ["random", "path"])]
    commands: Option<PathBuf>,
    /// Lead the robot along the commands of such a file, slowly: each settles from the one before, with friction of tendons,
    /// obstacles and discs where there is any, and says whether the robot snapped on the way
    #[arg(long, value_name = "FILE", group = "file", conflicts_with = "random")]
    path: Option<PathBuf>,
    /// With --commands or --path, the table to write (.csv or .json): tip, tendons, stiffness, residual of each command
    #[arg(long, value_name = "FILE", requires = "file", conflicts_with_all = ["command", "random"])]
    out: Option<PathBuf>,
    /// Settle N random commands instead, on one thread, and report how many settle, how well and how fast
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..))]
    random: Option<u64>,
    /// Seed of the random commands
    #[arg(long, default_value_t = 0, requires = "random", conflicts_with_all = ["command", "commands", "path"])]
    seed: u64,
    #[command(flatten)]
    base: BaseArg,
    #[command(flatten)]
    loads: LoadArgs,
    #[command(flatten)]
    scene: SceneArgs,
    /// Also print the compliance of the tip: its motion per force and moment on it
    #[arg(long, conflicts_with_all = ["random", "commands", "path"])]
    compliance: bool,
    #[command(flatten)]
    picture: PictureArg,
}

#[derive(Serialize)]
struct Settled {
    tdcr_version: &'static str,
    /// Name of the robot.
    robot: String,
    /// One value per tendon, in `units.command`.
    command: Vec<f64>,
    loads: LoadsJson,
    units: Value,
    /// Disc origins, world frame (m).
    positions: Vec<[f64; 3]>,
    /// Disc orientations, world frame, unit quaternions (w, x, y, z): of each the sign nearer to that of the body below,
    /// the base's with w >= 0.
    orientations: Vec<[f64; 4]>,
    tendon_lengths: Vec<f64>,
    tendon_tensions: Vec<f64>,
    residual: f64,
    iterations: usize,
    smallest_stiffness: f64,
    converged: bool,
    /// `stable`, `neutral`, `unstable` or `flutter`; null where this is no equilibrium.
    stability: Option<Stability>,
    /// What that was told from: `energy`, `motion` or `statics`.
    examined: Option<Examined>,
    /// The small motion that grows fastest, where one does.
    #[serde(skip_serializing_if = "Option::is_none")]
    growth: Option<GrowthJson>,
    /// What the robot touches, of a scene.
    #[serde(flatten)]
    surroundings: Option<Surroundings>,
    /// Where asked for, and the robot has settled.
    #[serde(skip_serializing_if = "Option::is_none")]
    tip_compliance: Option<Compliance>,
}

#[derive(Serialize)]
struct GrowthJson {
    /// 1/s.
    rate: f64,
    /// Hz; 0 where the robot leaves without swinging.
    frequency: f64,
    without_damping: bool,
}

impl From<Growth> for GrowthJson {
    fn from(growth: Growth) -> Self {
        Self {
            rate: growth.rate,
            frequency: growth.angular_frequency / TAU,
            without_damping: growth.without_damping,
        }
    }
}

/// How the tip disc moves by what acts on it, world frame. Rows: its origin along x, y, z (m), its rotation about them
/// (rad); columns: a force on its origin along x, y, z (N), a moment about them (N m).
type Compliance = [[f64; 6]; 6];

/// How settling random commands went.
#[derive(Serialize)]
struct Survey {
    count: u64,
    converged: u64,
    /// Largest residual moment on a joint (N m).
    max_residual: f64,
    /// Time of one solve from the straight pose.
    median_us: f64,
    p99_us: f64,
}

pub(super) fn run(args: &SettleArgs, console: &Console) -> anyhow::Result<()> {
    let picture = args.picture.wanted()?;
    let is_of_many = args.commands.is_some() || args.path.is_some() || args.random.is_some();
    if picture.is_some() && is_of_many {
        bail!(
            "--picture is of one command; expected --command, not --commands, --path or --random"
        );
    }
    let robot = args.base.put(Robot::new(args.robot.load()?)?)?;
    let scene = args.scene.load()?;
    let (around, out) = ((&robot, &scene), args.out.as_deref());
    if let Some(file) = &args.commands {
        return settle_many::run(around, file, &args.loads, out, console);
    }
    if let Some(file) = &args.path {
        return settle_path::run(around, file, &args.loads, out, console);
    }
    let loads = args.loads.on(&robot)?;
    if let Some(count) = args.random {
        return survey(&robot, &scene, &loads, count, args.seed, console);
    }
    let others = ", --commands FILE, --path FILE or --random N";
    let command = super::command_of(args.command.as_deref(), &robot, others)?;
    let mut settler = ContactSettler::new(&robot, &scene);
    let found = settler.settle(&command, &loads)?.clone();
    let failure = found.equilibrium.failure(&robot, &command);
    if let Some(picture) = picture {
        of_robot(picture, &robot, found.equilibrium.pose(), &loads, &scene)?;
    }
    let tip_compliance = match args.compliance && found.equilibrium.converged {
        true => Some(tip_compliance(&settler, &command, &loads)?),
        false => None,
    };
    let smallest_stiffness = settler.smallest_stiffness(&command, &loads);
    let surroundings = Surroundings::of(&settler);
    let equilibrium = found.equilibrium;
    let settled = Settled {
        tdcr_version: env!("CARGO_PKG_VERSION"),
        robot: robot.spec().name.clone(),
        command: command.as_slice().to_vec(),
        loads: LoadsJson::new(&loads),
        units: units(&robot),
        smallest_stiffness,
        surroundings,
        positions: equilibrium
            .positions
            .iter()
            .map(|p| [p.x, p.y, p.z])
            .collect(),
        orientations: equilibrium
            .orientations
            .iter()
            .map(|q| [q.w, q.i, q.j, q.k])
            .collect(),
        tendon_lengths: equilibrium.tendon_lengths,
        tendon_tensions: equilibrium.tendon_tensions,
        residual: equilibrium.residual,
        iterations: equilibrium.iterations,
        converged: equilibrium.converged,
        stability: equilibrium.stability,
        examined: equilibrium.examined,
        growth: equilibrium.growth.map(GrowthJson::from),
        tip_compliance,
    };
    console.result(&settled, table)?;
    if let Some(failure) = failure {
        return Err(failure.into());
    }
    Ok(())
}

fn tip_compliance(
    settler: &ContactSettler,
    command: &Command,
    loads: &Loads,
) -> Result<Compliance, SensitivityError> {
    let robot = settler.robot();
    let tip = robot.discs().len() - 1;
    let forces = Axis::ALL.map(|axis| Parameter::Force(tip, axis));
    let moments = Axis::ALL.map(|axis| Parameter::Moment(tip, axis));
    let sensitivity = settler.sensitivity(command, loads)?;
    let jacobian = sensitivity
        .parameters()
        .jacobian(&[forces, moments].concat())?;
    let entry = |row, column| jacobian[(6 * tip + row, column)];
    Ok(std::array::from_fn(|row| {
        std::array::from_fn(|column| entry(row, column))
    }))
}

/// Settles random commands one after another and reports figures over all of them.
fn survey(
    robot: &Robot,
    scene: &Scene,
    loads: &Loads,
    count: u64,
    seed: u64,
    console: &Console,
) -> anyhow::Result<()> {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut settler = ContactSettler::new(robot, scene);
    let (mut converged, mut max_residual) = (0, 0.0_f64);
    // Eight bytes a solve: the one thing that grows with their number.
    let mut times: Vec<f64> = Vec::new();
    console.begin("settle", count, 0);
    for done in 0..count {
        let command = robot.random_command(&mut rng);
        let began = Instant::now();
        let settled = &settler.settle(&command, loads)?.equilibrium;
        times.push(began.elapsed().as_nanos() as f64 / 1e3);
        converged += u64::from(settled.converged);
        max_residual = max_residual.max(settled.residual);
        if done % 1024 == 1023 {
            console.advance(1024);
            if console.interrupted() {
                break;
            }
        }
    }
    console.end();
    let stopped = (times.len() as u64) < count;
    let count = times.len() as u64;
    times.sort_unstable_by(f64::total_cmp);
    let survey = Survey {
        count,
        converged,
        max_residual,
        median_us: quantile(&times, 0.5),
        p99_us: quantile(&times, 0.99),
    };
    console.result(&survey, |survey| {
        format!(
            "{}, {} settled, largest residual {:.1e} N m\nper command: median {:.1} us, 99th percentile {:.1} us\n",
            counted(survey.count as usize, "command"), survey.converged, survey.max_residual, survey.median_us, survey.p99_us
        )
    })?;
    if stopped {
        return Err(Interrupted.into());
    }
    if converged < count {
        bail!("{} of {count} commands did not settle", count - converged);
    }
    Ok(())
}

fn table(settled: &Settled) -> String {
    let mut text = String::from(
        "disc       x (m)      y (m)      z (m)         w         x         y         z\n",
    );
    for (disc, ([x, y, z], [w, i, j, k])) in settled
        .positions
        .iter()
        .zip(&settled.orientations)
        .enumerate()
    {
        // Writing to a string cannot fail.
        let _ = writeln!(
            text,
            "{disc:4}  {x:10.6} {y:10.6} {z:10.6}  {w:8.5}  {i:8.5}  {j:8.5}  {k:8.5}"
        );
    }
    text.push_str("\ntendon  length (m)  tension (N)\n");
    for (tendon, (length, tension)) in settled
        .tendon_lengths
        .iter()
        .zip(&settled.tendon_tensions)
        .enumerate()
    {
        let number = tendon + 1;
        let _ = writeln!(text, "{number:6}  {length:10.6}  {tension:11.4}");
    }
    let _ = writeln!(
        text,
        "\n{} in {} Newton steps; residual {:.1e} N m, smallest stiffness {:.3e} N m/rad",
        match settled.stability {
            Some(Stability::Neutral) if settled.converged => "settled (neutral equilibrium)",
            Some(Stability::Unstable) => "NOT settled (unstable equilibrium)",
            Some(Stability::Flutter) if settled.converged => "settled (flutter: it has no damping)",
            Some(Stability::Flutter) => "NOT settled (flutter)",
            _ if settled.converged => "settled",
            _ => "NOT settled",
        },
        settled.iterations,
        settled.residual,
        settled.smallest_stiffness
    );
    if let Some(said) = settled
        .examined
        .and_then(|examined| basis_of(examined, settled.stability))
    {
        let _ = writeln!(text, "{said}");
    }
    if let Some(growth) = &settled.growth {
        let _ = writeln!(
            text,
            "small motions grow by {:.3e} 1/s{}{}",
            growth.rate,
            match growth.frequency {
                0.0 => String::new(),
                frequency => format!(", swinging at {frequency:.4} Hz"),
            },
            match growth.without_damping {
                true => "",
                false => "; without the robot's damping none would",
            }
        );
    }
    if let Some(surroundings) = &settled.surroundings {
        surroundings.write(&mut text);
    }
    if let Some(compliance) = &settled.tip_compliance {
        text.push_str(
            "\ntip by            Fx (N)     Fy (N)     Fz (N)   Mx (N m)   My (N m)   Mz (N m)\n",
        );
        let names = [
            "x (m)",
            "y (m)",
            "z (m)",
            "rot x (rad)",
            "rot y (rad)",
            "rot z (rad)",
        ];
        for (name, row) in names.iter().zip(compliance) {
            let _ = write!(text, "{name:13}");
            for entry in row {
                let _ = write!(text, " {entry:10.3e}");
            }
            text.push('\n');
        }
    }
    text
}

/// What the kind of an equilibrium under loads without a potential was told from.
fn basis_of(examined: Examined, stability: Option<Stability>) -> Option<&'static str> {
    match examined {
        Examined::Energy => None,
        Examined::Motion => Some(
            "the loads have no potential: small motions were examined, with the robot's own inertia and damping",
        ),
        Examined::Statics if stability == Some(Stability::Unstable) => {
            Some("the loads have no potential: their moments alone make the robot leave")
        }
        Examined::Statics => Some(
            "the loads have no potential, and small motions could not be examined (a joint without inertia, an imposed \
             length, or rates too far apart to be computed): its Jacobian alone was, and in motion it might flutter",
        ),
    }
}
