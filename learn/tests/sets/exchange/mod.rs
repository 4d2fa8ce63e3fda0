//! Clouds of other programs, in and out.

mod unusual;

use std::fs;
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};

use tdcr_learn::data::{
    DataError, DataSet, ExportFormat, Finding, ImportSettings, LengthUnit, NpzArray, NpzRows,
    NpzValues, Sample, Split, check, export, import, read_cloud, write_npz,
};
use tempfile::tempdir;

use crate::common::{collect, meta};

const SETTINGS: ImportSettings = ImportSettings {
    unit: LengthUnit::Metre,
    points: 6,
    voxel_size: None,
    split: None,
    seed: 7,
};

/// Work that nobody watches.
fn go_on(_: usize, _: usize) -> ControlFlow<()> {
    ControlFlow::Continue(())
}

/// The samples of all splits, with the points of each cloud and the samples in order.
fn sorted(set: &DataSet) -> Vec<Sample> {
    let mut samples: Vec<Sample> = Split::ALL
        .iter()
        .flat_map(|&split| set.read_split(split).unwrap())
        .collect();
    for sample in &mut samples {
        let mut order: Vec<usize> = (0..sample.cloud.len()).collect();
        let key = |k: &usize| sample.cloud.points[*k].map(f32::to_bits);
        order.sort_by_key(key);
        sample.cloud.points = order.iter().map(|&k| sample.cloud.points[k]).collect();
        sample.cloud.colors = order.iter().map(|&k| sample.cloud.colors[k]).collect();
    }
    samples.sort_by(|a, b| a.condition.motors.partial_cmp(&b.condition.motors).unwrap());
    samples
}

#[test]
fn what_was_asked_to_stop_tells_how_far_it_came_and_goes_on() {
    let dir = tempdir().unwrap();
    let original = dir.path().join("original");
    collect(&original, &meta());
    let set = DataSet::open(&original).unwrap();
    let out = dir.path().join("clouds");
    let stop = |done: usize, count: usize| {
        assert_eq!(count, 43);
        match done {
            3 => ControlFlow::Break(()),
            _ => ControlFlow::Continue(()),
        }
    };
    let stopped = export(&set, ExportFormat::Npz, &out, stop);
    assert!(
        matches!(stopped, Err(DataError::Interrupted)),
        "{stopped:?}"
    );
    assert_eq!(fs::read_dir(&out).unwrap().count(), 0);
    export(&set, ExportFormat::Npz, &out, go_on).unwrap();
    let train = out.join(Split::Train.folder());
    let clouds = fs::read_dir(&train).unwrap().count() / 2;
    let again = dir.path().join("set");
    let stop = |done: usize, count: usize| match done {
        _ if count != clouds => panic!("{count} of {clouds}"),
        5 => ControlFlow::Break(()),
        _ => ControlFlow::Continue(()),
    };
    let stopped = import(&train, &again, &SETTINGS, stop, go_on);
    assert!(
        matches!(stopped, Err(DataError::Interrupted)),
        "{stopped:?}"
    );
    let mut steps = Vec::new();
    let watch = |done: usize, _: usize| {
        steps.push(done);
        ControlFlow::Continue(())
    };
    let imported = import(&train, &again, &SETTINGS, watch, go_on).unwrap();
    assert_eq!(imported.clouds, clouds);
    assert!(
        steps.iter().copied().eq(0..steps.len()) && steps.len() > 1,
        "{steps:?}"
    );
}

#[test]
fn what_is_exported_is_imported_again() {
    let dir = tempdir().unwrap();
    let original = dir.path().join("original");
    collect(&original, &meta());
    let set = DataSet::open(&original).unwrap();
    for (name, format) in [("ply", ExportFormat::Ply), ("npz", ExportFormat::Npz)] {
        let out = dir.path().join(name);
        assert_eq!(export(&set, format, &out, go_on).unwrap(), 43);
        // All splits in one folder, as a robot would record them.
        let flat = dir.path().join(format!("{name}-flat"));
        fs::create_dir(&flat).unwrap();
        for split in Split::ALL {
            for entry in fs::read_dir(out.join(split.folder())).unwrap() {
                let path = entry.unwrap().path();
                let file = path.file_name().unwrap().to_str().unwrap();
                fs::copy(&path, flat.join(format!("{}-{file}", split.folder()))).unwrap();
            }
        }
        let again = dir.path().join(format!("{name}-set"));
        assert_eq!(
            import(&flat, &again, &SETTINGS, go_on, go_on)
                .unwrap()
                .clouds,
            43
        );
        let again_set = DataSet::open(&again).unwrap();
        assert_eq!(sorted(&again_set), sorted(&set));
        assert_eq!(check(&again).unwrap(), []);
    }
}

