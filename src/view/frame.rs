//! What a robot does, in numbers: the message that goes to a page for every move.

/// What a message of numbers holds: its first number.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    /// Where the robot is.
    Frame,
    /// Points and their colours.
    Cloud,
    /// A picture that the page asked for, as pixels.
    Picture,
    /// A picture that a camera took: of a rig, or of a recording.
    Taken,
}

impl Kind {
    pub fn number(self) -> f64 {
        f64::from(self as u8)
    }
}

/// What a robot does, in numbers.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Frame {
    /// The number of the request that is answered.
    pub stamp: f64,
    /// Time of the solve (s).
    pub solve: f64,
    /// Residual (N m).
    pub residual: f64,
    /// Newton steps.
    pub iterations: f64,
    /// 1 where the robot rests there, else 0.
    pub converged: f64,
    /// The place of the kind of equilibrium in the layout's list, or -1.
    pub stability: f64,
    /// Payload (kg).
    pub payload: f64,
    /// By what physics the robot follows its tendons: 0 at rest, 1 with friction, 2 in motion; 3 in a pose that was given.
    pub physics: f64,
    /// Time of the motion (s).
    pub time: f64,
    /// What computing a motion takes of its time.
    pub load: f64,
    /// Origin of the distal disc, world frame (m).
    pub tip: [f64; 3],
    /// Command of each tendon (m, or N for a tension drive).
    pub command: Vec<f64>,
    /// Tension of each tendon (N).
    pub tensions: Vec<f64>,
    /// Length of each tendon (m).
    pub lengths: Vec<f64>,
    /// Position (m) and quaternion (x, y, z, w) of each of the layout's solids.
    pub solids: Vec<[f64; 7]>,
    /// Holes of the tendons, one tendon after another, world frame (m).
    pub holes: Vec<[f64; 3]>,
    /// For each contact: disc; obstacle, or -1 - other disc; point (m), normal, force (N), gap (m).
    pub contacts: Vec<[f64; 12]>,
}

impl Frame {
    /// The frame as a message: little-endian `f64`s, read by `decode` in `src/view/page/link.js`.
    pub fn bytes(&self) -> Vec<u8> {
        let counts = [
            self.command.len(),
            self.solids.len(),
            self.holes.len(),
            self.contacts.len(),
        ];
        let head = [
            Kind::Frame.number(),
            self.stamp,
            self.solve,
            self.residual,
            self.iterations,
            self.converged,
            self.stability,
            self.payload,
            self.physics,
            self.time,
            self.load,
        ];
        let numbers = head
            .into_iter()
            .chain(self.tip)
            .chain(counts.map(|count| count as f64))
            .chain(self.command.iter().copied())
            .chain(self.tensions.iter().copied())
            .chain(self.lengths.iter().copied())
            .chain(self.solids.iter().flatten().copied())
            .chain(self.holes.iter().flatten().copied())
            .chain(self.contacts.iter().flatten().copied());
        numbers.flat_map(f64::to_le_bytes).collect()
    }
}
