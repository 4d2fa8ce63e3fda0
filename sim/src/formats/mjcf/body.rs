//! Bodies: what is rigidly together, and the joints that it turns on.

use std::collections::HashSet;

use nalgebra::{Isometry3, Point3, Vector3};

use super::attributes::{Attributes, Classes};
use super::document::Document;
use super::frame::{Compiler, InertiaFromGeom, POSE};
use super::joint_element::JointElement;
use super::mass::{Geom, PartMass};
use crate::formats::{ImportError, Note};

/// Reads the bodies of a model.
pub(super) struct BodyReader<'a> {
    pub document: &'a Document,
    pub classes: Classes,
    pub compiler: Compiler,
    /// Whether geoms can touch.
    pub contacts: bool,
    /// Moving geoms that can.
    pub touching: Vec<usize>,
    /// Names of the sites that tendons go through.
    pub used_sites: HashSet<&'a str>,
    pub notes: Vec<Note>,
}

/// A body with the bodies fastened to it.
#[derive(Default)]
pub(super) struct RigidGroup<'a> {
    pub joints: Vec<JointElement>,
    pub masses: Vec<PartMass>,
    pub geoms: Vec<Geom>,
    pub sites: Vec<Site<'a>>,
    /// A body `payload` that holds nothing but an inertial.
    pub payload: Option<PartMass>,
    /// Bodies on joints that the group carries.
    pub carried: Vec<Carried<'a>>,
    /// Geoms of bodies that are fixed in the world.
    still_geoms: Vec<usize>,
}

/// One body of a group.
#[derive(Clone, Copy)]
struct Member<'a> {
    body: usize,
    /// Its pose in the group's frame.
    pose: Isometry3<f64>,
    /// Default class of the elements within.
    childclass: Option<&'a str>,
}

/// A site on a body of a group.
pub(super) struct Site<'a> {
    pub name: Option<&'a str>,
    pub element: usize,
    pub body: usize,
    /// Position in its body's frame (m).
    pub position: Vector3<f64>,
    /// Pose of its body in the group's frame.
    pub body_pose: Isometry3<f64>,
}

impl Site<'_> {
    /// Position in the frame of its group (m).
    pub fn in_group(&self) -> Vector3<f64> {
        (self.body_pose * Point3::from(self.position)).coords
    }
}

/// A body on a joint, and what carries it.
#[derive(Clone, Copy)]
pub(super) struct Carried<'a> {
    pub element: usize,
    pub carrier: usize,
    /// Pose of the carrier in its group's frame.
    pub carrier_pose: Isometry3<f64>,
    /// Default class of the elements within.
    pub childclass: Option<&'a str>,
}

