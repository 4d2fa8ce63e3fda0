//! Boards for printing, read back as an image would be.

use nalgebra::Point2;
use tdcr_hw::extrinsics::{Detector, GreyImage, World, read_board};

use crate::board;

/// The PNG at 600 dots per inch, each pixel a mean of 12 x 12, shown to the detector.
#[test]
fn the_detector_finds_all_corners_of_the_printed_image() {
    const MEAN: usize = 12;
    let board = board();
    let bytes = board.to_png().unwrap();
    let reader = png::Decoder::new(std::io::Cursor::new(&bytes))
        .read_info()
        .unwrap();
    let (size, density) = (
        [reader.info().width, reader.info().height],
        reader.info().pixel_dims.unwrap().xppu,
    );
    let printed = GreyImage::read_png(std::io::Cursor::new(&bytes), size).unwrap();
    let small = size.map(|side| side / MEAN as u32);
    let mean = |index: usize| {
        let (x, y) = (index % small[0] as usize, index / small[0] as usize);
        let row =
            |j: usize| &printed.pixels()[(MEAN * y + j) * size[0] as usize + MEAN * x..][..MEAN];
        let sum: usize = (0..MEAN).flat_map(row).map(|&grey| usize::from(grey)).sum();
        (sum / (MEAN * MEAN)) as u8
    };
    let pixels = (0..(small[0] * small[1]) as usize).map(mean).collect();
    let found = Detector::new(&board)
        .unwrap()
        .detect(&GreyImage::new(small, pixels).unwrap());
    assert_eq!(found.len(), board.corners() as usize);
    let margin = 0.5 * board.spec().square;
    for corner in found {
        let point = board.corner(corner.id).unwrap();
        let pixel = |metres: f64| (metres + margin) * f64::from(density) / MEAN as f64 - 0.5;
        let error = corner.pixel - nalgebra::Vector2::new(pixel(point.x), pixel(point.y));
        assert!(error.norm() < 0.2, "{}: {error}", corner.id);
    }
}

/// Rectangles of the SVG's path, in millimetres, against the board itself at points of a grid that avoids edges.
#[test]
fn the_vector_drawing_is_the_board() {
    let board = board();
    let svg = board.to_svg();
    let path = svg.split("d=\"").nth(1).unwrap().split('"').next().unwrap();
    let rectangle = |text: &str| -> [f64; 3] {
        let numbers = text.split(|c: char| c.is_ascii_alphabetic() || c == ' ');
        let numbers: Vec<f64> = numbers.take(3).map(|n| n.parse().unwrap()).collect();
        numbers.try_into().unwrap()
    };
    let rectangles: Vec<[f64; 3]> = path.split('M').skip(1).map(rectangle).collect();
    let [width, height] = board.size().map(|side| (1e3 * side + 35.0).round());
    assert!(svg.contains(&format!("width=\"{width}mm\" height=\"{height}mm\"")));
    let black = |x: f64, y: f64| {
        let within = |at: f64, from: f64, edge: f64| (from..from + edge).contains(&at);
        rectangles
            .iter()
            .any(|[left, top, edge]| within(x, *left, *edge) && within(y, *top, *edge))
    };
    let (mut dark, mut points) = (0, 0);
    for (i, j) in (0..211).flat_map(|i| (0..167).map(move |j| (i, j))) {
        let [x, y] = [i, j].map(|k| 0.777 + 1.6631 * f64::from(k));
        let at = Point2::new((x - 17.5) / 1e3, (y - 17.5) / 1e3);
        assert_eq!(black(x, y), board.is_black(at), "{x} {y}");
        dark += u32::from(black(x, y));
        points += 1;
    }
    assert!(dark > points / 3);
}

/// The example is a board, and its print fits A4 paper.
#[test]
fn the_example_of_a_board_is_read_with_and_without_a_world() {
    let path = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../examples/board.toml");
    let (board, world) = read_board(&path).unwrap();
    assert!(matches!(world, World::FirstCamera));
    let [width, height] = board.size().map(|side| side + board.spec().square);
    assert!(width < 0.297 && height < 0.210, "{width} x {height} m");
    // The lines that are left to the user.
    let text = std::fs::read_to_string(&path).unwrap();
    let (above, world) = text.split_once("# [world]").unwrap();
    let folder = tempfile::tempdir().unwrap();
    let with = folder.path().join("board.toml");
    std::fs::write(
        &with,
        format!("{above}[world]{}", world.replace("\n# ", "\n")),
    )
    .unwrap();
    let (_, world) = read_board(&with).unwrap();
    assert!(!matches!(world, World::FirstCamera));
}
