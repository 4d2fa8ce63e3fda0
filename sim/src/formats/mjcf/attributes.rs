//! Attributes of elements, their defaults resolved.

use std::collections::HashMap;

use super::document::Document;
use crate::formats::ImportError;

/// The default classes of a model.
pub(super) struct Classes {
    classes: Vec<Class>,
    by_name: HashMap<String, usize>,
}

#[derive(Default)]
struct Class {
    parent: Option<usize>,
    /// Elements whose attributes are the class's defaults.
    elements: Vec<usize>,
}

/// The class that the others inherit from.
const MAIN: usize = 0;
/// Most elements and attributes in all defaults together: each element looks through them.
const MOST_DEFAULTS: usize = 4_000;
const ACTUATORS: [&str; 4] = ["general", "motor", "position", "velocity"];

impl Classes {
    pub fn of(document: &Document) -> Result<Self, ImportError> {
        let mut classes = Self {
            classes: vec![Class::default()],
            by_name: HashMap::from([("main".to_owned(), MAIN)]),
        };
        let mut open: Vec<(usize, usize)> = Vec::new();
        let mut count = 0;
        for (index, _) in document.sections("default") {
            if let Some(name) = attribute(document, index, "class") {
                classes.by_name.insert(name.to_owned(), MAIN);
            }
            open.push((index, MAIN));
        }
        while let Some((section, class)) = open.pop() {
            for (index, element) in document.children(section) {
                count += 1 + element.attributes.len();
                if count > MOST_DEFAULTS {
                    let reason = format!(
                        "the defaults have more than {MOST_DEFAULTS} attributes; expected less"
                    );
                    return Err(document.refuse(index, reason));
                }
                if element.tag != "default" {
                    classes.classes[class].elements.push(index);
                    continue;
                }
                let Some(name) = attribute(document, index, "class") else {
                    return Err(document.refuse(index, "expected an attribute `class`"));
                };
                classes.classes.push(Class {
                    parent: Some(class),
                    elements: Vec::new(),
                });
                let number = classes.classes.len() - 1;
                if classes.by_name.insert(name.to_owned(), number).is_some() {
                    let reason = format!("there are two classes `{name}`; expected one");
                    return Err(document.refuse(index, reason));
                }
                open.push((index, number));
            }
        }
        Ok(classes)
    }

    /// The attributes of `element`, within bodies whose `childclass` is given.
    pub fn resolve<'a>(
        &self,
        document: &'a Document,
        element: usize,
        childclass: Option<&str>,
    ) -> Result<Attributes<'a>, ImportError> {
        let own = &document.elements[element];
        let mut values: Vec<(&str, &str)> = (own.attributes.iter())
            .map(|(name, value)| (name.as_str(), value.as_str()))
            .collect();
        let class = attribute(document, element, "class").or(childclass);
        let mut class = match class {
            None => Some(MAIN),
            Some(name) => Some(*self.by_name.get(name).ok_or_else(|| {
                document.refuse(element, format!("there is no default class `{name}`"))
            })?),
        };
        while let Some(index) = class {
            for &default in self.classes[index].elements.iter().rev() {
                let default = &document.elements[default];
                if !is_default_of(&default.tag, &own.tag) {
                    continue;
                }
                for (name, value) in &default.attributes {
                    if !values.iter().any(|(known, _)| known == name) {
                        values.push((name, value));
                    }
                }
            }
            class = self.classes[index].parent;
        }
        Ok(Attributes {
            document,
            element,
            values,
        })
    }
}

/// Whether the defaults of elements `default` are also those of `tag`: MuJoCo has one set of
/// defaults for all actuators, and one for all tendons.
fn is_default_of(default: &str, tag: &str) -> bool {
    default == tag
        || (ACTUATORS.contains(&default) && ACTUATORS.contains(&tag))
        || (default == "tendon" && matches!(tag, "spatial" | "fixed"))
}

fn attribute<'a>(document: &'a Document, element: usize, name: &str) -> Option<&'a str> {
    let attributes = &document.elements[element].attributes;
    let found = attributes.iter().find(|(key, _)| key == name);
    found.map(|(_, value)| value.as_str())
}

