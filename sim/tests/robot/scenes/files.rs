//! Fields of scene files, and files that are written and read again.

use std::fs;
use std::path::Path;

use nalgebra::{Isometry3, Point3, UnitQuaternion, Vector3};
use tdcr_sim::geometry::{Pipe, Shape};
use tdcr_sim::scene::{
    ContactLaw, Impedance, Obstacle, ObstacleShape, ObstacleSpec, Scene, SceneError, SceneSpec,
    SelfContact, ShapeSpec,
};

use super::{SHELF, STL, scene};

/// The one obstacle of a text.
fn only(text: &str) -> Obstacle {
    let scene = scene(text).unwrap();
    assert_eq!(scene.obstacles().len(), 1);
    scene.obstacles()[0].clone()
}

#[test]
fn a_file_says_no_more_than_a_shape_and_the_rest_has_defaults() {
    let obstacle = only("[[obstacle]]\nhalf_space = {}");
    assert_eq!(obstacle.name, "obstacle 0");
    assert!(matches!(obstacle.shape, ObstacleShape::HalfSpace));
    assert_eq!(obstacle.pose, Isometry3::identity());
    assert_eq!(obstacle.compliance, 1e-6);
    assert_eq!(obstacle.friction, 0.0);
    assert_eq!(obstacle.color, [150, 140, 125]);
    assert_eq!(obstacle.mass, None);
    assert!(scene("").unwrap().obstacles().is_empty());
}

#[test]
fn every_field_is_read() {
    let obstacle = only(
        "[[obstacle]]
         name = 'a ball'
         sphere = { radius = 2 }
         position = [1, 2.5, -3]
         orientation = [1, 0, 0, 1]
         compliance = 2e-4
         friction = 0.25
         color = [1, 2, 255]
         mass = 0.5",
    );
    assert_eq!(obstacle.name, "a ball");
    assert_eq!(
        obstacle.pose.translation.vector,
        Vector3::new(1.0, 2.5, -3.0)
    );
    // A quarter turn about z, normalised.
    let turned = obstacle.pose.rotation * Vector3::x();
    assert!((turned - Vector3::y()).norm() < 1e-15);
    assert_eq!((obstacle.compliance, obstacle.friction), (2e-4, 0.25));
    assert_eq!((obstacle.color, obstacle.mass), ([1, 2, 255], Some(0.5)));
}

#[test]
fn every_shape_is_read() {
    let spec = SceneSpec::from_toml(
        "[[obstacle]]
         box = { size = [1, 2, 3] }
         [[obstacle]]
         capsule = { radius = 0.1, length = 0.5 }
         [[obstacle]]
         cylinder = { radius = 0.2, length = 0.6 }
         [[obstacle]]
         pipe = { radius = 0.3, length = 0.7 }
         [[obstacle]]
         pipe = { radius = 0.3, path = [[0, 0, 0], [0, 0, 1], [0, 1, 1]] }
         [[obstacle]]
         mesh = 'a.stl'
         [[obstacle]]
         mesh = { file = 'b.stl', scale = 1e-3 }
         [obstacle.half_space]",
    );
    // The last has two.
    assert!(matches!(spec, Err(SceneError::Shapes { .. })), "{spec:?}");
    let text = "[[obstacle]]\nbox = { size = [1, 2, 3] }\n[[obstacle]]\n[obstacle.mesh]\nfile = 'b.stl'\nscale = 1e-3";
    let shapes: Vec<ShapeSpec> = (SceneSpec::from_toml(text).unwrap().obstacles)
        .into_iter()
        .map(|obstacle| obstacle.shape)
        .collect();
    let size = [1.0, 2.0, 3.0];
    let (file, scale) = ("b.stl".into(), 1e-3);
    assert_eq!(
        shapes,
        [ShapeSpec::Box { size }, ShapeSpec::Mesh { file, scale }]
    );
    let pipe = only("[[obstacle]]\npipe = { radius = 0.3, path = [[0, 0, 0], [0, 0, 1]] }");
    assert!(matches!(pipe.shape, ObstacleShape::Pipe(_)));
}

