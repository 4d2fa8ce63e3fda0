//! What stands for the world of objects in a build without rapier: there is none, and scenes with objects are refused.

use std::convert::Infallible;

use nalgebra::Vector3;

use super::{Body, Meeting, ObjectError, ObjectState, Twist};
use crate::scene::Scene;

/// No world of objects.
#[derive(Clone, Debug)]
pub(crate) struct World(Infallible);

impl World {
    /// None for a scene without objects.
    pub fn new(scene: &Scene, _: Vector3<f64>, _: f64) -> Result<Option<Self>, ObjectError> {
        let mut obstacles = scene.obstacles().iter();
        match obstacles.find(|obstacle| obstacle.mass.is_some()) {
            None => Ok(None),
            Some(object) => Err(ObjectError::NoRapier {
                object: object.name.clone(),
            }),
        }
    }

    pub fn bodies(&self) -> &[Body] {
        match self.0 {}
    }

    pub fn meetings(&self, _: &mut Vec<Meeting>) {
        match self.0 {}
    }

    pub fn states(&self) -> &[ObjectState] {
        match self.0 {}
    }

    pub fn set(&mut self, _: &[ObjectState]) -> Result<(), ObjectError> {
        match self.0 {}
    }

    pub fn step(&mut self, _: &[Option<Twist>]) -> Result<(), ObjectError> {
        match self.0 {}
    }
}
