//! From a robot's specification to a MuJoCo model.

use nalgebra::{Quaternion, UnitQuaternion, Vector3};

use super::check::{longest, representable};
use super::keyframe::{KEYFRAME, Start};
use super::obstacles::Touching;
use super::options::ExportOptions;
use super::write::{Attribute, XmlWriter, number, numbers, quaternion, rgba, vector};
use super::written_joint::WrittenJoint;
use crate::camera::Camera;
use crate::formats::ExportError;
use crate::geometry::{Kind, Solid, base_solids, disc_color};
use crate::render::BaseVisibility;
use crate::robot::{
    Body, Cameras, Disc, Drive, HingeRow, Lens, MassSpec, Payload, Pull, Robot, RobotSpec, Tendon,
    Waypoint,
};

/// What a model says of joints that bend and turn unlike.
pub(super) const IN_SERIES: &str = "Bending and torsion differ: each joint is a ball with the largest stiffness, \
                         in series with a hinge about each softer axis. Turns about one of the axes \
                         have exactly the energy of the rod; combined turns differ by terms of \
                         fourth order in the angles.";

/// The robot as a MuJoCo model (MJCF text), its numbers in full precision.
///
/// Bodies are named `base`, `disc0`, ..; sites `base_0`, `disc0_0`, .. by their hole; tendons and
/// their actuators `tendon0`, ..; cameras `camera0`, ..; the keyframe `settled`. A command is MuJoCo's
/// `ctrl`.
///
/// With a scene, obstacles are geoms of the world by their names (`obstacle0`, .. where two would be the same), and what the robot
/// touches with are spheres on its discs; [`scene_notes`](super::scene_notes) tells what MuJoCo has otherwise. The keyframe is an
/// equilibrium among the obstacles.
///
/// # Errors
/// [`ExportError`] for an invalid robot, and for whatever MuJoCo cannot represent with the same
/// meaning, by the field's path: soft limits, friction of tendons, drives
/// that set the length of an inextensible tendon, discs without mass, distorted lenses, cameras of
/// unlike resolutions, pixels that are not square or centred on the optical axis. For a command of
/// another robot, or one that it does not settle in, and for a time step that is not stable. For a straight robot inside an obstacle.
pub fn export(spec: &RobotSpec, options: &ExportOptions) -> Result<String, ExportError> {
    let robot = Robot::new(spec.clone())?;
    representable(&robot, &options.payload)?;
    let joints: Vec<WrittenJoint> = robot.discs().iter().map(WrittenJoint::of).collect();
    let start = Start::of(&robot, options)?;
    let touching = Touching::new(&robot, &options.scene);
    let timestep = start.timestep(&robot, &joints, options)?;
    let mut xml = XmlWriter::default();
    xml.open("mujoco", &[("model", spec.name.clone())]);
    xml.leaf("compiler", &[("angle", "radian".to_owned())]);
    xml.leaf(
        "option",
        &[
            ("timestep", number(timestep)),
            ("integrator", options.integrator.name().to_owned()),
            ("gravity", numbers(&spec.gravity)),
        ],
    );
    write_visual(&mut xml, spec);
    write_defaults(&mut xml, &touching, timestep);
    touching.write_meshes(&mut xml);
    xml.open("worldbody", &[]);
    write_cameras(&mut xml, spec);
    if options.base == BaseVisibility::Shown {
        for solid in base_solids(&robot) {
            write_solid(&mut xml, &solid);
        }
    }
    touching.write_obstacles(&mut xml);
    if !joints.iter().all(WrittenJoint::is_as_here) {
        xml.comment(IN_SERIES);
    }
    let base = Base {
        position: spec.base.position,
        orientation: robot.base_orientation(),
        class: None,
    };
    write_chain(
        &mut xml,
        &robot,
        &joints,
        &options.payload,
        &touching,
        &base,
    );
    touching.write_objects(&mut xml);
    xml.close();
    touching.write_exclusions(&mut xml);
    if !robot.tendons().is_empty() {
        write_tendons(&mut xml, &robot, None);
    }
    if start.settled {
        let mut coordinates = start.coordinates(&robot, &joints);
        coordinates.extend(touching.coordinates());
        write_keyframe(&mut xml, &start, &coordinates);
    }
    Ok(xml.finish())
}

