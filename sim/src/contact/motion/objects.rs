//! The objects of a scene beside the robot's step: they are where the step begins, take its impulses, and move on.

use nalgebra::Vector3;

use super::super::Partner;
use super::ContactStepper;
use super::coupled::Movables;
use super::law::Push;
use super::touch::{Name, Opposite, Side, Touch};
use crate::dynamics::DynamicsError;
use crate::objects::{Body, Meeting, ObjectError, ObjectState, Twist, World};
use crate::scene::Scene;

/// Inertance of contacts among objects and with what is fixed, for the mass that they resist: their surfaces give way by so much less
/// than the object would move if it were free.
const HARD: f64 = 1e4;

/// The objects of one scene; of most scenes none.
#[derive(Clone, Debug, Default)]
pub(super) struct Objects {
    world: Option<Box<World>>,
    /// The world in which nothing has moved.
    start: Option<Box<World>>,
    /// Number of the object of each obstacle.
    numbers: Vec<Option<usize>>,
    meetings: Vec<Meeting>,
    /// Of those that the robot touches in this step, the motions at its end.
    motions: Vec<Option<Twist>>,
}

impl Objects {
    pub fn new(scene: &Scene, gravity: Vector3<f64>, timestep: f64) -> Result<Self, ObjectError> {
        let Some(world) = World::new(scene, gravity, timestep)?.map(Box::new) else {
            return Ok(Self::default());
        };
        let mut numbers = vec![None; scene.obstacles().len()];
        for (number, body) in world.bodies().iter().enumerate() {
            numbers[body.obstacle] = Some(number);
        }
        Ok(Self {
            motions: vec![None; world.bodies().len()],
            start: Some(world.clone()),
            world: Some(world),
            numbers,
            meetings: Vec::new(),
        })
    }

    pub fn are_none(&self) -> bool {
        self.world.is_none()
    }

    pub fn states(&self) -> &[ObjectState] {
        self.world.as_ref().map_or(&[], |world| world.states())
    }

    pub fn bodies(&self) -> &[Body] {
        self.world.as_ref().map_or(&[], |world| world.bodies())
    }

    /// The object that an obstacle is.
    pub fn of_obstacle(&self, obstacle: usize) -> Option<(usize, &Body)> {
        let number = (*self.numbers.get(obstacle)?)?;
        Some((number, &self.bodies()[number]))
    }

    /// Starts anew in states, or as the scene has it.
    pub fn restart(&mut self, states: Option<&[ObjectState]>) -> Result<(), ObjectError> {
        let Some(start) = &self.start else {
            return match states {
                Some(states) if !states.is_empty() => Err(ObjectError::Count {
                    found: states.len(),
                    expected: 0,
                }),
                _ => Ok(()),
            };
        };
        let mut world = start.clone();
        if let Some(states) = states {
            world.set(states)?;
        }
        self.world = Some(world);
        Ok(())
    }

    /// Writes the highest speed of a point of each obstacle in the step, as far as it is known (m/s): nothing where no obstacle moves.
    pub fn speeds(&self, movables: &Movables, out: &mut Vec<f64>) {
        out.clear();
        out.resize(self.numbers.len(), 0.0);
        for body in self.bodies() {
            let speed = |twist: &Twist| twist.linear.norm() + twist.angular.norm() * body.enclosing;
            out[body.obstacle] = speed(&body.free).max(speed(&body.twist));
        }
        for movable in &movables.all {
            let speed = &mut out[movable.body.obstacle];
            *speed = speed.max(movable.fastest());
        }
    }