#[test]
fn clouds_are_read_from_text_and_binary_files() {
    let dir = tempdir().unwrap();
    let read = |name: &str, bytes: &[u8]| {
        let path = dir.path().join(name);
        fs::write(&path, bytes).unwrap();
        read_cloud(&path).unwrap()
    };
    let ply = read(
        "a.ply",
        b"ply\nformat ascii 1.0\ncomment x\nelement vertex 2\nproperty double x\nproperty float y\n\
          property float z\nproperty uchar red\nproperty uchar green\nproperty uchar blue\n\
          element face 1\nproperty list uchar int vertex_indices\nend_header\n\
          1 2 3 4 5 6\nnan 0 0 1 1 1\n3 0 1 1\n",
    );
    assert_eq!(
        (ply.points, ply.colors),
        (vec![[1.0, 2.0, 3.0]], vec![[4, 5, 6]])
    );
    let header = |data: &str| {
        format!(
            "# .PCD v0.7\nVERSION 0.7\nFIELDS x y z rgb\nSIZE 4 4 4 4\nTYPE F F F U\nCOUNT 1 1 1 1\n\
             WIDTH 1\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS 1\nDATA {data}\n"
        )
    };
    let color = 0x0004_0506_u32;
    let text = read(
        "a.pcd",
        format!("{}1 2 3 {color}\n", header("ascii")).as_bytes(),
    );
    let mut bytes = header("binary").into_bytes();
    bytes.extend([1.0_f32, 2.0, 3.0].iter().flat_map(|x| x.to_le_bytes()));
    bytes.extend(color.to_le_bytes());
    let binary = read("b.pcd", &bytes);
    for cloud in [text, binary] {
        assert_eq!(
            (cloud.points, cloud.colors),
            (vec![[1.0, 2.0, 3.0]], vec![[4, 5, 6]])
        );
    }
}

#[test]
fn what_is_wrong_with_a_file_is_said_with_its_place() {
    let dir = tempdir().unwrap();
    let refuse = |name: &str, bytes: &[u8], expected: &str| {
        let path = dir.path().join(name);
        fs::write(&path, bytes).unwrap();
        let error = read_cloud(&path).unwrap_err().to_string();
        assert_eq!(error, format!("{}: {expected}", path.display()));
    };
    let ply = "ply\nformat ascii 1.0\nelement vertex 2\nproperty float x\nproperty float y\nproperty float z\nend_header\n";
    let with = |rows: &str| format!("{ply}{rows}").into_bytes();
    refuse(
        "a.ply",
        &with("1 2 3\n1 two 3\n"),
        "line 9: `two`, expected a number",
    );
    refuse(
        "a.ply",
        &with("1 2 3\n"),
        "last line: the file ends after 1 of 2 points",
    );
    refuse(
        "a.ply",
        &with("1 2 3\n1 2\n"),
        "line 9: 2 numbers, expected 3",
    );
    refuse(
        "a.ply",
        b"solid\n",
        "line 1: not a PLY file, expected `ply`",
    );
    refuse(
        "a.ply",
        b"ply\nformat binary_big_endian 1.0\n",
        "line 2: expected format ascii or binary_little_endian",
    );
    refuse(
        "a.ply",
        ply.replace("float z", "float w").as_bytes(),
        "header: no `z`, expected x, y and z",
    );
    refuse(
        "a.ply",
        ply.replace("vertex 2", "vertex 0").as_bytes(),
        "points: no finite point, expected at least 1",
    );
    let pcd = "FIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nPOINTS 3\nDATA ";
    refuse(
        "a.pcd",
        format!("{pcd}binary_compressed\n").as_bytes(),
        "line 5: DATA binary_compressed is not read; write the file as binary or ascii",
    );
    refuse(
        "a.pcd",
        format!("{pcd}binary\n12345678901234").as_bytes(),
        "byte 70: the file ends after 1 of 3 points",
    );
    refuse(
        "a.npy",
        b"\x93NUMPY\x01\x00",
        "header: the file ends within its header",
    );
    refuse(
        "a.npz",
        b"PK",
        "archive: invalid Zip archive: Could not find EOCD",
    );
    refuse(
        "a.xyz",
        b"",
        "name: unknown extension, expected .ply, .pcd, .npy or .npz",
    );
}