#[test]
fn sizes_are_whole_in_files_and_lengths_of_capsules_are_without_their_ends() {
    let spec = |text: &str| {
        scene(text).unwrap().spec().unwrap().obstacles[0]
            .shape
            .clone()
    };
    let capsule = "[[obstacle]]\ncapsule = { radius = 0.1, length = 0.5 }";
    let (radius, length) = (0.1, 0.5);
    assert_eq!(spec(capsule), ShapeSpec::Capsule { radius, length });
    // The same in memory: half the length.
    let shape = ObstacleShape::Solid(Shape::capsule(0.1, 0.25).unwrap());
    let made = Scene::new(vec![Obstacle::new("c", shape)]).unwrap();
    let written = made.spec().unwrap().obstacles[0].shape.clone();
    assert_eq!(written, ShapeSpec::Capsule { radius, length });
    let shape = ObstacleShape::Solid(Shape::cuboid([0.5, 1.0, 1.5]).unwrap());
    let made = Scene::new(vec![Obstacle::new("b", shape)]).unwrap();
    let written = made.spec().unwrap().obstacles[0].shape.clone();
    let size = [1.0, 2.0, 3.0];
    assert_eq!(written, ShapeSpec::Box { size });
}

#[test]
fn what_is_written_is_read_as_the_same() {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("part.stl"), STL).unwrap();
    let more = "
        [[obstacle]]
        name = 'part'
        mesh = { file = 'part.stl', scale = 0.01 }
        [[obstacle]]
        mesh = 'part.stl'
        position = [0.1, 0.2, 0.3]
        compliance = 0
        mass = 2.5";
    let path = folder.path().join("scene.toml");
    fs::write(&path, format!("\u{feff}{SHELF}{more}")).unwrap();
    let first = Scene::load(&path).unwrap();
    let text = first.to_toml().unwrap();
    let second = Scene::from_toml(&text, folder.path()).unwrap();
    assert_eq!(first.obstacles().len(), 9);
    assert_eq!(first.find("part"), Some(7));
    assert_eq!(first.find("obstacle 8"), Some(8));
    let (a, b) = (first.spec().unwrap(), second.spec().unwrap());
    for (a, b) in a.obstacles.iter().zip(&b.obstacles) {
        let turned = (a.orientation.iter())
            .zip(b.orientation)
            .map(|(a, b)| (a - b).abs());
        assert!(turned.fold(0.0, f64::max) < 1e-15);
        let orientation = a.orientation;
        assert_eq!(
            *a,
            ObstacleSpec {
                orientation,
                ..b.clone()
            }
        );
    }
    // A specification of unit quaternions is the same to the bit.
    assert_eq!(SceneSpec::from_toml(&a.to_toml().unwrap()).unwrap(), a);
    assert_eq!(SceneSpec::from_toml(&text).unwrap(), a);
    // What a file leaves out is left out.
    assert!(
        text.contains("[obstacle.mesh]\nfile = \"part.stl\"\nscale = 0.01"),
        "{text}"
    );
    assert_eq!(text.matches("mass").count(), 2, "{text}");
}

#[test]
fn friction_between_discs_is_read_and_written() {
    let own = |text: &str| scene(text).unwrap().self_contact();
    let rough = SelfContact::Touching {
        compliance: 1e-6,
        friction: 0.3,
    };
    assert_eq!(own("self_contact = { compliance = 1e-6 }"), own(""));
    assert_eq!(own("self_contact = { friction = 0.3 }"), rough);
    let read = scene("self_contact = { friction = 0.3 }").unwrap();
    let written = read.to_toml().unwrap();
    assert_eq!(own(&written), rough, "{written}");
    let refused = scene("self_contact = { friction = -1 }").unwrap_err();
    assert!(
        (refused.to_string()).contains("`self_contact.friction` is -1; expected a number from 0"),
        "{refused}"
    );
}

#[test]
fn the_smoothing_of_contacts_is_read_and_written() {
    assert_eq!(scene("").unwrap().smoothing(), 0.0);
    let read = scene("smoothing = 1e-5\n[[obstacle]]\nhalf_space = {}").unwrap();
    assert_eq!(read.with_obstacles(Vec::new()).unwrap().smoothing(), 1e-5);
    let record = serde_json::to_string(&read).unwrap();
    assert_eq!(serde_json::from_str::<Scene>(&record).unwrap(), read);
    let written = read.to_toml().unwrap();
    assert!(written.starts_with("smoothing = "), "{written}");
    assert_eq!(scene(&written).unwrap(), read);
    assert!(read != read.clone().with_smoothing(0.0).unwrap());
    let refused = scene("smoothing = -1").unwrap_err().to_string();
    assert!(
        refused.contains("`smoothing` is -1; expected a number from 0 to 1 (J)"),
        "{refused}"
    );
}

