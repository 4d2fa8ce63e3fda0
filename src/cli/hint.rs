//! How to go on after an error, in the words of the command line: by which option, by which command.
//!
//! The libraries say what they found; what to type against it is known here alone.

use std::error::Error;

use tdcr::control::plan::follow_the_leader::DeploymentError;
use tdcr::control::plan::{Limit, PlanError, Refusal as PlaceRefusal};
use tdcr::hw::capture::CaptureError;
use tdcr::hw::log::LogError;
use tdcr::hw::recorded::RecordedError;
use tdcr::hw::rig::RigError;
use tdcr::learn::data::{DataError, MergeError};
use tdcr::learn::options::OptionsError;
use tdcr::learn::train::TrainError;
use tdcr::pages::PageError;
use tdcr::pipeline::recording::{CalibrateError, RecordingFileError};
use tdcr::pipeline::{CaptureStop, CompareError, Divergence, PipelineError, TrainRunError};
use tdcr::study::{Refusal, StudyError};

const GO_ON: &str = "run the same command again to go on";
const IN_USE: &str = "wait for its end, or choose another folder (--out)";

/// What to do about an error; nothing where its text says all.
pub(super) fn hint(error: &anyhow::Error) -> Option<String> {
    error.chain().find_map(of_cause)
}

fn of_cause(cause: &(dyn Error + 'static)) -> Option<String> {
    let page = cause.downcast_ref().and_then(of_page);
    page.or_else(|| cause.downcast_ref().and_then(of_stage))
        .or_else(|| cause.downcast_ref().and_then(of_study))
        .or_else(|| cause.downcast_ref().and_then(of_data))
        .or_else(|| cause.downcast_ref().and_then(of_options))
        .or_else(|| cause.downcast_ref().and_then(of_training))
        .or_else(|| cause.downcast_ref().and_then(of_calibration))
        .or_else(|| cause.downcast_ref().and_then(of_recording))
        .or_else(|| cause.downcast_ref().and_then(of_capture))
        .or_else(|| cause.downcast_ref().and_then(of_rig))
        .or_else(|| cause.downcast_ref().and_then(of_recorded))
        .or_else(|| cause.downcast_ref().and_then(of_log))
        .or_else(|| cause.downcast_ref().and_then(of_plan))
        .or_else(|| cause.downcast_ref().and_then(of_deployment))
}

fn of_plan(error: &PlanError) -> Option<String> {
    let hint = match error {
        PlanError::NotFound { limit, halts, .. } => {
            let more = match limit {
                Limit::Nodes => "--nodes allows more nodes",
                Limit::Seconds => "--seconds allows more time",
            };
            let room = (halts.near > 0).then_some(", a smaller --clearance more room");
            format!(
                "{more}{}, another --seed searches elsewhere",
                room.unwrap_or_default()
            )
        }
        PlanError::Start(refusal) | PlanError::Goal(refusal) => return of_place(refusal),
        PlanError::NoGoal { last, .. } => return last.as_ref().and_then(of_place),
        _ => return None,
    };
    Some(hint)
}

/// What to do about a place where a plan may not be.
fn of_place(refusal: &PlaceRefusal) -> Option<String> {
    let hint = match refusal {
        PlaceRefusal::Obstacle { .. } => "--clearance says how near it may come",
        PlaceRefusal::Touching { .. } => {
            "`self_contact = \"ignored\"` in the scene lets discs pass through each other"
        }
        PlaceRefusal::Tension { .. } => "--min-tension and --max-tension are the limits",
        PlaceRefusal::Unsettled => "tdcr settle shows where the robot comes to rest",
    };
    Some(hint.to_owned())
}

fn of_deployment(error: &DeploymentError) -> Option<String> {
    let hint = match error {
        DeploymentError::TooLong { .. } => {
            "points of --along are in metres, and end where its tip is to end"
        }
        DeploymentError::Unsettled { .. } => {
            "more --stages go in smaller steps; where obstacles are in the way, move them or the curve"
        }
        _ => return None,
    };
    Some(hint.to_owned())
}

fn of_page(error: &PageError) -> Option<String> {
    Some(match error {
        PageError::Stage(error) => return of_stage(error),
        PageError::SeveralSets { .. } => "--out names the file".to_owned(),
        PageError::OtherCount { found, .. } => {
            format!("say --samples {found}, or choose another folder (--out)")
        }
        _ => return None,
    })
}

fn of_stage(error: &PipelineError) -> Option<String> {
    match error {
        PipelineError::Interrupted => Some(GO_ON.to_owned()),
        PipelineError::InUse { .. } => Some(IN_USE.to_owned()),
        PipelineError::Data(error) => of_data(error),
        PipelineError::Train(error) => of_run(error),
        PipelineError::Compare(error) => of_comparison(error),
        PipelineError::Capture(error) => of_capture_stop(error),
        _ => None,
    }
}

fn of_run(error: &TrainRunError) -> Option<String> {
    Some(match error {
        TrainRunError::Options(error) => return of_options(error),
        TrainRunError::OwnSampler { .. } => {
            "leave out --sampler, --sampler-steps, --sampler-power, --sampler-tolerance and --sampler-denoise"
                .to_owned()
        }
        TrainRunError::OtherRun { .. } => {
            "choose another folder (--out), where --init MODEL starts at the network of this run, or remove this one"
                .to_owned()
        }
        TrainRunError::ModelInTheWay { .. } => {
            "choose another folder (--out), or move it away".to_owned()
        }
        TrainRunError::Diverged(run) => of_divergence(run),
        TrainRunError::Train(error) => return of_training(error),
        _ => return None,
    })
}

fn of_options(error: &OptionsError) -> Option<String> {
    matches!(error, OptionsError::Endless { .. }).then(|| "say --steps N".to_owned())
}

fn of_divergence(run: &Divergence) -> String {
    let Some(lower) = run.lower_rate() else {
        return "distil into another folder (--out) with another --seed".to_owned();
    };
    let again = format!(
        "train into another folder (--out) with a lower --learning-rate than {}, such as {lower:.1e}",
        run.learning_rate
    );
    match &run.model {
        None => again,
        Some((path, _)) => format!(
            "{again}. To go on from the best network, other options as they were: tdcr train --init {} \
             --learning-rate {lower:.1e} --out NEW",
            path.display()
        ),
    }
}

fn of_training(error: &TrainError) -> Option<String> {
    matches!(error, TrainError::BatchNorm).then(|| {
        "train it in PyTorch, by `python -m tdcr.torch.train` with the same options, or take --layers residual"
            .to_owned()
    })
}

fn of_comparison(error: &CompareError) -> Option<String> {
    let hint = match error {
        CompareError::NothingInCommon { .. } => {
            "--tolerance allows larger differences, --match index pairs samples by their places"
        }
        CompareError::NoRobot { .. } => "name the robot (--robot), or a second data set",
        _ => return None,
    };
    Some(hint.to_owned())
}

fn of_capture_stop(error: &CaptureStop) -> Option<String> {
    match error {
        CaptureStop::Rig(error) => of_capture(error),
        CaptureStop::Given { .. }
        | CaptureStop::Payloads { .. }
        | CaptureStop::Loads(_)
        | CaptureStop::NotHung { .. } => None,
        CaptureStop::Ended { ended, .. } => {
            let way = of_stage(ended).filter(|_| !ended.is_interruption());
            let ways: Vec<String> = way.into_iter().chain([GO_ON.to_owned()]).collect();
            Some(ways.join(", and "))
        }
    }
}

fn of_data(error: &DataError) -> Option<String> {
    Some(match error {
        DataError::NoDataSet { path } => format!(
            "`tdcr collect --out {}` makes one, `tdcr data import` makes one of clouds",
            path.display()
        ),
        DataError::Unmerged { .. } => {
            "`tdcr data merge PARTS... --out DIR` puts them together".to_owned()
        }
        DataError::Merge(error) => match &**error {
            MergeError::NotAPart { path, .. } => {
                format!(
                    "`tdcr collect --part I/N --out {}` makes one",
                    path.display()
                )
            }
            MergeError::Missing { of, .. } => {
                format!("`tdcr collect --part I/{of}` makes part I, with the options of the others")
            }
            _ => return None,
        },
        _ => return None,
    })
}

fn of_study(error: &StudyError) -> Option<String> {
    let hint = match error {
        StudyError::Interrupted => GO_ON,
        StudyError::InUse { .. } => IN_USE,
        StudyError::OtherStudy { .. } => "choose another folder (--out), or remove it",
        StudyError::NoPart { .. } => "`tdcr study FILE --part I/N --out DIR` makes one",
        StudyError::File { refusal, .. } => match &**refusal {
            Refusal::NoModel { .. } => "`tdcr train --out DIR` makes DIR/model.safetensors",
            _ => return None,
        },
        _ => return None,
    };
    Some(hint.to_owned())
}

fn of_calibration(error: &CalibrateError) -> Option<String> {
    match error {
        CalibrateError::File(error) => of_recording(error),
        _ => None,
    }
}

fn of_recording(error: &RecordingFileError) -> Option<String> {
    match error {
        RecordingFileError::BadRows { .. } => Some("--skip-bad-rows leaves them out".to_owned()),
        RecordingFileError::DataSet(error) => of_data(error),
        RecordingFileError::Log(error) => of_recorded(error),
        _ => None,
    }
}

fn of_recorded(error: &RecordedError) -> Option<String> {
    match error {
        RecordedError::Log(error) => of_log(error),
        _ => None,
    }
}

fn of_capture(error: &CaptureError) -> Option<String> {
    match error {
        CaptureError::Rig(error) => of_rig(error),
        _ => None,
    }
}

fn of_rig(error: &RigError) -> Option<String> {
    match error {
        RigError::NotHomed(_) => Some("tdcr home --rig FILE homes a rig".to_owned()),
        RigError::NotRecalled(_) => {
            Some("put the robot into its home pose and use --here".to_owned())
        }
        RigError::Log(error) => of_log(error),
        _ => None,
    }
}

fn of_log(error: &LogError) -> Option<String> {
    match error {
        LogError::Compressed { .. } => {
            Some("`mcap compress --compression none` undoes it".to_owned())
        }
        _ => None,
    }
}
