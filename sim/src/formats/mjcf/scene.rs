//! From a MuJoCo model to the obstacles of a scene: what stands still in it and touches what moves.

use std::collections::{BTreeMap, HashSet};
use std::path::{Path, PathBuf};

use nalgebra::{Isometry3, Vector3};

use super::attributes::{Attributes, Classes};
use super::body::BodyReader;
use super::collision::{Rules, Toucher, ordered};
use super::document::Document;
use super::frame::Compiler;
use super::import::{World, used_sites};
use super::mass::{Shape, read_shape};
use super::stage::Stage;
use crate::formats::{ImportError, Note};
use crate::geometry::{Kind, Triangles};
use crate::scene::{ContactLaw, ObstacleSpec, Scene, SceneSpec, SelfContact, ShapeSpec};

/// Colour of geoms that have none.
const RGBA: [f64; 4] = [0.5, 0.5, 0.5, 1.0];
/// Endings of files of meshes that are read.
const STL: &str = "stl";

/// Obstacles read from a MuJoCo model.
#[derive(Clone, Debug)]
pub struct ImportedScene {
    /// The obstacles.
    pub scene: Scene,
    /// What a scene has no place for, and what was done instead.
    pub notes: Vec<Note>,
}

/// The obstacles in a MuJoCo model in a file (MJCF), and in those it includes: planes, boxes, spheres, capsules, cylinders, and
/// convex hulls of meshes on bodies that no joint moves, where MuJoCo lets them touch what moves. Friction is what MuJoCo takes of
/// the two that touch. Whether the robot touches itself is as between its geoms.
///
/// # Errors
/// [`ImportError`] when a file cannot be read or is not MJCF, and for numbers that no obstacle can have. What has no counterpart
/// becomes a [`Note`]: other shapes, how surfaces give way, margins.
pub fn import_scene(path: &Path) -> Result<ImportedScene, ImportError> {
    read_scene(&Document::read(path)?, path.parent())
}

/// The obstacles in a text (MJCF) that includes no files; otherwise as [`import_scene`].
///
/// # Errors
/// As [`import_scene`].
pub fn import_scene_text(text: &str) -> Result<ImportedScene, ImportError> {
    read_scene(&Document::parse(text)?, None)
}

fn read_scene(document: &Document, folder: Option<&Path>) -> Result<ImportedScene, ImportError> {
    let Some((worldbody, _)) = document.sections("worldbody").next() else {
        return Err(document.refuse(0, "expected a section <worldbody>"));
    };
    let contacts = World::of(document)?.contacts;
    let reader = BodyReader {
        document,
        classes: Classes::of(document)?,
        compiler: Compiler::of(document)?,
        contacts,
        touching: Vec::new(),
        used_sites: used_sites(document),
        notes: Vec::new(),
    };
    let stage = Stage::of(&reader, worldbody)?;
    let mut model = Model {
        rules: Rules::of(document, &reader.classes)?,
        meshes: meshes(document, &reader.classes)?,
        folder: mesh_folder(document, folder),
        still: Vec::new(),
        moving: Vec::new(),
        bodies: Vec::new(),
        reader,
        stage,
    };
    model.sort_geoms()?;
    if !contacts {
        model
            .reader
            .note(0, "no obstacles: the option switches contacts off");
        return Ok(model.finish(SceneSpec {
            obstacles: Vec::new(),
            self_contact: SelfContact::Ignored,
            contact_law: ContactLaw::default(),
            smoothing: 0.0,
        }));
    }
    let spec = model.spec()?;
    Ok(model.finish(spec))
}

/// A model and what of it touches.
struct Model<'a> {
    reader: BodyReader<'a>,
    stage: Stage<'a>,
    rules: Rules<'a>,
    /// Attributes of meshes by their names.
    meshes: BTreeMap<String, (usize, Attributes<'a>)>,
    /// Where their files lie; `None` for a text.
    folder: Option<PathBuf>,
    still: Vec<Toucher<'a>>,
    moving: Vec<Toucher<'a>>,
    /// Names of the bodies by their numbers.
    bodies: Vec<Option<&'a str>>,
}

