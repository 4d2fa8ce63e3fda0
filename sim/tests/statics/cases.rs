//! The test cases of `data/cases.toml`, settled.

use std::path::Path;

use nalgebra::{Quaternion, UnitQuaternion, Vector3};
use serde::Deserialize;
use tdcr_sim::chain::Configuration;
use tdcr_sim::robot::{Frame, Loads, Robot, RobotSpec, Wrench};
use tdcr_sim::statics::{Equilibrium, Settler};

#[derive(Deserialize)]
struct Cases {
    case: Vec<Case>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Case {
    name: String,
    robot: String,
    command: Vec<f64>,
    #[serde(default)]
    payload: f64,
    #[serde(default)]
    wrenches: Vec<CaseWrench>,
    #[serde(default = "yes")]
    from_straight: bool,
    tip: Option<[f64; 3]>,
    #[serde(default)]
    positions: Vec<[f64; 3]>,
    #[serde(default)]
    orientations: Vec<[f64; 4]>,
    tolerance: f64,
    source: String,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct CaseWrench {
    disc: usize,
    force: [f64; 3],
    moment: [f64; 3],
    frame: CaseFrame,
}

#[derive(Deserialize)]
#[serde(rename_all = "snake_case")]
enum CaseFrame {
    World,
    Disc,
}

fn yes() -> bool {
    true
}

fn data() -> &'static Path {
    Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/tests/data"))
}

fn cases() -> Vec<Case> {
    let text = std::fs::read_to_string(data().join("cases.toml")).unwrap();
    toml::from_str::<Cases>(&text).unwrap().case
}

impl Case {
    fn robot(&self) -> Robot {
        if RobotSpec::STANDARD.contains(&self.robot.as_str()) {
            return Robot::load(&self.robot).unwrap();
        }
        Robot::load(data().join(&self.robot).to_str().unwrap()).unwrap()
    }

    fn loads(&self) -> Loads {
        let mut loads = Loads::payload(self.payload).unwrap();
        for wrench in &self.wrenches {
            let wrench = Wrench {
                disc: wrench.disc,
                point: [0.0; 3],
                force: wrench.force,
                moment: wrench.moment,
                frame: match wrench.frame {
                    CaseFrame::World => Frame::World,
                    CaseFrame::Disc => Frame::Disc,
                },
            };
            loads = loads.with_wrench(wrench).unwrap();
        }
        loads
    }

    /// The listed pose as rotations of the joints.
    fn configuration(&self) -> Configuration {
        let mut below = UnitQuaternion::identity();
        let joint = |&[w, i, j, k]: &[f64; 4]| {
            let disc = UnitQuaternion::from_quaternion(Quaternion::new(w, i, j, k));
            let joint = below.inverse() * disc;
            below = disc;
            joint
        };
        Configuration(self.orientations.iter().map(joint).collect())
    }

    /// Largest distance of a disc from where it is listed (m).
    fn apart(&self, settled: &Equilibrium) -> f64 {
        let discs = settled.positions.len();
        let tip = self.tip.iter().map(|tip| (discs - 1, tip));
        let listed = self.positions.iter().enumerate().chain(tip);
        let distances =
            listed.map(|(disc, p)| (settled.positions[disc] - Vector3::from(*p)).norm());
        distances.fold(0.0, f64::max)
    }
}

#[test]
fn every_case_says_what_it_checks_and_against_what() {
    let cases = cases();
    for (number, case) in cases.iter().enumerate() {
        let discs = case.robot().discs().len();
        let listed = case.positions.len();
        assert!(
            (listed == discs && case.tip.is_none()) || (listed == 0 && case.tip.is_some()),
            "{}: a tip, or one position per disc",
            case.name
        );
        assert!([0, listed].contains(&case.orientations.len()));
        assert!(case.from_straight || !case.orientations.is_empty());
        assert!(!case.source.is_empty() && case.tolerance > 0.0);
        assert!(cases[..number].iter().all(|other| other.name != case.name));
    }
}

#[test]
fn every_case_settles_where_it_is_listed() {
    for case in cases().iter().filter(|case| case.from_straight) {
        let robot = case.robot();
        let command = robot.command(&case.command).unwrap();
        let settled = robot.settle(&command, &case.loads());
        let apart = case.apart(&settled);
        assert!(settled.converged, "{}: {}", case.name, settled.residual);
        assert!(apart <= case.tolerance, "{}: {apart} m", case.name);
    }
}

#[test]
fn every_listed_pose_is_a_stable_equilibrium() {
    for case in cases().iter().filter(|case| !case.orientations.is_empty()) {
        let robot = case.robot();
        let command = robot.command(&case.command).unwrap();
        let mut settler = Settler::new(&robot);
        let stayed = settler.settle_from(&case.configuration(), &command, &case.loads());
        let apart = case.apart(stayed);
        assert!(stayed.converged, "{}: {}", case.name, stayed.residual);
        assert!(apart <= case.tolerance, "{}: {apart} m", case.name);
    }
}

#[test]
fn an_equilibrium_that_is_not_reached_from_the_straight_pose_is_another_one() {
    for case in cases().iter().filter(|case| !case.from_straight) {
        let robot = case.robot();
        let command = robot.command(&case.command).unwrap();
        let settled = robot.settle(&command, &case.loads());
        assert!(settled.converged);
        assert!(case.apart(&settled) > 1e-3, "{}", case.name);
    }
}
