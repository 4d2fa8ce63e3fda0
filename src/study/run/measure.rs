//! What is computed of one configuration.

use std::time::Instant;

use nalgebra::{DMatrix, Matrix3, UnitQuaternion, Vector3};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use tdcr_sim::chain::Configuration;
use tdcr_sim::contact::ContactEquilibrium;
use tdcr_sim::pose::ToolFrame;
use tdcr_sim::robot::{Command, Loads, Robot};
use tdcr_sim::scene::Scene;
use tdcr_sim::sensitivity::Sensitivity;
use tdcr_sim::statics::{Equilibrium, Examined, Stability};

use super::solver::Solver;
use crate::pipeline::Probed;
use crate::study::outputs::table::Cell;
use crate::study::outputs::tip_loop::TipLoop;
use crate::study::spec::{Output, Study};

/// Random poses that equilibria are sought from.
const STARTS: usize = 16;
/// Largest rotation of a joint of a random pose about each axis (rad).
const START_ROTATION: f64 = 0.4;
/// Tips of different equilibria are at least this far apart, as a share of the backbone's length.
const APART: f64 = 1e-5;

/// A settled configuration.
pub(super) struct Settled<'a> {
    pub study: &'a Study,
    pub robot: &'a Robot,
    pub scene: &'a Scene,
    pub command: &'a Command,
    pub loads: &'a Loads,
    pub found: &'a ContactEquilibrium,
    /// Time that settling took (s).
    pub seconds: f64,
    /// What the model scores on it.
    pub probed: Option<Probed>,
    /// Smallest stiffness (N m/rad), if it is wanted.
    pub stiffness: f64,
    /// Smallest gap to obstacles (m), if contact is wanted.
    pub clearance: f64,
}

/// Settles; returns the time that it took (s).
///
/// # Errors
/// What cannot be solved among obstacles, as text.
pub(super) fn settle(
    settler: &mut Solver,
    command: &Command,
    loads: &Loads,
) -> Result<f64, String> {
    let began = Instant::now();
    settler
        .settle(command, loads)
        .map_err(|error| error.to_string())?;
    Ok(began.elapsed().as_secs_f64())
}

