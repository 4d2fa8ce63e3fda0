//! From URDF to a robot's specification.

use std::collections::HashMap;
use std::f64::consts::{FRAC_PI_2, PI};
use std::path::Path;

use nalgebra::{Isometry3, UnitQuaternion, Vector3};
use tdcr_base::files::{LARGEST_TEXT, read_text};
use urdf_rs::{Geometry, Inertial, Joint, JointType, Link, Pose};

use super::{EXTENSION, LINK_SHARE, check};
use crate::formats::{
    DiscLayout, DiscMass, ImportError, Imported, Layout, Note, Place, ring_around, xml,
};
use crate::robot::{BaseSpec, Disc, Holes, Payload, RigidMass, Robot, RobotSpec};

/// Difference that counts as none (m, rad; of masses and damping, as a share).
const SAME: f64 = 1e-9;
/// How much a joint's limits may fall short of a free turn: they are often written as 3.14 (rad).
const NEARLY_FREE: f64 = 0.01;
/// How deep elements may nest; URDF's own go six deep.
const DEEPEST: usize = 64;
/// Image size of the cameras around a robot that its file says nothing about (pixels).
const RESOLUTION: [u32; 2] = [1280, 720];

/// The robot of a URDF file: its `<tdcr>` element's where it has one, which its links and joints
/// must agree with; otherwise the chain of its links, without tendons, and a note that says so.
///
/// # Errors
/// [`ImportError`] when the file cannot be read or is not URDF, for whatever is not a chain of links
/// on triples of joints about x, y and z, and for links that disagree with `<tdcr>`.
pub fn import(path: &Path) -> Result<Imported, ImportError> {
    let text = read_text(path, LARGEST_TEXT).map_err(|source| ImportError::Read {
        path: path.to_owned(),
        source,
    })?;
    Reader { path: Some(path) }.robot(&text)
}

/// The robot of a URDF text; otherwise as [`import`].
///
/// # Errors
/// As [`import`].
pub fn import_text(text: &str) -> Result<Imported, ImportError> {
    Reader { path: None }.robot(text)
}

#[derive(Clone, Copy)]
struct Reader<'a> {
    path: Option<&'a Path>,
}

/// A joint and the link it carries.
#[derive(Clone, Copy)]
struct Step<'a> {
    joint: &'a Joint,
    link: &'a Link,
}

