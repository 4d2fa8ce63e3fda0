//! From a MuJoCo model to a robot's specification.

use std::collections::HashSet;
use std::path::Path;

use super::actuator::DrivenTendon;
use super::attributes::{Attributes, Classes};
use super::body::BodyReader;
use super::check::longest;
use super::document::Document;
use super::frame::Compiler;
use super::keyframe::KEYFRAME;
use crate::formats::{ImportError, Imported, Layout};
use crate::robot::Robot;

/// Sections of a model that change nothing of a robot.
const PASSED_OVER: [&str; 7] = [
    "size",
    "visual",
    "statistic",
    "custom",
    "asset",
    "default",
    "contact",
];

/// The robot of a MuJoCo model in a file (MJCF), and in those it includes.
///
/// Reads a chain of bodies on ball joints, or on one to three hinges at one place, that carry one another,
/// above a body that stands fixed in the world; masses from geoms and inertials; tendons through sites; `position`, `motor` and
/// `general` actuators that pull them. A disc's origin is its centre of mass, so a joint may lie
/// below it. Runs of like discs become modules. Commands are in the order of the actuators; a note
/// says where one is another function of MuJoCo's `ctrl` than the value itself.
///
/// # Errors
/// [`ImportError`] when a file cannot be read or is not MJCF, and for whatever a robot cannot have,
/// with its line, tag and attribute, and what would be right. What changes neither how the robot
/// moves nor where it rests (keyframes, sensors, lights) becomes a [`Note`](crate::formats::Note), and
/// so does what robots here do otherwise: contacts, mocap bodies.
pub fn import(path: &Path) -> Result<Imported, ImportError> {
    read_robot(&Document::read(path)?)
}

/// The robot of a MuJoCo model in a text (MJCF) that includes no files; otherwise as [`import`].
///
/// # Errors
/// As [`import`].
pub fn import_text(text: &str) -> Result<Imported, ImportError> {
    read_robot(&Document::parse(text)?)
}

fn read_robot(document: &Document) -> Result<Imported, ImportError> {
    check_sections(document)?;
    let Some((worldbody, _)) = document.sections("worldbody").next() else {
        return Err(document.refuse(0, "expected a section <worldbody>"));
    };
    let world = World::of(document)?;
    let mut reader = BodyReader {
        document,
        classes: Classes::of(document)?,
        compiler: Compiler::of(document)?,
        contacts: world.contacts,
        touching: Vec::new(),
        used_sites: used_sites(document),
        notes: Vec::new(),
    };
    let chain = reader.chain(worldbody)?;
    let tendons = reader.tendons(&chain.holes)?;
    reader.note_contacts();
    let cameras = reader.cameras(worldbody, &chain.base, &chain.discs)?;
    for section in ["keyframe", "sensor"] {
        for (index, _) in document.section(section) {
            // One that follows from the robot goes without saying.
            if Attributes::own(document, index).text("name") == Some(KEYFRAME) {
                continue;
            }
            reader.note(index, "left out: robots have none");
        }
    }
    let model = Attributes::own(document, 0).text("model");
    let layout = Layout {
        name: model.unwrap_or("MuJoCo model").to_owned(),
        gravity: world.gravity,
        base: chain.base,
        discs: chain.discs,
        tendons: tendons.iter().map(|tendon| tendon.route.clone()).collect(),
        cameras,
    };
    let robot = Robot::new(layout.into_spec()).map_err(Box::new)?;
    check_strength(document, &robot, &tendons)?;
    Ok(Imported {
        spec: robot.spec().clone(),
        payload: chain.payload,
        notes: reader.notes,
    })
}

/// Refuses models with sections that a robot has no place for.
fn check_sections(document: &Document) -> Result<(), ImportError> {
    for (index, element) in document.children(0) {
        let fits = match element.tag.as_str() {
            "compiler" | "option" | "worldbody" | "tendon" | "actuator" | "keyframe" | "sensor" => {
                true
            }
            tag => PASSED_OVER.contains(&tag) || element.children.is_empty(),
        };
        if !fits {
            return Err(document.refuse(index, "a section that robots here have no place for"));
        }
    }
    Ok(())
}

/// What the element `option` says.
pub(super) struct World {
    gravity: [f64; 3],
    pub contacts: bool,
}

impl BodyReader<'_> {
    /// Says of geoms that touch others in MuJoCo that they touch none here.
    fn note_contacts(&mut self) {
        let pairs = self.document.section("contact");
        let pair = (pairs
            .filter(|(_, e)| e.tag == "pair")
            .map(|(index, _)| index))
        .next();
        if let Some(&first) = self.touching.first() {
            let count = self.touching.len();
            let text = format!(
                "contacts are left out, with all {count} geoms that can touch others: robots here touch with beads of their own, in a scene"
            );
            self.note(first, text);
        } else if let Some(pair) = pair {
            self.note(pair, "contacts are left out");
        }
    }
}

impl World {
    pub fn of(document: &Document) -> Result<Self, ImportError> {
        let mut world = Self {
            gravity: [0.0, 0.0, -9.81],
            contacts: true,
        };
        let mut weightless = false;
        for (index, _) in document.sections("option") {
            let option = Attributes::own(document, index);
            for name in ["density", "viscosity", "wind"] {
                let values = option.list(name)?.unwrap_or_default();
                if values.iter().any(|x| *x != 0.0) {
                    return Err(option.refuse(name, "expected 0: robots are in still, thin air"));
                }
            }
            if let Some(gravity) = option.numbers("gravity")? {
                world.gravity = gravity;
            }
            for (index, element) in document.children(index) {
                if element.tag != "flag" {
                    continue;
                }
                let flags = Attributes::own(document, index);
                let disabled = |name| flags.text(name) == Some("disable");
                world.contacts &= !disabled("contact") && !disabled("constraint");
                weightless |= disabled("gravity");
                for name in ["passive", "spring", "damper", "actuation", "clampctrl"] {
                    if disabled(name) {
                        return Err(flags.refuse(name, "expected enable"));
                    }
                }
            }
        }
        if weightless {
            world.gravity = [0.0; 3];
        }
        Ok(world)
    }
}

/// Names of the sites that tendons go through.
pub(super) fn used_sites(document: &Document) -> HashSet<&str> {
    let tendons = document.section("tendon");
    let steps = tendons.flat_map(|(index, _)| document.children(index));
    steps
        .filter_map(|(index, _)| Attributes::own(document, index).text("site"))
        .collect()
}

/// Refuses actuators whose greatest force a tendon can reach: robots have none.
fn check_strength(
    document: &Document,
    robot: &Robot,
    tendons: &[DrivenTendon],
) -> Result<(), ImportError> {
    for (index, (tendon, driven)) in robot.tendons().iter().zip(tendons).enumerate() {
        let needed = if tendon.stiffness > 0.0 {
            tendon.stiffness * (longest(robot, index) - tendon.range[0])
        } else {
            tendon.range[1]
        };
        if driven.strongest.is_some_and(|strongest| strongest < needed) {
            let reason = format!(
                "attribute forcerange: limits the pull; expected none, or one beyond {needed:.3} N"
            );
            return Err(document.refuse(driven.element, reason));
        }
    }
    Ok(())
}
