//! Pulls one tendon of the 2m robot and lets it go again, with more and more friction in its holes,
//! and draws the tip's hysteresis.
//!
//! ```text
//! cargo run --release --example friction_loop [friction_loop.svg]
//! ```
#![allow(
    clippy::print_stdout,
    reason = "the table is what the example is run for"
)]

use std::fmt::Write;

use anyhow::{Context, Result, ensure};
use tdcr::sim::friction::FrictionPath;
use tdcr::sim::robot::{Friction, Loads, Robot, RobotSpec};

/// Coefficients of friction, and the colour that each is drawn in.
const COEFFICIENTS: [(f64, &str); 4] = [
    (0.0, "#6b7480"),
    (0.05, "#1f77b4"),
    (0.1, "#d97706"),
    (0.2, "#b3261e"),
];
/// Commands of the tendons that are not driven (m).
const STILL: f64 = 0.02;
/// Commands of the driven tendon: pulled in and let out again (m).
const PULLED: f64 = 0.0;
const LET_OUT: f64 = 0.04;
/// Commands from one end to the other.
const STEPS: usize = 80;

/// What one coefficient of friction does.
struct Hysteresis {
    coefficient: f64,
    colour: &'static str,
    /// Command of the driven tendon, and the tip's x (mm): the way there, then one closed loop.
    points: Vec<(f64, f64)>,
    /// Turned into heat over the closed loop (mJ).
    dissipated: f64,
    /// Largest difference of the tip's x between pulling and letting out (mm).
    width: f64,
    /// Tension at the tendon's end over that at the servo, pulled in.
    arriving: f64,
}

fn main() -> Result<()> {
    let path = std::env::args()
        .nth(1)
        .unwrap_or_else(|| "friction_loop.svg".to_owned());
    let loops = COEFFICIENTS
        .iter()
        .map(|&(coefficient, colour)| drive(coefficient, colour))
        .collect::<Result<Vec<_>>>()?;
    println!("  mu   dissipated (mJ)   loop width (mm)   end/servo tension");
    for Hysteresis {
        coefficient,
        dissipated,
        width,
        arriving,
        ..
    } in &loops
    {
        println!("{coefficient:4.2} {dissipated:17.3} {width:17.2} {arriving:19.3}");
    }
    std::fs::write(&path, picture(&loops)).with_context(|| format!("cannot write {path}"))?;
    println!("drawn in {path}");
    Ok(())
}

/// Pulls the tendon, lets it out, and goes once around the closed loop.
fn drive(coefficient: f64, colour: &'static str) -> Result<Hysteresis> {
    let mut spec = RobotSpec::load("2m")?;
    for tendons in spec.modules.iter_mut().filter_map(|m| m.tendons.as_mut()) {
        tendons.friction = Some(Friction {
            coefficient,
            contact_stiffness: 1e5,
        });
    }
    let robot = Robot::new(spec)?;
    let mut path = FrictionPath::new(&robot);
    let (mut points, mut dissipated, mut arriving) = (Vec::new(), 0.0, 1.0);
    for stroke in 0..4 {
        let (from, to) = if stroke % 2 == 0 {
            (LET_OUT, PULLED)
        } else {
            (PULLED, LET_OUT)
        };
        for step in 0..=STEPS {
            let first = from + (to - from) * step as f64 / STEPS as f64;
            let command = robot.command(&[first, STILL, STILL, STILL, STILL, STILL])?;
            let state = path.advance(&command, &Loads::default());
            let equilibrium = &state.equilibrium;
            ensure!(
                equilibrium.converged,
                "mu {coefficient}, command {first} m: no equilibrium"
            );
            points.push((1e3 * first, 1e3 * equilibrium.positions[9].x));
        }
        let state = path.state();
        match stroke {
            1 => dissipated = -state.dissipated,
            2 => arriving = state.tendons[0].tensions[4] / state.tendons[0].tensions[0],
            3 => dissipated += state.dissipated,
            _ => {}
        }
    }
    let closed = &points[2 * (STEPS + 1)..];
    let pairs = closed.iter().zip(closed.iter().rev());
    Ok(Hysteresis {
        coefficient,
        colour,
        width: pairs.map(|(a, b)| (a.1 - b.1).abs()).fold(0.0, f64::max),
        points,
        dissipated: 1e3 * dissipated,
        arriving,
    })
}

/// Size of the picture and its margins around the plot (SVG user units).
const WIDTH: f64 = 760.0;
const HEIGHT: f64 = 560.0;
const LEFT: f64 = 70.0;
const RIGHT: f64 = 24.0;
const TOP: f64 = 62.0;
const BOTTOM: f64 = 120.0;

