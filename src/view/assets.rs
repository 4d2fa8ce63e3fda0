//! The files of the page, which are in the binary.

/// A file of the page.
pub(super) struct Asset {
    /// Its path behind the token.
    pub path: &'static str,
    /// Its media type.
    pub mime: &'static str,
    /// What is in it.
    pub bytes: &'static [u8],
}

const SCRIPT: &str = "text/javascript; charset=utf-8";

macro_rules! asset {
    ($path:literal, $mime:expr) => {
        Asset {
            path: $path,
            mime: $mime,
            bytes: include_bytes!(concat!("page/", $path)),
        }
    };
}

/// The page itself, in which `{{nonce}}` stands for a word that lets the page's own script in.
pub(super) const PAGE: &str = include_str!("page/index.html");

/// The files that the page asks for.
pub(super) static ASSETS: [Asset; 17] = [
    asset!("style.css", "text/css; charset=utf-8"),
    asset!("main.js", SCRIPT),
    asset!("link.js", SCRIPT),
    asset!("overlays.js", SCRIPT),
    asset!("study.js", SCRIPT),
    asset!("cameras.js", SCRIPT),
    asset!("physics.js", SCRIPT),
    asset!("stage.js", SCRIPT),
    asset!("solids.js", SCRIPT),
    asset!("controls.js", SCRIPT),
    asset!("readout.js", SCRIPT),
    asset!("rig.js", SCRIPT),
    asset!("robot_file.js", SCRIPT),
    asset!("three/three.core.min.js", SCRIPT),
    asset!("three/three.module.min.js", SCRIPT),
    asset!("three/OrbitControls.js", SCRIPT),
    asset!("three/LICENSE", "text/plain; charset=utf-8"),
];

/// The file at a path.
pub(super) fn find(path: &str) -> Option<&'static Asset> {
    ASSETS.iter().find(|asset| asset.path == path)
}
