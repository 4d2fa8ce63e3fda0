//! What wrong scenes are told: which obstacle, which field, and what would be right.

use std::fs;
use std::path::Path;

use nalgebra::Isometry3;
use tdcr_sim::geometry::Shape;
use tdcr_sim::scene::{Obstacle, ObstacleShape, Scene, SceneError};

use super::scene;

/// What the fields of an obstacle `it`, number 1, are told.
fn said(fields: &str) -> String {
    let text = format!("[[obstacle]]\nhalf_space = {{}}\n[[obstacle]]\nname = 'it'\n{fields}\n");
    scene(&text).expect_err(fields).to_string()
}

fn check(fields: &str, expected: &str) {
    assert_eq!(
        said(fields),
        format!("obstacle 1 `it`: {expected}"),
        "{fields}"
    );
}

#[test]
fn lengths_are_above_0_and_at_most_1e6_m() {
    let expected = "expected a length above 0, at most 1e6 m";
    for value in ["0", "-1", "nan", "inf", "-inf", "1.1e6"] {
        let value: f64 = value.parse().unwrap();
        for (shape, fields) in [
            ("sphere", "radius = X"),
            ("capsule", "radius = X, length = 1"),
            ("capsule", "length = X, radius = 1"),
            ("cylinder", "radius = X, length = 1"),
            ("cylinder", "length = X, radius = 1"),
            ("pipe", "radius = X, length = 1"),
            ("pipe", "length = X, radius = 1"),
            ("pipe", "radius = X, path = [[0, 0, 0], [0, 0, 1]]"),
        ] {
            let field = fields.split(' ').next().unwrap();
            let number = format!("{value:?}").replace("NaN", "nan");
            let text = format!("{shape} = {{ {} }}", fields.replace('X', &number));
            check(
                &text,
                &format!("field `{shape}.{field}` is {value}; {expected}"),
            );
        }
    }
    check(
        "box = { size = [1, 0, 1] }",
        &format!("field `box.size` is 0; {expected}"),
    );
    scene("[[obstacle]]\nsphere = { radius = 1e6 }").unwrap();
    check(
        "capsule = { radius = 9e5, length = 9e5 }",
        "field `capsule` is of a shape that reaches 1.35e6 m from its origin; expected 1e6 m at most",
    );
}

#[test]
fn numbers_are_finite_and_of_a_size() {
    let ball = |field: &str| format!("sphere = {{ radius = 1 }}\n{field}");
    for (field, expected) in [
        ("compliance", "a number from 0 to 1e15"),
        ("friction", "a number from 0 to 1e15"),
        ("mass", "a mass above 0, at most 1e9 kg"),
    ] {
        for value in ["-1", "nan", "inf", "1e16"] {
            let shown = value
                .replace("nan", "NaN")
                .replace("1e16", "10000000000000000");
            let expected = format!("field `{field}` is {shown}; expected {expected}");
            check(&ball(&format!("{field} = {value}")), &expected);
        }
    }
    check(
        &ball("mass = 0"),
        "field `mass` is 0; expected a mass above 0, at most 1e9 kg",
    );
    check(
        "half_space = {}\nmass = 1",
        "field `mass` is 1; expected none of a half space, which cannot move",
    );
    let expected = "expected finite coordinates of at most 1e6 m";
    check(
        &ball("position = [0, nan, 0]"),
        &format!("field `position` is [0.0, NaN, 0.0]; {expected}"),
    );
    check(
        &ball("position = [0, 0, -2e6]"),
        &format!("field `position` is [0.0, 0.0, -2000000.0]; {expected}"),
    );
    let expected = "expected a quaternion (w, x, y, z), not all 0";
    check(
        &ball("orientation = [0, 0, 0, 0]"),
        &format!("field `orientation` is [0.0, 0.0, 0.0, 0.0]; {expected}"),
    );
    check(
        &ball("orientation = [1, 0, inf, 0]"),
        &format!("field `orientation` is [1.0, 0.0, inf, 0.0]; {expected}"),
    );
    check(
        &ball("orientation = [1e200, 0, 0, 0]"),
        &format!("field `orientation` is [1e200, 0.0, 0.0, 0.0]; {expected}"),
    );
}