/// What the model that [`export`] writes has otherwise than the robot, if anything: to be said to whoever takes it.
///
/// # Errors
/// [`ExportError`] for an invalid robot.
pub fn export_notes(spec: &RobotSpec) -> Result<Vec<String>, ExportError> {
    let robot = Robot::new(spec.clone())?;
    let unlike = |disc: &&Disc| !WrittenJoint::of(disc).is_as_here();
    let ratio = |disc: &Disc| {
        let springs = disc.backbone.map_or(Vector3::zeros(), |b| b.stiffness());
        springs.max() / springs.min()
    };
    let ratios = robot.discs().iter().filter(unlike).map(ratio);
    let count = ratios.clone().count();
    let Some(largest) = ratios.reduce(f64::max) else {
        return Ok(Vec::new());
    };
    Ok(vec![format!(
        "bending and torsion differ at {count} joints, by up to {largest:.3} times, which MuJoCo's ball joints cannot: each is written \
         as a ball in series with hinges. Turns about one axis are the same, combined ones are not, by the fourth power of the angle: \
         the tip of 2m is 4e-5 mm off where torsion is 0.77 times bending, 0.01 mm at 1.15 times and 0.6 mm at 3 times"
    )])
}

/// What a model of a robot [on hinges](RobotSpec::on_hinges) has otherwise than the robot `spec`, if anything.
///
/// # Errors
/// [`ExportError`] for an invalid robot.
pub fn hinge_notes(spec: &RobotSpec, row: HingeRow) -> Result<Vec<String>, ExportError> {
    let robot = Robot::new(spec.clone())?;
    let balls = robot.discs().iter().filter(|disc| disc.hinges.is_none());
    let elastic = balls.clone().filter(|disc| disc.backbone.is_some()).count();
    let mut notes = Vec::new();
    if row == HingeRow::Universal && balls.clone().count() > 0 {
        notes.push(format!(
            "{} ball joints are written as hinges about x, then y: their discs cannot twist",
            balls.count()
        ));
    }
    if elastic > 0 {
        notes.push(format!(
            "{elastic} elastic ball joints are written as hinges: turns about one axis have the same energy, combined ones differ by \
             the fourth power of the angle"
        ));
    }
    Ok(notes)
}

fn write_visual(xml: &mut XmlWriter, spec: &RobotSpec) {
    let cameras = Camera::placed(&spec.cameras);
    let largest = |side: fn(&Camera) -> u32| cameras.iter().map(side).max().unwrap_or_default();
    let [width, height] = [
        largest(|camera| camera.intrinsics.width),
        largest(|camera| camera.intrinsics.height),
    ];
    xml.open("visual", &[]);
    xml.leaf(
        "global",
        &[
            ("offwidth", width.to_string()),
            ("offheight", height.to_string()),
        ],
    );
    xml.close();
}

fn write_defaults(xml: &mut XmlWriter, touching: &Touching, timestep: f64) {
    xml.open("default", &[]);
    let no_contact = [("contype", "0".to_owned()), ("conaffinity", "0".to_owned())];
    xml.leaf("geom", &no_contact);
    xml.leaf("site", &[("size", "0.001".to_owned())]);
    xml.leaf(
        "tendon",
        &[
            ("width", "0.0005".to_owned()),
            ("rgba", "0.2 0.2 0.2 1".to_owned()),
        ],
    );
    xml.open("default", &[("class", "visual".to_owned())]);
    xml.leaf(
        "geom",
        &[("group", "1".to_owned()), ("mass", "0".to_owned())],
    );
    xml.close();
    touching.write_defaults(xml, timestep);
    xml.close();
}

fn write_cameras(xml: &mut XmlWriter, spec: &RobotSpec) {
    // MuJoCo's cameras look along -z with y up; ours along z with y down.
    let half_turn = UnitQuaternion::new_unchecked(Quaternion::new(0.0, 1.0, 0.0, 0.0));
    for (index, camera) in Camera::placed(&spec.cameras).iter().enumerate() {
        let position = camera.pose.translation.vector;
        xml.leaf(
            "camera",
            &[
                ("name", format!("camera{index}")),
                ("pos", vector(&position)),
                ("quat", quaternion(&(camera.pose.rotation * half_turn))),
                ("fovy", number(fovy(spec, index, camera))),
            ],
        );
    }
}

