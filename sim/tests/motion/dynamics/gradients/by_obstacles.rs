//! Derivatives of motions by obstacles, both ways, against differences of motions.

use nalgebra::{UnitQuaternion, Vector3};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use tdcr_sim::dynamics::{DynamicsError, ObstacleTangent, RolloutDirection};
use tdcr_sim::pose::PoseTangent;

use super::case::{Case, assert_near};
use super::tangents::assert_adjoint;

/// The gradient and the tangent by what obstacles are, beside differences.
pub fn assert_derivatives_by_obstacles(case: &Case, label: &str) {
    assert_gradient(case, label);
    let mut rng = ChaCha8Rng::seed_from_u64(53);
    assert_adjoint(case, &mut rng, label);
    let direction = RolloutDirection {
        obstacles: case.direction(&mut rng).obstacles,
        ..nothing(case)
    };
    let expected = case.numeric(2e-7, |by| case.among_changed(&direction.obstacles, by));
    let found = case.along(&direction);
    assert!(found.abs() > 1.0, "{label}: {found}");
    assert_near(found, expected, 2e-7, &format!("{label}: forward"));
    let none = RolloutDirection {
        obstacles: Vec::new(),
        ..direction
    };
    assert_eq!(case.along(&none), 0.0, "{label}");
}

/// The gradient, number by number.
fn assert_gradient(case: &Case, label: &str) {
    let gradient = case.gradient(&[]);
    let count = case.scene.as_ref().unwrap().obstacles().len();
    assert_eq!(gradient.obstacles.len(), count);
    for (number, found) in gradient.obstacles.iter().enumerate() {
        let compare = |found: f64, unit: ObstacleTangent, size: f64, what: &str| {
            let mut units = vec![ObstacleTangent::default(); count];
            units[number] = unit;
            let expected = case.numeric(size, |by| case.among_changed(&units, by));
            assert_near(found, expected, size, &format!("{label}: {what}"));
        };
        let moved = |position, rotation| ObstacleTangent {
            pose: PoseTangent { position, rotation },
            compliance: 0.0,
        };
        let (still, pose) = (Vector3::zeros(), &found.pose);
        for axis in 0..3 {
            let unit = Vector3::ith(axis, 1.0);
            compare(pose.position[axis], moved(unit, still), 2e-7, "position");
            compare(pose.rotation[axis], moved(still, unit), 2e-6, "rotation");
        }
        let softer = ObstacleTangent {
            compliance: 1.0,
            ..Default::default()
        };
        compare(found.compliance, softer, 1e-8, "compliance");
    }
}

impl Case {
    /// The motion with its obstacles changed by this share of `changes`.
    fn among_changed(&self, changes: &[ObstacleTangent], by: f64) -> Self {
        let scene = self.scene.as_ref().unwrap();
        let changed = scene.obstacles().iter().zip(changes).map(|(old, change)| {
            let mut obstacle = old.clone();
            obstacle.pose.translation.vector += change.pose.position * by;
            obstacle.pose.rotation = UnitQuaternion::from_scaled_axis(change.pose.rotation * by)
                * obstacle.pose.rotation;
            let compliance = old.compliance + change.compliance * by;
            obstacle.with_compliance(compliance).unwrap()
        });
        Self {
            scene: Some(scene.with_obstacles(changed.collect()).unwrap()),
            ..self.with(self.rollout.clone())
        }
    }
}

/// The direction in which nothing changes.
fn nothing(case: &Case) -> RolloutDirection {
    let (robot, _) = case.states();
    let zeros = vec![Vector3::zeros(); robot.discs().len()];
    RolloutDirection {
        commands: vec![vec![0.0; robot.tendons().len()]; case.rollout.commands.len()],
        start: vec![0.0; 2 * robot.dof()],
        forces: zeros.clone(),
        moments: zeros,
        wrenches: Vec::new(),
        parameters: Vec::new(),
        obstacles: Vec::new(),
        base: PoseTangent::default(),
    }
}

/// Changes of another number of obstacles than there are.
pub fn assert_refuses_others(case: &Case) {
    let count = case
        .scene
        .as_ref()
        .map_or(0, |scene| scene.obstacles().len());
    let direction = RolloutDirection {
        obstacles: vec![ObstacleTangent::default(); count + 1],
        ..nothing(case)
    };
    let refused = case.tangents(&direction).unwrap_err();
    let what = "direction of obstacles";
    assert!(
        matches!(&refused, DynamicsError::Size { what: found, expected, .. } if *found == what && *expected == count),
        "{refused}"
    );
}