#[test]
fn clouds_without_motors_or_with_others_are_named() {
    let dir = tempdir().unwrap();
    let clouds = dir.path().join("clouds");
    fs::create_dir(&clouds).unwrap();
    let ply = b"ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\nproperty float z\nend_header\n1 2 3\n";
    for k in 0..12 {
        fs::write(clouds.join(format!("{k:02}.ply")), ply).unwrap();
        fs::write(
            clouds.join(format!("{k:02}.json")),
            format!("{{\"ctrl\": [{k}, 1]}}"),
        )
        .unwrap();
    }
    let out = dir.path().join("set");
    let refuse = |json: Option<&str>, expected: &str| {
        let path = clouds.join("03.json");
        match json {
            Some(json) => fs::write(&path, json).unwrap(),
            None => fs::remove_file(&path).unwrap(),
        }
        let error = import(&clouds, &out, &SETTINGS, go_on, go_on)
            .unwrap_err()
            .to_string();
        assert!(
            error.contains("03.json") && error.contains(expected),
            "{error}"
        );
    };
    refuse(
        Some("{\"ctrl\": [1]}"),
        "ctrl: 1 values, expected 2 as in the first file",
    );
    refuse(Some("{\"ctrl\": \"up\"}"), "line 1 column");
    refuse(Some("{\"ctrl\": []}"), "no value, expected one per motor");
    refuse(None, "cannot read");
    fs::write(clouds.join("03.json"), "{\"ctrl\": [3, 1]}").unwrap();
    assert_eq!(
        import(&clouds, &out, &SETTINGS, go_on, go_on)
            .unwrap()
            .clouds,
        12
    );
    assert!(import(Path::new("/no/such/folder"), &out, &SETTINGS, go_on, go_on).is_err());
}

/// Imports 12 clouds of one point each, at `x`, as clouds of `unit`; returns the set's folder.
fn import_points(dir: &Path, x: f64, unit: LengthUnit) -> PathBuf {
    let (clouds, out) = (dir.join("clouds"), dir.join(format!("{unit:?}")));
    fs::create_dir_all(&clouds).unwrap();
    for k in 0..12 {
        let text = format!("{PLY}{} 0 0\n", x + 0.001 * x * f64::from(k));
        fs::write(clouds.join(format!("{k:02}.ply")), text).unwrap();
        let motors = format!("{{\"ctrl\": [{k}]}}");
        fs::write(clouds.join(format!("{k:02}.json")), motors).unwrap();
    }
    let settings = ImportSettings { unit, ..SETTINGS };
    import(&clouds, &out, &settings, go_on, go_on).unwrap();
    out
}

const PLY: &str = "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\nproperty float z\n\
                   end_header\n";

#[test]
fn clouds_in_millimetres_become_metres_and_are_found_where_they_do_not() {
    let dir = tempdir().unwrap();
    for (unit, scale) in [
        (LengthUnit::Metre, 339.5),
        (LengthUnit::Centimetre, 3.395),
        (LengthUnit::Millimetre, 0.3395),
    ] {
        let set = import_points(dir.path(), 339.5 / 1.011, unit);
        let found = DataSet::open(&set).unwrap().normalisation().scale;
        assert!((found / scale - 1.0).abs() < 1e-6, "{unit:?}: {found}");
        let findings = check(&set).unwrap();
        match unit {
            LengthUnit::Metre => assert_eq!(findings, [Finding::Size { found }]),
            _ => assert_eq!(findings, []),
        }
    }
    // Metres that are taken for millimetres.
    let dir = tempdir().unwrap();
    let set = import_points(dir.path(), 0.3, LengthUnit::Millimetre);
    assert_eq!(check(&set).unwrap().len(), 1);
}