impl<'a> BodyReader<'a> {
    /// What stands fixed in the world.
    pub fn world(&mut self, worldbody: usize) -> Result<RigidGroup<'a>, ImportError> {
        self.group(worldbody, None)
    }

    /// A body on a joint, and what is fastened to it.
    pub fn group_of(&mut self, body: &Carried<'a>) -> Result<RigidGroup<'a>, ImportError> {
        self.group(body.element, body.childclass)
    }

    /// Pose of a body in the frame of the body it stands in.
    pub fn pose(&self, body: usize) -> Result<Isometry3<f64>, ImportError> {
        let attributes = Attributes::own(self.document, body);
        attributes.only(
            &[&["childclass", "mocap"], &POSE[..]].concat(),
            &["gravcomp"],
        )?;
        match attributes.text("mocap") {
            None | Some("false" | "true") => self.compiler.pose(&attributes),
            Some(_) => Err(attributes.refuse("mocap", "expected true or false")),
        }
    }

    fn group(
        &mut self,
        root: usize,
        childclass: Option<&'a str>,
    ) -> Result<RigidGroup<'a>, ImportError> {
        let document = self.document;
        let mut group = RigidGroup::default();
        let mut open = vec![Member {
            body: root,
            pose: Isometry3::identity(),
            childclass,
        }];
        while let Some(mut member) = open.pop() {
            let own = Attributes::own(document, member.body);
            member.childclass = own.text("childclass").or(member.childclass);
            let mut masses = BodyMasses::default();
            let mut fastened = Vec::new();
            for (index, element) in document.children(member.body) {
                if element.tag == "body" {
                    fastened.extend(self.body_within(index, &member, root, &mut group)?);
                } else {
                    self.part(index, &member, root, &mut group, &mut masses)?;
                }
            }
            // The last is taken up first: reversed, they are read in order.
            open.extend(fastened.into_iter().rev());
            // What a disc touches with does not say what it looks like, beside something that does.
            if masses.geoms.iter().any(|geom| !geom.is_bead()) {
                masses.geoms.retain(|geom| !geom.is_bead());
            }
            let parts = masses.parts(self.compiler.inertia_from_geom);
            group
                .masses
                .extend(parts.map(|part| part.moved(&member.pose)));
            group
                .geoms
                .extend(masses.geoms.into_iter().map(|geom| Geom {
                    pose: member.pose * geom.pose,
                    ..geom
                }));
        }
        if let Some(&first) = group.still_geoms.first() {
            let count = group.still_geoms.len();
            self.note(
                first,
                format!("left out, with all {count} geoms that stand still"),
            );
        }
        Ok(group)
    }

    /// Sorts a body within a group's member: the group's payload, a body that it carries, or else,
    /// returned, a further member.
    fn body_within(
        &mut self,
        index: usize,
        member: &Member<'a>,
        root: usize,
        group: &mut RigidGroup<'a>,
    ) -> Result<Option<Member<'a>>, ImportError> {
        if self.has_joint(index) {
            group.carried.push(Carried {
                element: index,
                carrier: member.body,
                carrier_pose: member.pose,
                childclass: member.childclass,
            });
            return Ok(None);
        }
        if self.is_payload(index) && member.body == root && group.payload.is_none() {
            group.payload = Some(self.payload(index)?);
            return Ok(None);
        }
        if Attributes::own(self.document, index).text("mocap") == Some("true") {
            let text = "a mocap body: read as fixed where the model has it at the start";
            self.note(index, text);
        }
        Ok(Some(Member {
            body: index,
            pose: member.pose * self.pose(index)?,
            childclass: member.childclass,
        }))
    }

    /// Reads what is not a body within a group's member.
    fn part(
        &mut self,
        index: usize,
        member: &Member<'a>,
        root: usize,
        group: &mut RigidGroup<'a>,
        masses: &mut BodyMasses,
    ) -> Result<(), ImportError> {
        let document = self.document;
        let class = member.childclass;
        let stands_still = document.elements[root].tag == "worldbody";
        match document.elements[index].tag.as_str() {
            "joint" => group.joints.push(self.joint_element(index, class)?),
            "freejoint" => {
                let reason = "expected a ball joint in each moving body";
                return Err(document.refuse(index, reason));
            }
            "inertial" => {
                let attributes = Attributes::own(document, index);
                masses.given = Some(PartMass::read(&attributes, &self.compiler)?);
            }
            "geom" if stands_still => group.still_geoms.push(index),
            "geom" => masses.geoms.push(self.geom(index, class)?),
            "site" => group.sites.push(self.site(index, member)?),
            "camera" if !stands_still => {
                self.note(
                    index,
                    "left out: it moves with its body, and cameras stand still around the robot",
                );
            }
            "camera" | "light" => {}
            _ => {
                let expected = "expected bodies, joints, inertials, geoms and sites";
                return Err(document.refuse(index, expected));
            }
        }
        Ok(())
    }

    pub fn note(&mut self, element: usize, text: impl Into<String>) {
        self.notes.push(Note {
            place: self.document.place(element),
            text: text.into(),
        });
    }

    pub fn has_joint(&self, body: usize) -> bool {
        let mut children = self.document.children(body);
        children.any(|(_, child)| matches!(child.tag.as_str(), "joint" | "freejoint"))
    }

    /// The masses of one body alone, in its frame.
    pub fn masses_of(
        &self,
        body: usize,
        childclass: Option<&str>,
    ) -> Result<Vec<PartMass>, ImportError> {
        let mut masses = BodyMasses::default();
        for (index, element) in self.document.children(body) {
            match element.tag.as_str() {
                "inertial" => {
                    let attributes = Attributes::own(self.document, index);
                    masses.given = Some(PartMass::read(&attributes, &self.compiler)?);
                }
                "geom" => {
                    let attributes = self.classes.resolve(self.document, index, childclass)?;
                    masses.geoms.push(Geom::read(&attributes, &self.compiler)?);
                }
                _ => {}
            }
        }
        Ok(masses.parts(self.compiler.inertia_from_geom).collect())
    }

    fn is_payload(&self, body: usize) -> bool {
        Attributes::own(self.document, body).text("name") == Some("payload")
            && (self.document.children(body)).all(|(_, child)| child.tag == "inertial")
    }

    fn payload(&self, body: usize) -> Result<PartMass, ImportError> {
        let pose = self.pose(body)?;
        let Some((inertial, _)) = self.document.children(body).next() else {
            return Err(self.document.refuse(body, "expected an <inertial>"));
        };
        let attributes = Attributes::own(self.document, inertial);
        Ok(PartMass::read(&attributes, &self.compiler)?.moved(&pose))
    }

    fn geom(&mut self, index: usize, class: Option<&str>) -> Result<Geom, ImportError> {
        let attributes = self.classes.resolve(self.document, index, class)?;
        let groups = ["contype", "conaffinity"];
        if self.contacts && groups.iter().any(|name| attributes.text(name) != Some("0")) {
            self.touching.push(index);
        }
        Geom::read(&attributes, &self.compiler)
    }

    fn site(&self, index: usize, member: &Member<'_>) -> Result<Site<'a>, ImportError> {
        let name = Attributes::own(self.document, index).text("name");
        let attributes = (self.classes).resolve(self.document, index, member.childclass)?;
        if name.is_some_and(|name| self.used_sites.contains(name)) {
            let known = ["type", "size", "group", "rgba", "material"];
            attributes.only(&[&known[..], &POSE[..]].concat(), &[])?;
        }
        Ok(Site {
            name,
            element: index,
            body: member.body,
            position: attributes.numbers::<3>("pos")?.unwrap_or_default().into(),
            body_pose: member.pose,
        })
    }
}

/// What the mass of one body is given by.
#[derive(Default)]
struct BodyMasses {
    given: Option<PartMass>,
    geoms: Vec<Geom>,
}

impl BodyMasses {
    fn parts(&self, from_geom: InertiaFromGeom) -> impl Iterator<Item = PartMass> {
        let given = self
            .given
            .as_ref()
            .filter(|_| from_geom != InertiaFromGeom::Always);
        let of_geoms = given.is_none() && from_geom != InertiaFromGeom::Never;
        let geoms: &[Geom] = if of_geoms { &self.geoms } else { &[] };
        let parts = geoms.iter().map(Geom::part).filter(|part| part.mass > 0.0);
        given.cloned().into_iter().chain(parts)
    }
}
