//! Which fields a robot file lacks: all of them at once, each by its table.
//!
//! Reading a file stops at the first thing that is wrong. Where that is a missing field, the tables
//! of the file are looked through again for whatever else is missing.

use std::fmt;

use toml::Spanned;
use toml::de::{DeTable, DeValue};

/// Fields that a table of a robot file lacks.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct MissingFields {
    /// The table's path, e.g. `modules[1].tendons`; empty for the file itself.
    pub table: String,
    /// The line where it begins, from 1; `None` in JSON files.
    pub line: Option<usize>,
    /// The fields; where one of several would do, all of them, e.g. `pitch` or `length`.
    pub fields: Vec<String>,
}

impl fmt::Display for MissingFields {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        match self.table.as_str() {
            "" => write!(f, "the file")?,
            table => write!(f, "`{table}`")?,
        }
        if let Some(line) = self.line {
            write!(f, " (line {line})")?;
        }
        write!(f, " lacks {}", self.fields.join(", "))
    }
}

/// A value of a file, as far as it matters here.
enum Node {
    Table {
        line: Option<usize>,
        fields: Vec<(String, Node)>,
    },
    List(Vec<Node>),
    Other,
}

/// What a kind of table must have: of each list one field. And the tables within it, or lists of
/// such tables, by their names.
struct Kind {
    required: &'static [&'static [&'static str]],
    within: &'static [(&'static str, &'static Kind)],
}

const fn kind(
    required: &'static [&'static [&'static str]],
    within: &'static [(&'static str, &'static Kind)],
) -> Kind {
    Kind { required, within }
}

static ROBOT: Kind = kind(
    &[
        &["name"],
        &["gravity"],
        &["routing"],
        &["base"],
        &["modules"],
    ],
    &[
        ("fluid", &FLUID),
        ("base", &BASE),
        ("modules", &MODULE),
        ("routes", &ROUTE),
        ("cameras", &CAMERAS),
    ],
);
static FLUID: Kind = kind(&[&["density"], &["drag_coefficient"]], &[]);
static BASE: Kind = kind(
    &[&["position"], &["holes"], &["hole_height"]],
    &[("holes", &CIRCLE)],
);
static CIRCLE: Kind = kind(&[&["radius"], &["angles", "degrees"]], &[]);
static MODULE: Kind = kind(
    &[
        &["discs"],
        &["pitch", "length"],
        &["radius"],
        &["half_height"],
        &["mass"],
        &["holes"],
        &["damping"],
        &["armature"],
    ],
    &[
        ("mass", &MASS),
        ("holes", &CIRCLE),
        ("joint", &JOINT),
        ("backbone", &BACKBONE),
        ("rod", &ROD),
        ("limit", &LIMIT),
        ("tendons", &TENDON),
    ],
);
static MASS: Kind = kind(&[], &[("rigid", &RIGID), ("solid", &SOLID)]);
static RIGID: Kind = kind(&[&["mass"], &["inertia"]], &[]);
static SOLID: Kind = kind(&[&["density"]], &[]);
static JOINT: Kind = kind(&[&["hinges"]], &[("hinges", &HINGE)]);
static HINGE: Kind = kind(&[&["axis"]], &[]);
static BACKBONE: Kind = kind(&[&["bending"], &["torsion"]], &[]);
static ROD: Kind = kind(
    &[&["youngs"], &["poisson"], &["radius"], &["density"]],
    &[("damping", &ROD_DAMPING)],
);
static ROD_DAMPING: Kind = kind(&[&["bending"], &["torsion"]], &[]);
static LIMIT: Kind = kind(&[&["angle", "degrees"], &["stiffness"]], &[]);
static TENDON: Kind = kind(&[&["drive"], &["range"]], &[("friction", &FRICTION)]);
static FRICTION: Kind = kind(&[&["coefficient"]], &[]);
static ROUTE: Kind = kind(&[&["through"], &["tendon"]], &[("tendon", &TENDON)]);
/// A ring; cameras in a list are [`CAMERA`]s.
static CAMERAS: Kind = kind(
    &[
        &["count"],
        &["radius"],
        &["height"],
        &["pitch", "pitch_degrees"],
        &["fovy"],
        &["resolution"],
    ],
    &[],
);
static CAMERA: Kind = kind(
    &[&["position"], &["aim"], &["lens"], &["resolution"]],
    &[("lens", &LENS)],
);
static LENS: Kind = kind(&[], &[("pixels", &PIXELS)]);
static PIXELS: Kind = kind(&[&["focal"], &["principal"]], &[]);

/// What a TOML text lacks to be a robot file; nothing for a text that is not TOML.
pub(super) fn in_toml(text: &str) -> Vec<MissingFields> {
    match DeTable::parse(text) {
        Ok(table) => missing(&of_toml(text, &table)),
        Err(_) => Vec::new(),
    }
}

/// The same of a JSON text.
pub(super) fn in_json(text: &str) -> Vec<MissingFields> {
    match serde_json::from_str(text) {
        Ok(value) => missing(&of_json(value)),
        Err(_) => Vec::new(),
    }
}

fn missing(root: &Node) -> Vec<MissingFields> {
    let mut found = Vec::new();
    look_through(root, &ROBOT, "", &mut found);
    found
}

fn look_through(node: &Node, kind: &Kind, path: &str, found: &mut Vec<MissingFields>) {
    let (line, fields) = match node {
        Node::Table { line, fields } => (*line, fields),
        Node::List(nodes) => {
            let kind = if std::ptr::eq(kind, &CAMERAS) {
                &CAMERA
            } else {
                kind
            };
            for (index, node) in nodes.iter().enumerate() {
                look_through(node, kind, &format!("{path}[{index}]"), found);
            }
            return;
        }
        Node::Other => return,
    };
    let get = |name: &str| fields.iter().find(|(field, _)| field == name);
    let lacks = |names: &&&[&str]| names.iter().all(|name| get(name).is_none());
    let quoted = |names: &&[&str]| {
        let names: Vec<String> = names.iter().map(|name| format!("`{name}`")).collect();
        names.join(" or ")
    };
    let lacking: Vec<String> = (kind.required.iter().filter(lacks)).map(quoted).collect();
    if !lacking.is_empty() {
        found.push(MissingFields {
            table: path.to_owned(),
            line,
            fields: lacking,
        });
    }
    for (name, kind) in kind.within {
        if let Some((_, node)) = get(name) {
            let path = match path {
                "" => (*name).to_owned(),
                path => format!("{path}.{name}"),
            };
            look_through(node, kind, &path, found);
        }
    }
}

fn of_toml(text: &str, table: &Spanned<DeTable<'_>>) -> Node {
    toml_table(text, table.span().start, table.get_ref())
}

fn toml_table(text: &str, start: usize, table: &DeTable<'_>) -> Node {
    let value = |value: &Spanned<DeValue<'_>>| toml_value(text, value);
    let fields = table.iter();
    Node::Table {
        line: Some(1 + text[..start].matches('\n').count()),
        fields: fields
            .map(|(key, item)| (key.get_ref().to_string(), value(item)))
            .collect(),
    }
}

fn toml_value(text: &str, value: &Spanned<DeValue<'_>>) -> Node {
    match value.get_ref() {
        DeValue::Table(table) => toml_table(text, value.span().start, table),
        DeValue::Array(list) => {
            Node::List(list.iter().map(|item| toml_value(text, item)).collect())
        }
        _ => Node::Other,
    }
}

fn of_json(value: serde_json::Value) -> Node {
    match value {
        serde_json::Value::Object(fields) => Node::Table {
            line: None,
            fields: (fields.into_iter())
                .map(|(key, item)| (key, of_json(item)))
                .collect(),
        },
        serde_json::Value::Array(list) => Node::List(list.into_iter().map(of_json).collect()),
        _ => Node::Other,
    }
}
