//! What a model has that can touch: beads on the discs, and obstacles.

use super::write::{Attribute, XmlWriter, number, numbers, quaternion, rgba, vector};
use crate::contact::ContactSettler;
use crate::geometry::{Kind, Triangles};
use crate::robot::Robot;
use crate::scene::{Obstacle, ObstacleShape, Scene};

/// Default classes of obstacles and of what a robot touches with.
pub(super) const OBSTACLE: &str = "obstacle";
pub(super) const BEAD: &str = "bead";
/// Half sides of what is seen of a plane (m), and the spacing of its grid.
const PLANE: [f64; 3] = [1.0, 1.0, 0.1];
/// Time constant of contacts, in time steps; MuJoCo takes 2 at the least.
const TIME_STEPS: f64 = 4.0;
/// Share of a hull's volume that a mesh may lack and be convex.
const CONVEX: f64 = 1e-9;

/// What of a model can touch.
pub(super) struct Touching<'a> {
    scene: &'a Scene,
    /// The robot among the obstacles; `None` where it touches nothing.
    settler: Option<ContactSettler>,
    /// How each obstacle is written.
    written: Vec<Written>,
}

/// What MuJoCo has otherwise than a scene, if anything: to be said to whoever takes a model with it.
pub fn scene_notes(scene: &Scene) -> Vec<String> {
    let mut notes = Vec::new();
    for obstacle in scene.obstacles() {
        let text = match written(obstacle) {
            Written::Left(reason) => format!("left out: {reason}"),
            _ if obstacle.mass.is_some() => "written as one that does not move".to_owned(),
            _ => continue,
        };
        notes.push(format!("obstacle `{}`: {text}", obstacle.name));
    }
    if !scene.is_empty() {
        notes.push(
            "surfaces give way by MuJoCo's solref and solimp, in proportion to the inertia of what they touch, and not by a \
             compliance"
                .to_owned(),
        );
    }
    notes
}

/// How an obstacle is written.
enum Written {
    /// By its dimensions.
    Primitive,
    /// By its corners, of which MuJoCo takes the convex hull (m).
    Hull(Triangles),
    /// Not at all, and why.
    Left(&'static str),
}

fn written(obstacle: &Obstacle) -> Written {
    let shape = match &obstacle.shape {
        ObstacleShape::Pipe(_) => return Written::Left("MuJoCo has no pipes that are hollow"),
        ObstacleShape::Solid(shape) if matches!(shape.0, Kind::Mesh(_)) => shape,
        ObstacleShape::Solid(_) | ObstacleShape::HalfSpace => return Written::Primitive,
    };
    let mesh = shape.triangles(&nalgebra::Isometry3::identity());
    match mesh.hull() {
        Some(hull) if mesh.volume().abs() >= (1.0 - CONVEX) * hull.volume() => Written::Hull(hull),
        _ => Written::Left(
            "its mesh is not convex, or not closed, and MuJoCo would touch its convex hull",
        ),
    }
}

impl<'a> Touching<'a> {
    pub fn new(robot: &Robot, scene: &'a Scene) -> Self {
        Self {
            scene,
            settler: (!scene.is_empty()).then(|| ContactSettler::new(robot, scene)),
            written: scene.obstacles().iter().map(written).collect(),
        }
    }

    /// Classes of what touches: bits 1 of beads and 2 of obstacles, each touching the other, and beads each other where the robot
    /// touches itself.
    pub fn write_defaults(&self, xml: &mut XmlWriter, timestep: f64) {
        let Some(settler) = &self.settler else {
            return;
        };
        let own = if settler.touchable().is_some() { 3 } else { 2 };
        let text = |value: &str| value.to_owned();
        let solver = [
            ("solref", numbers(&[TIME_STEPS * timestep, 1.0])),
            ("solimp", text("0.99 0.999 0.0001")),
        ];
        let bits = |contype: u32, conaffinity: u32| {
            [
                ("contype", contype.to_string()),
                ("conaffinity", conaffinity.to_string()),
            ]
        };
        let beads = [
            ("type", text("sphere")),
            ("mass", text("0")),
            // Not shown, as the discs are.
            ("group", text("3")),
            ("condim", text("1")),
            ("friction", text("0 0 0")),
        ];
        let obstacles = [("mass", text("0")), ("condim", text("1"))];
        for (class, attributes) in [
            (BEAD, [&beads[..], &bits(1, own), &solver].concat()),
            (OBSTACLE, [&obstacles[..], &bits(2, 1), &solver].concat()),
        ] {
            xml.open("default", &[("class", text(class))]);
            xml.leaf("geom", &attributes);
            xml.close();
        }
    }