#[test]
fn arrays_are_read_as_they_are_written_and_must_fill_their_shape() {
    let folder = tempdir().unwrap();
    let path = folder.path().join("cloud.npz");
    let points = |values| NpzArray {
        name: "points",
        shape: &[2, 3],
        values,
    };
    let error = write_npz(&path, &[points(NpzValues::Bytes(&[0; 5]))]).unwrap_err();
    assert_eq!(error.place, "array `points`");
    assert_eq!(error.problem, "5 values, expected 6 as [2, 3] says");
    assert!(!path.exists());
    let values = [0.5, 1.0, -2.0, 4.0, 5.0, 6.0];
    let colors = NpzArray {
        name: "rgb",
        ..points(NpzValues::Bytes(&[1, 2, 3, 4, 5, 255]))
    };
    write_npz(&path, &[points(NpzValues::Floats(&values)), colors]).unwrap();
    let cloud = read_cloud(&path).unwrap();
    assert_eq!(cloud.points.as_flattened(), values);
    assert_eq!(cloud.colors, [[1, 2, 3], [4, 5, 255]]);
}

#[test]
fn archives_of_rows_are_those_of_whole_arrays_and_there_only_once_whole() {
    let folder = tempdir().unwrap();
    let [whole, rows] = ["whole.npz", "rows.npz"].map(|name| folder.path().join(name));
    let array = |name, shape, values| NpzArray {
        name,
        shape,
        values,
    };
    let (points, colors) = ([0.5, 1.0, -2.0, 4.0, 5.0, 6.0], [1, 2, 3, 4, 5, 255]);
    let arrays = [
        array("points", &[2, 3][..], NpzValues::Floats(&points)),
        array("rgb", &[2, 3], NpzValues::Bytes(&colors)),
    ];
    write_npz(&whole, &arrays).unwrap();

    fs::write(&rows, "what was there before").unwrap();
    let mut archive = NpzRows::new(&rows);
    for k in [0, 1] {
        let range = 3 * k..3 * k + 3;
        let point = array("points", &[3], NpzValues::Floats(&points[range.clone()]));
        let color = array("rgb", &[3], NpzValues::Bytes(&colors[range]));
        let first_alone = array("spread", &[1], NpzValues::Floats(&[0.25]));
        archive.push(&[point, color, first_alone][..3 - k]).unwrap();
        assert_eq!(fs::read(&rows).unwrap(), b"what was there before");
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 2);
    }
    archive.finish().unwrap();
    assert!(fs::read(&rows).unwrap() == fs::read(&whole).unwrap());
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 2);
}

#[test]
fn rows_that_do_not_fit_those_before_are_refused() {
    let folder = tempdir().unwrap();
    let path = folder.path().join("rows.npz");
    let mut archive = NpzRows::new(&path);
    let mut push = |shape: &[usize], values| {
        let name = "points";
        archive.push(&[NpzArray {
            name,
            shape,
            values,
        }])
    };
    push(&[2], NpzValues::Floats(&[1.0, 2.0])).unwrap();
    for (shape, values, problem) in [
        (&[3][..], NpzValues::Floats(&[0.0; 3]), "a row of shape [3]"),
        (
            &[2],
            NpzValues::Bytes(&[0; 2]),
            "a row of shape [2] and type `|u1`",
        ),
        (&[2], NpzValues::Floats(&[0.0; 3]), "3 values, expected 2"),
    ] {
        let error = push(shape, values).unwrap_err();
        assert_eq!(error.place, "array `points`");
        assert!(error.problem.starts_with(problem), "{error}");
    }
    let nowhere = folder.path().join("no/folder.npz");
    let row = NpzArray {
        name: "points",
        shape: &[1],
        values: NpzValues::Floats(&[1.0]),
    };
    assert!(NpzRows::new(&nowhere).push(&[row]).is_err());
}
