//! Ball joints written as hinges: what the model settles in, beside the robot.

use tdcr_sim::formats::mjcf::{ExportOptions, export, hinge_notes, import_text};
use tdcr_sim::robot::{
    Backbone, HingeRow, Loads, PerDisc, RigidMass, Robot, RobotSpec, RodDamping, RodSpec,
};

/// A command that bends both modules of 2m, in different planes.
const BENT: [f64; 6] = [0.034, 0.007, 0.001, 0.026, 0.015, 0.019];
/// One that bends them about the y axis alone.
const PLANAR: [f64; 6] = [0.034, 0.007, 0.007, 0.01, 0.02, 0.02];

/// Largest distance (m) of a disc from where the robot has it, in the model on hinges that is written and read back.
fn apart(spec: &RobotSpec, row: HingeRow, command: &[f64; 6]) -> f64 {
    let hinged = spec.on_hinges(row).unwrap();
    let model = export(&hinged, &ExportOptions::default()).unwrap();
    let discs = spec.disc_count();
    assert_eq!(model.matches("type=\"hinge\"").count(), discs * row.count());
    assert!(!model.contains("type=\"ball\""));
    let read = import_text(&model).unwrap();
    assert!(read.notes.is_empty(), "{:?}", read.notes);
    let settled = [spec.clone(), read.spec].map(|spec| {
        let robot = Robot::new(spec).unwrap();
        let settled = robot.settle(&robot.command(command).unwrap(), &Loads::default());
        assert!(settled.converged);
        settled.positions
    });
    let pairs = settled[0].iter().zip(&settled[1]);
    pairs.map(|(a, b)| (a - b).norm()).fold(0.0, f64::max)
}

fn on_springs(bending: [f64; 2], torsion: f64, rest: [f64; 3]) -> RobotSpec {
    let mut spec = RobotSpec::standard("2m").unwrap();
    for module in &mut spec.modules {
        module.backbone = Some(PerDisc::Uniform(Backbone {
            bending,
            torsion,
            rest,
        }));
    }
    spec
}

#[test]
fn joints_that_turn_freely_have_the_same_equilibria_on_three_hinges() {
    let spec = RobotSpec::standard("2m").unwrap();
    let freely = apart(&spec, HingeRow::Three, &BENT);
    assert!(freely < 1e-9, "{freely}");
    assert!(hinge_notes(&spec, HingeRow::Three).unwrap().is_empty());
    // Without twist, tendons that wind about the robot cannot.
    let twisted = apart(&spec, HingeRow::Universal, &BENT);
    assert!((1e-5..5e-3).contains(&twisted), "{twisted}");
    let [note] = &hinge_notes(&spec, HingeRow::Universal).unwrap()[..] else {
        panic!("one note");
    };
    assert!(note.contains("10 ball joints") && note.contains("cannot twist"));
}

#[test]
fn elastic_joints_have_nearly_the_same() {
    let spec = on_springs([0.2, 0.25], 0.17, [0.02, -0.01, 0.01]);
    let three = apart(&spec, HingeRow::Three, &BENT);
    assert!((1e-9..5e-4).contains(&three), "{three}");
    let notes = hinge_notes(&spec, HingeRow::Universal).unwrap();
    assert!(notes[1].contains("10 elastic ball joints"), "{notes:?}");
    // About one axis nothing is otherwise.
    let upright = on_springs([0.2, 0.25], 0.17, [0.0; 3]);
    for row in [HingeRow::Three, HingeRow::Universal] {
        let planar = apart(&upright, row, &PLANAR);
        assert!(planar < 1e-9, "{planar}");
    }
}

#[test]
fn a_robot_of_universal_joints_is_the_same_robot() {
    let universal = on_springs([0.2, 0.25], 0.1, [0.0; 3]);
    let universal = universal.on_hinges(HingeRow::Universal).unwrap();
    assert_eq!(universal.on_hinges(HingeRow::Three).unwrap(), universal);
    assert!(apart(&universal, HingeRow::Universal, &BENT) < 1e-9);
    assert!(hinge_notes(&universal, HingeRow::Three).unwrap().is_empty());
}

#[test]
fn rods_leave_their_stiffness_damping_and_mass() {
    let mut spec = RobotSpec::standard("2m").unwrap();
    for module in &mut spec.modules {
        module.rod = Some(RodSpec {
            youngs: 6e10,
            poisson: 0.3,
            radius: 5e-4,
            density: 6450.0,
            damping: RodDamping {
                bending: 1e-3,
                torsion: 2e-3,
            },
        });
    }
    let hinged = Robot::new(spec.on_hinges(HingeRow::Three).unwrap()).unwrap();
    let ball = Robot::new(spec).unwrap();
    for (a, b) in ball.discs().iter().zip(hinged.discs()) {
        let hinges = b.hinges.as_ref().unwrap();
        let mass = |disc: &tdcr_sim::robot::Disc| RigidMass {
            mass: disc.mass,
            inertia: disc.inertia.into(),
            centre_of_mass: disc.centre_of_mass.into(),
        };
        assert_eq!(mass(a), mass(b));
        let backbone = a.backbone.unwrap();
        let [x, y] = backbone.bending;
        assert_eq!(hinges.stiffness.as_slice(), [x, y, backbone.torsion]);
        let damping = a.extra_damping.add_scalar(a.damping);
        assert!((hinges.damping - damping).amax() < 1e-12 * damping.amax());
        assert_eq!(hinges.armature.min(), a.armature);
    }
}
