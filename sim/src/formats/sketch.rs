//! A first robot file from a few words: one that loads, settles, and says in comments what to change.

use std::f64::consts::PI;
use std::fmt::Write;

use thiserror::Error;

use crate::robot::{Robot, RobotSpec, SpecError};

/// What one knows of a robot before anything else. All segments are alike but for the directions of their tendons.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sketch {
    /// Segments that bend on their own.
    pub segments: usize,
    /// Discs of each segment.
    pub discs: usize,
    /// Tendons of each segment, evenly around its axis; all start at the base.
    pub tendons: usize,
    /// Length of each segment (m).
    pub length: f64,
    /// What holds the discs apart.
    pub backbone: SketchedBackbone,
    /// What pulls the tendons.
    pub servos: SketchedServos,
}

/// The elastic wire through all discs of a [`Sketch`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SketchedBackbone {
    /// Young's modulus (Pa), shear modulus by a Poisson's ratio of 0.3.
    pub youngs: f64,
    /// Radius (m).
    pub radius: f64,
    /// Density (kg/m³).
    pub density: f64,
}

impl SketchedBackbone {
    /// A wire of spring steel.
    pub fn steel(radius: f64) -> Self {
        Self {
            youngs: 200e9,
            radius,
            density: 7850.0,
        }
    }

    /// A wire of superelastic nickel titanium, as austenite.
    pub fn nitinol(radius: f64) -> Self {
        Self {
            youngs: 60e9,
            radius,
            density: 6450.0,
        }
    }
}

/// What the servos of a [`Sketch`] are told.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SketchedServos {
    /// Positions: how much of a tendon is not wound up (m). Tendons are elastic.
    Position,
    /// Tensions (N), by load cells or currents.
    Tension,
}

/// Why a sketch is no robot.
#[derive(Debug, Error)]
pub enum SketchError {
    /// A number that is none of a robot's.
    #[error("{what} is {value}; expected {expected}")]
    Value {
        /// What it counts or measures.
        what: &'static str,
        /// What was given.
        value: f64,
        /// What may be given.
        expected: &'static str,
    },
    /// The file would not be valid.
    #[error(transparent)]
    Robot(#[from] SpecError),
    /// The text would not be a robot file.
    #[error("the robot file cannot be read back: {0}")]
    Text(String),
}

/// Stiffness of tendons that servos wind up (N/m), such as of braided polyethylene a metre long.
const GAIN: f64 = 3000.0;
/// Bend of a segment at the ends of its tendons' range (rad).
const BEND: f64 = PI / 2.0;

impl Sketch {
    /// The robot file (TOML), of the given name.
    ///
    /// # Errors
    /// [`SketchError`] for counts and sizes that no robot has, such as a segment without discs or tendons.
    pub fn to_toml(&self, name: &str) -> Result<String, SketchError> {
        self.check()?;
        let mut text = self.head(name);
        for segment in 0..self.segments {
            text += &self.module(segment);
        }
        let spec: RobotSpec =
            toml::from_str(&text).map_err(|error| SketchError::Text(error.to_string()))?;
        Robot::new(spec)?;
        Ok(text)
    }

    /// A command that bends the first segment (m or N).
    pub fn command(&self) -> Vec<f64> {
        (0..self.segments * self.tendons)
            .map(|tendon| {
                let [low, high] = self.range(tendon / self.tendons);
                let straight = (tendon / self.tendons + 1) as f64 * self.length;
                match (self.servos, tendon) {
                    (SketchedServos::Tension, 0) => low + 0.25 * (high - low),
                    (SketchedServos::Tension, _) => low,
                    (SketchedServos::Position, 0) => straight - 0.25 * (straight - low),
                    (SketchedServos::Position, _) => straight.min(high),
                }
            })
            .map(|value| (1e6 * value).round() / 1e6)
            .collect()
    }

    fn check(&self) -> Result<(), SketchError> {
        let counts = [
            ("the number of segments", self.segments, 1..=20, "1 to 20"),
            (
                "the number of discs of a segment",
                self.discs,
                1..=50,
                "1 to 50",
            ),
            (
                "the number of tendons of a segment",
                self.tendons,
                1..=12,
                "1 to 12",
            ),
        ];
        for (what, count, accepted, expected) in counts {
            if !accepted.contains(&count) {
                let value = count as f64;
                return Err(SketchError::Value {
                    what,
                    value,
                    expected,
                });
            }
        }
        for (what, value, largest, expected) in [
            (
                "the length of a segment (m)",
                self.length,
                10.0,
                "above 0, at most 10 m",
            ),
            (
                "the radius of the backbone (m)",
                self.backbone.radius,
                self.hole_radius(),
                "above 0, and less than a twelfth of a segment's length",
            ),
        ] {
            if !(value > 0.0 && value <= largest) {
                return Err(SketchError::Value {
                    what,
                    value,
                    expected,
                });
            }
        }
        Ok(())
    }