impl Reader<'_> {
    fn robot(self, text: &str) -> Result<Imported, ImportError> {
        // The bounds hold for `urdf_rs` too, which takes the nesting in stack.
        let xml = xml::parse(text, DEEPEST).map_err(|reason| self.syntax(reason))?;
        let urdf = urdf_rs::read_from_string(text).map_err(|e| self.syntax(e.to_string()))?;
        let path = self.path_to_tip(&urdf)?;
        let chain = self.chain(&urdf.name, &path)?;
        let mut children = xml.root_element().children();
        let extension = children.find(|child| child.has_tag_name(EXTENSION));
        let (spec, notes) = match extension.and_then(|element| element.text()) {
            Some(own) => (self.own_spec(own, &chain)?, Vec::new()),
            None => {
                let text = format!("no element <{EXTENSION}>: the robot has no tendons");
                let place = self.place("robot", &urdf.name);
                let mut notes = vec![Note { place, text }];
                notes.extend(self.notes_on_masses(&urdf.name, &path));
                (chain, notes)
            }
        };
        spec.validate().map_err(Box::new)?;
        Ok(Imported {
            spec,
            payload: Payload::default(),
            notes,
        })
    }

    /// The robot that the extension describes, which must be the one that the links are.
    fn own_spec(self, own: &str, chain: &RobotSpec) -> Result<RobotSpec, ImportError> {
        let spec: RobotSpec = toml::from_str(own).map_err(|e| self.syntax(e.to_string()))?;
        let own = Robot::new(spec).map_err(Box::new)?;
        let links = Robot::new(chain.clone()).map_err(Box::new)?;
        let differ = |what: &str| {
            let reason = format!(
                "is not what <{EXTENSION}> says; change both, or leave out <{EXTENSION}> and with \
                 it the tendons"
            );
            Err(self.refuse("robot", &chain.name, format!("{what} {reason}")))
        };
        if own.discs().len() != links.discs().len() {
            return differ("the number of discs");
        }
        let turn = own.base_orientation().angle_to(&links.base_orientation());
        if (own.base() - links.base()).norm() > SAME || turn > SAME {
            return differ("the pose of link `base`");
        }
        let mut pairs = own.discs().iter().zip(links.discs());
        if let Some(disc) = pairs.position(|(a, b)| !agree(a, b)) {
            return differ(&format!("link `disc{disc}` or a joint below it"));
        }
        Ok(own.spec().clone())
    }

    /// The links as a robot without tendons.
    fn chain(self, name: &str, path: &[Step<'_>]) -> Result<RobotSpec, ImportError> {
        for Step { joint, link } in path {
            check::of_joint(joint).map_err(|reason| self.refuse("joint", &joint.name, reason))?;
            check::of_link(link).map_err(|reason| self.refuse("link", &link.name, reason))?;
        }
        let is_fixed = |step: &Step<'_>| step.joint.joint_type == JointType::Fixed;
        let (base, turns) = path.split_at(path.iter().take_while(|step| is_fixed(step)).count());
        if turns.is_empty() {
            let reason = "no joint turns; expected three joints about x, y and z below each disc";
            return Err(self.refuse("robot", name, reason));
        }
        let base = (base.iter()).fold(Isometry3::identity(), |below, step| {
            below * pose(&step.joint.origin)
        });
        let mut discs: Vec<DiscLayout> = Vec::new();
        for turn in turns.chunks(3) {
            let &[x, y, z] = turn else {
                let reason = "expected three joints below each disc, about x, y and z";
                return Err(self.refuse("joint", &turn[0].joint.name, reason));
            };
            let below = discs.last().map_or(0.0, |disc| disc.joint_below);
            discs.push(self.disc([x, y, z], below)?);
        }
        let q = base.rotation;
        let base = BaseSpec {
            position: base.translation.vector.into(),
            orientation: [q.w, q.i, q.j, q.k],
            holes: Holes::At(Vec::new()),
            hole_height: 0.0,
        };
        Ok(Layout {
            name: name.to_owned(),
            gravity: [0.0, 0.0, -9.81],
            cameras: ring_around(&base, &discs, RESOLUTION),
            base,
            discs,
            tendons: Vec::new(),
        }
        .into_spec())
    }

    /// The joints from the root to the tip, each with the link it carries.
    fn path_to_tip<'a>(self, urdf: &'a urdf_rs::Robot) -> Result<Vec<Step<'a>>, ImportError> {
        let mut links: HashMap<&str, &Link> = HashMap::new();
        for link in &urdf.links {
            if links.insert(link.name.as_str(), link).is_some() {
                return Err(self.refuse(
                    "link",
                    &link.name,
                    "there are two of this name; expected one",
                ));
            }
        }
        let mut carried: HashMap<&str, Step<'a>> = HashMap::new();
        let mut roots: HashMap<&str, &Link> = links.clone();
        for joint in &urdf.joints {
            let (parent, child) = (joint.parent.link.as_str(), joint.child.link.as_str());
            let Some(link) = links.get(child) else {
                let reason = format!("there is no link `{child}`");
                return Err(self.refuse("joint", &joint.name, reason));
            };
            if roots.remove(child).is_none() || !links.contains_key(parent) {
                let reason = "expected a link of the robot as its parent, and a child of its own";
                return Err(self.refuse("joint", &joint.name, reason));
            }
            if carried.insert(parent, Step { joint, link }).is_some() {
                let reason = format!("link `{parent}` carries several; expected a chain");
                return Err(self.refuse("joint", &joint.name, reason));
            }
        }
        let mut roots = roots.into_keys();
        let (Some(mut link), None) = (roots.next(), roots.next()) else {
            let reason = "expected one link that is no joint's child: the root";
            return Err(self.refuse("robot", &urdf.name, reason));
        };
        // Every link has one parent at most, so a path from the root meets none twice.
        let mut path = Vec::with_capacity(urdf.joints.len());
        while let Some(step) = carried.remove(link) {
            link = step.link.name.as_str();
            path.push(step);
        }
        Ok(path)
    }

    /// A disc on its three joints, where the link below has its disc's origin `below` (m) above its
    /// own.
    fn disc(self, steps: [Step<'_>; 3], below: f64) -> Result<DiscLayout, ImportError> {
        let damping = steps.map(|Step { joint, .. }| {
            joint
                .dynamics
                .as_ref()
                .map_or(0.0, |dynamics| dynamics.damping)
        });
        let axes = [Vector3::x(), Vector3::y(), Vector3::z()];
        for (step, axis) in steps.iter().zip(axes) {
            self.check_joint(step.joint, axis)?;
        }
        let [x, y, z] = steps;
        for Step { joint, .. } in [y, z] {
            if Vector3::from(joint.origin.xyz.0).norm() > SAME {
                let reason = "expected its origin in that of the joint below: a ball joint";
                return Err(self.refuse("joint", &joint.name, reason));
            }
        }
        if damping[1] != damping[0] || damping[2] != damping[0] {
            let reason = "expected the same damping of the three joints of a disc";
            return Err(self.refuse("joint", &z.joint.name, reason));
        }
        let mut rigid = self.rigid_mass(z.link)?;
        for Step { link, .. } in [x, y] {
            let mass = link.inertial.mass.value;
            if mass > 0.0 && rigid.mass == 0.0 {
                let reason = format!(
                    "it has no mass, and link `{}` between its joints has {mass} kg; expected the disc's mass here, and \
                     almost none there",
                    link.name
                );
                return Err(self.refuse("link", &z.link.name, reason));
            }
            if mass > 10.0 * LINK_SHARE * rigid.mass {
                let reason = format!(
                    "its mass is {mass} kg; expected almost none between the joints of a disc, of that of link `{}`, {} kg, \
                     a hundred thousandth at most",
                    z.link.name, rigid.mass
                );
                return Err(self.refuse("link", &link.name, reason));
            }
        }
        let [radius, half_height, joint_below] = self.cylinder(z.link)?;
        rigid.centre_of_mass[2] -= joint_below;
        let [off_x, off_y, offset] = x.joint.origin.xyz.0;
        if off_x.hypot(off_y) > SAME {
            let reason = "its origin lies off the z axis of the link below; expected on it";
            return Err(self.refuse("joint", &x.joint.name, reason));
        }
        Ok(DiscLayout {
            step: offset + joint_below - below,
            joint_below,
            radius,
            half_height,
            mass: DiscMass::Rigid(rigid),
            holes: Vec::new(),
            damping: damping[0],
            armature: 0.0,
            backbone: None,
            joint: None,
        })
    }

    fn check_joint(self, joint: &Joint, axis: Vector3<f64>) -> Result<(), ImportError> {
        let refuse = |reason: &str| Err(self.refuse("joint", &joint.name, reason));
        let free = match joint.joint_type {
            JointType::Continuous => true,
            JointType::Revolute => {
                let angle = if axis.y == 1.0 { FRAC_PI_2 } else { PI } - NEARLY_FREE;
                joint.limit.lower <= -angle && joint.limit.upper >= angle
            }
            _ => return refuse("expected a revolute or continuous joint"),
        };
        if !free {
            return refuse("expected limits of +-pi about x and z, +-pi/2 about y, or none");
        }
        if (Vector3::from(joint.axis.xyz.0) - axis).norm() > SAME {
            let [x, y, z] = joint.axis.xyz.0;
            return refuse(&format!(
                "its axis is {x} {y} {z}; expected the axes x, y and z of the three joints of a disc, unit vectors"
            ));
        }
        if joint.origin.rpy.iter().any(|angle| angle.abs() > SAME) {
            return refuse("expected an origin that is not turned");
        }
        let friction = joint
            .dynamics
            .as_ref()
            .map_or(0.0, |dynamics| dynamics.friction);
        if friction != 0.0 || joint.mimic.is_some() {
            return refuse("expected no friction and no mimic");
        }
        Ok(())
    }

    fn rigid_mass(self, link: &Link) -> Result<RigidMass, ImportError> {
        let Inertial {
            origin,
            mass,
            inertia,
        } = &link.inertial;
        let refuse = |reason: &str| Err(self.refuse("link", &link.name, reason));
        let products = [inertia.ixy, inertia.ixz, inertia.iyz];
        let turned = origin.rpy.iter().any(|angle| angle.abs() > SAME);
        if turned || products.iter().any(|product| *product != 0.0) {
            return refuse("expected the link's axes to be principal axes of inertia");
        }
        Ok(RigidMass {
            mass: mass.value,
            inertia: [inertia.ixx, inertia.iyy, inertia.izz],
            centre_of_mass: origin.xyz.0,
        })
    }

    /// Radius and half height of the cylinder that a link is seen as, and the height of its centre in
    /// the link's frame (m): where it stands beside the z axis, that of the centre of mass.
    fn cylinder(self, link: &Link) -> Result<[f64; 3], ImportError> {
        let visuals = (link.visual.iter()).map(|visual| (&visual.geometry, &visual.origin));
        let collisions = (link.collision.iter()).map(|c| (&c.geometry, &c.origin));
        let size = (visuals.chain(collisions)).find_map(|(geometry, origin)| match geometry {
            Geometry::Cylinder { radius, length } => Some((*radius, length / 2.0, origin)),
            _ => None,
        });
        let placed = size.map(|(radius, half_height, origin)| {
            let [x, y, z] = origin.xyz.0;
            let upright = origin.rpy.iter().all(|angle| angle.abs() <= SAME);
            let on_axis = upright && x.hypot(y) <= SAME && z >= 0.0;
            let height = if on_axis {
                z
            } else {
                link.inertial.origin.xyz[2]
            };
            [radius, half_height, height]
        });
        placed.ok_or_else(|| {
            let reason = "expected a cylinder to see it as";
            self.refuse("link", &link.name, reason)
        })
    }

    /// What is unlike a robot's discs in the masses of links on triples of joints.
    fn notes_on_masses(self, name: &str, path: &[Step<'_>]) -> Vec<Note> {
        let turns = path
            .iter()
            .skip_while(|step| step.joint.joint_type == JointType::Fixed);
        let links: Vec<&Link> = turns.map(|step| step.link).collect();
        let (discs, between): (Vec<_>, Vec<_>) =
            links.iter().enumerate().partition(|(i, _)| i % 3 == 2);
        let named = |links: Vec<&Link>, what: &str| {
            let most = 10;
            let names: Vec<String> = links
                .iter()
                .take(most)
                .map(|link| format!("`{}`", link.name))
                .collect();
            let others = links.len().saturating_sub(most);
            let more = if others > 0 {
                format!(" and {others} more")
            } else {
                String::new()
            };
            let (place, text) = (
                self.place("robot", name),
                format!("{}{more} {what}", names.join(", ")),
            );
            (!links.is_empty()).then_some(Note { place, text })
        };
        let massless = discs
            .iter()
            .filter(|(_, link)| link.inertial.mass.value == 0.0);
        let largest = |link: &Link| {
            let inertia = &link.inertial.inertia;
            inertia.ixx.max(inertia.iyy).max(inertia.izz)
        };
        let turning = between
            .iter()
            .filter(|(i, link)| largest(link) > 10.0 * LINK_SHARE * largest(links[i - i % 3 + 2]));
        let weightless = named(
            massless.map(|(_, link)| **link).collect(),
            "(links): no mass, as without an <inertial>: such discs weigh nothing, and have no inertia",
        );
        let left_out = named(
            turning.map(|(_, link)| **link).collect(),
            "(links): the moments of inertia between the joints of a disc are left out",
        );
        weightless.into_iter().chain(left_out).collect()
    }

    fn place(self, tag: &str, name: &str) -> Place {
        Place {
            file: self.path.map(Path::to_owned),
            line: None,
            element: format!("<{tag} name=\"{name}\">"),
        }
    }

    fn refuse(self, tag: &str, name: &str, reason: impl Into<String>) -> ImportError {
        ImportError::Unsupported {
            place: self.place(tag, name),
            reason: reason.into(),
        }
    }

    fn syntax(self, reason: String) -> ImportError {
        ImportError::Syntax {
            what: (self.path).map_or_else(|| "the text".to_owned(), |p| p.display().to_string()),
            format: "a robot description (URDF)",
            reason,
        }
    }
}

fn pose(pose: &Pose) -> Isometry3<f64> {
    let [roll, pitch, yaw] = pose.rpy.0;
    let position: Vector3<f64> = pose.xyz.0.into();
    let turn = UnitQuaternion::from_euler_angles(roll, pitch, yaw);
    Isometry3::from_parts(position.into(), turn)
}

/// Whether two discs are the same, in what URDF says of them.
fn agree(a: &Disc, b: &Disc) -> bool {
    let near = |a: f64, b: f64| (a - b).abs() <= SAME * a.abs().max(b.abs());
    let centres = [a, b].map(|disc| disc.origin + disc.centre_of_mass);
    let lengths = [
        (centres[0].x, centres[1].x),
        (centres[0].y, centres[1].y),
        (centres[0].z, centres[1].z),
        (a.joint_offset.z, b.joint_offset.z),
        (a.origin.z, b.origin.z),
        (a.radius, b.radius),
        (a.half_height, b.half_height),
    ];
    let moments = a.inertia.iter().zip(&b.inertia);
    lengths.iter().all(|(a, b)| (a - b).abs() <= SAME)
        && near(a.mass, b.mass)
        && near(a.damping, b.damping)
        && moments.into_iter().all(|(a, b)| near(*a, *b))
}
