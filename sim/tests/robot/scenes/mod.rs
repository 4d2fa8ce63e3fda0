//! Scenes: what their files say, what they refuse, and what cameras see of them.

mod damage;
mod files;
mod pictures;
mod refusals;

use std::path::Path;

use tdcr_sim::scene::{Scene, SceneError};

/// The example of `docs/scene-files.md`.
const SHELF: &str = include_str!("../../../../examples/scenes/shelf.toml");

/// A scene without meshes.
fn scene(text: &str) -> Result<Scene, SceneError> {
    Scene::from_toml(text, Path::new("/no/such/folder"))
}

/// A tetrahedron as an STL text, its corners at the origin and at 1 on each axis.
const STL: &str = "solid t
facet normal 0 0 0\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\nendfacet
facet normal 0 0 0\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 0 1\nendloop\nendfacet
facet normal 0 0 0\nouter loop\nvertex 0 0 0\nvertex 0 1 0\nvertex 0 0 1\nendloop\nendfacet
facet normal 0 0 0\nouter loop\nvertex 1 0 0\nvertex 0 1 0\nvertex 0 0 1\nendloop\nendfacet
endsolid t
";
