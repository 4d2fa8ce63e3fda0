//! The byte order mark with which editors of Windows and spreadsheets begin a text: every reader of text passes it over.

use std::fmt::Debug;
use std::fs;
use std::ops::ControlFlow::Break;
use std::path::Path;

use tdcr::hw::extrinsics::{CameraFile, read_board};
use tdcr::hw::rig::RigFile;
use tdcr::learn::data::{DataSet, ImportSettings, import, merge, read_cloud};
use tdcr::pipeline::Silent;
use tdcr::pipeline::recording::{Columns, GivenPriors, RecordingFile};
use tdcr::sim::geometry::Shape;
use tdcr::sim::robot::RobotSpec;
use tdcr::sim::scene::Scene;
use tdcr::study::{Study, merge as merge_study, run};

use crate::cases::sound;
use crate::files::{PCD, PLY, STUDY, marked, meta, part_of};

/// What a reader makes of a file: what it read, or why it refused.
fn outcome<T: Debug, E: std::error::Error>(read: Result<T, E>) -> String {
    match read {
        Ok(read) => format!("{read:?}"),
        Err(error) => format!("refused: {error}"),
    }
}

/// Has `read` read a file `name` of `text` plain, marked and damaged, in a folder that `fill` has filled: marked it is what it is
/// plain, damaged it is not.
fn check_in(fill: impl Fn(&Path), name: &str, text: &[u8], read: impl Fn(&Path) -> String) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join(name);
    let of = |text: &[u8]| {
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        fill(folder.path());
        fs::write(&path, text).unwrap();
        read(&path)
    };
    let plain = of(text);
    assert_eq!(of(&marked(text)), plain, "{name}, marked");
    assert_ne!(of(&[b"!\n", text].concat()), plain, "{name}, damaged");
}

/// The same of a file that stands alone, and is sound.
fn check(name: &str, text: &[u8], read: impl Fn(&Path) -> String) {
    let sound = |path: &Path| {
        let read = read(path);
        let damaged = fs::read(path).unwrap().starts_with(b"!");
        assert!(damaged || !read.starts_with("refused"), "{name}: {read}");
        read
    };
    check_in(|_| {}, name, text, sound);
}

/// The first sound file of a reader's cases.
fn first(reader: &str) -> Vec<u8> {
    sound(reader).swap_remove(0).1
}

#[test]
fn robots_and_meshes_are_read_behind_a_mark() {
    let robot = |path: &Path| outcome(RobotSpec::load(&path.to_string_lossy()));
    check("robot.toml", &first("robot_toml"), robot);
    check("robot.json", &first("robot_json"), robot);
    check("robot.xml", &first("mjcf"), robot);
    check("robot.urdf", &first("urdf"), robot);
    check("mesh.stl", &first("stl"), |path| {
        outcome(Shape::read_stl(path))
    });
}

#[test]
fn files_of_studies_rigs_and_scenes_are_read_behind_a_mark() {
    let study = |path: &Path| outcome(Study::load(path));
    check("study.toml", STUDY.as_bytes(), study);
    let rig = |path: &Path| outcome(RigFile::load(path));
    let robot = concat!(env!("CARGO_MANIFEST_DIR"), "/examples/paper-robot.toml");
    let text = String::from_utf8(first("rig_file")).unwrap();
    let text = text.replace("paper-robot.toml", robot);
    check("rig.toml", text.as_bytes(), rig);
    let scene = |path: &Path| outcome(Scene::load(path));
    check("scene.toml", &first("scene_file"), scene);
    let board = include_bytes!("../../examples/board.toml");
    check("board.toml", board, |path| outcome(read_board(path)));
    let cameras = b"[[cameras]]\nserial = \"one\"\n[cameras.camera]\nresolution = [640, 480]\n\
        lens = { pixels = { focal = [600.0, 600.0], principal = [320.0, 240.0] } }\n";
    check("cameras.toml", cameras, |path| {
        outcome(CameraFile::read(path))
    });
}