impl<'a> Model<'a> {
    /// Sorts geoms by whether a joint moves them.
    fn sort_geoms(&mut self) -> Result<(), ImportError> {
        let document = self.reader.document;
        for (number, placed) in self.stage.bodies() {
            let name = match number {
                0 => Some("world"),
                _ => Attributes::own(document, placed.element).text("name"),
            };
            self.bodies.push(name);
            for (index, element) in document.children(placed.element) {
                if element.tag != "geom" {
                    continue;
                }
                let attributes = self
                    .reader
                    .classes
                    .resolve(document, index, placed.childclass)?;
                let geom = Toucher::read(attributes, index, number)?;
                match placed.is_still {
                    true => self.still.push(geom),
                    false => self.moving.push(geom),
                }
            }
        }
        // Of geoms that touch alike one counts: a model may have very many.
        let paired: HashSet<&str> = self.rules.pairs.keys().flatten().copied().collect();
        let mut seen = HashSet::new();
        self.moving.retain(|geom| {
            let numbers = (geom.condim.to_bits(), geom.friction.to_bits());
            let name = geom.name.filter(|name| paired.contains(name));
            seen.insert((geom.body, geom.contype, geom.conaffinity, numbers, name))
        });
        Ok(())
    }

    /// Whether MuJoCo lets two geoms of different bodies touch.
    fn touch(&self, one: &Toucher<'_>, other: &Toucher<'_>) -> bool {
        if self.pair(one, other).is_some() {
            return true;
        }
        let excluded = || match (self.bodies[one.body], self.bodies[other.body]) {
            (Some(a), Some(b)) => self.rules.excluded.contains(&ordered([a, b])),
            _ => false,
        };
        one.fits(other) && !excluded()
    }

    /// The friction that a pair of the two has, if there is one.
    fn pair(&self, one: &Toucher<'_>, other: &Toucher<'_>) -> Option<Option<f64>> {
        let names = ordered([one.name?, other.name?]);
        self.rules.pairs.get(&names).copied()
    }

