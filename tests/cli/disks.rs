//! Captures on disks that are too small: for the log, for the data.

use std::fs;
use std::path::Path;
use std::process::Output;

use crate::capture::small_rig;
use crate::stderr;

/// Runs a script with `DIR` as a disk of so many megabytes, which is gone afterwards; `None` where none can be mounted.
fn on_a_small_disk(folder: &Path, megabytes: u32, script: &str) -> Option<Output> {
    let disk = folder.join("disk");
    fs::create_dir_all(&disk).unwrap();
    let script = format!(
        "mount -t tmpfs -o size={megabytes}m tmpfs {disk} || exit 99\nDIR={disk} TDCR={}\n{script}",
        env!("CARGO_BIN_EXE_tdcr"),
        disk = disk.display(),
    );
    let run = std::process::Command::new("unshare")
        .args(["--map-root-user", "--mount", "sh", "-c", &script])
        .output()
        .ok()?;
    (run.status.code() != Some(99) && !stderr(&run).contains("unshare:")).then_some(run)
}

#[test]
fn a_full_disk_ends_the_log_and_not_the_capture() {
    let folder = tempfile::tempdir().unwrap();
    let rig = small_rig(folder.path());
    let script = format!(
        "$TDCR capture --rig {} --out $DIR/data --commands 20 --points 300 --voxel 0.004 || exit 3\n\
         $TDCR log info --json --quiet $DIR/data/log.mcap || exit 4\n$TDCR data check $DIR/data",
        rig.display()
    );
    let Some(run) = on_a_small_disk(folder.path(), 6, &script) else {
        eprintln!("no disk can be mounted: skipped");
        return;
    };
    let said = stderr(&run);
    assert!(run.status.success(), "{}: {said}", run.status);
    assert!(said.contains("the log ends here"), "{said}");
    let told = String::from_utf8_lossy(&run.stdout);
    assert!(
        told.contains("\"whole\": true") && told.contains("data: good"),
        "{told}"
    );
}

#[test]
fn a_disk_too_small_for_the_data_keeps_what_was_captured_and_says_how_much() {
    let folder = tempfile::tempdir().unwrap();
    let rig = small_rig(folder.path());
    let script = format!(
        "$TDCR capture --rig {} --out $DIR/data --commands 20 --points 10000 --voxel 0.004 && exit 3\n\
         ls $DIR/data/.partial | grep -c block; grep -c index $DIR/data/capture.jsonl",
        rig.display()
    );
    let Some(run) = on_a_small_disk(folder.path(), 1, &script) else {
        eprintln!("no disk can be mounted: skipped");
        return;
    };
    let (said, told) = (
        stderr(&run),
        String::from_utf8_lossy(&run.stdout).into_owned(),
    );
    assert!(run.status.success(), "{}: {said}{told}", run.status);
    let kept = told.lines().next().unwrap();
    assert!(kept.parse::<u32>().unwrap() > 2, "{told}");
    assert!(
        said.contains(&format!("{kept} of 20 samples are kept in")),
        "{said}{told}"
    );
    assert!(said.contains("and the data set takes up to"), "{said}");
    assert!(said.to_lowercase().contains("no space left"), "{said}");
}
