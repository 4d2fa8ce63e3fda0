//! What is captured.

use std::path::{Path, PathBuf};

use clap::Args;
use serde::Deserialize;
use serde_json::json;
use tdcr_base::hash::hash_all;
use tdcr_hw::capture::{CaptureError, Program, SessionSettings};
use tdcr_hw::mask::MaskFolder;
use tdcr_hw::plan::{Place, PlanError};
use tdcr_hw::rig::{Rig, RigFile, RigSpec, ServoLink};
use tdcr_learn::data::{Meta, Origin, Recording};
use tdcr_learn::options::cli::{amount, positive};
use tdcr_sim::robot::{Loads, LoadsError};

use crate::pipeline::{CaptureStop, PipelineError};

/// Samples per file on disk.
const SAMPLES_PER_SHARD: usize = 250;

/// Room (bytes) that a sample takes besides its values: a file's headers, a line of the journal with its digits.
const PER_SAMPLE: usize = 16 << 10;

/// Room (bytes) that a data set takes besides its samples.
const PER_SET: usize = 1 << 20;

/// What is captured. The one list of these options: the command line (`tdcr capture`) and Python (`Rig.capture`) take their names
/// and types from it, and the former its documentation. In JSON a field has the name of its option.
#[derive(Clone, Debug, PartialEq, Args, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct CaptureSettings {
    /// Number of commands, split 80/10/10 into train, val and test; of fewer than 10 one tests and one validates, as far as they go
    #[arg(long, default_value_t = Self::default().commands, value_name = "N", value_parser = amount)]
    pub commands: usize,
    /// Commands (m, one for each tendon) to capture in place of random ones; `commands` is not looked at then
    #[arg(skip)]
    pub given: Option<Vec<Vec<f64>>>,
    /// Capture each command so many times: all of them once, then all again, so that repeats lie far apart in time. A later run
    /// with more adds to the set
    #[arg(long, default_value_t = 1, value_name = "N", value_parser = amount)]
    pub repeat: usize,
    /// Capture all commands, with their repeats, under one payload at the tip after another (kg, separated by commas; 0 for none).
    /// Before each the rig is released and waits until it hangs there; a simulated one hangs it itself. Payloads are part of
    /// the samples' conditions
    #[arg(long, value_name = "KG,...", value_delimiter = ',')]
    pub payloads: Vec<f64>,
    /// Points per cloud
    #[arg(long, default_value_t = Self::default().points, value_name = "N", value_parser = amount)]
    pub points: usize,
    /// Edge of the voxels that thin the fused clouds (m)
    #[arg(long, default_value_t = Self::default().voxel, value_name = "M", value_parser = positive, allow_hyphen_values = true)]
    pub voxel: f64,
    /// Seed of commands, samples and splits
    #[arg(long, default_value_t = 0)]
    pub seed: u64,
    /// Look at the robot in its home pose after so many samples, and say how far it drifts
    #[arg(long, default_value_t = Self::default().sentinel_every, value_name = "N", value_parser = amount)]
    pub sentinel_every: usize,
    /// Folder of masks that another program has written, DIR/camera0/000000.png and so on: they make the clouds, in place of
    /// the masks of the rig's file
    #[arg(long, value_name = "DIR")]
    pub masks: Option<PathBuf>,
    /// Write no log. Else DIR/log.mcap has all that servos and cameras did, log-2.mcap where the capture is resumed
    #[arg(long)]
    pub no_log: bool,
}

/// 200 clouds of 10,000 points, with a look at the robot at home after every 25.
impl Default for CaptureSettings {
    fn default() -> Self {
        Self {
            commands: 200,
            given: None,
            repeat: 1,
            payloads: Vec::new(),
            points: 10_000,
            voxel: SessionSettings::default().voxel_size,
            seed: 0,
            sentinel_every: 25,
            masks: None,
            no_log: false,
        }
    }
}

