//! From a robot's specification to URDF.

use std::f64::consts::{FRAC_PI_2, PI};

use nalgebra::Vector3;
use urdf_rs::{
    Axis, Color, Dynamics, Geometry, Inertia, Inertial, Joint, JointLimit, JointType, Link,
    LinkName, Mass, Material, Pose, Vec3, Vec4, Visual,
};

use super::{EXTENSION, LINK_SHARE};
use crate::formats::mjcf::{escape, is_xml_char};
use crate::formats::{ExportError, is_inertia};
use crate::geometry::disc_color;
use crate::robot::{Disc, Robot, RobotSpec};

/// Limit of the joints' speed (rad/s), which URDF wants to be given.
const FASTEST: f64 = 100.0;

/// The robot as URDF text, its numbers in full precision.
///
/// # Errors
/// [`ExportError`] for an invalid robot, for joints of hinges, and for a name that XML cannot hold.
pub fn export(spec: &RobotSpec) -> Result<String, ExportError> {
    let robot = Robot::new(spec.clone())?;
    let refuse = |field: &str, value: String, expected| ExportError::Unsupported {
        format: "URDF",
        field: field.to_owned(),
        value,
        expected,
    };
    if !spec.name.chars().all(is_xml_char) {
        let found = format!("{:?}", spec.name);
        return Err(refuse("name", found, "text without control characters"));
    }
    if let Some(module) = spec.modules.iter().position(|m| m.joint.is_some()) {
        let expected = "ball joints: hinges are written to MJCF alone";
        return Err(refuse(
            &format!("modules[{module}].joint"),
            "given".to_owned(),
            expected,
        ));
    }
    for (disc, model) in robot.discs().iter().enumerate() {
        if is_inertia(model.inertia.into()).is_err() {
            let [a, b, c]: [f64; 3] = model.inertia.into();
            let expected = "moments of inertia of which none exceeds the sum of the others";
            return Err(refuse(
                &format!("mass of disc {disc}"),
                format!("{a:e}, {b:e}, {c:e} kg m2"),
                expected,
            ));
        }
    }
    let (mut links, mut joints) = (vec![link("world"), link("base")], vec![base_joint(&robot)]);
    let count = robot.discs().len();
    for (index, disc) in robot.discs().iter().enumerate() {
        add_disc(
            &mut links,
            &mut joints,
            index,
            disc,
            disc_color(index, count),
        );
    }
    let urdf = urdf_rs::Robot {
        name: spec.name.clone(),
        version: None,
        links,
        joints,
        materials: Vec::new(),
    };
    // Neither can fail on values that passed the checks above.
    let text = urdf_rs::write_to_string(&urdf)
        .map_err(|e| refuse("name", e.to_string(), "text that XML can hold"))?;
    let own =
        (spec.to_toml()).map_err(|e| refuse("name", e.to_string(), "text that TOML can hold"))?;
    let body = text.trim_end();
    let body = body.strip_suffix("</robot>").unwrap_or(body);
    // Between tags, line ends and quotes may stand as they are.
    let own = escape(&own).replace("&#10;", "\n").replace("&quot;", "\"");
    let body = body.trim_end();
    Ok(format!(
        "{body}\n  <{EXTENSION}>\n{own}  </{EXTENSION}>\n</robot>\n"
    ))
}

fn link(name: &str) -> Link {
    Link {
        name: name.to_owned(),
        inertial: Inertial::default(),
        visual: Vec::new(),
        collision: Vec::new(),
    }
}

fn base_joint(robot: &Robot) -> Joint {
    let (roll, pitch, yaw) = robot.base_orientation().euler_angles();
    let origin = Pose {
        xyz: Vec3(robot.base().into()),
        rpy: Vec3([roll, pitch, yaw]),
    };
    Joint {
        joint_type: JointType::Fixed,
        ..joint("base", "world", "base", origin)
    }
}

fn joint(name: &str, parent: &str, child: &str, origin: Pose) -> Joint {
    let link = |name: &str| LinkName {
        link: name.to_owned(),
    };
    Joint {
        name: name.to_owned(),
        joint_type: JointType::Revolute,
        origin,
        parent: link(parent),
        child: link(child),
        axis: Axis::default(),
        limit: JointLimit::default(),
        calibration: None,
        dynamics: None,
        mimic: None,
        safety_controller: None,
    }
}

/// Adds a disc, and the three joints that turn it.
fn add_disc(
    links: &mut Vec<Link>,
    joints: &mut Vec<Joint>,
    index: usize,
    disc: &Disc,
    color: [u8; 3],
) {
    let below = match index.checked_sub(1) {
        None => "base".to_owned(),
        Some(below) => format!("disc{below}"),
    };
    let [x, y] = ["x", "y"].map(|axis| format!("disc{index}_{axis}"));
    let name = format!("disc{index}");
    for between in [&x, &y] {
        links.push(Link {
            inertial: inertial(disc, LINK_SHARE),
            ..link(between)
        });
    }
    links.push(Link {
        inertial: inertial(disc, 1.0),
        visual: vec![cylinder(disc, &name, color)],
        ..link(&name)
    });
    let turns = [
        (&below, &x, Vector3::x(), PI, disc.joint_offset),
        (&x, &y, Vector3::y(), FRAC_PI_2, Vector3::zeros()),
        (&y, &name, Vector3::z(), PI, Vector3::zeros()),
    ];
    for ((parent, child, axis, largest, offset), letter) in turns.into_iter().zip(["x", "y", "z"]) {
        joints.push(Joint {
            axis: Axis {
                xyz: Vec3(axis.into()),
            },
            // Nothing drives the joints but the tendons.
            limit: JointLimit {
                lower: -largest,
                upper: largest,
                effort: 0.0,
                velocity: FASTEST,
                ..JointLimit::default()
            },
            dynamics: Some(Dynamics {
                damping: disc.damping,
                friction: 0.0,
            }),
            ..joint(&format!("disc{index}_{letter}"), parent, child, at(offset))
        });
    }
}

fn at(offset: Vector3<f64>) -> Pose {
    Pose {
        xyz: Vec3(offset.into()),
        rpy: Vec3::default(),
    }
}

/// A share of a disc's mass and moments of inertia, about its centre of mass.
fn inertial(disc: &Disc, share: f64) -> Inertial {
    let [ixx, iyy, izz]: [f64; 3] = (disc.inertia * share).into();
    Inertial {
        origin: at(disc.origin + disc.centre_of_mass),
        mass: Mass {
            value: disc.mass * share,
        },
        inertia: Inertia {
            ixx,
            iyy,
            izz,
            ..Inertia::default()
        },
    }
}

fn cylinder(disc: &Disc, name: &str, color: [u8; 3]) -> Visual {
    let [r, g, b] = color.map(|channel| (f64::from(channel) / 0.255).round() / 1000.0);
    Visual {
        name: None,
        origin: at(disc.origin),
        geometry: Geometry::Cylinder {
            radius: disc.radius,
            length: 2.0 * disc.half_height,
        },
        material: Some(Material {
            name: format!("{name}_color"),
            color: Some(Color {
                rgba: Vec4([r, g, b, 1.0]),
            }),
            texture: None,
        }),
    }
}
