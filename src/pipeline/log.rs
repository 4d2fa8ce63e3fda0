//! The log of a training run: a CSV file, and the same as TensorBoard's event file.
//!
//! The state holds all that the CSV says (losses, norms, validations), so a run that is resumed writes it anew up to its
//! state, and what was logged after the state, whose steps are taken again, is gone. The events have wall-clock times that no
//! state knows: they are cut after the state's step. Neither is read back. A run that is given more steps continues from its
//! state on the schedule of the new length, and its settings keep the earlier one. A state within a leap of the loss is not
//! saved, so that the one on disk can be continued from.

use std::fs::File;
use std::io::{self, Write};
use std::path::{Path, PathBuf};

use tdcr_base::files::write_atomically;
use tdcr_learn::train::Trainer;

use super::PipelineError;
use super::events::EventFile;

/// Steps between two rows; there is one more at each validation.
const STEPS_PER_ROW: u64 = 10;

/// What is logged at a step.
struct Row {
    step: u64,
    /// Mean loss over the steps since the row before.
    loss: f64,
    /// Mean norm of the gradient over these steps, before clipping.
    gradient_norm: f64,
    learning_rate: f64,
    /// Chamfer distance (m²), where the step was validated.
    validation_cd: Option<f64>,
}

/// The open log of a run.
pub(super) struct RunLog {
    /// Square of the length (m) that distances of validations are in.
    area: f64,
    csv: File,
    events: EventFile,
    paths: [PathBuf; 2],
    /// Step up to which both files are written.
    written: u64,
}

impl RunLog {
    /// Brings the log in the folder `run` to where `trainer` stands; `scale` (m) is that of the data.
    pub fn open(run: &Path, trainer: &Trainer, scale: f64) -> Result<Self, PipelineError> {
        let paths = ["log.csv", "events.out.tfevents.tdcr"].map(|name| run.join(name));
        let area = scale * scale;
        let taken = trainer.steps_taken();
        let csv = write_atomically(&paths[0], |csv| {
            writeln!(csv, "step,loss,gradient_norm,learning_rate,validation_cd")?;
            rows(trainer, area, 0).try_for_each(|row| row.write_csv(csv))
        })
        .and_then(|()| File::options().append(true).open(&paths[0]))
        .map_err(fail(&paths[0]))?;
        let (mut events, last) = EventFile::open(&paths[1], taken).map_err(fail(&paths[1]))?;
        rows(trainer, area, last)
            .try_for_each(|row| row.write_event(&mut events))
            .map_err(fail(&paths[1]))?;
        Ok(Self {
            area,
            csv,
            events,
            paths,
            written: taken,
        })
    }

    /// Logs what was done since. To be called when a step, and the validation due after it, is done.
    pub fn catch_up(&mut self, trainer: &Trainer) -> Result<(), PipelineError> {
        for row in rows(trainer, self.area, self.written) {
            row.write_csv(&mut self.csv).map_err(fail(&self.paths[0]))?;
            row.write_event(&mut self.events)
                .map_err(fail(&self.paths[1]))?;
        }
        self.written = trainer.steps_taken();
        Ok(())
    }

    /// Flushes the log to the disk.
    pub fn sync(&self) -> Result<(), PipelineError> {
        self.csv.sync_data().map_err(fail(&self.paths[0]))?;
        self.events.sync().map_err(fail(&self.paths[1]))
    }
}

fn fail(path: &Path) -> impl FnOnce(io::Error) -> PipelineError {
    move |source| PipelineError::Write {
        path: path.to_owned(),
        source,
    }
}

/// The rows after step `after`, up to where the trainer stands.
fn rows(trainer: &Trainer, area: f64, after: u64) -> impl Iterator<Item = Row> {
    (after + 1..=trainer.steps_taken()).filter_map(move |step| row(trainer, area, step))
}

/// The row of a step, if it has one.
fn row(trainer: &Trainer, area: f64, step: u64) -> Option<Row> {
    let validations = trainer.validations();
    let before = validations.partition_point(|(validated, _)| *validated < step);
    let validation = validations
        .get(before)
        .filter(|(validated, _)| *validated == step);
    if !step.is_multiple_of(STEPS_PER_ROW) && validation.is_none() {
        return None;
    }
    let validated = before.checked_sub(1).map_or(0, |last| validations[last].0);
    let start = validated.max((step - 1) / STEPS_PER_ROW * STEPS_PER_ROW) as usize;
    let mean = |history: &[f32]| {
        let interval = &history[start..step as usize];
        let sum: f64 = interval.iter().copied().map(f64::from).sum();
        sum / interval.len() as f64
    };
    Some(Row {
        step,
        loss: mean(trainer.losses()),
        gradient_norm: mean(trainer.gradient_norms()),
        learning_rate: trainer.settings().learning_rate_at(step),
        validation_cd: validation.map(|(_, distance)| distance * area),
    })
}

impl Row {
    fn write_csv(&self, file: &mut File) -> io::Result<()> {
        let Self {
            step,
            loss,
            gradient_norm,
            learning_rate,
            validation_cd,
        } = self;
        let cd = validation_cd.map_or(String::new(), |cd| format!("{cd:.6e}"));
        // One write for a line, so that no reader sees half of it.
        let line = format!("{step},{loss:.6e},{gradient_norm:.6e},{learning_rate:.6e},{cd}\n");
        file.write_all(line.as_bytes())
    }

    fn write_event(&self, events: &mut EventFile) -> io::Result<()> {
        let mut scalars = vec![
            ("loss", self.loss),
            ("gradient_norm", self.gradient_norm),
            ("learning_rate", self.learning_rate),
        ];
        scalars.extend(self.validation_cd.map(|cd| ("validation_cd", cd)));
        events.add_scalars(self.step, &scalars)
    }
}