impl CaptureSettings {
    /// Commands that are captured, each counted once.
    pub fn distinct(&self) -> usize {
        self.given.as_ref().map_or(self.commands, Vec::len)
    }

    /// Samples of the data set.
    pub fn samples(&self) -> usize {
        self.samples_of_part().saturating_mul(self.parts())
    }

    /// Samples under each payload.
    pub fn samples_of_part(&self) -> usize {
        self.distinct().saturating_mul(self.repeat)
    }

    /// Parts between which the payload changes.
    pub fn parts(&self) -> usize {
        self.payloads.len().max(1)
    }

    /// The part that a sample belongs to.
    pub fn part_of(&self, index: usize) -> usize {
        index / self.samples_of_part().max(1)
    }

    /// What hangs at the tip in a part (kg); `None` where samples have no payload.
    pub fn payload_in(&self, part: usize) -> Option<f64> {
        self.payloads.get(part).copied()
    }

    /// What the robot carries in a part, and in the others.
    ///
    /// # Errors
    /// [`LoadsError`] for a negative or non-finite payload.
    pub fn loads_in(&self, part: usize) -> Result<(Loads, Vec<Loads>), LoadsError> {
        let loads = |part| Loads::payload(self.payload_in(part).unwrap_or(0.0));
        let others = (0..self.parts()).filter(|&other| other != part);
        Ok((loads(part)?, others.map(loads).collect::<Result<_, _>>()?))
    }

    /// What the rig of a file is going to do in a part.
    ///
    /// # Errors
    /// As [`Program::new`], and [`loads_in`](Self::loads_in).
    pub fn program(&self, file: &RigFile, part: usize) -> Result<Program, CaptureStop> {
        let (loads, others) = self.loads_in(part)?;
        let program = Program::new(file, self.seed)?;
        Ok(program
            .carrying(loads, &others)
            .map_err(CaptureError::from)?)
    }

    /// Number of commands after which they come again; `None` where each is captured once.
    pub fn cycle(&self) -> Option<usize> {
        (self.given.is_some() || self.repeat > 1 || self.parts() > 1).then(|| self.distinct())
    }

    /// Where sample `index` is taken.
    ///
    /// # Errors
    /// As [`Program::draw`].
    pub fn place(&self, index: usize, program: &mut Program) -> Result<Place, PlanError> {
        let command = index % self.distinct().max(1);
        Ok(match &self.given {
            Some(given) => program.command(&given[command])?.into(),
            None => program.draw(command as u64)?.shape.into(),
        })
    }

    /// Refuses payloads that make no sense, and commands that were given and that the rig of a file could not take, under each of
    /// the payloads, before anything moves. Those that chance draws are right by themselves.
    ///
    /// # Errors
    /// [`CaptureStop::Payloads`]; [`CaptureStop::Given`] for the first command.
    pub fn check(&self, file: &RigFile) -> Result<(), PipelineError> {
        self.check_payloads()?;
        let Some(given) = &self.given else {
            return Ok(());
        };
        for part in 0..self.parts() {
            let mut program = self.program(file, part)?;
            for (row, values) in given.iter().enumerate() {
                program.given(values).map_err(|error| CaptureStop::Given {
                    row,
                    payload: self.payload_in(part),
                    error,
                })?;
            }
        }
        Ok(())
    }

    /// Refuses payloads that are negative or not finite, that come twice, or that are all 0.
    ///
    /// # Errors
    /// [`CaptureStop::Payloads`].
    pub fn check_payloads(&self) -> Result<(), CaptureStop> {
        let payloads = &self.payloads;
        for (part, mass) in payloads.iter().enumerate() {
            Loads::payload(*mass)?;
            if payloads[..part].contains(mass) {
                return Err(CaptureStop::Payloads {
                    found: format!("{mass} kg twice"),
                });
            }
        }
        if !payloads.is_empty() && payloads.iter().all(|&mass| mass == 0.0) {
            return Err(CaptureStop::Payloads {
                found: "0 kg alone".to_owned(),
            });
        }
        Ok(())
    }