#[test]
fn the_law_of_contacts_is_read_and_written() {
    assert_eq!(scene("").unwrap().contact_law(), ContactLaw::default());
    let softer = Impedance {
        solref: [0.01, 2.0],
        ..Impedance::default()
    };
    for (text, law) in [
        ("compliant = {}", ContactLaw::default()),
        (
            "compliant = { relaxation = 0 }",
            ContactLaw::Compliant { relaxation: 0.0 },
        ),
        (
            "impedance = {}",
            ContactLaw::Impedance(Impedance::default()),
        ),
        (
            "impedance = { solref = [0.01, 2] }",
            ContactLaw::Impedance(softer),
        ),
    ] {
        let text = format!("contact_law = {{ {text} }}\n[[obstacle]]\nhalf_space = {{}}");
        let read = scene(&text).unwrap();
        assert_eq!(read.contact_law(), law);
        // As it is of the same scene with other obstacles, of its record, and of its file.
        let moved = read.with_obstacles(Vec::new()).unwrap();
        assert_eq!(moved.contact_law(), law);
        let record = serde_json::to_string(&read).unwrap();
        assert_eq!(serde_json::from_str::<Scene>(&record).unwrap(), read);
        let written = read.to_toml().unwrap();
        assert_eq!(
            written.contains("contact_law"),
            law != ContactLaw::default()
        );
        assert_eq!(scene(&written).unwrap(), read);
        let usual = read.clone().with_contact_law(ContactLaw::default());
        assert_eq!(usual.unwrap() == read, law == ContactLaw::default());
    }
}

#[test]
fn builders_make_what_files_say() {
    let by_hand = Scene::new(vec![
        Obstacle::half_space("floor").with_color([1, 2, 3]),
        Obstacle::cuboid("box", [0.1, 0.2, 0.3])
            .unwrap()
            .at([1.0, 0.0, 0.0]),
        Obstacle::sphere("ball", 0.02)
            .unwrap()
            .at([0.0, 0.0, 0.5])
            .with_compliance(1e-3)
            .unwrap()
            .with_friction(0.4)
            .unwrap()
            .with_mass(0.1)
            .unwrap(),
        Obstacle::cylinder("post", 0.01, 0.3).unwrap(),
        Obstacle::capsule("rail", 0.01, 0.3)
            .unwrap()
            .with_orientation([0.0, 2.0, 0.0, 0.0])
            .unwrap(),
        Obstacle::pipe("pipe", 0.01, 0.3).unwrap(),
        Obstacle::pipe_along("bend", 0.01, &[[0.0; 3], [0.0, 0.0, 1.0]]).unwrap(),
    ]);
    let by_hand = by_hand.unwrap();
    let text = "
        obstacle = [
            { name = 'floor', half_space = {}, color = [1, 2, 3] },
            { name = 'box', box = { size = [0.1, 0.2, 0.3] }, position = [1, 0, 0] },
            { name = 'ball', sphere = { radius = 0.02 }, position = [0, 0, 0.5], compliance = 1e-3, friction = 0.4, mass = 0.1 },
            { name = 'post', cylinder = { radius = 0.01, length = 0.3 } },
            { name = 'rail', capsule = { radius = 0.01, length = 0.3 }, orientation = [0, 1, 0, 0] },
            { name = 'pipe', pipe = { radius = 0.01, length = 0.3 } },
            { name = 'bend', pipe = { radius = 0.01, path = [[0, 0, 0], [0, 0, 1]] } },
        ]";
    assert_eq!(
        by_hand.spec().unwrap(),
        scene(text).unwrap().spec().unwrap()
    );
    let turn = UnitQuaternion::from_euler_angles(0.1, 0.2, 0.3);
    let pose = Isometry3::from_parts([1.0, 2.0, 3.0].into(), turn);
    let placed = Obstacle::half_space("wall").with_pose(pose);
    assert_eq!(placed.pose * Point3::origin(), Point3::new(1.0, 2.0, 3.0));
}

