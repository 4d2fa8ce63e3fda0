//! Pictures of results: as a camera sees them (PNG), or as lines (SVG).

use std::path::{Path, PathBuf};

use clap::Args;
use nalgebra::{UnitQuaternion, Vector3};
use tdcr::report::{
    Aspect, Figure, Ink, Mark, Panel, Scale, Shape, Window, cloud_sheet, counted, outlines,
};
use tdcr::sim::camera::Camera;
use tdcr::sim::chain::Configuration;
use tdcr::sim::cloud::PointCloud;
use tdcr::sim::geometry::Instance;
use tdcr::sim::pose::Pose;
use tdcr::sim::render::{BaseVisibility, RgbdFrame, Visuals};
use tdcr::sim::robot::{Aim, CameraSpec, Lens, Loads, Robot};
use tdcr::sim::scene::Scene;

use super::film::{FRAME_TIME, Film};
use super::output;

/// Edge of a view (pixels).
const EDGE: u32 = 480;
/// Field of view (degrees): little perspective.
const FOVY: f64 = 20.0;

/// A picture of the result.
#[derive(Debug, Args)]
pub(super) struct PictureArg {
    /// Draw the result in this file: .png as a camera sees it, .svg as lines; of simulate and plan also .mp4, by ffmpeg
    #[arg(long, value_name = "FILE")]
    picture: Option<PathBuf>,
}

/// What a picture consists of.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Format {
    /// Pixels.
    Png,
    /// Lines.
    Svg,
    /// A video.
    Mp4,
}

impl PictureArg {
    /// The file and its format, asked before the work is done.
    pub fn wanted(&self) -> anyhow::Result<Option<(&Path, Format)>> {
        self.one_of(&["png", "svg"])
    }

    /// The same of a motion, which may be a video.
    pub fn wanted_of_motion(&self) -> anyhow::Result<Option<(&Path, Format)>> {
        self.one_of(&["png", "svg", "mp4"])
    }

    fn one_of(&self, formats: &[&str]) -> anyhow::Result<Option<(&Path, Format)>> {
        let Some(path) = self.picture.as_deref() else {
            return Ok(None);
        };
        let format = match output::format("--picture", path, formats)? {
            "svg" => Format::Svg,
            "mp4" => Format::Mp4,
            _ => Format::Png,
        };
        Ok(Some((path, format)))
    }
}

/// Two cameras that see all that the robot can reach: from the front (-y), and from the side (+x).
fn cameras(robot: &Robot) -> [Camera; 2] {
    let length = robot.arc_lengths().last().copied().unwrap_or(0.1);
    let base = Vector3::from(robot.spec().base.position);
    let [w, x, y, z] = robot.spec().base.orientation;
    let up = UnitQuaternion::from_quaternion(nalgebra::Quaternion::new(w, x, y, z)) * Vector3::z();
    let middle = base + up * (0.3 * length);
    let distance = 1.05 * length / (FOVY / 2.0).to_radians().tan();
    [-Vector3::y(), Vector3::x()].map(|from| {
        Camera::free(&CameraSpec {
            position: (middle + from * distance).into(),
            aim: Aim::At(middle.into()),
            lens: Lens::Fovy(FOVY),
            resolution: [EDGE, EDGE],
            distortion: None,
        })
    })
}

/// What a camera sees of the robot, row by row; white where there is nothing.
fn view(robot: &Robot, pose: Pose, loads: &Loads, scene: &Scene, camera: &Camera) -> Vec<[u8; 3]> {
    let mut visuals = Visuals::of_robot(robot, pose, BaseVisibility::Shown);
    visuals.add_tendons(robot, pose);
    visuals.add_payload(robot, pose, &loads.tip_payload());
    visuals.add_scene(scene);
    let mut frames: Vec<RgbdFrame> = Vec::new();
    visuals.render_all_into(std::slice::from_ref(camera), &mut frames);
    let frame = &frames[0];
    let seen = frame.color.iter().zip(&frame.mask);
    seen.map(|(color, instance)| match instance {
        Instance::Background => [255; 3],
        _ => *color,
    })
    .collect()
}