fn picture(loops: &[Hysteresis]) -> String {
    let tips = || loops.iter().flat_map(|l| &l.points).map(|point| point.1);
    let (low, high) = (
        (tips().fold(f64::INFINITY, f64::min) / 20.0).floor() * 20.0,
        (tips().fold(f64::NEG_INFINITY, f64::max) / 20.0).ceil() * 20.0,
    );
    let (start, end) = (1e3 * PULLED, 1e3 * LET_OUT);
    let x = |command: f64| LEFT + (command - start) / (end - start) * (WIDTH - LEFT - RIGHT);
    let y = |tip: f64| TOP + (high - tip) / (high - low) * (HEIGHT - TOP - BOTTOM);
    let mut svg = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {WIDTH} {HEIGHT}\" \
         width=\"{WIDTH}\" height=\"{HEIGHT}\" font-family=\"sans-serif\" font-size=\"13\" \
         fill=\"#1c2128\">\n<title>Tip position against command with friction</title>\n\
         <rect width=\"100%\" height=\"100%\" fill=\"white\"/>\n\
         <text x=\"{LEFT}\" y=\"22\" font-size=\"16\" font-weight=\"600\">\
         2m robot, tendon 0 pulled and let out: the tip lags behind</text>\n"
    );
    // Writing to a String cannot fail.
    for tick in 0..=((high - low) / 20.0).round() as usize {
        let (value, foot) = (low + 20.0 * tick as f64, LEFT - 8.0);
        let (at, right) = (y(value), WIDTH - RIGHT);
        let _ = writeln!(
            svg,
            "<path d=\"M{LEFT} {at:.1}H{right}\" stroke=\"#dfe3e8\"/>\
             <text x=\"{foot}\" y=\"{:.1}\" text-anchor=\"end\">{value:.0}</text>",
            at + 4.5
        );
    }
    let bottom = HEIGHT - BOTTOM;
    for tick in 0..=4 {
        let value = start + (end - start) * f64::from(tick) / 4.0;
        let _ = writeln!(
            svg,
            "<path d=\"M{0:.1} {bottom}v5\" stroke=\"#5a6370\"/>\
             <text x=\"{0:.1}\" y=\"{1}\" text-anchor=\"middle\">{value:.0}</text>",
            x(value),
            bottom + 20.0
        );
    }
    let _ = writeln!(
        svg,
        "<path d=\"M{LEFT} {TOP}V{bottom}H{0}\" fill=\"none\" stroke=\"#5a6370\"/>\
         <text x=\"{1}\" y=\"{2}\" text-anchor=\"middle\">command of tendon 0: rest length (mm); \
         pulled in at the left</text>\
         <text transform=\"translate(20 {3}) rotate(-90)\" text-anchor=\"middle\">tip x (mm)</text>",
        WIDTH - RIGHT,
        (LEFT + WIDTH - RIGHT) / 2.0,
        bottom + 42.0,
        (TOP + bottom) / 2.0
    );
    for (index, hysteresis) in loops.iter().enumerate() {
        let (first, closed) = hysteresis.points.split_at(2 * (STEPS + 1));
        let colour = hysteresis.colour;
        for (points, style) in [(first, "1\" stroke-dasharray=\"4 3"), (closed, "2")] {
            let line: Vec<_> = (points.iter())
                .map(|&(command, tip)| format!("{:.1},{:.1}", x(command), y(tip)))
                .collect();
            let _ = writeln!(
                svg,
                "<polyline points=\"{}\" fill=\"none\" stroke=\"{colour}\" \
                 stroke-width=\"{style}\"/>",
                line.join(" ")
            );
        }
        let at = LEFT + 120.0 * index as f64;
        let _ = writeln!(
            svg,
            "<path d=\"M{at} 42h26\" stroke=\"{colour}\" stroke-width=\"2\"/>\
             <text x=\"{}\" y=\"46.5\">mu = {}</text>",
            at + 32.0,
            hysteresis.coefficient
        );
    }
    let caption = [
        format!(
            "Quasi-static path: the other tendons stay at {:.0} mm, no payload, contact stiffness \
             100 kN/m.",
            1e3 * STILL
        ),
        "Dashed: from the equilibrium without friction, pulled and let out once. Solid: the closed \
         loop after that."
            .to_owned(),
    ];
    for (row, text) in caption.iter().enumerate() {
        let at = bottom + 70.0 + 18.0 * row as f64;
        let _ = writeln!(
            svg,
            "<text x=\"{LEFT}\" y=\"{at}\" fill=\"#5a6370\">{text}</text>"
        );
    }
    svg + "</svg>\n"
}