    fn spec(&mut self) -> Result<SceneSpec, ImportError> {
        let mut obstacles: Vec<ObstacleSpec> = Vec::new();
        let still = std::mem::take(&mut self.still);
        for geom in &still {
            let touched: Vec<&Toucher<'_>> = self
                .moving
                .iter()
                .filter(|own| self.touch(geom, own))
                .collect();
            if touched.is_empty() {
                if geom.contype != 0 || geom.conaffinity != 0 {
                    self.reader
                        .note(geom.element, "left out: nothing that moves touches it");
                }
                continue;
            }
            let of = |geoms: &mut dyn Iterator<Item = &Toucher<'_>>| -> usize {
                geoms.map(|geom| geom.body).collect::<HashSet<_>>().len()
            };
            let (some, all) = (
                of(&mut touched.iter().copied()),
                of(&mut self.moving.iter()),
            );
            let friction = (touched.iter())
                .map(|own| match self.pair(geom, own) {
                    Some(Some(friction)) => friction,
                    _ => geom.friction_with(own),
                })
                .fold(0.0, f64::max);
            let Some((shape, pose)) = self.shape(geom)? else {
                continue;
            };
            if some < all {
                let text =
                    format!("touches {some} of {all} bodies in MuJoCo; here all discs touch it");
                self.reader.note(geom.element, text);
            }
            let margin = geom.attributes.number("margin")?.unwrap_or(0.0);
            if margin != 0.0 {
                self.reader.note(
                    geom.element,
                    format!("its margin of {margin} m is left out"),
                );
            }
            if obstacles.is_empty() {
                let text = "surfaces give way by a compliance of 1e-6 m/N here, in place of solref and solimp";
                self.reader.note(geom.element, text);
            }
            let name = name_of(geom, &obstacles);
            let rgba = geom.attributes.numbers::<4>("rgba")?.unwrap_or(RGBA);
            let turn = pose.rotation;
            obstacles.push(ObstacleSpec {
                position: pose.translation.vector.into(),
                orientation: [turn.w, turn.i, turn.j, turn.k],
                friction,
                // `as` saturates.
                color: [rgba[0], rgba[1], rgba[2]].map(|share| (255.0 * share).round() as u8),
                ..ObstacleSpec::new(&name, shape)
            });
        }
        Ok(SceneSpec {
            obstacles,
            self_contact: match self.touches_itself() {
                true => SelfContact::default(),
                false => SelfContact::Ignored,
            },
            contact_law: ContactLaw::default(),
            smoothing: 0.0,
        })
    }

    /// Whether geoms of bodies that do not carry each other touch.
    fn touches_itself(&self) -> bool {
        let apart = |one: &Toucher<'_>, other: &Toucher<'_>| {
            one.body.abs_diff(other.body) > 1 && self.touch(one, other)
        };
        (self.moving.iter()).any(|one| self.moving.iter().any(|other| apart(one, other)))
    }

    /// The shape of an obstacle and its pose in the world; nothing, with a note, for one that scenes do not have.
    fn shape(
        &mut self,
        geom: &Toucher<'a>,
    ) -> Result<Option<(ShapeSpec, Isometry3<f64>)>, ImportError> {
        let attributes = &geom.attributes;
        let body = self.stage.pose(geom.body);
        let kind = attributes.text("type").unwrap_or("sphere");
        let left = |reason: &str| format!("left out: {reason}");
        let found = match kind {
            "plane" => {
                let pose = self.reader.compiler.pose(attributes)?;
                Ok((ShapeSpec::HalfSpace, pose))
            }
            "mesh" => {
                let pose = self.reader.compiler.pose(attributes)?;
                self.mesh(geom)?.map(|shape| (shape, pose))
            }
            _ if attributes.text("mesh").is_some() => {
                Err("shapes that are fitted to meshes are not read".to_owned())
            }
            "sphere" | "capsule" | "cylinder" | "box" => {
                let (shape, pose) = read_shape(attributes, &self.reader.compiler)?;
                let shape = match shape {
                    Shape::Sphere { radius } => ShapeSpec::Sphere { radius },
                    Shape::Capsule { radius, half } => {
                        let length = 2.0 * half;
                        ShapeSpec::Capsule { radius, length }
                    }
                    Shape::Cylinder { radius, half } => {
                        let length = 2.0 * half;
                        ShapeSpec::Cylinder { radius, length }
                    }
                    Shape::Box(half) | Shape::Ellipsoid(half) => ShapeSpec::Box {
                        size: half.map(|side| 2.0 * side),
                    },
                };
                Ok((shape, pose))
            }
            other => Err(format!("scenes have no obstacles of type {other}")),
        };
        match found {
            Ok((shape, pose)) => Ok(Some((shape, body * pose))),
            Err(reason) => {
                self.reader.note(geom.element, left(&reason));
                Ok(None)
            }
        }
    }

    /// The convex hull of a geom's mesh, which is what MuJoCo touches, or why there is none.
    fn mesh(&mut self, geom: &Toucher<'a>) -> Result<Result<ShapeSpec, String>, ImportError> {
        let name = geom.attributes.text("mesh").unwrap_or_default();
        let Some((_, asset)) = self.meshes.get(name) else {
            return Err(geom
                .attributes
                .refuse("mesh", "expected the name of a mesh of the model"));
        };
        let moved = ["refpos", "refquat"]
            .into_iter()
            .any(|name| asset.text(name).is_some());
        if moved {
            return Ok(Err("meshes with a reference pose are not read".to_owned()));
        }
        let scale = asset.numbers::<3>("scale")?.unwrap_or([1.0; 3]);
        let mut surface = match (asset.list("vertex")?, asset.text("file")) {
            (Some(numbers), _) => Triangles {
                points: numbers
                    .as_chunks::<3>()
                    .0
                    .iter()
                    .map(|p| Vector3::from(*p))
                    .collect(),
                triangles: Vec::new(),
            },
            (None, Some(file)) => match self.read_mesh(file) {
                Ok(surface) => surface,
                Err(reason) => return Ok(Err(reason)),
            },
            (None, None) => return Err(asset.refuse_element("expected a `file` or `vertex`")),
        };
        for point in &mut surface.points {
            point.component_mul_assign(&Vector3::from(scale));
        }
        let Some(hull) = surface.hull() else {
            return Ok(Err("its mesh is flat".to_owned()));
        };
        let lacks = hull.volume() - surface.volume().abs();
        if !surface.triangles.is_empty() && lacks > 1e-6 * hull.volume() {
            let text = "read as the convex hull of its mesh, which is what MuJoCo touches";
            self.reader.note(geom.element, text);
        }
        Ok(Ok(ShapeSpec::Triangles {
            vertices: hull.points.iter().map(|p| (*p).into()).collect(),
            triangles: hull.triangles,
        }))
    }

    fn read_mesh(&self, file: &str) -> Result<Triangles, String> {
        let is_stl = (Path::new(file).extension())
            .is_some_and(|ending| ending.to_string_lossy().eq_ignore_ascii_case(STL));
        let Some(folder) = self.folder.as_ref().filter(|_| is_stl) else {
            return Err(format!("meshes are read from STL files, not from {file}"));
        };
        let shape = crate::geometry::Shape::read_stl(&folder.join(file));
        let shape = shape.map_err(|error| error.to_string())?;
        debug_assert!(matches!(shape.0, Kind::Mesh(_)));
        Ok(shape.triangles(&Isometry3::identity()))
    }

    fn finish(self, spec: SceneSpec) -> ImportedScene {
        let mut notes = self.reader.notes;
        let scene = Scene::compile(spec, Path::new("")).unwrap_or_else(|error| {
            notes.push(Note {
                place: self.reader.document.place(0),
                text: format!("no obstacles: {error}"),
            });
            Scene::default()
        });
        ImportedScene { scene, notes }
    }
}

