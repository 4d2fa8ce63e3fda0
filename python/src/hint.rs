//! How to go on after an error, in the words of the Python package: by which argument, by which function.
//!
//! The libraries say what they found; what to write against it in Python is known here alone.

use tdcr::control::plan::follow_the_leader::DeploymentError;
use tdcr::control::plan::{Limit, PlanError, Refusal as PlaceRefusal};
use tdcr::hw::capture::CaptureError;
use tdcr::hw::rig::RigError;
use tdcr::learn::data::{DataError, MergeError};
use tdcr::learn::train::TrainError;
use tdcr::pages::PageError;
use tdcr::pipeline::recording::RecordingFileError;
use tdcr::pipeline::{CaptureStop, CompareError, Divergence, PipelineError, TrainRunError};
use tdcr::study::{Refusal, StudyError};

const GO_ON: &str = "the same call goes on";
const IN_USE: &str = "wait for its end, or choose another folder";

/// What to do about a page that was not written.
pub fn of_page(error: &PageError) -> Option<String> {
    match error {
        PageError::Stage(error) => of_stage(error),
        PageError::OtherCount { found, .. } => {
            Some(format!("ask for samples={found}, or choose another folder"))
        }
        _ => None,
    }
}

/// What to do about a stage that ended early.
pub fn of_stage(error: &PipelineError) -> Option<String> {
    match error {
        PipelineError::Interrupted => Some(GO_ON.to_owned()),
        PipelineError::InUse { .. } => Some(IN_USE.to_owned()),
        PipelineError::Data(error) => of_data(error),
        PipelineError::Train(error) => of_run(error),
        PipelineError::Compare(error) => of_comparison(error),
        PipelineError::Capture(CaptureStop::Rig(CaptureError::Rig(error))) => of_rig(error),
        PipelineError::Capture(CaptureStop::Ended { ended, .. })
            if matches!(**ended, PipelineError::Capture(CaptureStop::NotHung { .. })) =>
        {
            Some("give hang, a function that has it done".to_owned())
        }
        PipelineError::Capture(CaptureStop::Ended { .. }) => Some(GO_ON.to_owned()),
        _ => None,
    }
}

fn of_run(error: &TrainRunError) -> Option<String> {
    let hint = match error {
        TrainRunError::OwnSampler { .. } => "leave out sampler and what belongs to it",
        TrainRunError::OtherRun { .. } => {
            "choose another folder, where init=MODEL starts at the network of this run, or remove this one"
        }
        TrainRunError::ModelInTheWay { .. } => "choose another folder, or move it away",
        TrainRunError::Diverged(run) => return Some(of_divergence(run)),
        TrainRunError::Train(TrainError::BatchNorm) => {
            "train it in PyTorch, by `python -m tdcr.torch.train`, or take layers=\"residual\""
        }
        _ => return None,
    };
    Some(hint.to_owned())
}

fn of_divergence(run: &Divergence) -> String {
    match (run.lower_rate(), &run.model) {
        (None, _) => "distil into another folder with another seed".to_owned(),
        (Some(rate), None) => {
            format!("train into another folder with a lower learning_rate, such as {rate:.1e}")
        }
        (Some(rate), Some((path, _))) => format!(
            "train into another folder with a lower learning_rate, such as {rate:.1e}; init=\"{}\" goes on from the best network",
            path.display()
        ),
    }
}

fn of_comparison(error: &CompareError) -> Option<String> {
    let hint = match error {
        CompareError::NothingInCommon { .. } => {
            "tolerance allows larger differences, match=\"index\" pairs samples by their places"
        }
        CompareError::NoRobot { .. } => "name the robot, or a second data set",
        _ => return None,
    };
    Some(hint.to_owned())
}

/// What to do about a data set that was refused.
pub fn of_data(error: &DataError) -> Option<String> {
    let hint = match error {
        DataError::NoDataSet { .. } => {
            "tdcr.collect makes one, tdcr.import_clouds makes one of clouds"
        }
        DataError::Unmerged { .. } => "tdcr.merge puts them together",
        DataError::Merge(error) => match &**error {
            MergeError::NotAPart { .. } | MergeError::Missing { .. } => {
                "tdcr.collect(part=\"I/N\") makes part I, with the arguments of the others"
            }
            _ => return None,
        },
        _ => return None,
    };
    Some(hint.to_owned())
}

/// What to do about a study that is not done.
pub fn of_study(error: &StudyError) -> Option<String> {
    let hint = match error {
        StudyError::Interrupted => GO_ON,
        StudyError::InUse { .. } => IN_USE,
        StudyError::OtherStudy { .. } => "choose another folder, or remove it",
        StudyError::NoPart { .. } => "tdcr.study(..., part=\"I/N\") makes one",
        StudyError::File { refusal, .. } => match &**refusal {
            Refusal::NoModel { .. } => "tdcr.train makes model.safetensors in its folder",
            _ => return None,
        },
        _ => return None,
    };
    Some(hint.to_owned())
}

/// What to do about a plan that was not found.
pub fn of_plan(error: &PlanError) -> Option<String> {
    let refusal = match error {
        PlanError::NotFound { limit, halts, .. } => {
            let more = match limit {
                Limit::Nodes => "nodes= allows more nodes",
                Limit::Seconds => "seconds= allows more time",
            };
            let room = (halts.near > 0).then_some(", a smaller clearance= more room");
            let room = room.unwrap_or_default();
            return Some(format!("{more}{room}, another seed= searches elsewhere"));
        }
        PlanError::Start(refusal) | PlanError::Goal(refusal) => refusal,
        PlanError::NoGoal { last, .. } => last.as_ref()?,
        _ => return None,
    };
    let hint = match refusal {
        PlaceRefusal::Obstacle { .. } => "clearance= says how near it may come",
        PlaceRefusal::Touching { .. } => {
            "Scene.with_self_contact(None) lets discs pass through each other"
        }
        PlaceRefusal::Tension { .. } => "min_tension= and max_tension= are the limits",
        PlaceRefusal::Unsettled => "tdcr.settle shows where the robot comes to rest",
    };
    Some(hint.to_owned())
}

/// What to do about a deployment that does not come to its end.
pub fn of_deployment(error: &DeploymentError) -> Option<String> {
    let hint = match error {
        DeploymentError::TooLong { .. } => {
            "points of the curve are in metres, and end where the tip is to end"
        }
        DeploymentError::Unsettled { .. } => {
            "more stages= go in smaller steps; where obstacles are in the way, move them or the curve"
        }
        _ => return None,
    };
    Some(hint.to_owned())
}

/// What to do about a recording that was refused.
pub fn of_recording(error: &RecordingFileError) -> Option<String> {
    match error {
        RecordingFileError::BadRows { .. } => Some("skip_bad_rows=True leaves them out".to_owned()),
        RecordingFileError::DataSet(error) => of_data(error),
        _ => None,
    }
}

/// What to do about a rig that does not do what it should.
pub fn of_rig(error: &RigError) -> Option<String> {
    let hint = match error {
        RigError::NotHomed(_) => "Rig.home homes a rig",
        RigError::NotRecalled(_) => {
            "put the robot into its home pose, and call Rig.home without recall"
        }
        _ => return None,
    };
    Some(hint.to_owned())
}