/// Vertical field of view (degrees), as the specification has it where it does.
fn fovy(spec: &RobotSpec, index: usize, camera: &Camera) -> f64 {
    let given = match &spec.cameras {
        Cameras::Ring(ring) => Lens::Fovy(ring.fovy),
        Cameras::Free(cameras) => cameras[index].lens,
    };
    match given {
        Lens::Fovy(degrees) => degrees,
        Lens::Pixels(_) => {
            let half = f64::from(camera.intrinsics.height) / (2.0 * camera.intrinsics.fy);
            2.0 * half.atan().to_degrees()
        }
    }
}

fn write_solid(xml: &mut XmlWriter, solid: &Solid) {
    let (kind, size) = match &solid.shape.0 {
        Kind::Cylinder(c) => ("cylinder", numbers(&[c.radius, c.half_height])),
        Kind::Cuboid(c) => ("box", vector(&c.half)),
        other => unreachable!("the base is made of cylinders and boxes, not {other:?}"),
    };
    xml.leaf(
        "geom",
        &[
            ("class", "visual".to_owned()),
            ("type", kind.to_owned()),
            ("size", size),
            ("pos", vector(&solid.pose.translation.vector)),
            ("quat", quaternion(&solid.pose.rotation)),
            ("rgba", rgba(solid.color)),
        ],
    );
}

/// The body that a chain stands on.
pub(super) struct Base {
    /// In the model's world (m).
    pub position: [f64; 3],
    pub orientation: UnitQuaternion<f64>,
    /// Class whose defaults all of the chain has.
    pub class: Option<&'static str>,
}

impl Base {
    fn attributes(&self) -> Vec<Attribute<'static>> {
        let mut base = vec![
            ("name", "base".to_owned()),
            ("pos", numbers(&self.position)),
        ];
        if self.orientation != UnitQuaternion::identity() {
            base.push(("quat", quaternion(&self.orientation)));
        }
        base.extend(self.class.map(|class| ("childclass", class.to_owned())));
        base
    }
}

/// The base and the discs, each within the one below.
pub(super) fn write_chain(
    xml: &mut XmlWriter,
    robot: &Robot,
    joints: &[WrittenJoint],
    payload: &Payload,
    touching: &Touching,
    base: &Base,
) {
    let spec = robot.spec();
    xml.open("body", &base.attributes());
    write_sites(xml, spec, Body::Base, spec.base.hole_height);
    for (index, (disc, joint)) in robot.discs().iter().zip(joints).enumerate() {
        write_disc(xml, robot, index, disc, joint);
        touching.write_beads(xml, index);
    }
    if payload.mass > 0.0 {
        xml.open("body", &[("name", "payload".to_owned())]);
        write_inertial(xml, payload.offset, payload.mass, [0.0; 3]);
        xml.close();
    }
    for _ in 0..=robot.discs().len() {
        xml.close();
    }
}

/// Opens the body of a disc, and leaves it open for the next.
fn write_disc(xml: &mut XmlWriter, robot: &Robot, index: usize, disc: &Disc, joint: &WrittenJoint) {
    let rest = disc.backbone.map_or(Vector3::zeros(), |b| b.rest.into());
    let bend = match &disc.hinges {
        None => UnitQuaternion::from_scaled_axis(rest),
        Some(hinges) => hinges.zero,
    };
    let mut body = vec![("name", format!("disc{index}"))];
    if bend == UnitQuaternion::identity() {
        body.push(("pos", vector(&disc.offset)));
    } else {
        let joint = disc.offset - disc.origin;
        body.push(("pos", vector(&(joint + bend * disc.origin))));
        body.push(("quat", quaternion(&bend)));
    }
    xml.open("body", &body);
    let geom_mass = match density(robot.spec(), index) {
        Some(density) => ("density", number(density)),
        None => {
            let center = disc.centre_of_mass.into();
            write_inertial(xml, center, disc.mass, disc.inertia.into());
            ("mass", "0".to_owned())
        }
    };
    for attributes in joint.elements() {
        xml.leaf("joint", &attributes);
    }
    xml.leaf(
        "geom",
        &[
            ("type", "cylinder".to_owned()),
            ("size", numbers(&[disc.radius, disc.half_height])),
            geom_mass,
            ("rgba", rgba(disc_color(index, robot.discs().len()))),
        ],
    );
    write_sites(xml, robot.spec(), Body::Disc(index), 0.0);
}

