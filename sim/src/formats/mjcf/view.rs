//! The model's cameras.

use nalgebra::{Isometry3, Matrix3, Quaternion, Rotation3, UnitQuaternion, Vector3};

use super::attributes::Attributes;
use super::body::BodyReader;
use super::document::Document;
use super::frame::POSE;
use super::stage::Stage;
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

impl<'a> BodyReader<'a> {
    /// The cameras that stand still: a ring where they are one; 8 cameras around the robot where there are none.
    pub fn cameras(
        &mut self,
        worldbody: usize,
        base: &BaseSpec,
        discs: &[DiscLayout],
    ) -> Result<Cameras, ImportError> {
        let document = self.document;
        let stage = Stage::of(self, worldbody)?;
        let mut views = Vec::new();
        for (body, placed) in stage.bodies().filter(|(_, placed)| placed.is_still) {
            for (index, element) in document.children(placed.element) {
                if element.tag == "camera" {
                    let camera = self.classes.resolve(document, index, placed.childclass)?;
                    views.extend(self.view(&stage, body, &camera, index)?);
                }
            }
        }
        let resolution = match views.first().and_then(|view| view.resolution) {
            Some(resolution) => resolution,
            None => offscreen_buffer(document)?,
        };
        if views.is_empty() {
            let text = "no cameras that stand still: 8 around the robot in their place";
            self.note(worldbody, text);
            return Ok(ring_around(base, discs, resolution));
        }
        Ok(match recognise(&views, resolution) {
            Some(ring) => Cameras::Ring(ring),
            None => Cameras::Free(views.iter().map(|view| view.free(resolution)).collect()),
        })
    }

    /// A camera on the body numbered `body`, where it looks from and to at the start; `None`, with a note, for one that sees otherwise
    /// than ours do.
    fn view(
        &mut self,
        stage: &Stage<'a>,
        body: usize,
        camera: &Attributes<'_>,
        index: usize,
    ) -> Result<Option<View>, ImportError> {
        let known = [
            "fovy",
            "mode",
            "target",
            "resolution",
            "ipd",
            "projection",
            "orthographic",
            "output",
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
        // MuJoCo's 4.0 has the first of the names, earlier ones the second.
        let parallel = [
            ("projection", "orthographic", "perspective"),
            ("orthographic", "true", "false"),
        ];
        let mut is_parallel = false;
        for (name, yes, no) in parallel {
            match camera.text(name) {
                None => {}
                Some(value) if value == no => {}
                Some(value) if value == yes => is_parallel = true,
                Some(_) => return Err(camera.refuse(name, format!("expected {yes} or {no}"))),
            }
        }
        if is_parallel {
            let text = "left out: its projection is orthographic, and cameras here are perspective";
            self.note(index, text);
            return Ok(None);
        }
        let half_turn = UnitQuaternion::new_unchecked(Quaternion::new(0.0, 1.0, 0.0, 0.0));
        let resolution = camera.numbers::<2>("resolution")?;
        Ok(Some(View {
            pose: self.placed(stage, body, camera, index)? * half_turn,
            fovy: camera.number("fovy")?.unwrap_or(45.0),
            // `as` saturates: what is no size is refused with the whole specification.
            resolution: resolution.map(|sides| sides.map(|side| side as u32)),
        }))
    }

    /// The pose of a camera at the start, in MuJoCo's camera frame; a note where MuJoCo moves it with the robot.
    fn placed(
        &mut self,
        stage: &Stage<'a>,
        body: usize,
        camera: &Attributes<'_>,
        index: usize,
    ) -> Result<Isometry3<f64>, ImportError> {
        let mut pose = stage.pose(body) * self.compiler.pose(camera)?;
        let given = camera.text("target").is_some();
        let aim = match camera.text("mode") {
            // Of a body that stands still, its origin is no other place.
            None | Some("fixed" | "track") => return Ok(pose),
            Some("trackcom") => {
                // MuJoCo keeps the place from the target's centre of mass, and adds it to that of the camera's body.
                if given {
                    let target = stage.target(camera)?;
                    let [from, to] = [target, body].map(|body| stage.centre_of_mass(self, body));
                    pose.translation.vector += to? - from?;
                }
                let text =
                    "follows a centre of mass in MuJoCo; here it stands where it is at the start";
                self.note(index, text);
                return Ok(pose);
            }
            Some("targetbody" | "targetbodycom") if !given => {
                return Err(
                    camera.refuse_element("expected an attribute `target`: the body to look at")
                );
            }
            Some("targetbody") => stage.origin(stage.target(camera)?),
            Some("targetbodycom") => stage.centre_of_mass(self, stage.target(camera)?)?,
            Some(_) => {
                let expected = "expected fixed, track, trackcom, targetbody or targetbodycom";
                return Err(camera.refuse("mode", expected));
            }
        };
        if !stage.is_still(stage.target(camera)?) {
            let text =
                "turns after its target in MuJoCo; here it looks at where that is at the start";
            self.note(index, text);
        }
        pose.rotation = looking(&(aim - pose.translation.vector));
        Ok(pose)
    }
}

/// The orientation in which MuJoCo has a camera look along a direction: along its -z axis, its x axis level.
fn looking(direction: &Vector3<f64>) -> UnitQuaternion<f64> {
    let z = -direction.try_normalize(1e-15).unwrap_or(-Vector3::x());
    let x = Vector3::z().cross(&z).try_normalize(1e-15);
    let x = x.unwrap_or(Vector3::x());
    let axes = Matrix3::from_columns(&[x, z.cross(&x), z]);
    UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(axes))
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
        let attributes = Attributes::own(document, index);
        for (side, name) in size.iter_mut().zip(["offwidth", "offheight"]) {
            if let Some(pixels) = attributes.not_negative(name)? {
                *side = pixels as u32;
            }
        }
    }
    Ok(size)
}