/// The picture of a robot: from the front and from the side.
pub(super) fn of_robot(
    (path, format): (&Path, Format),
    robot: &Robot,
    pose: Pose,
    loads: &Loads,
    scene: &Scene,
) -> anyhow::Result<()> {
    match format {
        Format::Svg => output::write(path, side_views(robot, pose, scene).to_svg()),
        Format::Png | Format::Mp4 => {
            let views = cameras(robot).map(|camera| view(robot, pose, loads, scene, &camera));
            let rows = views[0]
                .chunks(EDGE as usize)
                .zip(views[1].chunks(EDGE as usize));
            let pixels: Vec<u8> = rows.flat_map(|(a, b)| [a, b].concat()).flatten().collect();
            let mut film = Film::png(path, [2 * EDGE, EDGE], 1)?;
            film.add(&pixels)?;
            film.finish()
        }
    }
}

/// The backbone, the discs' edges and the obstacles, from the front and from the side.
fn side_views(robot: &Robot, pose: Pose, scene: &Scene) -> Figure {
    let base = Vector3::from(robot.spec().base.position);
    let panel = |title: &str, across: usize, towards: Vector3<f64>| {
        let place = |p: &Vector3<f64>| [1e3 * p[across], 1e3 * p.z];
        let backbone: Vec<_> = std::iter::once(&base)
            .chain(pose.positions)
            .map(place)
            .collect();
        let edges = robot
            .discs()
            .iter()
            .zip(pose.positions.iter().zip(pose.orientations));
        let edges = edges.flat_map(|(disc, (position, orientation))| {
            // The widest chord of the disc, as seen from there.
            let chord = (orientation * Vector3::z()).cross(&towards);
            let chord = chord
                .try_normalize(1e-9)
                .unwrap_or(Vector3::ith(across, 1.0))
                * disc.radius;
            [place(&(position - chord)), place(&(position + chord))]
        });
        let edges: Vec<_> = edges.collect();
        let window = Window::around(edges.iter().chain(&backbone).copied());
        let obstacles = outlines(scene, &towards, &base, window, place);
        let mark = |shape, ink, points| Mark {
            name: String::new(),
            shape,
            ink,
            points,
        };
        Panel {
            title: title.to_owned(),
            x: Scale::linear(["x (mm)", "y (mm)"][across]),
            y: Scale::linear("z (mm)"),
            aspect: Aspect::Equal,
            marks: vec![
                obstacles,
                mark(Shape::Segments, Ink::Grey, edges),
                mark(Shape::Line, Ink::Blue, backbone),
            ],
        }
    };
    let tip = pose.tip().translation.vector * 1e3;
    Figure {
        title: format!("Robot {}", robot.spec().name),
        caption: format!(
            "Backbone (blue) and discs{}. Tip at x {:.1}, y {:.1}, z {:.1} mm.",
            match scene.obstacles().len() {
                0 => String::new(),
                count => format!(", {} (vermilion)", counted(count, "obstacle")),
            },
            tip.x,
            tip.y,
            tip.z
        ),
        panels: vec![
            panel("From the front", 0, Vector3::y()),
            panel("From the side", 1, Vector3::x()),
        ],
    }
}

/// The picture of clouds.
pub(super) fn of_clouds(
    (path, format): (&Path, Format),
    clouds: &[PointCloud],
) -> anyhow::Result<()> {
    match format {
        Format::Png | Format::Mp4 => output::write(
            path,
            cloud_sheet(clouds, clouds.len().clamp(1, 4), EDGE as usize).0,
        ),
        Format::Svg => {
            let panel = |across: usize| Panel {
                title: ["From the front", "From the side"][across].to_owned(),
                x: Scale::linear(["x (mm)", "y (mm)"][across]),
                y: Scale::linear("z (mm)"),
                aspect: Aspect::Equal,
                marks: (clouds.iter().zip(
                    [Ink::Blue, Ink::Vermilion, Ink::Green, Ink::Purple]
                        .into_iter()
                        .cycle(),
                ))
                .map(|(cloud, ink)| Mark {
                    name: String::new(),
                    shape: Shape::Specks,
                    ink,
                    points: (cloud.points.iter())
                        .map(|p| [1e3 * f64::from(p[across]), 1e3 * f64::from(p[2])])
                        .collect(),
                })
                .collect(),
            };
            let count: usize = clouds.iter().map(PointCloud::len).sum();
            let figure = Figure {
                title: "Predicted cloud".to_owned(),
                caption: format!("{count} points."),
                panels: vec![panel(0), panel(1)],
            };
            output::write(path, figure.to_svg())
        }
    }
}

