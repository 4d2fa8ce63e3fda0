//! From bodies to the base and the discs.

use std::collections::HashMap;

use nalgebra::{Isometry3, Point3, UnitQuaternion, Vector3};

use super::attributes::Attributes;
use super::body::{BodyReader, Carried, RigidGroup, Site};
use super::disc::{DiscBody, is_turned, off_axis};
use super::frame::SAME_PLACE;
use crate::formats::{DiscLayout, ImportError};
use crate::robot::{BaseSpec, Body, Holes, Payload, Waypoint};

/// The robot's bodies.
pub(super) struct Chain<'a> {
    pub base: BaseSpec,
    pub discs: Vec<DiscLayout>,
    pub payload: Payload,
    /// The holes by the names of their sites.
    pub holes: HashMap<&'a str, Waypoint>,
}

/// A body's holes: x and y of each (m), and their height in the body's frame (m).
struct HoleRow {
    holes: Vec<[f64; 2]>,
    height: f64,
}

impl<'a> BodyReader<'a> {
    /// The chain of bodies in the world.
    pub fn chain(&mut self, worldbody: usize) -> Result<Chain<'a>, ImportError> {
        let world = self.world(worldbody)?;
        let carried = self.with_tendons(&world.carried);
        let Some(first) = self.only_one(worldbody, &carried)? else {
            let reason = "expected a body on a ball joint or on hinges: the first disc";
            return Err(self.document.refuse(worldbody, reason));
        };
        let (discs, groups): (Vec<DiscBody>, Vec<RigidGroup<'a>>) =
            self.discs(first)?.into_iter().unzip();
        let mut holes = HashMap::new();
        let own_base = base_frame(&discs[0]);
        let base = self.base(&mut holes, &world.sites, &first, &own_base)?;
        let mut layouts = Vec::with_capacity(discs.len());
        for (index, (disc, group)) in discs.iter().zip(&groups).enumerate() {
            let below = index
                .checked_sub(1)
                .map_or(0.0, |below| discs[below].center);
            let pose = match index {
                0 => own_base.inverse() * disc.pose,
                _ => disc.pose,
            };
            let center = Vector3::new(0.0, 0.0, disc.center);
            let sites = group
                .sites
                .iter()
                .map(|site| (site, site.in_group() - center));
            let row = self.hole_row(&mut holes, Body::Disc(index), sites, Some(0.0))?;
            layouts.push(self.layout(disc, &pose, below, row.holes)?);
        }
        let payload = match (discs.last(), groups.last()) {
            (Some(disc), Some(group)) => self.payload_on(disc, group),
            _ => Payload::default(),
        };
        Ok(Chain {
            base,
            discs: layouts,
            payload,
            holes,
        })
    }

