//! The model's cameras.

use nalgebra::{Isometry3, Quaternion, UnitQuaternion, Vector3};

use super::body::BodyReader;
use super::document::Document;
use super::frame::POSE;
use crate::camera::Camera;
use crate::formats::{DiscLayout, ImportError, ring_around};
use crate::robot::{Aim, BaseSpec, CameraSpec, Cameras, Lens, RingSpec};

/// Deviation from a ring (m, rad, degrees) that counts as none.
const SAME_VIEW: f64 = 1e-6;

/// A camera of the model, in our camera frame.
struct View {
    pose: Isometry3<f64>,
    fovy: f64,
    resolution: Option<[u32; 2]>,
}

impl View {
    fn free(&self, resolution: [u32; 2]) -> CameraSpec {
        let q = self.pose.rotation;
        CameraSpec {
            position: self.pose.translation.vector.into(),
            aim: Aim::Orientation([q.w, q.i, q.j, q.k]),
            lens: Lens::Fovy(self.fovy),
            resolution: self.resolution.unwrap_or(resolution),
            distortion: None,
        }
    }
}

impl BodyReader<'_> {
    /// The world's cameras: a ring where they are one; 8 cameras around the robot where it has none.
    pub fn cameras(
        &mut self,
        worldbody: usize,
        base: &BaseSpec,
        discs: &[DiscLayout],
    ) -> Result<Cameras, ImportError> {
        let document = self.document;
        let cameras = document
            .children(worldbody)
            .filter(|(_, e)| e.tag == "camera");
        let views: Vec<View> = cameras
            .map(|(index, _)| self.view(index))
            .collect::<Result<_, _>>()?;
        let resolution = match views.first().and_then(|view| view.resolution) {
            Some(resolution) => resolution,
            None => offscreen_buffer(document)?,
        };
        if views.is_empty() {
            self.note(worldbody, "no cameras: 8 around the robot in their place");
            return Ok(ring_around(base, discs, resolution));
        }
        Ok(match recognise(&views, resolution) {
            Some(ring) => Cameras::Ring(ring),
            None => Cameras::Free(views.iter().map(|view| view.free(resolution)).collect()),
        })
    }

    fn view(&self, index: usize) -> Result<View, ImportError> {
        let camera = self.classes.resolve(self.document, index, None)?;
        let half_turn = UnitQuaternion::new_unchecked(Quaternion::new(0.0, 1.0, 0.0, 0.0));
        let known = [
            "fovy",
            "mode",
            "target",
            "resolution",
            "ipd",
            "projection",
            "orthographic",
        ];
        camera.only(
            &[&known[..], &POSE[..]].concat(),
            &[
                "focal",
                "focalpixel",
                "principal",
                "principalpixel",
                "sensorsize",
            ],
        )?;
        let resolution = camera.numbers::<2>("resolution")?;
        Ok(View {
            pose: self.compiler.pose(&camera)? * half_turn,
            fovy: camera.number("fovy")?.unwrap_or(45.0),
            // `as` saturates: what is no size is refused with the whole specification.
            resolution: resolution.map(|sides| sides.map(|side| side as u32)),
        })
    }
}

/// The ring that all views are on.
fn recognise(views: &[View], resolution: [u32; 2]) -> Option<RingSpec> {
    let first = views.first()?;
    let position = first.pose.translation.vector;
    let axis = first.pose.rotation * Vector3::z();
    let ring = RingSpec {
        count: views.len(),
        radius: -position.y,
        height: position.z,
        // Without the last digits, which are those of rounding.
        pitch: ((-axis.z).atan2(axis.y) * 1e12).round() / 1e12,
        fovy: first.fovy,
        resolution,
        distortion: None,
    };
    let same = |(view, camera): (&View, &Camera)| {
        let place = view.pose.translation.vector - camera.pose.translation.vector;
        place.norm() < SAME_VIEW
            && view.pose.rotation.angle_to(&camera.pose.rotation) < SAME_VIEW
            && (view.fovy - ring.fovy).abs() < SAME_VIEW
            && view.resolution == first.resolution
    };
    let cameras = Camera::ring(&ring);
    views.iter().zip(&cameras).all(same).then_some(ring)
}

/// Size of the buffer that MuJoCo draws images in.
fn offscreen_buffer(document: &Document) -> Result<[u32; 2], ImportError> {
    let mut size = [640, 480];
    for (index, element) in document.section("visual") {
        if element.tag != "global" {
            continue;
        }
        let attributes = super::attributes::Attributes::own(document, index);
        for (side, name) in size.iter_mut().zip(["offwidth", "offheight"]) {
            if let Some(pixels) = attributes.not_negative(name)? {
                *side = pixels as u32;
            }
        }
    }
    Ok(size)
}
