//! Finds MuJoCo, writes Rust declarations of what is used from its header, and links its library.
//!
//! MuJoCo is Debian's (package libmujoco-dev), or the one in the folder `MUJOCO_DIR`: either an
//! unpacked release (`include/mujoco/mujoco.h`, `lib/libmujoco.so`) or the Python package
//! (`site-packages/mujoco`, with `include/mujoco/mujoco.h` and `libmujoco.so.X.Y.Z`).
#![allow(
    clippy::print_stdout,
    reason = "a build script speaks to cargo on stdout"
)]

use std::env;
use std::error::Error;
use std::fs;
use std::os::unix::fs::symlink;
use std::path::{Path, PathBuf};

/// Fields of MuJoCo's structs that not every version has, and the `cfg` that says that one is there.
const VERSION_DEPENDENT: [(&str, &str); 2] = [
    ("nJten", "tendon_sparsity_in_model"),
    ("nout", "actuators_of_many_outputs"),
];

fn main() {
    println!("cargo::rerun-if-changed=build.rs");
    println!("cargo::rerun-if-env-changed=MUJOCO_DIR");
    if let Err(error) = build() {
        println!("cargo::error={error}");
    }
}

fn build() -> Result<(), Box<dyn Error>> {
    let out = PathBuf::from(env::var("OUT_DIR")?);
    let mujoco = Installation::find()?;
    bind(&mujoco.include, &out)?;
    link(&mujoco.library, &out)
}

/// Where one version of MuJoCo is.
struct Installation {
    /// Folder that holds `mujoco/mujoco.h`.
    include: PathBuf,
    /// The library itself, links resolved: its file name is the name that it is loaded by.
    library: PathBuf,
}

impl Installation {
    fn find() -> Result<Self, String> {
        let (include, libraries, remedy) = match env::var_os("MUJOCO_DIR") {
            Some(folder) => {
                let folder = PathBuf::from(folder);
                (
                    folder.join("include"),
                    vec![folder.join("lib"), folder],
                    "set MUJOCO_DIR to the absolute path of a MuJoCo release, or of `mujoco` in \
                     the site-packages of a Python that has it",
                )
            }
            None => {
                let arch = env::var("CARGO_CFG_TARGET_ARCH").unwrap_or_default();
                (
                    PathBuf::from("/usr/include"),
                    vec![format!("/usr/lib/{arch}-linux-gnu").into()],
                    "install the Debian package libmujoco-dev, or set MUJOCO_DIR to the folder of \
                     another MuJoCo",
                )
            }
        };
        let header = include.join("mujoco/mujoco.h");
        if !header.is_file() {
            return Err(format!("no header {}: {remedy}", header.display()));
        }
        let library = libraries
            .iter()
            .find_map(|folder| shared_library(folder))
            .ok_or_else(|| format!("no libmujoco.so in {libraries:?}: {remedy}"))?;
        Ok(Self { include, library })
    }
}

/// `libmujoco.so` in `folder`, or else `libmujoco.so.X.Y.Z`.
fn shared_library(folder: &Path) -> Option<PathBuf> {
    let versioned = fs::read_dir(folder).ok()?.flatten().map(|e| e.path());
    let mut libraries: Vec<_> = versioned
        .filter(|path| {
            let name = path.file_name().unwrap_or_default().to_string_lossy();
            name == "libmujoco.so" || name.starts_with("libmujoco.so.")
        })
        .collect();
    libraries.sort();
    fs::canonicalize(libraries.first()?).ok()
}

/// Writes `bindings.rs`, and tells the crate which version-dependent fields there are.
fn bind(include: &Path, out: &Path) -> Result<(), Box<dyn Error>> {
    // Bindgen panics without libclang.
    std::panic::catch_unwind(bindgen::clang_version).map_err(|_| {
        "no libclang: install the Debian package libclang-dev, or set LIBCLANG_PATH to its folder"
    })?;
    let bindings = bindgen::Builder::default()
        .header(include.join("mujoco/mujoco.h").to_string_lossy())
        .clang_arg(format!("-I{}", include.display()))
        .allowlist_var("mjVERSION_HEADER")
        .allowlist_type("mjtObj")
        .allowlist_function("mj_(versionString|version|loadXML|deleteModel|makeData|deleteData)")
        .allowlist_function("mj_(forward|step|name2id|isSparse|mulM)")
        .allowlist_function("mjd_transitionFD")
        .prepend_enum_name(false)
        .generate_comments(false)
        .formatter(bindgen::Formatter::None)
        .parse_callbacks(Box::new(bindgen::CargoCallbacks::new()))
        .generate()?;
    let text = bindings.to_string();
    for (field, cfg) in VERSION_DEPENDENT {
        println!("cargo::rustc-check-cfg=cfg({cfg})");
        if text.contains(&format!("pub {field} :")) {
            println!("cargo::rustc-cfg={cfg}");
        }
    }
    Ok(bindings.write_to_file(out.join("bindings.rs"))?)
}

/// Links the library through `out`, under the name that the linker asks for and the name that it is
/// loaded by: cargo adds search paths within its target folder to the loader's when it runs tests.
fn link(library: &Path, out: &Path) -> Result<(), Box<dyn Error>> {
    let name = library.file_name().ok_or("the library has no file name")?;
    for link in [out.join("libmujoco.so"), out.join(name)] {
        if link.is_symlink() {
            fs::remove_file(&link)?;
        }
        symlink(library, &link)?;
    }
    println!("cargo::rerun-if-changed={}", library.display());
    println!("cargo::rustc-link-search=native={}", out.display());
    println!("cargo::rustc-link-lib=dylib=mujoco");
    Ok(())
}
