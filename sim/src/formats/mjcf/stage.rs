//! The model as it stands at the start, where MuJoCo's cameras that follow something look from and at.

use std::collections::HashMap;

use nalgebra::{Isometry3, Point3, Vector3};

use super::attributes::Attributes;
use super::body::BodyReader;
use crate::formats::ImportError;

/// The bodies of a model, the world first, each before those that stand in it.
pub(super) struct Stage<'a> {
    bodies: Vec<Placed<'a>>,
    by_name: HashMap<&'a str, usize>,
}

/// A body where the model has it at the start.
pub(super) struct Placed<'a> {
    pub element: usize,
    /// In the world.
    pub pose: Isometry3<f64>,
    /// Whether no joint moves it.
    pub is_still: bool,
    /// Default class of the elements within.
    pub childclass: Option<&'a str>,
    parent: usize,
}

impl<'a> Stage<'a> {
    pub fn of(reader: &BodyReader<'a>, worldbody: usize) -> Result<Self, ImportError> {
        let mut stage = Self {
            bodies: Vec::new(),
            by_name: HashMap::from([("world", 0)]),
        };
        let mut open = vec![Placed {
            element: worldbody,
            pose: Isometry3::identity(),
            is_still: true,
            childclass: None,
            parent: 0,
        }];
        while let Some(mut body) = open.pop() {
            let own = Attributes::own(reader.document, body.element);
            body.childclass = own.text("childclass").or(body.childclass);
            let number = stage.bodies.len();
            if let Some(name) = own.text("name").filter(|_| number > 0) {
                stage.by_name.insert(name, number);
            }
            let mut within = Vec::new();
            for (element, child) in reader.document.children(body.element) {
                if child.tag == "body" {
                    within.push(Placed {
                        element,
                        pose: body.pose * reader.pose(element)?,
                        is_still: body.is_still && !reader.has_joint(element),
                        childclass: body.childclass,
                        parent: number,
                    });
                }
            }
            stage.bodies.push(body);
            // The last is taken up first: reversed, they are read in order.
            open.extend(within.into_iter().rev());
        }
        Ok(stage)
    }

    pub fn bodies(&self) -> impl Iterator<Item = (usize, &Placed<'a>)> {
        self.bodies.iter().enumerate()
    }

    /// The number of the body that a camera follows or looks at.
    pub fn target(&self, camera: &Attributes<'_>) -> Result<usize, ImportError> {
        let name = camera.text("target");
        let number = name.and_then(|name| self.by_name.get(name)).copied();
        number.ok_or_else(|| camera.refuse("target", "expected the name of a body of the model"))
    }

    pub fn pose(&self, body: usize) -> Isometry3<f64> {
        self.bodies[body].pose
    }

    pub fn origin(&self, body: usize) -> Vector3<f64> {
        self.bodies[body].pose.translation.vector
    }

    /// Whether no joint moves a body.
    pub fn is_still(&self, body: usize) -> bool {
        self.bodies[body].is_still
    }

    /// The centre of mass of a body and of all that stand in it, in the world (m); its origin where they have no mass.
    pub fn centre_of_mass(
        &self,
        reader: &BodyReader<'a>,
        body: usize,
    ) -> Result<Vector3<f64>, ImportError> {
        let (mut mass, mut moment) = (0.0, Vector3::zeros());
        // Those within follow their body.
        let mut within = vec![false; self.bodies.len()];
        for (number, placed) in self.bodies().skip(body) {
            within[number] = number == body || within[placed.parent];
            if !within[number] {
                continue;
            }
            for part in reader.masses_of(placed.element, placed.childclass)? {
                mass += part.mass;
                moment += (placed.pose * Point3::from(part.center)).coords * part.mass;
            }
        }
        Ok(match mass > 0.0 {
            true => moment / mass,
            false => self.origin(body),
        })
    }
}