/// The name of a geom, or one that no obstacle has.
fn name_of(geom: &Toucher<'_>, others: &[ObstacleSpec]) -> String {
    let taken = |name: &str| others.iter().any(|other| other.name == name);
    let named = geom.name.map(ToOwned::to_owned);
    let mut numbered = (others.len()..).map(|number| format!("geom {number}"));
    named
        .filter(|name| !taken(name))
        .or_else(|| numbered.find(|name| !taken(name)))
        .unwrap_or_default()
}

/// The meshes of a model by their names: those of their files where they have none.
fn meshes<'a>(
    document: &'a Document,
    classes: &Classes,
) -> Result<BTreeMap<String, (usize, Attributes<'a>)>, ImportError> {
    let mut found = BTreeMap::new();
    for (index, _) in document.section("asset").filter(|(_, e)| e.tag == "mesh") {
        let attributes = classes.resolve(document, index, None)?;
        let stem = |file: &str| Some(Path::new(file).file_stem()?.to_string_lossy().into_owned());
        let name = attributes.text("name").map(ToOwned::to_owned);
        if let Some(name) = name.or_else(|| stem(attributes.text("file")?)) {
            found.insert(name, (index, attributes));
        }
    }
    Ok(found)
}

/// Where a model in `folder` has its meshes.
fn mesh_folder(document: &Document, folder: Option<&Path>) -> Option<PathBuf> {
    let mut within = PathBuf::new();
    for name in ["assetdir", "meshdir"] {
        for (index, _) in document.sections("compiler") {
            if let Some(given) = Attributes::own(document, index).text(name) {
                within = PathBuf::from(given);
            }
        }
    }
    Some(folder?.join(within))
}
