//! Damaged scene files get an answer, in bounded time, and what is accepted can be written, read again and seen.

use std::time::{Duration, Instant};

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use tdcr_sim::camera::{Camera, Intrinsics};
use tdcr_sim::render::Visuals;
use tdcr_sim::scene::Scene;

use super::{SHELF, scene};

const CASES: usize = 6_000;
/// An unoptimised build on a busy machine takes a tenth of it.
const LONGEST: Duration = Duration::from_secs(120);

/// Words that mean something in scene files.
const WORDS: [&str; 20] = [
    "nan",
    "-inf",
    "1e308",
    "-1",
    "0",
    "1e-320",
    "[",
    "]",
    "{",
    "}",
    "\n",
    "'",
    "\"",
    "=",
    "[[obstacle]]\n",
    "mesh = '/dev/zero'\n",
    "half_space = {}\n",
    "path",
    "18446744073709551616",
    "\u{feff}",
];

fn damage(text: &str, rng: &mut ChaCha8Rng) -> String {
    let mut text: Vec<char> = text.chars().collect();
    for _ in 0..rng.random_range(1..5) {
        let start = rng.random_range(0..=text.len());
        let end = text.len().min(start + rng.random_range(1..30));
        let word = WORDS[rng.random_range(0..WORDS.len())];
        match rng.random_range(0..5) {
            0 => text.truncate(text.len().max(40) - rng.random_range(0..40)),
            1 => drop(text.drain(start..end)),
            2 => {
                let part = text[start..end].repeat(rng.random_range(1..50));
                text.splice(start..start, part);
            }
            3 => drop(text.splice(start..end.min(start + 1), word.chars())),
            _ => drop(text.splice(start..start, word.chars())),
        }
    }
    text.into_iter().collect()
}

/// Numbers alone are replaced: most of these files can be parsed.
fn other_numbers(text: &str, rng: &mut ChaCha8Rng) -> String {
    let numbers = [
        "0", "-1.0", "1e6", "nan", "inf", "1e-300", "0.5", "1e15", "3",
    ];
    let pieces = text.split_inclusive([' ', ',', '[', ']', '}']);
    let replaced = pieces.map(|piece| {
        let number = piece.trim_end_matches([' ', ',', '[', ']', '}']);
        match number.parse::<f64>().is_ok() && rng.random_bool(0.03) {
            true => piece.replacen(number, numbers[rng.random_range(0..numbers.len())], 1),
            false => piece.to_owned(),
        }
    });
    replaced.collect()
}

#[test]
fn damaged_files_get_an_answer_and_accepted_ones_are_whole() {
    let mut rng = ChaCha8Rng::seed_from_u64(5);
    let began = Instant::now();
    let camera = Camera {
        intrinsics: Intrinsics::from_fovy(32, 24, 60_f64.to_radians()),
        pose: nalgebra::Isometry3::translation(0.0, 0.0, -0.5),
    };
    let mut accepted = 0;
    for case in 0..CASES {
        let text = match case % 2 {
            0 => damage(SHELF, &mut rng),
            _ => other_numbers(SHELF, &mut rng),
        };
        match scene(&text) {
            Ok(read) => {
                accepted += 1;
                let again: Scene = scene(&read.to_toml().unwrap()).unwrap();
                assert_eq!(again.obstacles().len(), read.obstacles().len(), "{text}");
                let mut visuals = Visuals::default();
                visuals.add_scene(&read);
                let frame = visuals.render(&camera);
                assert!(
                    frame
                        .depth
                        .iter()
                        .all(|depth| depth.is_finite() && *depth >= 0.0),
                    "{text}"
                );
            }
            Err(error) => assert!(error.to_string().chars().count() > 10, "{text}"),
        }
    }
    assert!(began.elapsed() < LONGEST, "{:?}", began.elapsed());
    // Neither all nor nothing is refused.
    assert!((CASES / 20..CASES).contains(&accepted), "{accepted}");
}

/// Files that ask for more than they hold are refused or read in a moment.
#[test]
fn files_that_ask_for_much_get_an_answer_in_bounded_time() {
    let pipe = "[[obstacle]]\npipe = { radius = 1, length = 1 }\n";
    let points = "[0, 0, 0], [0, 0, 1], ".repeat(100_000);
    for (name, text, is_read) in [
        ("deep", format!("obstacle = {}", "[".repeat(100_000)), false),
        ("many", "[[obstacle]]\n".repeat(200_000), false),
        ("many pipes", pipe.repeat(10_000), true),
        ("a pipe more", pipe.repeat(10_001), false),
        (
            "long",
            format!("[[obstacle]]\npipe = {{ radius = 1, path = [{points}] }}"),
            false,
        ),
        (
            "far",
            "[[obstacle]]\nhalf_space = {}\n".repeat(9_999) + "friction = true",
            false,
        ),
        (
            "itself",
            "[[obstacle]]\nmesh = 'Cargo.toml'".to_owned(),
            false,
        ),
    ] {
        let began = Instant::now();
        assert_eq!(scene(&text).is_ok(), is_read, "{name}");
        let took = began.elapsed();
        assert!(took < Duration::from_secs(20), "{name}: {took:?}");
    }
}
