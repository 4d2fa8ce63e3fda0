//! Clouds as other programs write them: colours of other names and kinds, other shapes, endings in capitals.

use std::fs;

use tdcr_learn::data::{import, read_cloud};
use tempfile::tempdir;

use super::{PLY, SETTINGS, go_on};

/// An ASCII PLY of one point, with columns of colours.
fn colored(kind: &str, names: [&str; 3], values: &str) -> Vec<u8> {
    let properties: String = names
        .map(|name| format!("property {kind} {name}\n"))
        .concat();
    let header = PLY.replace("end_header", &format!("{properties}end_header"));
    format!("{header}1 2 3 {values}\n").into()
}

const RED: [&str; 3] = ["red", "green", "blue"];

#[test]
fn colours_are_read_by_any_of_their_names_from_bytes_and_from_floats() {
    let dir = tempdir().unwrap();
    let read = |name: &str, bytes: &[u8]| {
        let path = dir.path().join(name);
        fs::write(&path, bytes).unwrap();
        read_cloud(&path).map(|cloud| cloud.colors[0])
    };
    let whole = [65, 0, 255];
    for (kind, names, values) in [
        ("uchar", RED, "65 0 255"),
        ("int", RED, "65 0 255"),
        ("float", RED, "0.254902 0 1"),
        ("double", RED, "0.254902 0 1.0"),
        ("uchar", ["r", "g", "b"], "65 0 255"),
        ("uchar", ["Red", "Green", "Blue"], "65 0 255"),
        (
            "float",
            ["diffuse_red", "diffuse_green", "diffuse_blue"],
            "0.254902 0 1",
        ),
    ] {
        // The ending in whatever case, and the mark of an editor before the text.
        let bytes = colored(kind, names, values);
        assert_eq!(read("a.PLY", &bytes).unwrap(), whole, "{kind} {names:?}");
        let marked = ["\u{feff}".as_bytes(), &bytes[..]].concat();
        assert_eq!(read("a.ply", &marked).unwrap(), whole);
    }
    let pcd = "FIELDS x y z r g b\nSIZE 4 4 4 1 1 1\nTYPE F F F U U U\nPOINTS 1\nDATA ascii\n1 2 3 65 0 255\n";
    assert_eq!(read("a.pcd", pcd.as_bytes()).unwrap(), whole);
    // Others are no colours, and a point that was not seen has none.
    let other = colored("uchar", ["hue", "saturation", "value"], "65 0 255");
    assert_eq!(read("a.ply", &other).unwrap(), [128; 3]);
    for (kind, values, expected) in [
        (
            "float",
            "254 0 0",
            "line 11: `red` is 254, expected a colour from 0 to 1, as the numbers are floats",
        ),
        ("float", "0 -1 0", "`green` is -1"),
        ("float", "0 0 nan", "`blue` is NaN"),
        (
            "uchar",
            "0.254902 0 1",
            "`red` is 0.254902, expected a colour from 0 to 255, as the numbers are integers",
        ),
        ("ushort", "65535 0 0", "`red` is 65535"),
        ("int", "0 -1 0", "`green` is -1"),
    ] {
        let said = read("a.ply", &colored(kind, RED, values)).unwrap_err();
        assert!(said.to_string().contains(expected), "{said}");
    }
}

/// An NPY file of such a shape.
fn npy(shape: [usize; 2], values: &[f32]) -> Vec<u8> {
    let [rows, columns] = shape;
    let header = format!(
        "{{'descr': '<f4', 'fortran_order': False, 'shape': ({rows}, {columns}), }}{:>40}",
        "\n"
    );
    let length = (header.len() as u16).to_le_bytes();
    let data: Vec<u8> = values.iter().flat_map(|x| x.to_le_bytes()).collect();
    [b"\x93NUMPY\x01\x00", &length[..], header.as_bytes(), &data].concat()
}