    fn disc_radius(&self) -> f64 {
        self.length / 10.0
    }

    /// Distance of the tendons from the axis (m).
    fn hole_radius(&self) -> f64 {
        self.length / 12.0
    }

    /// What a command may be (m or N) for the tendons of a segment.
    fn range(&self, segment: usize) -> [f64; 2] {
        let straight = (segment + 1) as f64 * self.length;
        // A tendon at the distance r from the axis gets shorter by r times the bend.
        let pulled = BEND * self.hole_radius() * (segment + 1) as f64;
        match self.servos {
            SketchedServos::Position => [straight - pulled, straight + pulled],
            SketchedServos::Tension => {
                let SketchedBackbone { youngs, radius, .. } = self.backbone;
                // A tendon bends a rod by its tension times its distance from the axis.
                let stiffness = youngs * PI * radius.powi(4) / 4.0;
                let tension = stiffness * BEND / self.length / self.hole_radius();
                [0.0, 1.5 * tension * (segment + 1) as f64]
            }
        }
        .map(|value| format!("{value:.3e}").parse().unwrap_or(value))
    }

    fn degrees(&self) -> String {
        let angles: Vec<String> = (0..self.tendons)
            .map(|k| rounded(360.0 * k as f64 / self.tendons as f64))
            .collect();
        format!("[{}]", angles.join(", "))
    }

    fn head(&self, name: &str) -> String {
        let command: Vec<String> = self.command().into_iter().map(|v| format!("{v}")).collect();
        let quoted = toml::Value::String(name.to_owned());
        format!(
            "# A robot of {} alike. Units: metres, kilograms, seconds, newtons, pascals; angles in degrees where a field says so.\n\
             # Sizes that were not asked for are guesses from the length of a segment: measure yours.\n\
             # A command that bends the first segment:\n\
             #   {}\n\
             name = {quoted}\n\
             gravity = [0.0, 0.0, -9.81]       # the robot stands; [0.0, 0.0, 9.81] hangs it\n\
             routing = \"base\"                  # every tendon starts at the base\n\n\
             [base]\n\
             position = [0.0, 0.0, 0.0]\n\
             holes = {{ radius = {}, degrees = {} }} # of the first segment; those above are turned by their clocking\n\
             hole_height = 0.0\n",
            match self.segments {
                1 => "one segment, all discs".to_owned(),
                count => format!("{count} segments, all"),
            },
            command.join(","),
            rounded(self.hole_radius()),
            self.degrees(),
        )
    }

    fn module(&self, segment: usize) -> String {
        let pitch = self.length / self.discs as f64;
        let mut text = String::from("\n[[modules]]\n");
        let mut line = |field: &str, value: String, comment: &str| {
            // Writing to a string cannot fail.
            let _ = match comment {
                "" => writeln!(text, "{field} = {value}"),
                comment => writeln!(text, "{:33} # {comment}", format!("{field} = {value}")),
            };
        };
        line("discs", self.discs.to_string(), "");
        line(
            "length",
            rounded(self.length),
            "from the joint below the first disc to the last disc",
        );
        if segment > 0 {
            let turn = 360.0 * segment as f64 / (self.tendons * self.segments) as f64;
            line(
                "clocking_degrees",
                rounded(turn),
                "tendons of all segments stand evenly around the axis",
            );
        }
        line(
            "joint_below",
            rounded(pitch / 2.0),
            "joints half way between discs",
        );
        line("radius", rounded(self.disc_radius()), "of the discs");
        line(
            "half_height",
            rounded((pitch / 8.0).min(0.001)),
            "half of a disc's height",
        );
        line("mass", "{ density = 1200.0 }".to_owned(), "printed discs");
        let holes = format!(
            "{{ radius = {}, degrees = {} }}",
            rounded(self.hole_radius()),
            self.degrees()
        );
        line("holes", holes, "");
        line(
            "damping",
            "1e-4".to_owned(),
            "N m s/rad of each joint; moves no equilibrium",
        );
        line(
            "armature",
            "1e-6".to_owned(),
            "kg m² of each joint; moves no equilibrium",
        );
        let SketchedBackbone {
            youngs,
            radius,
            density,
        } = self.backbone;
        let rod = format!(
            "{{ youngs = {youngs:e}, poisson = 0.3, radius = {}, density = {} }}",
            rounded(radius),
            rounded(density)
        );
        line("rod", rod, "");
        let [low, high] = self.range(segment);
        let drive = match self.servos {
            SketchedServos::Tension => "\"tension\"".to_owned(),
            SketchedServos::Position => format!("{{ gain = {GAIN:?} }}"),
        };
        let tendons =
            format!("{{ drive = {drive}, range = [{low:?}, {high:?}], pull = \"tension_only\" }}");
        line("tendons", tendons, "");
        text
    }
}

/// A number of three or four digits, as people write it.
fn rounded(value: f64) -> String {
    let short: f64 = format!("{value:.3e}").parse().unwrap_or(value);
    format!("{short:?}")
}