#[test]
fn velocities_and_joints_are_those_of_objects() {
    let ball = |field: &str| format!("sphere = {{ radius = 1 }}\n{field}");
    check(
        &ball("velocity = [1, 0, 0]"),
        "field `velocity` is [1.0, 0.0, 0.0]; expected none without a `mass`",
    );
    check(
        &ball("mass = 1\nangular_velocity = [0, 2e4, 0]"),
        "field `angular_velocity` is [0.0, 20000.0, 0.0]; expected finite components of at most 1e4",
    );
    check(
        &ball("joint = { slider = { axis = [1, 0, 0] } }"),
        "field `joint` is given; expected none without a `mass`",
    );
    check(
        &ball("mass = 1\njoint = { hinge = { axis = [0, 0, 0] } }"),
        "field `joint.hinge.axis` is [0.0, 0.0, 0.0]; expected three finite numbers, not all 0",
    );
    check(
        &ball("mass = 1\njoint = { hinge = { axis = [0, 0, 1], limits = [-4, 0] } }"),
        "field `joint.hinge.limits` is [-4.0, 0.0]; expected [smallest, largest] with 0 in between, within half a turn (pi rad)",
    );
    check(
        &ball("mass = 1\njoint = { slider = { axis = [0, 0, 1], limits = [0.1, 0.2] } }"),
        "field `joint.slider.limits` is [0.1, 0.2]; expected [smallest, largest] with 0 in between, within 1e6 m",
    );
    check(
        &ball("mass = 1\njoint = { slider = { axis = [0, 0, 1], damping = -1 } }"),
        "field `joint.slider.damping` is -1; expected a number from 0 to 1e15",
    );
}

#[test]
fn an_obstacle_has_one_shape() {
    let all = "half_space, box, sphere, capsule, cylinder, pipe, mesh";
    let none = format!("obstacle 1 `it` has no shape; expected exactly one of {all}");
    assert_eq!(said("friction = 1"), none);
    let two =
        format!("obstacle 1 `it` has the shapes `box` and `sphere`; expected exactly one of {all}");
    assert_eq!(
        said("sphere = { radius = 1 }\nbox = { size = [1, 1, 1] }"),
        two
    );
    let expected = "expected one of `length` and `path`";
    check(
        "pipe = { radius = 1 }",
        &format!("field `pipe` is given without `length` and `path`; {expected}"),
    );
    check(
        "pipe = { radius = 1, length = 1, path = [] }",
        &format!("field `pipe` is given with `length` and `path`; {expected}"),
    );
}

#[test]
fn a_path_is_a_line_through_points_apart() {
    check(
        "pipe = { radius = 1, path = [[0, 0, 0]] }",
        "field `pipe.path` is a list of 1; expected two points at least",
    );
    check(
        "pipe = { radius = 1, path = [[0, 0, 0], [0, inf, 0]] }",
        "field `pipe.path[1]` is [0.0, inf, 0.0]; expected finite coordinates of at most 1e6 m",
    );
    let same = said("pipe = { radius = 1, path = [[0, 0, 1], [0, 0, 1]] }");
    assert!(same.starts_with("obstacle 1 `it`: "), "{same}");
    let long = "[0, 0, 1], [0, 0, 2], ".repeat(10_001);
    check(
        &format!("pipe = {{ radius = 1, path = [{long}] }}"),
        "field `pipe.path` is a line of 20002 points, with 20000 left; expected 20000 points at most of all pipes together, \
         2 of a straight one",
    );
}

/// What reading alone refuses has the line, the obstacle, and the table that a field belongs in.
#[test]
fn unknown_and_wrong_fields_are_named_with_their_obstacle() {
    for (fields, parts) in [
        (
            "radius = 1",
            &[
                "unknown field `radius`, expected one of `name`",
                "`radius` belongs in `sphere`, `capsule` and `cylinder` or `pipe`",
            ][..],
        ),
        (
            "colour = [1, 2, 3]",
            &[
                "unknown field `colour`, expected one of",
                "`color`",
                "line 5, column 1",
            ],
        ),
        (
            "sphere = { raduis = 1 }",
            &["unknown field `raduis`, expected `radius`"],
        ),
        ("sphere = {}", &["missing field `radius`"]),
        (
            "sphere = 1",
            &["invalid type: integer `1`, expected a table { radius }"],
        ),
        ("half_space = { height = 1 }", &["unknown field `height`"]),
        (
            "mesh = { file = 'a.stl', sclae = 1 }",
            &["unknown field `sclae`, expected one of `file`, `scale`, `vertices`, `triangles`"],
        ),
        (
            "mesh = { file = 'a.stl', vertices = [[0, 0, 0]] }",
            &[
                "expected a mesh with `file` and perhaps `scale`, or one with `vertices` and `triangles`",
            ],
        ),
        (
            "mesh = 3",
            &[
                "invalid type: integer `3`, expected the name of an STL file, { file, scale }, or { vertices, triangles }",
            ],
        ),
        (
            "color = [256, 0, 0]",
            &["invalid value: integer `256`, expected u8"],
        ),
        (
            "position = [1, 2]",
            &["invalid length 2, expected an array of length 3"],
        ),
        (
            "friction = 'high'",
            &["invalid type: string \"high\", expected f64"],
        ),
    ] {
        let said = said(fields);
        assert!(
            said.starts_with("obstacle 1 `it`: TOML parse error at line "),
            "{fields}: {said}"
        );
        for part in parts {
            assert!(said.contains(part), "{fields}: {said}");
        }
    }
    let other = said("sphere = { radius = 1 }\n[robot]\nname = '2m'");
    assert!(
        other.starts_with("TOML parse error")
            && other.contains(
                "unknown field `robot`, expected one of `self_contact`, `contact_law`, `smoothing`, `obstacle`"
            ),
        "{other}"
    );
    let other = scene("friction = 1\n[[obstacle]]\nhalf_space = {}")
        .unwrap_err()
        .to_string();
    assert!(
        other.ends_with("`friction` belongs in [[obstacle]]"),
        "{other}"
    );
    let unnamed = scene("obstacle = [{ half_space = {} }, { sphere = { size = 1 } }]")
        .unwrap_err()
        .to_string();
    assert!(
        unnamed.starts_with("obstacle 1: TOML parse error"),
        "{unnamed}"
    );
    let syntax = said("sphere = {");
    assert!(syntax.starts_with("TOML parse error at line 5"), "{syntax}");
}

