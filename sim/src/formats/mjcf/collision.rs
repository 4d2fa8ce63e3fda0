//! Which geoms of a MuJoCo model touch each other, and with which friction.
//!
//! Two geoms touch where the bits of `contype` and `conaffinity` say so, unless their bodies are excluded, or where a pair names
//! them (MuJoCo's documentation, Computation, Collision detection).

use std::collections::{BTreeMap, HashSet};

use super::attributes::{Attributes, Classes};
use super::document::Document;
use crate::formats::ImportError;

/// Sliding friction of geoms that have none.
const FRICTION: f64 = 1.0;

/// What a geom touches with.
pub(super) struct Toucher<'a> {
    pub element: usize,
    pub name: Option<&'a str>,
    pub body: usize,
    pub contype: u32,
    pub conaffinity: u32,
    pub condim: f64,
    pub friction: f64,
    pub attributes: Attributes<'a>,
}

impl<'a> Toucher<'a> {
    /// The geom of an element on the body numbered `body`.
    pub fn read(
        attributes: Attributes<'a>,
        element: usize,
        body: usize,
    ) -> Result<Self, ImportError> {
        let bits = |name: &str| -> Result<u32, ImportError> {
            let found = attributes.number(name)?.unwrap_or(1.0);
            match found.fract() == 0.0 && (0.0..=f64::from(u32::MAX)).contains(&found) {
                true => Ok(found as u32),
                false => Err(attributes.refuse(name, "expected a whole number, 0 or above")),
            }
        };
        Ok(Self {
            element,
            name: attributes.text("name"),
            body,
            contype: bits("contype")?,
            conaffinity: bits("conaffinity")?,
            condim: attributes.number("condim")?.unwrap_or(3.0),
            friction: sliding(&attributes)?.unwrap_or(FRICTION),
            attributes,
        })
    }

    /// Whether the bits of the two let them touch.
    pub fn fits(&self, other: &Self) -> bool {
        self.contype & other.conaffinity != 0 || other.contype & self.conaffinity != 0
    }

    /// Coefficient of friction of the two.
    pub fn friction_with(&self, other: &Self) -> f64 {
        match self.condim.max(other.condim) >= 3.0 {
            true => self.friction.max(other.friction),
            false => 0.0,
        }
    }
}

/// The first number of `friction`, which is that of sliding.
fn sliding(attributes: &Attributes<'_>) -> Result<Option<f64>, ImportError> {
    let Some(numbers) = attributes.list("friction")? else {
        return Ok(None);
    };
    match numbers.first() {
        Some(number) if *number >= 0.0 => Ok(Some(*number)),
        _ => Err(attributes.refuse("friction", "expected numbers of 0 or above")),
    }
}

/// What the section `contact` says.
#[derive(Default)]
pub(super) struct Rules<'a> {
    /// Bodies that do not touch, by their names.
    pub excluded: HashSet<[&'a str; 2]>,
    /// Geoms that touch whatever their bits, by their names, and their friction, if it is given.
    pub pairs: BTreeMap<[&'a str; 2], Option<f64>>,
}

impl<'a> Rules<'a> {
    pub fn of(document: &'a Document, classes: &Classes) -> Result<Self, ImportError> {
        let mut rules = Self::default();
        for (index, element) in document.section("contact") {
            let attributes = classes.resolve(document, index, None)?;
            let two = |names: [&str; 2]| {
                let [first, second] = names.map(|name| attributes.text(name));
                let reason = format!("expected attributes `{}` and `{}`", names[0], names[1]);
                let missing = || attributes.refuse_element(reason.clone());
                Ok::<_, ImportError>(ordered([
                    first.ok_or_else(missing)?,
                    second.ok_or_else(missing)?,
                ]))
            };
            match element.tag.as_str() {
                "exclude" => {
                    rules.excluded.insert(two(["body1", "body2"])?);
                }
                "pair" => {
                    let condim = attributes.number("condim")?;
                    let friction = match condim {
                        Some(condim) if condim < 3.0 => Some(0.0),
                        _ => sliding(&attributes)?,
                    };
                    rules.pairs.insert(two(["geom1", "geom2"])?, friction);
                }
                _ => {}
            }
        }
        Ok(rules)
    }
}

/// Two names, the same in either order.
pub(super) fn ordered([a, b]: [&str; 2]) -> [&str; 2] {
    if a <= b { [a, b] } else { [b, a] }
}