    /// Adds to the contacts of the robot those that hold the objects that it touches: among objects, and with what is fixed.
    pub fn add_meetings(
        &mut self,
        timestep: f64,
        movables: &mut Movables,
        touches: &mut Vec<Touch>,
    ) {
        let Some(world) = &self.world else { return };
        if movables.all.is_empty() {
            return;
        }
        self.meetings.clear();
        world.meetings(&mut self.meetings);
        // Objects in a chain of contacts from those that the robot touches.
        let mut known = 0;
        while known < movables.all.len() {
            let number = movables.all[known].number;
            known += 1;
            for meeting in &self.meetings {
                match (meeting.object, meeting.other) {
                    (one, Some(other)) if one == number => {
                        movables.place(other, &world.bodies()[other]);
                    }
                    (one, Some(other)) if other == number => {
                        movables.place(one, &world.bodies()[one]);
                    }
                    _ => {}
                }
            }
        }
        for meeting in &self.meetings {
            if let Some(touch) = touch_of(meeting, timestep, movables) {
                touches.push(touch);
            }
        }
    }

    /// Takes the motions that the contacts of the problem give the objects.
    pub fn take(&mut self, movables: &Movables, touches: &[Touch]) {
        self.motions.fill(None);
        for (number, motion) in movables.motions(touches) {
            self.motions[number] = Some(motion);
        }
    }

    /// Moves the objects by a step.
    pub fn step(&mut self) -> Result<(), ObjectError> {
        match &mut self.world {
            Some(world) => world.step(&self.motions),
            None => Ok(()),
        }
    }
}

/// A contact of an object that the problem has, as the problem has it: it lets the surfaces come as near as they are apart, no more.
fn touch_of(meeting: &Meeting, timestep: f64, movables: &Movables) -> Option<Touch> {
    let place = movables.find(meeting.object)?;
    let movable = &movables.all[place];
    let arm = meeting.point - movable.body.centre;
    let mut free = movable.body.free.at(&arm);
    let mut mobility = movable.mobility(&arm, &meeting.normal);
    let mut against = None;
    if let Some(other) = meeting.other {
        let object = movables.find(other)?;
        let other = &movables.all[object];
        let arm = meeting.point - other.body.centre;
        free -= other.body.free.at(&arm);
        mobility += other.mobility(&arm, &meeting.normal);
        against = Some(Opposite { object, arm });
    }
    if mobility <= 0.0 {
        return None;
    }
    Some(Touch {
        name: Name::Objects(meeting.object, meeting.other),
        on: Side::Object(place),
        against,
        other: None,
        partner: Partner::Obstacle(movable.body.obstacle),
        gap: meeting.gap,
        gradient: meeting.normal,
        normal: meeting.normal,
        arm,
        push: Push {
            inertance: HARD / mobility,
            speed: -meeting.gap.max(0.0) / timestep,
        },
        friction: meeting.friction,
        bound: 0.0,
        free,
        velocity: free,
        impulse: Vector3::zeros(),
    })
}

impl ContactStepper {
    /// Where the scene's objects are and how they move, in the order of [`Scene::objects`].
    pub fn objects(&self) -> &[ObjectState] {
        self.objects.states()
    }

    /// Places the objects in states, one for each in the order of [`Scene::objects`], or where `None` as the scene had them at first.
    /// What comes then is a function of these states: impulses of earlier steps, from which searches begin, are forgotten.
    ///
    /// # Errors
    /// [`DynamicsError::Objects`] for states of other objects, or with numbers that none can have.
    pub fn place_objects(&mut self, states: Option<&[ObjectState]>) -> Result<(), DynamicsError> {
        self.objects.restart(states)?;
        self.problem.bounds.forget();
        self.follow_objects();
        Ok(())
    }

    /// Takes the objects' poses into the scene.
    pub(super) fn follow_objects(&mut self) {
        if self.objects.are_none() {
            return;
        }
        let obstacles = self.scene.obstacles_mut();
        for (body, state) in self.objects.bodies().iter().zip(self.objects.states()) {
            let obstacle = &mut obstacles[body.obstacle];
            if obstacle.pose != state.pose {
                obstacle.pose = state.pose;
                let n = self.free.len();
                self.neighbourhood.forget(body.obstacle, n);
            }
        }
    }
}
