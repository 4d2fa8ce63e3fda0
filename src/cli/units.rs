//! Units of what is said of settled robots.

use serde_json::{Value, json};
use tdcr::sim::robot::Robot;

/// Units of what results say of settled robots, by field.
pub(super) fn units(robot: &Robot) -> Value {
    let tendons = robot.tendons().iter();
    let command: Vec<&str> = tendons.map(|t| t.unit().symbol()).collect();
    json!({
        "command": command,
        "payload": "kg",
        "force": "N",
        "moment": "N m",
        "line_load": "N/m",
        "positions": "m",
        "orientations": "unit quaternions (w, x, y, z)",
        "tendon_lengths": "m",
        "tendon_tensions": "N",
        "residual": "N m",
        "smallest_stiffness": "N m/rad",
        "growth": "rate 1/s, frequency Hz",
        "tip_compliance": "rows m, m, m, rad, rad, rad by columns N, N, N, N m, N m, N m",
    })
}

/// Names of a table's columns for a command's entries, by which files of commands are read again.
pub(super) fn command_columns(robot: &Robot) -> Vec<String> {
    (robot.tendons().iter().enumerate())
        .map(|(t, tendon)| format!("c{t} ({})", tendon.unit()))
        .collect()
}