fn write_inertial(xml: &mut XmlWriter, center: [f64; 3], mass: f64, moments: [f64; 3]) {
    xml.leaf(
        "inertial",
        &[
            ("pos", numbers(&center)),
            ("mass", number(mass)),
            ("diaginertia", numbers(&moments)),
        ],
    );
}

fn write_sites(xml: &mut XmlWriter, spec: &RobotSpec, body: Body, height: f64) {
    for (hole, [x, y]) in spec.hole_positions(body).into_iter().enumerate() {
        let name = site(Waypoint(body, hole));
        xml.leaf("site", &[("name", name), ("pos", numbers(&[x, y, height]))]);
    }
}

/// Tendons, with the defaults of a class if they have one, and their actuators.
pub(super) fn write_tendons(xml: &mut XmlWriter, robot: &Robot, class: Option<&str>) {
    xml.open("tendon", &[]);
    for (index, tendon) in robot.tendons().iter().enumerate() {
        let mut attributes = vec![("name", format!("tendon{index}"))];
        attributes.extend(class.map(|class| ("class", class.to_owned())));
        xml.open("spatial", &attributes);
        for waypoint in &tendon.route {
            xml.leaf("site", &[("site", site(*waypoint))]);
        }
        xml.close();
    }
    xml.close();
    xml.open("actuator", &[]);
    for (index, tendon) in robot.tendons().iter().enumerate() {
        write_actuator(xml, index, tendon, longest(robot, index));
    }
    xml.close();
}

fn write_keyframe(xml: &mut XmlWriter, start: &Start, coordinates: &[f64]) {
    let mut key = vec![
        ("name", KEYFRAME.to_owned()),
        ("qpos", numbers(coordinates)),
    ];
    let command = start.command.as_slice();
    if !command.is_empty() {
        key.push(("ctrl", numbers(command)));
    }
    xml.open("keyframe", &[]);
    xml.leaf("key", &key);
    xml.close();
}

/// The actuator of a tendon that gets at most `longest` (m) long.
fn write_actuator(xml: &mut XmlWriter, index: usize, tendon: &Tendon, longest: f64) {
    let name = format!("tendon{index}");
    let mut attributes = vec![("name", name.clone()), ("tendon", name)];
    let tag = match tendon.drive {
        Drive::Gain(_) | Drive::Length => {
            attributes.push(("kp", number(tendon.stiffness)));
            "position"
        }
        // A tension shortens the tendon, where MuJoCo's forces lengthen it.
        Drive::Tension => {
            attributes.push(("gear", "-1".to_owned()));
            "motor"
        }
    };
    attributes.push(("ctrllimited", "true".to_owned()));
    attributes.push(("ctrlrange", numbers(&tendon.range)));
    if tendon.pull == Pull::TensionOnly && tendon.drive != Drive::Tension {
        // MuJoCo wants a lower end, too: one that no command and no pose reach.
        let strongest = tendon.stiffness * (longest - tendon.range[0]).max(1.0);
        let beyond = 10_f64.powf(strongest.log10().ceil());
        attributes.push(("forcelimited", "true".to_owned()));
        attributes.push(("forcerange", numbers(&[-beyond.max(strongest), 0.0])));
    }
    xml.leaf(tag, &attributes);
}

fn site(waypoint: Waypoint) -> String {
    match waypoint {
        Waypoint(Body::Base, hole) => format!("base_{hole}"),
        Waypoint(Body::Disc(disc), hole) => format!("disc{disc}_{hole}"),
    }
}

/// Density of a disc whose mass is that of its cylinder; `None` where the mass, its centre or the
/// moments of inertia are others.
fn density(spec: &RobotSpec, disc: usize) -> Option<f64> {
    let module = spec.module_of(disc)?;
    let first: usize = spec.modules[..module].iter().map(|m| m.discs).sum();
    match &spec.modules[module].mass {
        MassSpec::Density(density) if !carries_rod(spec, disc) => {
            density.of_disc(disc - first).copied()
        }
        MassSpec::Density(_) | MassSpec::Solid(_) | MassSpec::Rigid(_) => None,
    }
}

/// Whether a disc carries a piece of a rod: of its own module's, or of that of the module above.
fn carries_rod(spec: &RobotSpec, disc: usize) -> bool {
    [disc, disc + 1].into_iter().any(|disc| {
        let module = spec.module_of(disc).map(|module| &spec.modules[module]);
        module.is_some_and(|module| module.rod.is_some())
    })
}
