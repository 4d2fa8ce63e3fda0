//! Scenes in files: reading, writing, and which obstacle an error is about.

use std::path::Path;

use tdcr_base::files::{Table, read_text, with_place};
use toml::Spanned;
use toml::de::{DeTable, DeValue};

use super::error::called;
use super::shape_spec::{
    BoxInFile, HalfSpaceInFile, MeshTable, PipeInFile, RoundInFile, SphereInFile,
};
use super::spec::{ObstacleInFile, SceneInFile};
use super::{Scene, SceneError, SceneSpec};

/// Largest file of a scene (bytes).
const LARGEST_SCENE: u64 = 16 << 20;

impl SceneSpec {
    /// Reads a scene's file (TOML, at most 16 MiB). Values are checked when it is compiled.
    ///
    /// # Errors
    /// [`SceneError::File`] when the file cannot be read, or as [`from_toml`](Self::from_toml).
    pub fn load(path: &Path) -> Result<Self, SceneError> {
        let read = read_text(path, LARGEST_SCENE).map_err(SceneError::Read);
        in_file(path, read.and_then(|text| Self::from_toml(&text)))
    }

    /// Reads the text of a scene's file.
    ///
    /// # Errors
    /// [`SceneError::Parse`] for a text that is not TOML, or has fields that a scene has not; [`SceneError::Shapes`] for an
    /// obstacle with no shape, or several; [`SceneError::Field`] for a pipe without length and path.
    pub fn from_toml(text: &str) -> Result<Self, SceneError> {
        let file: SceneInFile = toml::from_str(text).map_err(|error| SceneError::Parse {
            obstacle: error.span().and_then(|span| obstacle_at(text, span.start)),
            reason: with_place(&error.to_string(), &tables())
                .trim_end()
                .to_owned(),
        })?;
        file.try_into()
    }

    /// The text of its file.
    ///
    /// # Errors
    /// [`SceneError::Write`] for a mesh file whose name is not UTF-8.
    pub fn to_toml(&self) -> Result<String, SceneError> {
        toml::to_string(self).map_err(SceneError::Write)
    }
}

impl Scene {
    /// Reads and compiles a scene's file (TOML, at most 16 MiB); meshes with relative paths are beside it.
    ///
    /// # Errors
    /// [`SceneError::File`], whose source is that of [`SceneSpec::from_toml`] or [`Scene::compile`].
    pub fn load(path: &Path) -> Result<Self, SceneError> {
        let spec = SceneSpec::load(path)?;
        let folder = path.parent().unwrap_or(Path::new(""));
        in_file(path, Self::compile(spec, folder))
    }

    /// Compiles the text of a scene's file; meshes with relative paths are in `folder`.
    ///
    /// # Errors
    /// Those of [`SceneSpec::from_toml`] and [`Scene::compile`].
    pub fn from_toml(text: &str, folder: &Path) -> Result<Self, SceneError> {
        Self::compile(SceneSpec::from_toml(text)?, folder)
    }

    /// The text of its file, with all but the defaults of shape, position, orientation, friction and mass.
    ///
    /// # Errors
    /// As [`spec`](Self::spec) and [`SceneSpec::to_toml`].
    pub fn to_toml(&self) -> Result<String, SceneError> {
        self.spec()?.to_toml()
    }
}

fn in_file<T>(path: &Path, result: Result<T, SceneError>) -> Result<T, SceneError> {
    result.map_err(|source| SceneError::File {
        path: path.to_owned(),
        source: Box::new(source),
    })
}

/// The tables of a scene's file.
fn tables() -> [Table; 8] {
    [
        Table::of::<SceneInFile>("the file itself, above all tables"),
        Table::of::<ObstacleInFile>("[[obstacle]]"),
        Table::of::<HalfSpaceInFile>("`half_space`"),
        Table::of::<BoxInFile>("`box`"),
        Table::of::<SphereInFile>("`sphere`"),
        Table::of::<RoundInFile>("`capsule` and `cylinder`"),
        Table::of::<PipeInFile>("`pipe`"),
        Table::of::<MeshTable>("`mesh`"),
    ]
}

/// What an error at a byte of a text calls the obstacle there; `None` where there is none, or the text is not TOML.
fn obstacle_at(text: &str, byte: usize) -> Option<String> {
    let file = DeTable::parse(text).ok()?;
    let others = file.get_ref().keys().map(Spanned::span);
    let other = others
        .map(|span| span.start)
        .filter(|start| *start <= byte)
        .max();
    let DeValue::Array(obstacles) = file.get_ref().get("obstacle")?.get_ref() else {
        return None;
    };
    let before = |obstacle: &Spanned<DeValue>| obstacle.span().start <= byte;
    let index = obstacles.iter().rposition(before)?;
    // What begins after the obstacle is another table of the file.
    let begin = obstacles[index].span().start;
    let is_other = other.is_some_and(|other| other > begin + "[[".len());
    let name = match obstacles[index].get_ref() {
        DeValue::Table(table) => table.get("name").and_then(|name| name.get_ref().as_str()),
        _ => None,
    };
    (!is_other).then(|| called(Some(index), name))
}
