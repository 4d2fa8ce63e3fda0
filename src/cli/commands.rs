//! Files of commands: one command after another, as CSV or JSON.

use std::path::Path;

use anyhow::{Context, bail};

/// Reads commands from a JSON file (`.json`: a list of lists of numbers) or a CSV file (a line each; empty lines and lines
/// that begin with `#` are passed over). `make` takes the numbers of a command; what it refuses is told with its place.
pub(super) fn read_commands<T>(
    file: &Path,
    make: impl Fn(&[f64]) -> anyhow::Result<T>,
) -> anyhow::Result<Vec<T>> {
    let name = file.display();
    let text = std::fs::read_to_string(file)
        .with_context(|| format!("cannot read commands from {name}"))?;
    let mut commands = Vec::new();
    if file
        .extension()
        .is_some_and(|extension| extension == "json")
    {
        let rows: Vec<Vec<f64>> = serde_json::from_str(&text)
            .with_context(|| format!("{name} is not a list of lists of numbers"))?;
        for (number, row) in rows.iter().enumerate() {
            commands.push(make(row).with_context(|| format!("{name} entry {number}"))?);
        }
    } else {
        for (number, line) in text.lines().enumerate() {
            let line = line.trim();
            if line.is_empty() || line.starts_with('#') {
                continue;
            }
            let command = parse_line(line).and_then(|row| make(&row));
            commands.push(command.with_context(|| format!("{name} line {}", number + 1))?);
        }
    }
    if commands.is_empty() {
        bail!("{name} has no commands; expected one per line, or a JSON list of them");
    }
    Ok(commands)
}

fn parse_line(line: &str) -> anyhow::Result<Vec<f64>> {
    let entry = |text: &str| {
        let text = text.trim();
        (text.parse::<f64>()).with_context(|| format!("`{text}` is not a number"))
    };
    line.split(',').map(entry).collect()
}