#[test]
fn clones_share_their_obstacles() {
    let first = scene(SHELF).unwrap();
    let second = first.clone();
    assert!(std::ptr::eq(first.obstacles(), second.obstacles()));
    fn shared<T: Send + Sync>(_: &T) {}
    shared(&first);
}

/// A mesh or a pipe made in memory has no name or numbers to write.
#[test]
fn what_was_made_in_memory_is_written_where_it_can_be() {
    let mesh = Shape::mesh(&[[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]], &[[0, 1, 2]]).unwrap();
    let pipe = Pipe::straight(0.1, 1.0).unwrap();
    for shape in [
        ObstacleShape::Solid(mesh.clone()),
        ObstacleShape::Pipe(pipe),
    ] {
        let scene = Scene::new(vec![Obstacle::new("made", shape)]).unwrap();
        let said = scene.to_toml().unwrap_err().to_string();
        let expected = "obstacle 0 `made` is a mesh or a pipe made in memory; expected one of a file, or by its numbers";
        assert!(said.starts_with(expected), "{said}");
    }
    // A pipe that was read, and replaced by a mesh.
    let mut replaced = Obstacle::pipe("pipe", 0.1, 1.0).unwrap();
    replaced.shape = ObstacleShape::Solid(mesh);
    let scene = Scene::new(vec![replaced]).unwrap();
    assert!(matches!(scene.spec(), Err(SceneError::Unwritten { .. })));
}

#[test]
fn a_mesh_of_many_obstacles_is_read_once_and_meshes_are_scaled() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("part.stl");
    fs::write(&file, STL).unwrap();
    let text = "[[obstacle]]\nmesh = { file = 'part.stl', scale = 0.5 }\n".repeat(2000);
    assert_eq!(
        Scene::from_toml(&text, folder.path())
            .unwrap()
            .obstacles()
            .len(),
        2000
    );
    // From another folder by its whole path.
    let text = format!("[[obstacle]]\nmesh = '{}'", file.display());
    Scene::from_toml(&text, Path::new("/")).unwrap();
    // A scale that makes it too large.
    let large = Obstacle::mesh("part", &file, 2e6).unwrap_err().to_string();
    let expected = "obstacle `part`: field `mesh` is of a shape that reaches 2e6 m from its origin; expected 1e6 m at most";
    assert_eq!(large, expected);
}

/// The files of `docs/scene-files.md`: in blocks of its own, and in the example that it names.
#[test]
fn the_documented_files_are_scenes() {
    let page = include_str!("../../../../docs/scene-files.md");
    let blocks = page.split("```toml\n").skip(1);
    let blocks: Vec<&str> = blocks
        .map(|rest| rest.split("```").next().unwrap())
        .collect();
    assert_eq!(blocks.len(), 1);
    let spec = SceneSpec::from_toml(blocks[0]).unwrap();
    assert_eq!(spec.obstacles[1].name, "part");
    assert!(page.contains("examples/scenes/shelf.toml"));
    let shapes = scene(SHELF).unwrap().spec().unwrap().obstacles;
    let kinds: std::collections::HashSet<_> = (shapes.iter())
        .map(|obstacle| std::mem::discriminant(&obstacle.shape))
        .collect();
    assert_eq!(kinds.len(), 7, "all shapes but a mesh");
    // Defaults and accepted ends as the table of fields says them.
    for line in page.lines().filter(|line| line.starts_with("| `")) {
        let cells: Vec<&str> = line.trim_matches('|').split('|').map(str::trim).collect();
        let [field, default] = [
            cells[0].trim_matches('`'),
            cells.get(3).copied().unwrap_or(""),
        ];
        if cells.len() == 6 && default.starts_with('`') && field != "name" {
            let default = default.trim_matches('`');
            let text = format!("[[obstacle]]\nsphere = {{ radius = 1 }}\n{field} = {default}");
            let without = scene("[[obstacle]]\nsphere = { radius = 1 }").unwrap();
            assert_eq!(
                scene(&text).unwrap().spec().unwrap(),
                without.spec().unwrap(),
                "{field}"
            );
        }
    }
}