#[test]
fn laws_of_contacts_are_those_that_there_are() {
    for (law, expected) in [
        (
            "compliant = { relaxation = -1 }",
            "`contact_law.compliant.relaxation` is -1; expected a time from 0 to 1 s",
        ),
        (
            "compliant = { relaxation = nan }",
            "`contact_law.compliant.relaxation` is NaN; expected a time from 0 to 1 s",
        ),
        (
            "impedance = { solref = [0.02, 0] }",
            "`contact_law.impedance.solref` is [0.02, 0.0]; expected a time constant (s) and a damping ratio, both above 0",
        ),
        (
            "impedance = { solimp = [0.9, 0.95, inf, 0.5, 2] }",
            "`contact_law.impedance.solimp` is [0.9, 0.95, inf, 0.5, 2.0]; expected five finite numbers, none below 0",
        ),
        (
            "rigid = {}",
            "unknown variant `rigid`, expected `compliant` or `impedance`",
        ),
        (
            "impedance = { solreff = [0.02, 1] }",
            "unknown field `solreff`, expected `solref` or `solimp`",
        ),
        (
            "compliant = { time = 1 }",
            "unexpected keys in table: time, available keys: relaxation",
        ),
    ] {
        let refused = scene(&format!("contact_law = {{ {law} }}")).unwrap_err();
        assert!(refused.to_string().contains(expected), "{law}: {refused}");
    }
}

#[test]
fn names_are_of_one_obstacle_each() {
    let two = "[[obstacle]]\nname = 'obstacle 1'\nhalf_space = {}\n[[obstacle]]\nhalf_space = {}";
    let expected = "obstacles 0 and 1 are both named `obstacle 1`; expected names of their own";
    assert_eq!(scene(two).unwrap_err().to_string(), expected);
    let made = Scene::new(vec![Obstacle::half_space("a"), Obstacle::half_space("a")]);
    assert!(matches!(
        made,
        Err(SceneError::Name {
            obstacles: [0, 1],
            ..
        })
    ));
    let expected = "expected a name of 1 to 100 characters, none a control character";
    for name in [String::new(), "a\nb".to_owned(), "a".repeat(101)] {
        let said = Scene::new(vec![Obstacle::half_space(&name)])
            .unwrap_err()
            .to_string();
        assert!(
            said.ends_with(&format!("field `name` is {name:?}; {expected}")),
            "{said}"
        );
    }
}

#[test]
fn obstacles_are_10_000_at_most() {
    let text = "[[obstacle]]\nhalf_space = {}\n";
    assert_eq!(
        scene(&text.repeat(10_000)).unwrap().obstacles().len(),
        10_000
    );
    let expected = "10001 obstacles; expected 10000 at most";
    assert_eq!(
        scene(&text.repeat(10_001)).unwrap_err().to_string(),
        expected
    );
    let made = (0..10_001)
        .map(|k| Obstacle::half_space(&format!("{k}")))
        .collect();
    assert_eq!(Scene::new(made).unwrap_err().to_string(), expected);
}