    /// The corners of meshes.
    pub fn write_meshes(&self, xml: &mut XmlWriter) {
        let hulls = || {
            let all = self.written.iter().enumerate();
            all.filter_map(|(index, written)| match written {
                Written::Hull(hull) => Some((index, hull)),
                Written::Primitive | Written::Left(_) => None,
            })
        };
        if hulls().next().is_none() {
            return;
        }
        xml.open("asset", &[]);
        for (index, hull) in hulls() {
            let corners: Vec<f64> = hull.points.iter().flat_map(|p| [p.x, p.y, p.z]).collect();
            xml.leaf(
                "mesh",
                &[("name", mesh(index)), ("vertex", numbers(&corners))],
            );
        }
        xml.close();
    }

    pub fn write_obstacles(&self, xml: &mut XmlWriter) {
        for (index, obstacle) in self.scene.obstacles().iter().enumerate() {
            if matches!(self.written[index], Written::Left(_)) {
                xml.comment(&format!(
                    "obstacle {index} is left out: MuJoCo has no such shape"
                ));
                continue;
            }
            let (kind, size) = match &obstacle.shape {
                ObstacleShape::HalfSpace => ("plane", numbers(&PLANE)),
                ObstacleShape::Pipe(_) => continue,
                ObstacleShape::Solid(shape) => match &shape.0 {
                    Kind::Cuboid(cuboid) => ("box", vector(&cuboid.half)),
                    Kind::Sphere(sphere) => ("sphere", number(sphere.radius)),
                    Kind::Capsule(capsule) => {
                        ("capsule", numbers(&[capsule.radius, capsule.half_length]))
                    }
                    Kind::Cylinder(cylinder) => (
                        "cylinder",
                        numbers(&[cylinder.radius, cylinder.half_height]),
                    ),
                    Kind::Mesh(_) => ("mesh", mesh(index)),
                },
            };
            let mut attributes: Vec<Attribute> = vec![
                ("name", self.name(index)),
                ("class", OBSTACLE.to_owned()),
                ("type", kind.to_owned()),
                (if kind == "mesh" { "mesh" } else { "size" }, size),
                ("pos", vector(&obstacle.pose.translation.vector)),
                ("quat", quaternion(&obstacle.pose.rotation)),
                ("rgba", rgba(obstacle.color)),
            ];
            if obstacle.friction > 0.0 {
                attributes.push(("condim", "3".to_owned()));
                attributes.push(("friction", numbers(&[obstacle.friction, 0.0, 0.0])));
            }
            xml.leaf("geom", &attributes);
        }
    }

    /// The name of an obstacle's geom: its own, if XML can hold that.
    fn name(&self, index: usize) -> String {
        let name = &self.scene.obstacles()[index].name;
        match name.chars().all(super::is_xml_char) {
            true => name.clone(),
            false => format!("obstacle{index}"),
        }
    }

    /// What a disc touches with.
    pub fn write_beads(&self, xml: &mut XmlWriter, disc: usize) {
        let beads = self
            .settler
            .iter()
            .flat_map(|settler| settler.beads().as_slice());
        for bead in beads.filter(|bead| bead.disc == disc) {
            xml.leaf(
                "geom",
                &[
                    ("class", BEAD.to_owned()),
                    ("size", number(bead.radius)),
                    ("pos", vector(&bead.centre)),
                ],
            );
        }
    }

    /// The discs that do not touch each other, but for those on each other, which MuJoCo excludes by itself.
    pub fn write_exclusions(&self, xml: &mut XmlWriter) {
        let Some(first) = self.settler.as_ref().and_then(ContactSettler::touchable) else {
            return;
        };
        let pairs =
            || (first.iter().enumerate()).flat_map(|(i, &end)| (i + 2..end).map(move |j| (i, j)));
        if pairs().next().is_none() {
            return;
        }
        xml.open("contact", &[]);
        for (below, above) in pairs() {
            xml.leaf(
                "exclude",
                &[
                    ("body1", format!("disc{below}")),
                    ("body2", format!("disc{above}")),
                ],
            );
        }
        xml.close();
    }
}

/// Name of the mesh of an obstacle.
fn mesh(index: usize) -> String {
    format!("obstacle{index}")
}
