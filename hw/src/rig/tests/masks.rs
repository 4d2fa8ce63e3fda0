//! Masks of a rig's file, on pictures in memory.

use std::path::Path;

use tdcr_sim::cloud::VoxelGrid;

use super::*;
use crate::capture::Fuser;
use crate::mask::WorkspaceBox;

/// The example's rig with two small cameras, which are quick, and other masks; its file lies in `folder`.
pub fn masked(folder: &Path, masks: &str) -> RigFile {
    let end = SIMULATED.match_indices("[[cameras]]").nth(2).unwrap().0;
    let text = SIMULATED[..end].replace("[640, 480]", "[160, 120]");
    let old = &text[text.find("box = ").unwrap()..text.find("[simulation]").unwrap()];
    let robot = include_str!("../../../../examples/paper-robot.toml");
    std::fs::write(folder.join("paper-robot.toml"), robot).unwrap();
    RigFile::parse(&text.replace(old, masks), &folder.join("rig.toml")).unwrap()
}

/// Points that a rig sees of its robot, and those of them that lie where no robot is.
fn seen(file: RigFile) -> [usize; 2] {
    let mut rig = Rig::open_file(file, Pace::Computed).unwrap();
    let fuser = Fuser {
        grid: VoxelGrid::new(0.004),
        masker: rig.masker().unwrap(),
    };
    let kept = fuser.keep_robot(&rig.grab().unwrap(), 0).unwrap();
    let cloud = fuser.fuse(&kept);
    let workspace = WorkspaceBox {
        low: [-0.05, -0.05, 0.16],
        high: [0.05, 0.05, 0.40],
    };
    let outside = |point: &&[f32; 3]| !workspace.contains(&point.map(f64::from).into());
    [cloud.len(), cloud.points.iter().filter(outside).count()]
}

#[test]
fn masks_of_a_file_tell_the_robot_from_the_empty_scene() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let workspace = "box = { low = [-0.05, -0.05, 0.16], high = [0.05, 0.05, 0.40] }\n";
    let background = "background = { log = \"empty.mcap\" }\n";
    let parts = "components = { pixels = 20, gap = 2 }\n";
    let [expected, _] = seen(masked(folder, workspace));
    let [all, outside] = seen(masked(folder, ""));
    assert!(outside > all / 2, "{all}, {outside}");
    // There is no picture of the empty scene yet.
    let file = masked(folder, background);
    let said = file.masker().err().expect("no log").to_string();
    for part in [
        "rig.toml:4",
        "masks.background.log: ",
        "empty.mcap",
        "tdcr background",
    ] {
        assert!(said.contains(part), "{said} lacks {part}");
    }
    let log = folder.join("empty.mcap");
    let mut go_on = || ControlFlow::Continue(());
    file.record_background(&log, 2, &mut go_on).unwrap();
    let said = file.masker().err().expect("too few").to_string();
    assert!(said.contains("2 pictures of the empty scene"), "{said}");
    // What is there is not written over, and what was interrupted leaves nothing.
    let again = file.record_background(&log, 20, &mut go_on);
    assert!(matches!(again, Err(RigError::Log(_))), "{again:?}");
    std::fs::remove_file(&log).unwrap();
    let mut left = 3;
    let mut stop = || {
        left -= 1;
        match left {
            0 => ControlFlow::Break(()),
            _ => ControlFlow::Continue(()),
        }
    };
    let stopped = file.record_background(&log, 20, &mut stop);
    assert!(matches!(stopped, Err(RigError::Interrupted)));
    assert!(!log.exists());
    file.record_background(&log, 20, &mut go_on).unwrap();
    let alone = format!("{background}{parts}");
    let [points, wrong] = seen(masked(folder, &alone));
    assert!(
        points > expected * 9 / 10 && wrong < points / 10,
        "{points} of {expected}, {wrong} outside"
    );
    // Combinations mean what they say.
    let either = format!(
        "any = [{{ {} }}, {{ {} }}]\n",
        workspace.trim(),
        background.trim()
    );
    let [points, _] = seen(masked(folder, &either));
    assert!(points >= expected, "{points} of {expected}");
    let neither = format!("not = {{ {} }}\n", either.trim());
    let [points, outside] = seen(masked(folder, &neither));
    assert_eq!(points, outside);
    assert!(points > all / 2);
}