/// Attributes of one element: its own, then those of its default class.
pub(super) struct Attributes<'a> {
    document: &'a Document,
    element: usize,
    values: Vec<(&'a str, &'a str)>,
}

impl<'a> Attributes<'a> {
    /// The element's own attributes alone.
    pub fn own(document: &'a Document, element: usize) -> Self {
        let attributes = document.elements[element].attributes.iter();
        Self {
            document,
            element,
            values: attributes
                .map(|(name, value)| (name.as_str(), value.as_str()))
                .collect(),
        }
    }

    pub fn text(&self, name: &str) -> Option<&'a str> {
        let found = self.values.iter().find(|(key, _)| *key == name);
        found.map(|(_, value)| *value)
    }

    /// The first of the given attributes that the element has.
    pub fn first_of(&self, names: &[&str]) -> Option<&'a str> {
        let found = self.values.iter().find(|(name, _)| names.contains(name));
        found.map(|(name, _)| *name)
    }

    /// Finite numbers separated by spaces.
    pub fn list(&self, name: &str) -> Result<Option<Vec<f64>>, ImportError> {
        let Some(text) = self.text(name) else {
            return Ok(None);
        };
        let numbers = text
            .split_ascii_whitespace()
            .map(|word| match word.parse() {
                Ok(number) if f64::is_finite(number) => Ok(number),
                _ => Err(self.refuse(name, "expected finite numbers")),
            });
        numbers.collect::<Result<Vec<f64>, _>>().map(Some)
    }

    /// Exactly `N` finite numbers.
    pub fn numbers<const N: usize>(&self, name: &str) -> Result<Option<[f64; N]>, ImportError> {
        let Some(list) = self.list(name)? else {
            return Ok(None);
        };
        match list.try_into() {
            Ok(numbers) => Ok(Some(numbers)),
            Err(_) => Err(self.refuse(name, format!("expected {N} finite numbers"))),
        }
    }

    /// One finite number.
    pub fn number(&self, name: &str) -> Result<Option<f64>, ImportError> {
        Ok(self.numbers::<1>(name)?.map(|[number]| number))
    }

    /// One finite number, 0 or above.
    pub fn not_negative(&self, name: &str) -> Result<Option<f64>, ImportError> {
        match self.number(name)? {
            Some(number) if number < 0.0 => Err(self.refuse(name, "expected 0 or above")),
            number => Ok(number),
        }
    }

    /// Whether a limit is in force: said so, or implied by its range.
    pub fn limited(&self, flag: &str, range: &str, implied: bool) -> Result<bool, ImportError> {
        match self.text(flag) {
            Some("true") => Ok(true),
            Some("false") => Ok(false),
            None | Some("auto") => Ok(implied && self.text(range).is_some()),
            Some(_) => Err(self.refuse(flag, "expected true, false or auto")),
        }
    }

    /// Refuses attributes other than `known`, and such of `neutral` as are not all zero.
    pub fn only(&self, known: &[&str], neutral: &[&str]) -> Result<(), ImportError> {
        for (name, _) in &self.values {
            if neutral.contains(name) {
                let zero = self
                    .list(name)?
                    .unwrap_or_default()
                    .iter()
                    .all(|x| *x == 0.0);
                if !zero {
                    return Err(self.refuse(name, "robots here have none: expected 0"));
                }
            } else if !known.contains(name) && !matches!(*name, "name" | "class" | "user") {
                return Err(self.refuse(name, "an attribute that is not known here"));
            }
        }
        Ok(())
    }

    /// The error that an attribute's value cannot be represented.
    pub fn refuse(&self, name: &str, reason: impl AsRef<str>) -> ImportError {
        let value = self.text(name).map(|value| format!("=\"{value}\""));
        let (value, reason) = (value.unwrap_or_default(), reason.as_ref());
        self.document
            .refuse(self.element, format!("attribute {name}{value}: {reason}"))
    }

    /// The error that the element as a whole cannot be represented.
    pub fn refuse_element(&self, reason: impl Into<String>) -> ImportError {
        self.document.refuse(self.element, reason)
    }
}