#[test]
fn arrays_of_other_shapes_and_colours_than_documented_are_refused() {
    let dir = tempdir().unwrap();
    let path = dir.path().join("a.npy");
    let read = |shape: [usize; 2], values: &[f32]| {
        fs::write(&path, npy(shape, values)).unwrap();
        read_cloud(&path)
    };
    for shape in [[3, 8], [6, 8], [2, 2], [2, 4], [2, 5], [1, 7]] {
        let said = read(shape, &vec![0.5; shape[0] * shape[1]]).unwrap_err();
        let expected = format!(
            "header: shape ({}, {}), expected (N, 3), or (N, 6) with colours: a row for each point",
            shape[0], shape[1]
        );
        assert!(said.to_string().ends_with(&expected), "{said}");
    }
    let row = |color: [f32; 3]| [&[1.0, 2.0, 3.0][..], &color].concat();
    let cloud = read(
        [2, 6],
        &[row([0.0; 3]), row([0.254_902, 0.0, 1.0])].concat(),
    )
    .unwrap();
    assert_eq!(cloud.colors, [[0; 3], [65, 0, 255]]);
    for (color, expected) in [
        (
            [0.0, 255.0, 0.0],
            "row 1: column 4 is 255, expected a colour from 0 to 1",
        ),
        // Normals.
        ([0.0, 0.6, -0.8], "row 1: column 5 is -0.8"),
        ([f32::NAN, 0.0, 0.0], "row 1: column 3 is NaN"),
    ] {
        let said = read([2, 6], &[row([0.0; 3]), row(color)].concat()).unwrap_err();
        assert!(said.to_string().contains(expected), "{said}");
    }
    // What was not seen has no colour either.
    let unseen = [f32::NAN; 6];
    let cloud = read([2, 6], &[&unseen[..], &row([1.0; 3])].concat()).unwrap();
    assert_eq!(cloud.colors, [[255; 3]]);
}

#[test]
fn folders_are_imported_by_endings_in_any_case_and_what_is_passed_over_is_noted() {
    let dir = tempdir().unwrap();
    let (clouds, out) = (dir.path().join("clouds"), dir.path().join("set"));
    fs::create_dir(&clouds).unwrap();
    let said = import(&clouds, &out, &SETTINGS, go_on, go_on)
        .unwrap_err()
        .to_string();
    assert!(said.ends_with("there is no cloud to import"), "{said}");
    for ending in ["xyz", "txt", "las"] {
        fs::write(clouds.join(format!("a.{ending}")), "1 2 3").unwrap();
    }
    let said = import(&clouds, &out, &SETTINGS, go_on, go_on)
        .unwrap_err()
        .to_string();
    let expected = "ends in .ply, .pcd, .npy or .npz: there is no cloud to import; its files end in .las, .txt, .xyz";
    assert!(said.ends_with(expected), "{said}");
    for k in 0..12 {
        let hues = colored("uchar", ["hue", "saturation", "value"], "1 2 3");
        fs::write(clouds.join(format!("{k:02}.PLY")), hues).unwrap();
        let ending = if k == 3 { "JSON" } else { "json" };
        // As editors of Windows write it.
        let motors = format!("\u{feff}{{\"ctrl\": [{k}]}}");
        fs::write(clouds.join(format!("{k:02}.{ending}")), motors).unwrap();
    }
    // Of clouds that are refused nothing stays behind.
    let damaged = clouds.join("05.PLY");
    let whole = fs::read(&damaged).unwrap();
    fs::write(&damaged, "no cloud").unwrap();
    let said = import(&clouds, &out, &SETTINGS, go_on, go_on).unwrap_err();
    assert!(said.to_string().contains("05.PLY"), "{said}");
    assert!(!out.exists());
    fs::write(&damaged, whole).unwrap();
    let imported = import(&clouds, &out, &SETTINGS, go_on, go_on).unwrap();
    assert_eq!(imported.clouds, 12);
    let [grey, others] = &imported.notes[..] else {
        panic!("{imported:?}")
    };
    let expected = "no colours were found in 00.PLY and 11 more, whose points are grey; passed over: hue, saturation, value";
    assert!(grey.starts_with(expected), "{grey}");
    assert!(
        others.starts_with("files that end in .las, .txt, .xyz were passed over"),
        "{others}"
    );
}

#[cfg(unix)]
#[test]
fn devices_and_pipes_are_no_files_of_clouds() {
    let dir = tempdir().unwrap();
    for name in ["a.ply", "a.npz"] {
        let link = dir.path().join(name);
        std::os::unix::fs::symlink("/dev/zero", &link).unwrap();
        let said = read_cloud(&link).unwrap_err().to_string();
        assert!(said.contains("not a regular file"), "{said}");
    }
}