#[test]
fn files_are_named() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("scene.toml");
    let said = |text: Option<&str>| {
        if let Some(text) = text {
            fs::write(&path, text).unwrap();
        }
        let said = Scene::load(&path).unwrap_err().to_string();
        let prefix = format!("scene file {}: ", path.display());
        said.strip_prefix(&prefix)
            .unwrap_or_else(|| panic!("{said}"))
            .to_owned()
    };
    assert_eq!(
        said(None),
        "it cannot be read: No such file or directory (os error 2)"
    );
    let wrong = "[[obstacle]]\nname = 'it'\nsphere = { radius = 0 }";
    assert_eq!(
        said(Some(wrong)),
        "obstacle 0 `it`: field `sphere.radius` is 0; expected a length above 0, at most 1e6 m"
    );
    let mesh = folder.path().join("none.stl");
    let expected = format!(
        "obstacle 0: cannot read mesh {}: No such file or directory (os error 2)",
        mesh.display()
    );
    assert_eq!(said(Some("[[obstacle]]\nmesh = 'none.stl'")), expected);
    assert!(said(Some("[[obstacle]]\nmesh = '/dev/zero'")).contains("not a regular file"));
    let scale = "obstacle 0: field `mesh.scale` is -1; expected a number above 0, at most 1e15";
    assert_eq!(
        said(Some(
            "[[obstacle]]\nmesh = { file = 'none.stl', scale = -1 }"
        )),
        scale
    );
    let large = "#".repeat((16 << 20) + 1);
    assert_eq!(
        said(Some(&large)),
        "it cannot be read: 16777217 bytes; expected at most 16777216"
    );
    fs::write(&path, [0xff]).unwrap();
    assert_eq!(said(None), "it cannot be read: not UTF-8 text");
}

/// Many meshes take no more memory than one may.
#[test]
fn meshes_are_256_mib_at_most_together() {
    let folder = tempfile::tempdir().unwrap();
    for name in ["a.stl", "b.stl"] {
        let file = fs::File::create(folder.path().join(name)).unwrap();
        // A header and holes: nothing is read of what is too large.
        file.set_len(150 << 20).unwrap();
    }
    let text = "[[obstacle]]\nmesh = 'a.stl'";
    let first = Scene::from_toml(text, folder.path())
        .unwrap_err()
        .to_string();
    assert!(first.contains("is not STL"), "{first}");
    fs::File::create(folder.path().join("b.stl"))
        .unwrap()
        .set_len(257 << 20)
        .unwrap();
    let text = "[[obstacle]]\nmesh = 'b.stl'";
    let said = Scene::from_toml(text, folder.path())
        .unwrap_err()
        .to_string();
    let file = folder.path().join("b.stl");
    let expected = format!(
        "obstacle 0: field `mesh` is {} of 269484032 bytes; expected files of 256 MiB at most of all meshes together",
        file.display()
    );
    assert_eq!(said, expected);
}

/// Fields that are set by hand are checked when the scene is made; setters check at once.
#[test]
fn scenes_made_by_hand_are_checked() {
    let said = |obstacle: Obstacle| Scene::new(vec![obstacle]).unwrap_err().to_string();
    let ball = || Obstacle::sphere("ball", 0.1).unwrap();
    let mut wrong = ball();
    wrong.compliance = f64::NAN;
    assert_eq!(
        said(wrong),
        "obstacle 0 `ball`: field `compliance` is NaN; expected a number from 0 to 1e15"
    );
    assert!(said(ball().at([f64::NAN; 3])).contains("field `position`"));
    let mut turned = Isometry3::identity();
    turned.rotation.as_mut_unchecked().coords *= 2.0;
    let expected =
        "field `orientation` is [2.0, 0.0, 0.0, 0.0]; expected a unit quaternion (w, x, y, z)";
    assert!(said(ball().with_pose(turned)).ends_with(expected));
    let large = ObstacleShape::Solid(Shape::sphere(2e6).unwrap());
    let expected = "obstacle 0 `big`: field `sphere` is of a shape that reaches 2e6 m from its origin; expected 1e6 m at most";
    assert_eq!(said(Obstacle::new("big", large)), expected);
    let refused = |result: Result<Obstacle, SceneError>| result.unwrap_err().to_string();
    let expected = "obstacle `ball`: field `friction` is -1; expected a number from 0 to 1e15";
    assert_eq!(refused(ball().with_friction(-1.0)), expected);
    assert!(refused(ball().with_compliance(f64::INFINITY)).contains("field `compliance` is inf"));
    assert!(refused(ball().with_mass(0.0)).contains("field `mass` is 0"));
    assert!(refused(ball().with_orientation([0.0; 4])).contains("field `orientation`"));
    assert!(refused(Obstacle::sphere("b", -1.0)).contains("field `sphere.radius` is -1"));
    assert!(refused(Obstacle::mesh("m", Path::new("/none.stl"), 1.0)).contains("cannot read mesh"));
}
