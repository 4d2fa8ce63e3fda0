//! Which commit a release is built from, for `tdcr --version`.
//!
//! `make release` gives it as `TDCR_COMMIT`, and writes it into the file `COMMIT` of the Python source distribution; a crate
//! that cargo packaged has it in `.cargo_vcs_info.json`. A checkout is not asked: there, the library would be compiled anew
//! after every commit.

fn main() {
    println!("cargo::rerun-if-changed=build.rs");
    println!("cargo::rerun-if-env-changed=TDCR_COMMIT");
    let version = env!("CARGO_PKG_VERSION");
    let line = match commit() {
        Some(commit) => format!("{version} (commit {commit})"),
        None => version.to_owned(),
    };
    println!("cargo::rustc-env=TDCR_VERSION_LINE={line}");
}

/// The commit, where the build is told.
fn commit() -> Option<String> {
    let told = std::env::var("TDCR_COMMIT").ok();
    let commit = told
        .or_else(|| read("COMMIT"))
        .or_else(|| read(".cargo_vcs_info.json").and_then(|info| hash_in(&info)))?;
    let commit = commit.trim();
    // Seven digits are git's own short form; what is shorter, or has other letters, is no commit.
    let is_hash = commit.len() >= 7 && commit.bytes().all(|byte| byte.is_ascii_hexdigit());
    is_hash.then(|| commit.to_owned())
}

/// A file beside the manifest, where there is one. Cargo would run this script at every build if it were told of one that is
/// not there.
fn read(name: &str) -> Option<String> {
    let text = std::fs::read_to_string(name).ok()?;
    println!("cargo::rerun-if-changed={name}");
    Some(text)
}

/// The value of `sha1`, as cargo writes it.
fn hash_in(info: &str) -> Option<String> {
    let (_, behind) = info.split_once("\"sha1\"")?;
    behind.split('"').nth(1).map(str::to_owned)
}