#[test]
fn recordings_and_their_maps_are_read_behind_a_mark() {
    let robot = RobotSpec::standard("2m").unwrap();
    check("columns.toml", &first("columns"), |path| {
        outcome(Columns::load(path, &robot))
    });
    check("priors.toml", &first("priors"), |path| {
        outcome(GivenPriors::load(path))
    });
    let columns: Columns = toml::from_str(include_str!("columns.toml")).unwrap();
    check("recording.csv", &first("recording"), |path| {
        outcome(RecordingFile::load(path, &columns))
    });
}

#[test]
fn clouds_and_what_lies_beside_them_are_read_behind_a_mark() {
    let cloud = |path: &Path| outcome(read_cloud(path));
    check("cloud.ply", PLY.as_bytes(), cloud);
    check("cloud.pcd", PCD.as_bytes(), cloud);
    // Too few for a data set: what lies beside the clouds is read, and nothing is written.
    let clouds = |dir: &Path| {
        for name in ["a", "b", "c"] {
            fs::write(dir.join(format!("{name}.ply")), PLY).unwrap();
            fs::write(dir.join(format!("{name}.json")), r#"{"ctrl": [0.01]}"#).unwrap();
        }
    };
    let imported = |dir: &Path, split: Option<&Path>| {
        let settings = ImportSettings {
            split: split.map(Path::to_owned),
            ..ImportSettings::default()
        };
        let out = tempfile::tempdir().unwrap();
        let go_on = |_: usize, _: usize| std::ops::ControlFlow::<()>::Continue(());
        outcome(import(
            dir,
            &out.path().join("set"),
            &settings,
            go_on,
            go_on,
        ))
    };
    check_in(clouds, "a.json", br#"{"ctrl": [0.02]}"#, |path| {
        imported(path.parent().unwrap(), None)
    });
    let split = b"a,train\nb,val\nc,test\n";
    check_in(clouds, "splits/split.csv", split, |path| {
        imported(path.parent().unwrap().parent().unwrap(), Some(path))
    });
}

#[test]
fn what_data_sets_say_of_themselves_is_read_behind_a_mark() {
    let set = Path::new(env!("CARGO_MANIFEST_DIR")).join("learn/tests/data/chunked");
    let fill = |dir: &Path| {
        for entry in fs::read_dir(&set).unwrap() {
            let from = entry.unwrap().path();
            if from.is_file() {
                fs::copy(&from, dir.join(from.file_name().unwrap())).unwrap();
            }
        }
    };
    let open = |path: &Path| outcome(DataSet::open(path.parent().unwrap()));
    for name in [
        "global_motors_scope-all.json",
        "global_norm_scope-all_anchor-origin.json",
    ] {
        check_in(fill, name, &fs::read(set.join(name)).unwrap(), open);
    }
    check_in(fill, "meta.json", meta().to_string().as_bytes(), open);
    let part = part_of(3, meta()).to_string();
    check_in(
        |_| {},
        "part.json",
        part.as_bytes(),
        |path| {
            let dir = path.parent().unwrap();
            let merged = merge(&[dir.to_owned()], &dir.join("out"), |_, _| Break(()));
            outcome(merged)
        },
    );
}

#[test]
fn tables_and_records_of_studies_are_read_behind_a_mark() {
    let folder = tempfile::tempdir().unwrap();
    let (file, part) = (folder.path().join("s.toml"), folder.path().join("part"));
    fs::write(&file, STUDY).unwrap();
    let study = Study::load(&file).unwrap();
    run(&study, &part, Some("1/1".parse().unwrap()), &Silent).unwrap();
    for name in ["study.json", "table.csv"] {
        let whole = |dir: &Path| {
            for name in ["study.json", "table.csv"] {
                fs::copy(part.join(name), dir.join(name)).unwrap();
            }
        };
        check_in(whole, name, &fs::read(part.join(name)).unwrap(), |path| {
            let out = tempfile::tempdir().unwrap();
            let merged = merge_study(
                &[path.parent().unwrap().to_owned()],
                &out.path().join("all"),
                &Silent,
            );
            let rows = merged.map(|finished| (finished.rows, finished.settled));
            outcome(rows)
        });
    }
}
