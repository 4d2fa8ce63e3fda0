//! The contact sheet, and the pictures in it.

use tdcr::report::{Report, contact_sheet, scale_bar};

use crate::PAGE;
use crate::sample::{bent_tube, example};

/// Width, height and RGB of a PNG.
fn decode(png: &[u8]) -> (usize, usize, Vec<u8>) {
    let mut reader = png::Decoder::new(std::io::Cursor::new(png))
        .read_info()
        .unwrap();
    let mut rgb = vec![0; reader.output_buffer_size().unwrap()];
    let info = reader.next_frame(&mut rgb).unwrap();
    assert_eq!(info.color_type, png::ColorType::Rgb);
    (info.width as usize, info.height as usize, rgb)
}

/// Rows of a contact sheet of examples with errors, and the height of a line of labels.
const ROWS: usize = 4;
const LINE: usize = 30;

/// Height of a panel of a contact sheet.
fn panel_height(sheet: usize) -> usize {
    let panel = (sheet + 8 - LINE) / ROWS - LINE - 8;
    assert_eq!(LINE + ROWS * (panel + LINE + 8) - 8, sheet);
    panel
}

/// First line of pixels of a row's panels.
fn top(row: usize, panel: usize) -> usize {
    LINE + row * (panel + LINE + 8) + LINE
}

#[test]
fn a_contact_sheet_has_a_column_per_example_with_its_robot_in_it() {
    let examples = [example("a", 0.3, 0.4, 1.0), example("b", 2.0, 0.8, -1.0)];
    let (width, height, rgb) = decode(&contact_sheet(&examples, 200));
    assert_eq!(width, 2 * 200 + 8);
    let panel = panel_height(height);
    for column in 0..2 {
        for row in 0..ROWS {
            let inside = (0..panel * 200).filter(|k| {
                let (x, y) = (column * 208 + k % 200, top(row, panel) + k / 200);
                rgb[3 * (y * width + x)..][..3] != [255; 3]
            });
            let share = inside.count() as f64 / (panel * 200) as f64;
            assert!(
                (0.05..0.5).contains(&share),
                "panel {column}, {row}: {share}"
            );
        }
    }
    for y in (0..ROWS).flat_map(|row| top(row, panel)..top(row, panel) + panel) {
        assert!(
            rgb[3 * (y * width + 200)..][..24]
                .iter()
                .all(|&byte| byte == 255),
            "gap"
        );
    }
}

#[test]
fn every_row_and_column_of_a_contact_sheet_has_a_label() {
    let examples = [example("a", 0.3, 0.4, 1.0), example("b", 2.0, 0.8, -1.0)];
    let (width, height, rgb) = decode(&contact_sheet(&examples, 200));
    let panel = panel_height(height);
    let inked = |x: std::ops::Range<usize>, y: std::ops::Range<usize>| {
        let all = y.flat_map(|y| x.clone().map(move |x| 3 * (y * width + x)));
        all.filter(|&start| rgb[start..start + 3] != [255; 3])
            .count()
    };
    for column in 0..2 {
        assert!(inked(column * 208..column * 208 + 10, 0..LINE) > 10);
    }
    for row in 0..ROWS {
        let strip = top(row, panel) - LINE..top(row, panel);
        assert!(inked(0..100, strip) > 100, "row {row}");
    }
}

/// Sparse samples of one and the same surface.
fn sparse(points: usize) -> tdcr::report::Example {
    let mut sparse = example("sparse", 0.3, 0.4, 1.0);
    for (seed, cloud) in (5..).zip([
        &mut sparse.truth,
        &mut sparse.prediction,
        &mut sparse.nearest,
    ]) {
        *cloud = bent_tube(0.3, 0.4, 1.0, 0.0, seed);
        cloud.points.truncate(points);
        cloud.colors.truncate(points);
    }
    sparse
}