/// The picture of a motion: a film of the robot from the front, or the tip's course.
pub(super) struct MotionPicture<'a> {
    to: (&'a Path, Format),
    robot: &'a Robot,
    camera: Camera,
    loads: Loads,
    scene: Scene,
    /// Steps between two pictures.
    stride: usize,
    /// Of an animated picture.
    film: Option<Film>,
    tips: Vec<(f64, Vector3<f64>)>,
}

impl<'a> MotionPicture<'a> {
    /// Of so many steps of `dt` (s).
    pub fn new(
        to: (&'a Path, Format),
        robot: &'a Robot,
        loads: &Loads,
        scene: &Scene,
        (steps, dt): (usize, f64),
    ) -> anyhow::Result<Self> {
        let stride = ((FRAME_TIME / dt).round() as usize).max(1);
        let [camera, _] = cameras(robot);
        Ok(Self {
            to,
            robot,
            camera,
            loads: loads.clone(),
            scene: scene.clone(),
            stride,
            film: match to.1 {
                Format::Png => Some(Film::png(to.0, [EDGE; 2], steps.div_ceil(stride))?),
                Format::Mp4 => Some(Film::mp4(to.0, [EDGE; 2])?),
                Format::Svg => None,
            },
            tips: Vec::new(),
        })
    }

    /// Shows the objects where a scene has them from now on.
    pub fn move_objects(&mut self, scene: &Scene) {
        if scene.objects().next().is_some() {
            self.scene = scene.clone();
        }
    }

    /// Adds the robot after step `step`, counted from 0, at a time (s).
    pub fn add(
        &mut self,
        step: usize,
        time: f64,
        configuration: &Configuration,
    ) -> anyhow::Result<()> {
        self.add_of(self.robot, step, time, configuration)
    }

    /// The same of a robot that stands elsewhere.
    pub fn add_of(
        &mut self,
        robot: &Robot,
        step: usize,
        time: f64,
        configuration: &Configuration,
    ) -> anyhow::Result<()> {
        let (positions, orientations) = configuration.place(robot);
        // What cameras see of tendons follows from the discs.
        let pose = Pose {
            configuration,
            positions: &positions,
            orientations: &orientations,
            tendon_lengths: &[],
            tendon_tensions: &[],
        };
        match &mut self.film {
            None => self.tips.push((time, pose.tip().translation.vector)),
            Some(film) if step.is_multiple_of(self.stride) => {
                let seen = view(robot, pose, &self.loads, &self.scene, &self.camera);
                film.add(seen.as_flattened())?;
            }
            Some(_) => {}
        }
        Ok(())
    }

    /// Writes the file.
    pub fn finish(self) -> anyhow::Result<()> {
        let path = self.to.0;
        if let Some(film) = self.film {
            return film.finish();
        }
        let course = |axis: usize, name: &str, ink| Mark {
            name: name.to_owned(),
            shape: Shape::Line,
            ink,
            points: self
                .tips
                .iter()
                .map(|(time, tip)| [*time, 1e3 * tip[axis]])
                .collect(),
        };
        let figure = Figure {
            title: format!("Motion of robot {}", self.robot.spec().name),
            caption: format!("The tip over {} steps.", self.tips.len()),
            panels: vec![Panel {
                title: "Tip".to_owned(),
                x: Scale::linear("Time (s)"),
                y: Scale::linear("Position (mm)"),
                aspect: Aspect::Free,
                marks: vec![
                    course(0, "x", Ink::Blue),
                    course(1, "y", Ink::Vermilion),
                    course(2, "z", Ink::Green),
                ],
            }],
        };
        output::write(path, figure.to_svg())
    }
}
