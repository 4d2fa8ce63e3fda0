//! A rod as a chain of discs.

use nalgebra::Vector3;
use tdcr_sim::robot::{
    Backbone, Body, Drive, Frame, Holes, Loads, MassSpec, ModuleSpec, PerDisc, Pull, RigidMass,
    Robot, RobotSpec, RouteSpec, TendonSpec, Waypoint, Wrench,
};
use tdcr_sim::statics::Equilibrium;

/// A rod that stands on the origin, straight along z at rest.
#[derive(Clone)]
pub struct Rod {
    /// Length (m).
    pub length: f64,
    /// Bending stiffness `E I` about x and y, torsion stiffness `G J` about z (N m²).
    pub stiffness: Vector3<f64>,
    /// Mass per length (kg/m).
    pub line_density: f64,
    /// Gravitational acceleration (m/s²).
    pub gravity: [f64; 3],
    /// Tendons parallel to the rod.
    pub tendons: Vec<Parallel>,
}

/// A tendon parallel to the rod, of given tension, from the base to a disc.
#[derive(Clone, Copy, Debug)]
pub struct Parallel {
    /// Its place in the rod's section (m).
    pub hole: [f64; 2],
    /// Where it ends along the rod (m).
    pub end: f64,
    /// Tension (N).
    pub tension: f64,
}

/// Where in its pitch a disc's joint lies.
#[derive(Clone, Copy, PartialEq)]
pub enum JointPlace {
    /// In the middle, below the disc by half the pitch.
    Middle,
    /// At the top, in the disc's origin.
    Top,
}

impl Rod {
    /// A round rod without weight: `E I` = 1 N m², Poisson's ratio 0.3, length 1 m.
    pub fn unit() -> Self {
        Self {
            length: 1.0,
            stiffness: Vector3::new(1.0, 1.0, 1.0 / 1.3),
            line_density: 0.0,
            gravity: [0.0; 3],
            tendons: Vec::new(),
        }
    }

    /// The chain of `discs` discs, each of which guides the tendons.
    pub fn chain(&self, discs: usize) -> Robot {
        self.chain_with(discs, 1, JointPlace::Middle)
    }

    /// The chain of `discs` discs, of which every `guide`th guides the tendons.
    pub fn chain_with(&self, discs: usize, guide: usize, joint: JointPlace) -> Robot {
        let pitch = self.length / discs as f64;
        let [x, y, z]: [f64; 3] = (self.stiffness / pitch).into();
        let holes = Holes::At(self.tendons.iter().map(|tendon| tendon.hole).collect());
        let mut spec = RobotSpec::standard("2m").unwrap();
        spec.gravity = self.gravity;
        spec.base.position = [0.0; 3];
        spec.base.hole_height = 0.0;
        spec.base.holes = holes.clone();
        spec.modules = vec![ModuleSpec {
            discs,
            first_offset: pitch,
            pitch,
            joint_below: match joint {
                JointPlace::Middle => pitch / 2.0,
                JointPlace::Top => 0.0,
            },
            mass: MassSpec::Rigid(PerDisc::Each(self.masses(discs))),
            holes,
            // What rods without damping are said to do under moments does not count against their shapes.
            damping: PerDisc::Uniform(0.0),
            backbone: Some(PerDisc::Uniform(Backbone {
                bending: [x, y],
                torsion: z,
                rest: [0.0; 3],
            })),
            tendons: None,
            ..spec.modules[0].clone()
        }];
        let routes = self.tendons.iter().enumerate();
        spec.routes = routes
            .map(|(hole, tendon)| RouteSpec {
                through: std::iter::once(Waypoint(Body::Base, hole))
                    .chain(
                        (1..=(tendon.end / pitch).round() as usize)
                            .filter(|number| number % guide == 0)
                            .map(|number| Waypoint(Body::Disc(number - 1), hole)),
                    )
                    .collect(),
                tendon: TendonSpec {
                    drive: Drive::Tension,
                    range: [0.0, 100.0],
                    pull: Pull::Bilateral,
                    axial_stiffness: None,
                    stiffening: 0.0,
                    friction: None,
                    servo: None,
                },
            })
            .collect();
        Robot::new(spec).unwrap()
    }

    /// Each disc has the mass of half a pitch below it and half a pitch above.
    fn masses(&self, discs: usize) -> Vec<RigidMass> {
        let pitch = self.length / discs as f64;
        let halves = (0..discs).map(|disc| if disc + 1 < discs { 2.0 } else { 1.0 });
        halves
            .map(|halves| RigidMass {
                mass: halves * 0.5 * pitch * self.line_density,
                inertia: [0.0; 3],
                ..RigidMass::default()
            })
            .collect()
    }

    /// The chain at rest under the tendons' tensions and the loads.
    pub fn settle(&self, robot: &Robot, loads: &Loads) -> Equilibrium {
        let tensions: Vec<f64> = self.tendons.iter().map(|tendon| tendon.tension).collect();
        let settled = robot.settle(&robot.command(&tensions).unwrap(), loads);
        assert!(settled.converged, "{} N m left", settled.residual);
        settled
    }

    /// Where the tip of a chain of `discs` discs rests under a wrench (m).
    pub fn tip(&self, discs: usize, tip: &TipLoad) -> Vector3<f64> {
        let robot = self.chain(discs);
        *self
            .settle(&robot, &tip.on(&robot))
            .positions
            .last()
            .unwrap()
    }
}

/// A force and a moment on a rod's tip.
#[derive(Clone, Copy, Debug)]
pub struct TipLoad {
    /// Force (N).
    pub force: Vector3<f64>,
    /// Moment (N m).
    pub moment: Vector3<f64>,
    /// The frame that they keep their direction in.
    pub frame: Frame,
}

impl TipLoad {
    /// No load.
    pub fn none() -> Self {
        Self {
            force: Vector3::zeros(),
            moment: Vector3::zeros(),
            frame: Frame::World,
        }
    }

    /// A force that keeps its direction.
    pub fn force(x: f64, y: f64, z: f64) -> Self {
        Self {
            force: Vector3::new(x, y, z),
            ..Self::none()
        }
    }

    /// A moment that keeps its direction.
    pub fn moment(x: f64, y: f64, z: f64) -> Self {
        Self {
            moment: Vector3::new(x, y, z),
            ..Self::none()
        }
    }

    /// The load on the distal disc of a chain.
    pub fn on(&self, robot: &Robot) -> Loads {
        let wrench = Wrench {
            disc: robot.discs().len() - 1,
            point: [0.0; 3],
            force: self.force.into(),
            moment: self.moment.into(),
            frame: self.frame,
        };
        Loads::default().with_wrench(wrench).unwrap()
    }
}