#[test]
fn sparse_samples_of_one_surface_agree_in_the_pictures() {
    for points in [300, 1000, 5000] {
        let examples = [sparse(points)];
        let (width, height, rgb) = decode(&contact_sheet(&examples, 300));
        let panel = panel_height(height);
        let row = top(1, panel)..top(1, panel) + panel - 30;
        let pixels = row.flat_map(|y| (0..width).map(move |x| 3 * (y * width + x)));
        let (mut both, mut alone) = (0, 0);
        for pixel in pixels.map(|start| &rgb[start..start + 3]) {
            let spread = pixel.iter().max().unwrap() - pixel.iter().min().unwrap();
            match spread {
                _ if pixel == [255; 3] => {}
                // Grey, or the colour of one cloud.
                ..40 => both += 1,
                _ => alone += 1,
            }
        }
        let share = f64::from(alone) / f64::from(both + alone);
        assert!(both > 1000 && share < 0.06, "{points} points: {share}");
    }
}

#[test]
fn errors_and_uncertainties_have_colours_that_a_scale_explains() {
    assert!(PAGE.contains("from the true cloud: 0 <i class=\"scale\"></i> 5\u{a0}mm or more"));
    assert!(PAGE.contains("Uncertainty: 0 <i class=\"scale\"></i> 1\u{a0}mm or more"));
    assert!(PAGE.contains("Its error, mean\u{a0}2.5\u{a0}mm, 95\u{a0}% below 4.7\u{a0}mm"));
    assert!(PAGE.contains("tip\u{a0}2.3\u{a0}mm off"));
    // Points without error are light, those with the greatest dark.
    let brightness = |error: f64| {
        let mut one = example("one", 0.3, 0.4, 1.0);
        one.error = vec![error; 5000];
        // The scale's end.
        one.error[0] = 5e-3;
        one.error[1..200].fill(5e-3);
        let (width, height, rgb) = decode(&contact_sheet(&[one], 200));
        let panel = panel_height(height);
        let pixels = &rgb[3 * width * top(2, panel)..][..3 * width * (panel - 30)];
        let shown: Vec<u32> = (pixels.chunks(3).filter(|p| *p != [255; 3]))
            .map(|p| p.iter().copied().map(u32::from).sum())
            .collect();
        shown.iter().sum::<u32>() / shown.len() as u32
    };
    let levels = [0.0, 2e-3, 5e-3].map(brightness);
    assert!(
        levels[0] > levels[1] + 80 && levels[1] > levels[2] + 80,
        "{levels:?}"
    );
}

#[test]
fn the_robot_in_a_picture_is_as_long_as_the_scale_bar_says() {
    // A straight tube: 0.25 m long, seen from 0.21 rad above the horizon, with balls round its points that close it.
    let mut straight = example("straight", 0.0, 0.0, 0.0);
    straight.truth = bent_tube(0.0, 0.0, 0.0, 0.0, 1);
    straight.prediction = straight.truth.clone();
    straight.nearest = straight.truth.clone();
    let examples = [straight];
    let (width, height, rgb) = decode(&contact_sheet(&examples, 300));
    let panel = panel_height(height);
    let inked = |x: usize, y: usize| rgb[3 * (y * width + x)..][..3] != [255; 3];
    let bar_row = top(0, panel) + panel - 12;
    // Its length stands beside it.
    let bar = (10..width).take_while(|&x| inked(x, bar_row)).count() as f64;
    let metres_per_pixel = scale_bar(&examples, 300) / bar;
    let rows: Vec<usize> = (top(0, panel)..bar_row - 12)
        .filter(|&y| (0..width).any(|x| inked(x, y)))
        .collect();
    let seen = (rows[rows.len() - 1] - rows[0] + 1) as f64 * metres_per_pixel;
    // 5,000 points at random are 2.5 mm apart: the eighth neighbour is about 4 mm away, at 5 % of the points 5 mm.
    // The surface ends where three balls of 1.45 times that reach: about 1.25 times it beyond the points.
    let expected = 0.25 * 0.21f64.cos() + 2.0 * 0.02 * 0.21f64.sin() + 2.0 * 1.25 * 0.005;
    assert!(
        (seen / expected - 1.0).abs() < 0.03,
        "{seen} m, expected {expected} m"
    );
}

#[test]
fn clouds_without_points_make_white_pictures() {
    let mut empty = example("empty", 0.0, 0.5, 1.0);
    for cloud in [&mut empty.truth, &mut empty.prediction, &mut empty.nearest] {
        *cloud = Default::default();
    }
    let report = Report {
        examples: vec![empty],
        ..Report::default()
    };
    super::assert_balanced(&report.to_html());
    assert_eq!(decode(&contact_sheet(&[], 100)).0, 100);
}
