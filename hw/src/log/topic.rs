//! Names of a log's topics.

/// What a log's message is about: one topic for each, named as tools that read logs expect it.
///
/// Of cameras there may be several: their topics have the camera's serial number in them.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub enum Topic {
    /// Positions, velocities and currents of servos.
    Present,
    /// What servos were told.
    Goals,
    /// Models, modes, temperatures, voltages and faults of servos.
    Status,
    /// Where the homes of servos are.
    Homes,
    /// Bytes of servos' control tables.
    Registers,
    /// What was asked of the robot's tendons.
    Command,
    /// What happened besides, in words.
    Events,
    /// The robot as URDF. Foxglove's 3-D panel draws what this topic holds.
    Robot,
    /// Poses of frames within others.
    Transforms,
    /// The fused cloud.
    Cloud,
    /// Intrinsics of a camera.
    Calibration(String),
    /// Colour images of a camera.
    Color(String),
    /// Depth images of a camera.
    Depth(String),
}

const CAMERAS: &str = "/cameras/";

impl Topic {
    /// The topics of which a log has one each.
    pub const SINGLE: [Self; 10] = [
        Self::Present,
        Self::Goals,
        Self::Status,
        Self::Homes,
        Self::Registers,
        Self::Command,
        Self::Events,
        Self::Robot,
        Self::Transforms,
        Self::Cloud,
    ];

    /// The topic's name, such as `/cameras/0123/depth`.
    pub fn name(&self) -> String {
        match self {
            Self::Present => "/servos/present".to_owned(),
            Self::Goals => "/servos/goals".to_owned(),
            Self::Status => "/servos/status".to_owned(),
            Self::Homes => "/servos/homes".to_owned(),
            Self::Registers => "/servos/registers".to_owned(),
            Self::Command => "/command".to_owned(),
            Self::Events => "/events".to_owned(),
            Self::Robot => "/robot_description".to_owned(),
            Self::Transforms => "/tf".to_owned(),
            Self::Cloud => "/cloud".to_owned(),
            Self::Calibration(serial) => format!("{CAMERAS}{serial}/calibration"),
            Self::Color(serial) => format!("{CAMERAS}{serial}/color"),
            Self::Depth(serial) => format!("{CAMERAS}{serial}/depth"),
        }
    }

    /// The topic of a name; `None` for one that is not ours.
    pub fn parse(name: &str) -> Option<Self> {
        if let Some((serial, kind)) = (name.strip_prefix(CAMERAS)).and_then(|n| n.rsplit_once('/'))
        {
            return match kind {
                "calibration" => Some(Self::Calibration(serial.to_owned())),
                "color" => Some(Self::Color(serial.to_owned())),
                "depth" => Some(Self::Depth(serial.to_owned())),
                _ => None,
            };
        }
        Self::SINGLE.into_iter().find(|topic| topic.name() == name)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_parsed_into_their_topics() {
        let of_cameras = ["0123", "a/b", ""].into_iter().flat_map(|serial| {
            [Topic::Calibration, Topic::Color, Topic::Depth].map(|topic| topic(serial.to_owned()))
        });
        for topic in Topic::SINGLE.into_iter().chain(of_cameras) {
            assert_eq!(Topic::parse(&topic.name()), Some(topic));
        }
        for other in ["", "/", "/cameras/", "/cameras/1/infrared", "tf"] {
            assert_eq!(Topic::parse(other), None, "{other}");
        }
    }
}
