//! From a configuration's number to its row.

use serde_json::Value;
use tdcr_sim::robot::Robot;
use tdcr_sim::scene::Scene;

use super::measure::{Settled, settle};
use super::solver::Solver;
use crate::pipeline::Probe;
use crate::study::outputs::columns::{SETTLED, cell, columns, needs_tip};
use crate::study::outputs::table::Cell;
use crate::study::spec::case;
use crate::study::spec::cases::{Case, Cases};
use crate::study::spec::variable::Setting;
use crate::study::spec::{Output, Study};

/// Computes rows one after another; configurations of one robot share its compilation.
pub(super) struct Worker<'a> {
    study: &'a Study,
    cases: &'a Cases<'a>,
    columns: usize,
    robot: Option<Compiled>,
}

/// A robot and its solver, or why there is none, and the values that it was made of.
type Compiled = (Vec<Value>, Result<Ready, String>);

/// What configurations are computed with.
struct Ready {
    robot: Robot,
    scene: Scene,
    settler: Solver,
    /// The model that is tried on the robot.
    probe: Option<Probe>,
}

impl<'a> Worker<'a> {
    pub fn new(study: &'a Study, cases: &'a Cases<'a>) -> Self {
        Self {
            study,
            cases,
            columns: columns(study, cases).len(),
            robot: None,
        }
    }

    /// Row `index`: what cannot be computed is empty, and the status says why.
    pub fn row(&mut self, index: usize) -> Vec<Cell> {
        let case = self.cases.case(index);
        let mut cells = Vec::with_capacity(self.columns);
        cells.push(Cell::Whole(i64::try_from(index).unwrap_or(i64::MAX)));
        let shown = self.study.levels.iter().map(|levels| &levels.what);
        for what in shown.chain(self.study.scalars().map(|sampled| &sampled.what)) {
            let setting = case.settings.iter().rev().find(|setting| setting.0 == what);
            cells.push(setting.map_or(Cell::Empty, |setting| cell(&setting.1)));
        }
        let width = case.command.as_ref().map_or(0, Vec::len);
        let rest = self.outcome(&case, width, index).unwrap_or_else(|reason| {
            let mut rest = vec![Cell::Empty; width];
            rest.push(Cell::Text(reason));
            rest
        });
        cells.extend(rest);
        cells.resize(self.columns, Cell::Empty);
        cells
    }

    /// The command where it is sampled, in `width` cells, the status and the outputs.
    fn outcome(&mut self, case: &Case, width: usize, index: usize) -> Result<Vec<Cell>, String> {
        let study = self.study;
        let Ready {
            robot,
            scene,
            settler,
            probe,
        } = self.compiled(&case.settings)?;
        let command = case::command(robot, &case.settings, case.command.as_deref())?;
        let loads = case::loads(robot, &case.settings)?;
        let mut cells: Vec<Cell> = Vec::with_capacity(width);
        if width > 0 {
            cells.extend(command.as_slice().iter().copied().map(Cell::Number));
            cells.resize(width, Cell::Empty);
        }
        let seconds = settle(settler, &command, &loads)?;
        let found = settler.found();
        let equilibrium = &found.equilibrium;
        if let Some(failure) = equilibrium.failure(robot, &command) {
            cells.push(Cell::Text(failure.to_string()));
            return Ok(cells);
        }
        // Before all else, which then is not computed in vain.
        let sample = (index % study.samples()) as u64;
        let probed = (probe.as_ref())
            .map(|probe| probe.score(&command, &loads, equilibrium, sample))
            .transpose()
            .map_err(|error| error.to_string())?;
        cells.push(Cell::Text(SETTLED.to_owned()));
        // What the settler knows of this equilibrium, before it settles for other outputs.
        let (stiffness, clearance) = (
            (study.want.contains(&Output::Stability))
                .then(|| settler.smallest_stiffness(&command, &loads)),
            (study.want.contains(&Output::Contact)).then(|| settler.clearance()),
        );
        let needs = |want: &Output| {
            matches!(
                want,
                Output::Compliance | Output::Manipulability | Output::Force
            )
        };
        let derivatives = match study.want.iter().any(needs) {
            true => settler.sensitivity(&command, &loads),
            false => None,
        };
        let settled = Settled {
            study,
            robot,
            scene,
            command: &command,
            loads: &loads,
            found: &found,
            seconds,
            probed,
            stiffness: stiffness.unwrap_or(f64::NAN),
            clearance: clearance.unwrap_or(f64::NAN),
        };
        let tip = needs_tip(study).then_some(Output::Tip);
        for want in tip.into_iter().chain(study.want.iter().copied()) {
            cells.extend(settled.cells(want, settler, derivatives.as_ref()));
        }
        Ok(cells)
    }

    /// The robot of the settings and what is around it, its solver and its model.
    fn compiled(&mut self, settings: &[Setting]) -> Result<&mut Ready, String> {
        let of_robot = settings.iter().filter(|setting| setting.0.is_of_robot());
        let key: Vec<Value> = of_robot.map(|setting| setting.1.clone()).collect();
        if self.robot.as_ref().is_none_or(|(of, _)| *of != key) {
            self.robot = Some((key, ready(self.study, settings)));
        }
        match &mut self.robot {
            Some((_, Ok(ready))) => Ok(ready),
            Some((_, Err(reason))) => Err(reason.clone()),
            None => Err("there is no robot".to_owned()),
        }
    }
}

/// What the configurations of some settings are computed with.
fn ready(study: &Study, settings: &[Setting]) -> Result<Ready, String> {
    let robot = case::robot(study, settings)?;
    let models = study.models.as_ref();
    let probe = models.map(|models| models.probe(settings, &robot, study.seed));
    let scene = case::scene(study, settings)?;
    Ok(Ready {
        settler: Solver::new(&robot, &scene),
        probe: probe.transpose()?,
        robot,
        scene,
    })
}
