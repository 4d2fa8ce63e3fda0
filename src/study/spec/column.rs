//! Columns of tables.

use serde::{Deserialize, Serialize};

/// A column of a table.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Column {
    /// Its name.
    pub name: String,
    /// Unit of its numbers; empty where there is none.
    pub unit: String,
    /// What its cells are.
    pub kind: Kind,
}

/// What the cells of a column are. Any cell may be empty.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Kind {
    /// Numbers.
    Number,
    /// Whole numbers.
    Whole,
    /// Text.
    Text,
}

impl Column {
    pub(in crate::study) fn new(name: &str, unit: &str, kind: Kind) -> Self {
        Self {
            name: name.to_owned(),
            unit: unit.to_owned(),
            kind,
        }
    }

    /// Its name with its unit, as the first line of a table has it.
    pub fn title(&self) -> String {
        match self.unit.as_str() {
            "" => self.name.clone(),
            unit => format!("{} ({unit})", self.name),
        }
    }
}