    /// Room on the disk (bytes) that so many samples still to come take at the most, with those that are there, for so many motors.
    pub(super) fn bytes(&self, missing: usize, motors: usize) -> u64 {
        // Staged: a file for each, of points, colours and command, and a line of the journal. In the end the shards: points twice,
        // colours, and the command twice.
        let [staged, sharded] = [15, 27].map(|bytes| bytes * self.points + 8 * motors);
        (missing * (staged + PER_SAMPLE) + self.samples() * sharded + PER_SET) as u64
    }

    /// The end of a capture that has `kept` samples in the folder `dir`.
    pub(super) fn ended(&self, ended: PipelineError, kept: usize, dir: &Path) -> PipelineError {
        CaptureStop::Ended {
            ended: Box::new(ended),
            kept,
            count: self.samples(),
            path: dir.to_owned(),
        }
        .into()
    }

    pub(super) fn meta(&self, rig: &Rig) -> Meta {
        let RigSpec {
            name,
            base,
            servos,
            cameras,
            masks,
            commands,
            simulation,
            ..
        } = rig.spec();
        let sensors: Vec<_> = cameras
            .iter()
            .map(|camera| (&camera.serial, camera.sensor))
            .collect();
        // What a data set depends on: ports and speeds are none of it.
        let mut settings = json!({
            "ids": servos.ids,
            "directions": servos.directions,
            "spool_radius": servos.spool_radius,
            "home_tension": servos.home_tension,
            "limits": servos.limits,
            "cameras": sensors,
            "masks": masks,
            "commands": commands,
        });
        if let (Some(scene), Some(around)) = (&rig.file().scene, &rig.spec().scene) {
            settings["scene"] = json!({ "obstacles": scene, "clearance": around.clearance });
        }
        if servos.link == ServoLink::Simulated && simulation.scene.is_some() {
            settings["simulation"] = json!({ "scene": rig.file().simulated_scene });
        }
        if self.masks.is_some() {
            settings["masks_by"] = json!("another program");
        }
        if self.parts() > 1 {
            // Samples of a payload follow those of another: a set of several does not grow.
            settings["samples_of_payload"] = json!(self.samples_of_part());
        }
        if let Some(given) = &self.given {
            let rows = given.iter().map(|row| hash_of(row));
            settings["given_commands"] = json!({
                "count": given.len(),
                "hash": format!("{:016x}", hash_all(&rows.collect::<Vec<_>>())),
            });
        }
        Meta {
            format: Meta::FORMAT,
            tdcr_version: env!("CARGO_PKG_VERSION").to_owned(),
            seed: self.seed,
            count: self.samples(),
            motors: rig.winches().len(),
            points_per_cloud: self.points,
            samples_per_shard: SAMPLES_PER_SHARD,
            origin: Origin::Recorded {
                recording: Recording {
                    rig: name.clone(),
                    robot: rig.robot().spec().clone(),
                    base: *base,
                    voxel_size: self.voxel,
                    cycle: self.cycle(),
                    payloads: self.payloads.clone(),
                    settings,
                },
            },
        }
    }

    /// The folder of masks, where another program makes them, once it is known to have one for each of these samples and so
    /// many cameras.
    ///
    /// # Errors
    /// [`CaptureError::Mask`] for the first that is missing.
    pub fn mask_folder(
        &self,
        cameras: usize,
        samples: impl IntoIterator<Item = usize>,
    ) -> Result<Option<MaskFolder>, CaptureError> {
        let masks = self.masks.as_ref().map(MaskFolder::new);
        if let Some(masks) = &masks {
            masks.must_have(cameras, samples)?;
        }
        Ok(masks)
    }
}

/// A hash of a command's numbers.
fn hash_of(command: &[f64]) -> u64 {
    let bits = command.iter().map(|value| value.to_bits());
    hash_all(&bits.collect::<Vec<_>>())
}
