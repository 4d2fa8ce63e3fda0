//! What a model has that can touch: beads on the discs, and obstacles.

use super::write::{Attribute, XmlWriter, number, numbers, quaternion, rgba, vector};
use crate::contact::ContactSettler;
use crate::geometry::{Kind, Triangles};
use crate::robot::Robot;
use crate::scene::{ContactLaw, JointSpec, Obstacle, ObstacleShape, Scene};

/// Default classes of obstacles and of what a robot touches with.
pub(super) const OBSTACLE: &str = "obstacle";
pub(super) const BEAD: &str = "bead";
/// That of objects: obstacles that move.
const OBJECT: &str = "object";
/// Half sides of what is seen of a plane (m), and the spacing of its grid.
const PLANE: [f64; 3] = [1.0, 1.0, 0.1];
/// Time constant of contacts, in time steps; MuJoCo takes 2 at the least.
const TIME_STEPS: f64 = 4.0;

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
            Written::Primitive | Written::Hull(_) => continue,
        };
        notes.push(format!("obstacle `{}`: {text}", obstacle.name));
    }
    let is_compliant = matches!(scene.contact_law(), ContactLaw::Compliant { .. });
    if !scene.is_empty() && is_compliant {
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
    match shape.convex_surface() {
        Some(hull) => Written::Hull(hull),
        None => Written::Left(
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

    /// Whether the scene's contacts push by MuJoCo's law, under which there is no friction, and discs do not touch each other.
    fn is_mujocos(&self) -> bool {
        matches!(self.scene.contact_law(), ContactLaw::Impedance(_))
    }

    /// For each disc the first above it that it touches: [`ContactSettler::touchable`].
    fn touchable(&self) -> Option<&[usize]> {
        let settler = self.settler.as_ref().filter(|_| !self.is_mujocos());
        settler.and_then(ContactSettler::touchable)
    }

    /// Classes of what touches: bits 1 of beads and 2 of obstacles, each touching the other, and beads each other where the robot
    /// touches itself.
    pub fn write_defaults(&self, xml: &mut XmlWriter, timestep: f64) {
        if self.settler.is_none() {
            return;
        }
        let own = if self.touchable().is_some() { 3 } else { 2 };
        let text = |value: &str| value.to_owned();
        let (solref, solimp) = match self.scene.contact_law() {
            ContactLaw::Compliant { .. } => (
                numbers(&[TIME_STEPS * timestep, 1.0]),
                text("0.99 0.999 0.0001"),
            ),
            ContactLaw::Impedance(law) => (numbers(&law.solref), numbers(&law.solimp)),
        };
        let solver = [("solref", solref), ("solimp", solimp)];
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
        // MuJoCo's own friction is 1, and of two geoms the larger counts.
        let obstacles = [
            ("mass", text("0")),
            ("condim", text("1")),
            ("friction", text("0 0 0")),
        ];
        let classes = [
            (BEAD, [&beads[..], &bits(1, own), &solver].concat()),
            (OBSTACLE, [&obstacles[..], &bits(2, 1), &solver].concat()),
            // They touch beads, obstacles and each other.
            (OBJECT, [&obstacles[1..], &bits(6, 7), &solver].concat()),
        ];
        let has_objects = self.scene.objects().next().is_some();
        let count = if has_objects { 3 } else { 2 };
        for (class, attributes) in classes.into_iter().take(count) {
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
            if obstacle.mass.is_some() {
                continue;
            }
            let Some(mut attributes) = self.geom(index, OBSTACLE) else {
                xml.comment(&format!(
                    "obstacle {index} is left out: MuJoCo has no such shape"
                ));
                continue;
            };
            attributes.push(("pos", vector(&obstacle.pose.translation.vector)));
            attributes.push(("quat", quaternion(&obstacle.pose.rotation)));
            xml.leaf("geom", &attributes);
        }
    }

    /// Objects, each a body of its own on a free joint, or on its joint to the world; after the robot, so that its coordinates are the
    /// first.
    pub fn write_objects(&self, xml: &mut XmlWriter) {
        for (index, object) in self.scene.objects() {
            let Some(mut attributes) = self.geom(index, OBJECT) else {
                xml.comment(&format!(
                    "object {index} is left out: MuJoCo has no such shape"
                ));
                continue;
            };
            xml.open(
                "body",
                &[
                    ("name", self.name(index)),
                    ("pos", vector(&object.pose.translation.vector)),
                    ("quat", quaternion(&object.pose.rotation)),
                ],
            );
            match &object.joint {
                None => xml.leaf("freejoint", &[]),
                Some(joint) => xml.leaf("joint", &joint_attributes(joint)),
            }
            attributes.push(("mass", number(object.mass.unwrap_or_default())));
            xml.leaf("geom", &attributes);
            xml.close();
        }
    }

    /// MuJoCo's coordinates of the objects where the scene has them.
    pub fn coordinates(&self) -> Vec<f64> {
        let objects = self.scene.objects();
        let written =
            objects.filter(|(index, _)| !matches!(self.written[*index], Written::Left(_)));
        written
            .flat_map(|(_, object)| match object.joint {
                Some(_) => vec![0.0],
                None => {
                    let (at, turn) = (object.pose.translation.vector, object.pose.rotation);
                    vec![at.x, at.y, at.z, turn.w, turn.i, turn.j, turn.k]
                }
            })
            .collect()
    }

    /// The geom of an obstacle in its frame; `None` of one that is left out.
    fn geom(&self, index: usize, class: &str) -> Option<Vec<Attribute<'_>>> {
        if matches!(self.written[index], Written::Left(_)) {
            return None;
        }
        let obstacle = &self.scene.obstacles()[index];
        let (kind, size) = match &obstacle.shape {
            ObstacleShape::HalfSpace => ("plane", numbers(&PLANE)),
            ObstacleShape::Pipe(_) => return None,
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
            ("class", class.to_owned()),
            ("type", kind.to_owned()),
            (if kind == "mesh" { "mesh" } else { "size" }, size),
            ("rgba", rgba(obstacle.color)),
        ];
        if obstacle.friction > 0.0 && !self.is_mujocos() {
            attributes.push(("condim", "3".to_owned()));
            attributes.push(("friction", numbers(&[obstacle.friction, 0.0, 0.0])));
        }
        Some(attributes)
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
        let Some(first) = self.touchable() else {
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

/// A joint of an object to the world.
fn joint_attributes(joint: &JointSpec) -> Vec<Attribute<'_>> {
    let (kind, anchor, limits, damping) = match joint {
        JointSpec::Hinge(it) => ("hinge", it.anchor, it.limits, it.damping),
        JointSpec::Slider(it) => ("slide", [0.0; 3], it.limits, it.damping),
    };
    let mut attributes: Vec<Attribute> = vec![
        ("type", kind.to_owned()),
        ("axis", numbers(&joint.axis())),
        ("pos", numbers(&anchor)),
    ];
    if let Some(limits) = limits {
        attributes.push(("limited", "true".to_owned()));
        attributes.push(("range", numbers(&limits)));
    }
    if damping > 0.0 {
        attributes.push(("damping", number(damping)));
    }
    attributes
}

/// Name of the mesh of an obstacle.
fn mesh(index: usize) -> String {
    format!("obstacle{index}")
}