impl Settled<'_> {
    /// The cells of an output, as many as it has columns. What has no value is empty.
    pub fn cells(
        &self,
        want: Output,
        settler: &mut Solver,
        derivatives: Option<&Sensitivity>,
    ) -> Vec<Cell> {
        let numbers = |numbers: &[f64]| numbers.iter().copied().map(Cell::Number).collect();
        match want {
            Output::Tip => {
                let tip = self.found.equilibrium.pose().tip();
                let (p, q) = (tip.translation.vector, tip.rotation);
                numbers(&[p.x, p.y, p.z, q.w, q.i, q.j, q.k])
            }
            Output::Deflection => numbers(&self.deflection(settler)),
            Output::Tension => {
                let tensions = || self.found.equilibrium.tendon_tensions.iter().copied();
                let (least, most) = (
                    tensions().fold(f64::INFINITY, f64::min),
                    tensions().fold(f64::NEG_INFINITY, f64::max),
                );
                let margin = self.study.tension_limit.map(|limit| limit - most);
                numbers(&[&[least, most], margin.as_slice()].concat())
            }
            Output::Energy => numbers(&[self.robot.potential_energy(
                self.command,
                self.loads,
                &self.found.equilibrium,
            )]),
            Output::Stability => {
                let stability = self.found.equilibrium.stability.map_or("", Stability::name);
                let examined = self.found.equilibrium.examined.map_or("", Examined::name);
                vec![
                    Cell::Text(stability.to_owned()),
                    Cell::Text(examined.to_owned()),
                    Cell::Number(self.stiffness),
                ]
            }
            Output::Compliance => {
                let axes = derivatives
                    .and_then(|d| tip_compliance(self.robot, d))
                    .map(|c| singular(&c));
                let [least, _, most] = axes.unwrap_or([f64::NAN; 3]);
                numbers(&[least, most, most / least])
            }
            Output::Manipulability => {
                let axes = derivatives
                    .map(|d| ellipsoid(&tip_jacobian(self.robot, d, &self.found.equilibrium)));
                let [least, middle, most] = axes.unwrap_or([f64::NAN; 3]);
                numbers(&[least, middle, most, least * middle * most])
            }
            Output::Force => numbers(
                &derivatives
                    .and_then(|d| self.forces(d))
                    .unwrap_or([f64::NAN; 3]),
            ),
            Output::Contact => self.contact(),
            Output::Equilibria => {
                let (count, apart) = self.equilibria(settler);
                vec![Cell::Whole(count), Cell::Number(apart)]
            }
            Output::Hysteresis => {
                let about = self.study.hysteresis;
                let found = TipLoop::new((self.robot, self.scene), self.command, self.loads, about);
                let numbers_of_loop =
                    found.map(|found| [found.width(), found.area(), found.dissipated]);
                numbers(&numbers_of_loop.unwrap_or([f64::NAN; 3]))
            }
            Output::Cost => {
                let steps = i64::try_from(self.found.equilibrium.iterations).unwrap_or(i64::MAX);
                vec![Cell::Whole(steps), Cell::Number(self.seconds)]
            }
            Output::Model => match &self.probed {
                Some(probed) => numbers(&[
                    probed.distances.cd,
                    probed.distances.emd,
                    probed.tip.unwrap_or(f64::NAN),
                    probed.floor.cd,
                    probed.floor.emd,
                ]),
                None => Vec::new(),
            },
            Output::Workspace | Output::Dexterity => Vec::new(),
        }
    }

    /// Contacts, their largest force and the sum of all (N), deepest penetration and smallest gap (m).
    fn contact(&self) -> Vec<Cell> {
        let contacts = &self.found.contacts;
        let forces = || contacts.iter().map(|contact| contact.force.norm());
        vec![
            Cell::Whole(i64::try_from(contacts.len()).unwrap_or(i64::MAX)),
            Cell::Number(forces().fold(0.0, f64::max)),
            Cell::Number(forces().sum()),
            Cell::Number(self.found.penetration),
            Cell::Number(self.clearance),
        ]
    }

    /// How far the loads move the tip, and how far down along gravity (m).
    fn deflection(&self, settler: &mut Solver) -> [f64; 2] {
        let settled = settler.settle(self.command, &Loads::default()).ok();
        let Some(unloaded) = settled.filter(|unloaded| unloaded.converged) else {
            return [f64::NAN; 2];
        };
        let moved = self.found.equilibrium.pose().tip().translation.vector
            - unloaded.pose().tip().translation.vector;
        let down = Vector3::from(self.robot.spec().gravity).try_normalize(0.0);
        [moved.norm(), down.map_or(f64::NAN, |down| moved.dot(&down))]
    }

    /// Semi-axes (N per unit of command), ascending, of the ellipsoid of forces with which the tip, fixed in place, pushes
    /// under commands of unit norm: the tip's stiffness `C⁻¹` times its Jacobian.
    fn forces(&self, derivatives: &Sensitivity) -> Option<[f64; 3]> {
        let stiffness = tip_compliance(self.robot, derivatives)?.try_inverse()?;
        let jacobian = tip_jacobian(self.robot, derivatives, &self.found.equilibrium);
        Some(ellipsoid(
            &(DMatrix::from_iterator(3, 3, stiffness.iter().copied()) * jacobian),
        ))
    }

    /// Stable equilibria found from random poses and the one reported, and the largest distance of their tips from the
    /// latter (m).
    fn equilibria(&self, settler: &mut Solver) -> (i64, f64) {
        let tip = |equilibrium: &Equilibrium| equilibrium.pose().tip().translation.vector;
        let length = self.robot.arc_lengths().last().copied().unwrap_or(1.0);
        let mut found = vec![tip(&self.found.equilibrium)];
        // The same poses for every configuration.
        let mut rng = ChaCha8Rng::seed_from_u64(self.study.seed);
        for _ in 0..STARTS {
            let mut angle = || START_ROTATION * (2.0 * rng.random::<f64>() - 1.0);
            let joints = (0..self.robot.discs().len())
                .map(|_| UnitQuaternion::from_scaled_axis(Vector3::from_fn(|_, _| angle())));
            let start = Configuration(joints.collect());
            let settled = settler.settle_from(&start, self.command, self.loads);
            let Ok(settled) = settled else {
                continue;
            };
            let place = tip(settled);
            if settled.converged
                && found
                    .iter()
                    .all(|other| (place - other).norm() > APART * length)
            {
                found.push(place);
            }
        }
        let apart = found
            .iter()
            .map(|place| (place - found[0]).norm())
            .fold(0.0, f64::max);
        (i64::try_from(found.len()).unwrap_or(i64::MAX), apart)
    }
}

/// Compliance of the tip's face to forces (m/N).
fn tip_compliance(robot: &Robot, derivatives: &Sensitivity) -> Option<Matrix3<f64>> {
    let compliance = derivatives.compliance(&ToolFrame::tip_face(robot)).ok()?;
    Some(compliance.fixed_view::<3, 3>(0, 0).into())
}

/// Derivative of the position of the tip's face by the command.
fn tip_jacobian(
    robot: &Robot,
    derivatives: &Sensitivity,
    equilibrium: &Equilibrium,
) -> DMatrix<f64> {
    let jacobian = derivatives.command_jacobian();
    let tool = ToolFrame::tip_face(robot);
    let lever = tool.arm(&equilibrium.pose()).cross_matrix();
    let rows = |first: usize| jacobian.rows(6 * tool.disc + first, 3);
    // A rotation of the disc moves its face: p' = p + r x a.
    let lever = DMatrix::from_iterator(3, 3, lever.iter().copied());
    rows(0) - lever * rows(3)
}

fn singular(matrix: &Matrix3<f64>) -> [f64; 3] {
    let mut axes: [f64; 3] = matrix.singular_values().into();
    axes.sort_by(f64::total_cmp);
    axes
}

/// Semi-axes of the image of the unit ball, ascending: of a matrix with three rows.
fn ellipsoid(matrix: &DMatrix<f64>) -> [f64; 3] {
    let square = matrix * matrix.transpose();
    let square = Matrix3::from_fn(|row, column| square[(row, column)]);
    singular(&square).map(|axis| axis.max(0.0).sqrt())
}
