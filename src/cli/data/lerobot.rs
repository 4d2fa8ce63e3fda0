//! `tdcr data export --format lerobot`: what LeRobot's own writer, which is in Python, makes of logs and commands.
//!
//! The Python package does the work. The process becomes the interpreter, so that its progress, exit status and signals are those of
//! the command.

use std::ffi::OsString;
use std::io::{self, Seek, Write};
use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Context, bail, ensure};
use clap::Args;
use serde::Serialize;
use serde_json::{Map, Value, json};
use tdcr::learn::data::Subject;
use tdcr::report::counted;
use tdcr::sim::robot::Robot;

use super::Console;
use crate::cli::commands::read_commands;

/// The variable that names the interpreter; pip's command sets it to its own.
const PYTHON: &str = "TDCR_PYTHON";
const LAUNCHER: &str = include_str!("lerobot.py");

/// What an episode has. Defaults are those of the Python functions, which take what is given.
#[derive(Debug, Args)]
pub(super) struct EpisodeArgs {
    /// For files of commands: 2m, 3m, 5m, or the path of a robot file [default: 2m]
    #[arg(long, value_name = "ROBOT")]
    robot: Option<String>,
    /// For files of commands: numbers of the robot's cameras that see it move, separated by commas, or none; 0 by default
    #[arg(long, value_name = "N,N,...", value_parser = cameras)]
    cameras: Option<Cameras>,
    /// Frames per second, 1 to 1000 [default: 10]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=1000))]
    fps: Option<u32>,
    /// What the robot does, in words
    #[arg(long, value_name = "TEXT")]
    task: Option<String>,
    /// Name of the data set; tdcr/recorded by default, or tdcr/simulated
    #[arg(long, value_name = "USER/NAME")]
    repo_id: Option<String>,
    /// Keep pictures without loss, in place of MP4 videos
    #[arg(long)]
    images: bool,
    /// Write depth, too (LeRobot 0.6)
    #[arg(long)]
    depth: bool,
}

#[derive(Clone, Debug)]
struct Cameras(Vec<usize>);

fn cameras(text: &str) -> Result<Cameras, String> {
    if text == "none" {
        return Ok(Cameras(Vec::new()));
    }
    let number = |text: &str| {
        let text = text.trim();
        (text.parse())
            .map_err(|_| format!("`{text}` is no number of a camera; expected 0, 1, ... or none"))
    };
    text.split(',')
        .map(number)
        .collect::<Result<_, _>>()
        .map(Cameras)
}

impl EpisodeArgs {
    /// The first option that is given.
    pub fn first(&self) -> Option<&'static str> {
        let given = [
            ("--robot", self.robot.is_some()),
            ("--cameras", self.cameras.is_some()),
            ("--fps", self.fps.is_some()),
            ("--task", self.task.is_some()),
            ("--repo-id", self.repo_id.is_some()),
            ("--images", self.images),
            ("--depth", self.depth),
        ];
        given
            .iter()
            .find_map(|(name, given)| given.then_some(*name))
    }

    /// The keywords that both functions have.
    fn keywords(&self, out: &Path) -> anyhow::Result<Map<String, Value>> {
        let mut keywords = Map::new();
        keywords.insert("out".to_owned(), text(out)?.into());
        let mut put = |name: &str, value: Option<Value>| {
            if let Some(value) = value {
                keywords.insert(name.to_owned(), value);
            }
        };
        put("fps", self.fps.map(Value::from));
        put("task", self.task.clone().map(Value::from));
        put("repo_id", self.repo_id.clone().map(Value::from));
        put("videos", self.images.then_some(Value::from(false)));
        put("depth", self.depth.then_some(Value::from(true)));
        Ok(keywords)
    }
}

/// What the launcher reads.
#[derive(Serialize)]
struct Request {
    version: &'static str,
    function: &'static str,
    keywords: Map<String, Value>,
    episodes: usize,
    threads: usize,
    json: bool,
    quiet: bool,
}

/// Writes the data set.
pub(super) fn export(
    sources: &[PathBuf],
    out: &Path,
    args: &EpisodeArgs,
    console: &Console,
) -> anyhow::Result<()> {
    let mut keywords = args.keywords(out)?;
    let (function, episodes) = if sources.iter().any(|source| is_table(source)) {
        simulated(sources, args, &mut keywords)?
    } else {
        recorded(sources, args, &mut keywords)?
    };
    become_python(&Request {
        version: env!("CARGO_PKG_VERSION"),
        function,
        keywords,
        episodes,
        threads: rayon::current_num_threads(),
        json: console.is_json(),
        quiet: console.is_quiet(),
    })
}

fn is_table(source: &Path) -> bool {
    source.is_file()
        && ["csv", "json"]
            .iter()
            .any(|extension| has(source, extension))
}

