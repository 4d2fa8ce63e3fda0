//! Whether a predictor and a data set are of the same robot.

use tdcr_learn::data::Subject;

use super::EvalError;

/// Refuses to score a model of one subject on clouds of another.
pub(super) fn require_same(model: &Subject, data: &Subject) -> Result<(), EvalError> {
    if model.robot != data.robot {
        return Err(EvalError::OtherRobot {
            model: model.robot.name.clone(),
            data: data.robot.name.clone(),
        });
    }
    if model.base != data.base {
        return Err(EvalError::OtherBase {
            model: model.base,
            data: data.base,
        });
    }
    if model.scene != data.scene {
        let [model, data] = [model, data].map(|subject| subject.scene.obstacles().len());
        return Err(EvalError::OtherScene { model, data });
    }
    if model.obstacles != data.obstacles {
        let (model, data) = (model.obstacles, data.obstacles);
        return Err(EvalError::OtherObstacles { model, data });
    }
    let covered = match (model.payload, data.payload) {
        (Some(model), Some(data)) => model.covers(data),
        (model, data) => model == data,
    };
    if !covered {
        return Err(EvalError::OtherPayload {
            model: model.payload,
            data: data.payload,
        });
    }
    Ok(())
}
