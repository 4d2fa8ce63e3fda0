//! Files of others that ask for more memory than they hold.

use std::fs;
use std::io::{Read, Write};

use tdcr_learn::data::read_cloud;
use tempfile::tempdir;

#[test]
fn a_small_file_that_asks_for_much_memory_is_refused_before_it_gets_it() {
    let dir = tempdir().unwrap();
    let refuse = |name: &str, bytes: &[u8], expected: &str| {
        let path = dir.path().join(name);
        fs::write(&path, bytes).unwrap();
        let mut said = String::new();
        let used = allocation_counter::measure(|| {
            said = read_cloud(&path).unwrap_err().to_string();
        });
        assert!(said.contains(expected), "{said}");
        assert!(
            used.bytes_max < 100 << 20,
            "{name}: {} bytes",
            used.bytes_max
        );
    };
    // 300 MB of zeros in an archive of 300 kB.
    let rows = 25_000_000;
    let mut archive = zip::ZipWriter::new(fs::File::create(dir.path().join("a.npz")).unwrap());
    let deflated = zip::write::SimpleFileOptions::default();
    archive
        .start_file(
            "points.npy",
            deflated.compression_method(zip::CompressionMethod::Deflated),
        )
        .unwrap();
    let header = format!(
        "{{'descr': '<f4', 'fortran_order': False, 'shape': ({rows}, 3), }}{:>40}",
        "\n"
    );
    let length = (header.len() as u16).to_le_bytes();
    archive
        .write_all(&[b"\x93NUMPY\x01\x00", &length[..], header.as_bytes()].concat())
        .unwrap();
    std::io::copy(&mut std::io::repeat(0).take(12 * rows), &mut archive).unwrap();
    archive.finish().unwrap();
    let bytes = fs::read(dir.path().join("a.npz")).unwrap();
    let held = bytes.len();
    refuse(
        "a.npz",
        &bytes,
        &format!(
            "bytes of memory; expected at most {}",
            16 * held + (64 << 20)
        ),
    );
    // A field of 4096 numbers each, 200,000 times.
    let pcd = format!(
        "FIELDS x y z{}\nSIZE 4 4 4{}\nTYPE F F F{}\nCOUNT 1 1 1{}\nPOINTS 1\nDATA ascii\n",
        " f".repeat(200_000),
        " 4".repeat(200_000),
        " F".repeat(200_000),
        " 4096".repeat(200_000)
    );
    refuse(
        "a.pcd",
        pcd.as_bytes(),
        "expected at most 16384 numbers a point in all",
    );
    refuse(
        "a.ply",
        b"ply\nformat ascii 1.0\nelement vertex 999999999\nproperty float x\nproperty float y\nproperty float z\n\
          end_header\n",
        "999999999 points, expected at most",
    );
}