    /// Of several bodies on joints in the world the one that tendons pass, if it is one: the others are objects beside the robot.
    fn with_tendons(&mut self, carried: &[Carried<'a>]) -> Vec<Carried<'a>> {
        let (robots, others): (Vec<_>, Vec<_>) =
            (carried.iter().copied()).partition(|body| self.has_used_site(body.element));
        if robots.len() != 1 {
            return carried.to_vec();
        }
        for body in others {
            let text = "left out: a body on a joint that no tendon passes";
            self.note(body.element, text);
        }
        robots
    }

    /// Whether a body, or one within it, has a site that a tendon passes.
    fn has_used_site(&self, body: usize) -> bool {
        let document = self.document;
        let mut within = vec![body];
        while let Some(body) = within.pop() {
            for (index, element) in document.children(body) {
                match element.tag.as_str() {
                    "body" => within.push(index),
                    "site" => {
                        let name = Attributes::own(document, index).text("name");
                        if name.is_some_and(|name| self.used_sites.contains(name)) {
                            return true;
                        }
                    }
                    _ => {}
                }
            }
        }
        false
    }

    /// The discs from `first` to the tip.
    fn discs(
        &mut self,
        first: Carried<'a>,
    ) -> Result<Vec<(DiscBody, RigidGroup<'a>)>, ImportError> {
        let mut discs = Vec::new();
        // The first disc is seen from the body that carries it, not from the world.
        let mut next = Some(Carried {
            carrier_pose: Isometry3::identity(),
            ..first
        });
        while let Some(body) = next {
            let mut group = self.group_of(&body)?;
            next = self.only_one(body.element, &group.carried)?;
            if next.is_some() {
                // Only at the tip is it a payload.
                group.masses.extend(group.payload.take());
            }
            discs.push((self.disc(&body, &group)?, group));
        }
        Ok(discs)
    }

    /// The body that a group carries, if any.
    fn only_one(
        &self,
        carrier: usize,
        carried: &[Carried<'a>],
    ) -> Result<Option<Carried<'a>>, ImportError> {
        match carried {
            [] => Ok(None),
            [one] => Ok(Some(*one)),
            _ => {
                let reason = "carries several bodies on joints; expected one: a chain of discs";
                Err(self.document.refuse(carrier, reason))
            }
        }
    }

    /// The base, where `frame` is its pose in the body that carries the first disc.
    fn base(
        &mut self,
        holes: &mut HashMap<&'a str, Waypoint>,
        sites: &[Site<'a>],
        first: &Carried<'a>,
        frame: &Isometry3<f64>,
    ) -> Result<BaseSpec, ImportError> {
        let pose = first.carrier_pose * frame;
        let seen = sites.iter().filter_map(|site| {
            if site.body == first.carrier {
                let position = frame.inverse_transform_point(&Point3::from(site.position));
                return Some((site, position.coords));
            }
            // Elsewhere in the world, only what a tendon goes through is the base's.
            let used = site.name.is_some_and(|name| self.used_sites.contains(name));
            let position = pose.inverse_transform_point(&Point3::from(site.in_group()));
            used.then_some((site, position.coords))
        });
        let seen: Vec<_> = seen.collect();
        let row = self.hole_row(holes, Body::Base, seen.into_iter(), None)?;
        let q = pose.rotation;
        Ok(BaseSpec {
            position: pose.translation.vector.into(),
            orientation: [q.w, q.i, q.j, q.k],
            holes: Holes::At(row.holes),
            hole_height: row.height,
        })
    }

    /// The sites of a body that are holes: those that tendons go through, which must lie at one
    /// height (for discs, at 0), and the others at that height that are not on the axis.
    fn hole_row<'s>(
        &mut self,
        names: &mut HashMap<&'a str, Waypoint>,
        body: Body,
        sites: impl Iterator<Item = (&'s Site<'a>, Vector3<f64>)>,
        height: Option<f64>,
    ) -> Result<HoleRow, ImportError>
    where
        'a: 's,
    {
        let sites: Vec<_> = sites.collect();
        let is_used = |site: &Site<'_>| site.name.is_some_and(|n| self.used_sites.contains(n));
        let first = sites
            .iter()
            .find(|(site, _)| is_used(site))
            .or(sites.first());
        let height = height.or(first.map(|(_, place)| place.z)).unwrap_or(0.0);
        let mut holes = Vec::new();
        for (site, place) in &sites {
            let level = (place.z - height).abs() < SAME_PLACE;
            if is_used(site) && !level {
                let reason = format!(
                    "lies {} m above the others, or above the disc's centre of mass; expected \
                     the tendons' sites of a body at one height, those of a disc at that centre or \
                     at that of the cylinder that shows it",
                    place.z - height
                );
                return Err(self.document.refuse(site.element, reason));
            }
            if !is_used(site) && (!level || !off_axis(place)) {
                continue;
            }
            if let Some(name) = site.name {
                let waypoint = Waypoint(body, holes.len());
                if names.insert(name, waypoint).is_some() {
                    let reason = "there are two sites of this name; expected one";
                    return Err(self.document.refuse(site.element, reason));
                }
            }
            holes.push([place.x, place.y]);
        }
        Ok(HoleRow { holes, height })
    }

    fn layout(
        &self,
        disc: &DiscBody,
        pose: &Isometry3<f64>,
        below: f64,
        holes: Vec<[f64; 2]>,
    ) -> Result<DiscLayout, ImportError> {
        let refuse = |reason: &str| Err(self.document.refuse(disc.element, reason));
        let straight = disc.straight(pose, below);
        if is_turned(pose) && !disc.joint.has_rest() {
            return refuse(
                "turned against the body below, on a joint without stiffness: \
                 expected bodies in line",
            );
        }
        if off_axis(&straight) {
            return refuse("lies beside the z axis of the body below; expected on it");
        }
        if straight.z <= 0.0 {
            return refuse("lies below the body that carries it; expected above, along its z axis");
        }
        Ok(DiscLayout {
            step: straight.z,
            joint_below: disc.joint_below,
            radius: disc.radius,
            half_height: disc.half_height,
            mass: disc.mass,
            holes,
            damping: disc.joint.damping,
            armature: disc.joint.armature,
            backbone: disc.backbone(pose),
            joint: disc.hinges(pose),
        })
    }

    fn payload_on(&mut self, disc: &DiscBody, group: &RigidGroup<'a>) -> Payload {
        let Some(part) = &group.payload else {
            return Payload::default();
        };
        if part.inertia.amax() > 0.0 {
            let text = "the payload is a point: its moments of inertia are left out";
            self.note(disc.element, text);
        }
        Payload {
            mass: part.mass,
            offset: (part.center - Vector3::new(0.0, 0.0, disc.center)).into(),
        }
    }
}

/// The robot's base in the frame of the body that carries the first disc. The base being fixed, its
/// frame can be chosen such that the disc is straight above it: turned as a disc that turns freely
/// is, its origin on the disc's axis and below the disc.
fn base_frame(first: &DiscBody) -> Isometry3<f64> {
    let turn = if first.joint.has_rest() || !is_turned(&first.pose) {
        UnitQuaternion::identity()
    } else {
        first.pose.rotation
    };
    let turned = Isometry3::from_parts(Vector3::zeros().into(), turn);
    let mut shift = first.straight(&(turned.inverse() * first.pose), 0.0);
    if !off_axis(&shift) {
        (shift.x, shift.y) = (0.0, 0.0);
    }
    shift.z = if shift.z > 0.0 {
        0.0
    } else {
        shift.z - first.half_height
    };
    turned * Isometry3::from_parts(shift.into(), UnitQuaternion::identity())
}
