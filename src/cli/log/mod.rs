//! `tdcr log`: inspects and repairs logs of a rig, and takes pictures out of them.

use std::path::PathBuf;

use anyhow::bail;
use clap::{Args, Subcommand, ValueEnum};
use serde::Serialize;
use tdcr::hw::log::{Contents, Recovery, export_rosbag2, repair};
use tdcr::report::counted;

use super::console::Console;

mod pictures;
use pictures::PicturesArgs;

/// Inspect and repair logs of a rig, take pictures out of them
#[derive(Debug, Args)]
pub(super) struct LogArgs {
    #[command(subcommand)]
    command: LogCommand,
}

#[derive(Debug, Subcommand)]
enum LogCommand {
    Info(InfoArgs),
    Repair(RepairArgs),
    Export(ExportArgs),
    Pictures(PicturesArgs),
}

/// Summarise a log: topics, times, and what is damaged
#[derive(Debug, Args)]
struct InfoArgs {
    /// The log, an MCAP file
    #[arg(value_name = "FILE")]
    file: PathBuf,
}

/// Write a whole log of what can be read of one that was cut off or damaged
#[derive(Debug, Args)]
struct RepairArgs {
    /// The log, an MCAP file
    #[arg(value_name = "FILE")]
    file: PathBuf,
    /// The log to write
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
    /// Replace a file that is there
    #[arg(long)]
    force: bool,
}

/// Write a log as other tools have it
#[derive(Debug, Args)]
struct ExportArgs {
    /// The log, an MCAP file
    #[arg(value_name = "FILE")]
    file: PathBuf,
    /// The format to write
    #[arg(long, value_enum, default_value_t = LogFormat::Rosbag2)]
    format: LogFormat,
    /// The folder to write, which must not be there
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum LogFormat {
    /// Bag of ROS 2: MCAP with messages of sensor_msgs and its like
    Rosbag2,
}

pub(super) fn run(args: &LogArgs, console: &Console) -> anyhow::Result<()> {
    match &args.command {
        LogCommand::Info(args) => info(args, console),
        LogCommand::Repair(args) => mend(args, console),
        LogCommand::Export(args) => export(args, console),
        LogCommand::Pictures(args) => pictures::run(args, console),
    }
}

/// What is in a log. Times are in seconds since the Unix epoch.
#[derive(Serialize)]
struct Info {
    file: PathBuf,
    #[serde(flatten)]
    found: Found,
    start: Option<f64>,
    end: Option<f64>,
    topics: Vec<TopicInfo>,
}

#[derive(Serialize)]
struct TopicInfo {
    topic: String,
    schema: String,
    messages: u64,
    bytes: u64,
    /// Messages per second; none for a single one.
    rate: Option<f64>,
}

/// What could be read.
#[derive(Serialize)]
struct Found {
    whole: bool,
    messages: u64,
    /// What the log itself says.
    stated: Option<u64>,
    damages: u64,
    damage: Vec<DamageInfo>,
}

#[derive(Serialize)]
struct DamageInfo {
    at: u64,
    problem: String,
}

impl Found {
    fn new(recovery: &Recovery) -> Self {
        let damage = recovery.damage.iter().map(|damage| DamageInfo {
            at: damage.at,
            problem: damage.problem.to_string(),
        });
        Self {
            whole: recovery.is_whole(),
            messages: recovery.messages,
            stated: recovery.stated,
            damages: recovery.damages,
            damage: damage.collect(),
        }
    }

    /// Lines for people.
    fn text(&self) -> String {
        let messages = counted(self.messages as usize, "message");
        if self.whole {
            return format!("{messages}, whole\n");
        }
        let of = (self.stated).map_or(String::new(), |stated| format!(" of {stated}"));
        let mut text = format!("{messages}{of} can be read; damaged:\n");
        for DamageInfo { at, problem } in self.damage.iter().take(SHOWN) {
            text.push_str(&format!("  from byte {at}: {problem}\n"));
        }
        let more = self.damages.saturating_sub(SHOWN as u64);
        if more > 0 {
            text.push_str(&format!(
                "  and {}\n",
                counted(more as usize, "further place")
            ));
        }
        text
    }
}

/// Damage that people are shown.
const SHOWN: usize = 10;

fn seconds(nanoseconds: u64) -> f64 {
    nanoseconds as f64 * 1e-9
}

fn info(args: &InfoArgs, console: &Console) -> anyhow::Result<()> {
    let contents = Contents::of(&args.file)?;
    let topics = contents.topics.iter().map(|((topic, schema), of)| {
        let span = seconds(of.last - of.first);
        TopicInfo {
            topic: topic.clone(),
            schema: schema.clone(),
            messages: of.messages,
            bytes: of.bytes,
            rate: (span > 0.0).then(|| (of.messages - 1) as f64 / span),
        }
    });
    let times = contents.times();
    let info = Info {
        file: args.file.clone(),
        found: Found::new(&contents.recovery),
        start: times.map(|(start, _)| seconds(start)),
        end: times.map(|(_, end)| seconds(end)),
        topics: topics.collect(),
    };
    let span = times.map_or(0.0, |(start, end)| seconds(end - start));
    console.result(&info, |info| {
        let mut text = format!(
            "{}: {:.1} s, {}",
            info.file.display(),
            span,
            info.found.text()
        );
        for topic in &info.topics {
            let rate = (topic.rate).map_or(String::new(), |rate| format!("{rate:.1} / s"));
            let TopicInfo {
                topic,
                schema,
                messages,
                bytes,
                ..
            } = topic;
            text.push_str(&format!(
                "  {topic:32} {schema:26} {messages:>8} {:>9.1} kB {rate:>12}\n",
                *bytes as f64 / 1e3
            ));
        }
        text
    })
}

fn mend(args: &RepairArgs, console: &Console) -> anyhow::Result<()> {
    let out = &args.out;
    let is_there = std::fs::metadata(out).is_ok_and(|found| found.is_file());
    if is_there && !args.force {
        bail!("{} is there already; --force replaces it", out.display());
    }
    let found = Found::new(&repair(&args.file, out)?);
    console.summary(&found, |found| {
        let text = found.text();
        let what = if found.whole {
            "whole"
        } else {
            "with what could be read"
        };
        format!("{text}{}: written, {what}\n", out.display())
    })
}

#[derive(Serialize)]
struct Exported {
    dir: PathBuf,
    messages: u64,
    /// Messages that the format has nothing for.
    left_out: u64,
    topics: Vec<ExportedTopic>,
    whole: bool,
}

#[derive(Serialize)]
struct ExportedTopic {
    topic: String,
    #[serde(rename = "type")]
    kind: &'static str,
    messages: u64,
}

fn export(args: &ExportArgs, console: &Console) -> anyhow::Result<()> {
    let LogFormat::Rosbag2 = args.format;
    let bag = export_rosbag2(&args.file, &args.out)?;
    if !bag.recovery.is_whole() {
        tracing::warn!(
            "{} is damaged: the bag has what can be read of it",
            args.file.display()
        );
    }
    let topics = bag
        .topics
        .iter()
        .map(|(topic, (kind, messages))| ExportedTopic {
            topic: topic.clone(),
            kind,
            messages: *messages,
        });
    let exported = Exported {
        dir: args.out.clone(),
        messages: bag.messages(),
        left_out: bag.left_out,
        topics: topics.collect(),
        whole: bag.recovery.is_whole(),
    };
    console.summary(&exported, |e| {
        format!(
            "{}: {} of {}; {} have no message there",
            e.dir.display(),
            counted(e.messages as usize, "message"),
            counted(e.topics.len(), "topic"),
            e.left_out
        )
    })
}