fn has(path: &Path, extension: &str) -> bool {
    (path.extension()).is_some_and(|found| found.eq_ignore_ascii_case(extension))
}

/// Simulated episodes, of files of commands.
fn simulated(
    sources: &[PathBuf],
    args: &EpisodeArgs,
    keywords: &mut Map<String, Value>,
) -> anyhow::Result<(&'static str, usize)> {
    let spec = crate::cli::load_robot(args.robot.as_deref().unwrap_or(Subject::ROBOT))?;
    let robot = Robot::new(spec)?;
    let mut commands = Vec::new();
    for source in sources {
        let name = source.display();
        ensure!(
            is_table(source),
            "{name} is no file of commands (.csv, .json), as others are; expected these alone, or logs alone"
        );
        let episode = read_commands(source, |row| {
            let command = row.unloaded()?;
            robot.command(&command)?;
            Ok(command)
        })?;
        let rows = counted(episode.len(), "command");
        ensure!(episode.len() >= 2, "{name} has {rows}; expected at least 2");
        commands.push(episode);
    }
    keywords.insert("robot".to_owned(), serde_json::to_value(robot.spec())?);
    keywords.insert("commands".to_owned(), json!(commands));
    if let Some(Cameras(cameras)) = &args.cameras {
        keywords.insert("cameras".to_owned(), json!(cameras));
    }
    Ok(("export_commands", sources.len()))
}

/// Recorded episodes, of logs and the folders of captures.
fn recorded(
    sources: &[PathBuf],
    args: &EpisodeArgs,
    keywords: &mut Map<String, Value>,
) -> anyhow::Result<(&'static str, usize)> {
    for (name, given) in [
        ("--robot", args.robot.is_some()),
        ("--cameras", args.cameras.is_some()),
    ] {
        ensure!(
            !given,
            "{name} goes with files of commands; a log has its own"
        );
    }
    let mut logs = Vec::new();
    for source in sources {
        if source.is_dir() {
            logs.extend(logs_of(source)?);
        } else {
            ensure!(source.exists(), "there is no {}", source.display());
            logs.push(source.clone());
        }
    }
    let names = logs
        .iter()
        .map(|log| text(log))
        .collect::<Result<Vec<_>, _>>()?;
    keywords.insert("logs".to_owned(), json!(names));
    Ok(("export_logs", logs.len()))
}

/// The logs of a capture's folder: `log.mcap`, and `log-2.mcap` and so on of resumptions, in the order in which they were written.
fn logs_of(folder: &Path) -> anyhow::Result<Vec<PathBuf>> {
    let names =
        std::iter::once("log.mcap".to_owned()).chain((2..).map(|k| format!("log-{k}.mcap")));
    let logs: Vec<_> = names
        .map(|name| folder.join(name))
        .take_while(|log| log.is_file())
        .collect();
    if logs.is_empty() {
        bail!(
            "{}: no log.mcap, which `tdcr capture` writes beside its data set; a data set alone has poses at rest, without \
             times. Expected the folder of a capture, logs (.mcap), or files of commands to simulate (.csv, .json)",
            folder.display()
        );
    }
    Ok(logs)
}

/// A name as JSON can hold it.
fn text(path: &Path) -> anyhow::Result<&str> {
    path.to_str().with_context(|| {
        format!(
            "--format lerobot cannot pass on the name {}, which is not UTF-8; rename it",
            path.display()
        )
    })
}

/// Runs the request in Python, in place of this process.
fn become_python(request: &Request) -> anyhow::Result<()> {
    let named = std::env::var_os(PYTHON).filter(|name| !name.is_empty());
    let python = named.unwrap_or_else(|| OsString::from("python3"));
    // A file without a name: a pipe might not hold it all.
    let mut input = tempfile::tempfile().context("cannot make a temporary file")?;
    serde_json::to_writer(io::BufWriter::new(&input), request)?;
    input
        .flush()
        .and_then(|()| input.rewind())
        .context("cannot write a temporary file")?;
    let mut command = Command::new(&python);
    command.arg("-c").arg(LAUNCHER).stdin(input);
    let name = Path::new(&python).display();
    replaced_by(&mut command).with_context(|| {
        format!(
            "cannot run {name}: --format lerobot needs Python with the package tdcr and LeRobot (pip install 'tdcr[lerobot]'); \
             {PYTHON} names another interpreter"
        )
    })
}

#[cfg(unix)]
fn replaced_by(command: &mut Command) -> io::Result<()> {
    use std::os::unix::process::CommandExt;
    Err(command.exec())
}

#[cfg(not(unix))]
fn replaced_by(command: &mut Command) -> io::Result<()> {
    let status = command.status()?;
    std::process::exit(status.code().unwrap_or(1))
}
