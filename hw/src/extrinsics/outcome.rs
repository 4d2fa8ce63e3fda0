//! What a calibration finds, and why it may find nothing.

use nalgebra::Isometry3;
use tdcr_sim::camera::Camera;
use thiserror::Error;

/// Fewest corners of a sighting that count: with less than three beyond the pose's own freedom, wrong ones do not show.
pub const FEWEST_CORNERS: usize = 6;
/// The poses of all cameras, and how well they are known.
#[derive(Clone, Debug)]
pub struct Calibration {
    /// In the order of the cameras given.
    pub cameras: Vec<CalibratedCamera>,
    /// The board in each view that served, in order.
    pub views: Vec<PlacedBoard>,
    /// Corners left out as wrong.
    pub rejected: Vec<RejectedCorner>,
    /// Corners that served.
    pub corners: usize,
    /// Standard deviation of their errors, each way (pixels).
    pub noise: f64,
}

/// A camera and how well its pose is known.
#[derive(Clone, Debug)]
pub struct CalibratedCamera {
    /// Its serial number.
    pub serial: String,
    /// Its lens, and its pose in the world (m).
    pub camera: Camera,
    /// Views that served.
    pub views: usize,
    /// Corners that served.
    pub corners: usize,
    /// Root mean square distance between where corners are seen and where they should be (pixels).
    pub reprojection_rms: f64,
    /// Standard deviations of its position along the world's axes (m), as the corners' errors have it: 0 of a camera that is
    /// the world.
    pub position_deviation: [f64; 3],
    /// Standard deviations of its orientation about the world's axes (rad).
    pub orientation_deviation: [f64; 3],
}

/// Where the board stood in a view.
#[derive(Clone, Debug)]
pub struct PlacedBoard {
    /// Name of the view.
    pub view: String,
    /// Pose of the board's frame in the world (m).
    pub pose: Isometry3<f64>,
    /// Cameras that saw it.
    pub cameras: usize,
    /// Root mean square distance between where corners are seen and where they should be (pixels).
    pub reprojection_rms: f64,
}

/// A corner that disagrees with all others.
#[derive(Clone, Debug)]
pub struct RejectedCorner {
    /// Serial number of the camera.
    pub serial: String,
    /// Name of the view.
    pub view: String,
    /// Number of the corner.
    pub corner: u32,
    /// Distance from where it should be (pixels); `None` where that is behind the camera.
    pub error: Option<f64>,
}

/// Why the cameras' poses cannot be told.
#[derive(Debug, Error, PartialEq)]
pub enum CalibrationError {
    /// Nothing to relate.
    #[error(
        "{found} cameras; expected two or more, or a view in which the board's pose in the world is known"
    )]
    TooFewCameras {
        /// How many there are.
        found: usize,
    },
    /// No sighting at all.
    #[error(
        "no camera sees the board in any of {views} views: is it the board described (squares, dictionary), sharp, and larger \
         than about 100 pixels?"
    )]
    NoBoard {
        /// How many views there are.
        views: usize,
    },
    /// Cameras that never see it.
    #[error(
        "no image of {} shows the board with {FEWEST_CORNERS} corners or more; take views in which such a camera and another see it",
        serials.join(", ")
    )]
    Blind {
        /// Serial numbers.
        serials: Vec<String>,
    },
    /// The view that says where the world is does not.
    #[error("no camera sees the board in view {view}, which says where the world is")]
    WorldUnseen {
        /// Its name.
        view: String,
    },
    /// Cameras that share no views.
    #[error(
        "no views relate the cameras {}; take views in which a camera of each group sees the board at the same time",
        groups.iter().map(|group| format!("({})", group.join(", "))).collect::<Vec<_>>().join(" and ")
    )]
    Disconnected {
        /// Serial numbers of cameras that views relate.
        groups: Vec<Vec<String>>,
    },
    /// The corners contradict each other.
    #[error(
        "the corners do not determine the poses: too many are wrong, or all of a view are on a line"
    )]
    Undetermined,
}
