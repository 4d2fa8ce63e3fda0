//! `tdcr --help`, by what one wants to do.

use std::any::TypeId;
use std::ffi::OsString;
use std::path::PathBuf;

use clap::{CommandFactory, FromArgMatches};

use super::Cli;

/// Commands by user story, in the order in which they are told.
const STORIES: [(&str, &[&str]); 6] = [
    (
        "Robots in simulation",
        &[
            "new", "settle", "reach", "plan", "deploy", "track", "simulate", "study", "render",
            "view", "export",
        ],
    ),
    (
        "Learning",
        &["collect", "train", "distill", "predict", "eval", "demo"],
    ),
    (
        "Data, of others and of real robots",
        &["data", "compare", "calibrate"],
    ),
    (
        "A robot on the desk",
        &[
            "capture",
            "jog",
            "home",
            "pretension",
            "scan",
            "background",
            "calibrate-cameras",
            "log",
            "servo-sim",
        ],
    ),
    ("The shell", &["completions", "manual"]),
    ("", &["help"]),
];

/// The command line, its help grouped.
pub(super) fn command() -> clap::Command {
    let mut command = Cli::command();
    command.build();
    let mut groups = String::new();
    for (story, names) in STORIES {
        groups += "\n";
        if !story.is_empty() {
            groups += &format!("{story}:\n");
        }
        for name in names {
            let about = command
                .find_subcommand(name)
                .and_then(clap::Command::get_about);
            let about = about.map(ToString::to_string).unwrap_or_default();
            groups += &format!("  {name:18} {about}\n");
        }
    }
    // Built anew: what is built already cannot be changed.
    with_negative_numbers(Cli::command()).help_template(format!(
        "{{about}}\n\n{{usage-heading}} {{usage}}\n{groups}\nOptions:\n{{options}}\n"
    ))
}

/// The command, whose options take `-1` for a number, out of bounds as it may be, and not for another option.
///
/// Names and paths keep their protection: `--out -1` is a slip.
fn with_negative_numbers(command: clap::Command) -> clap::Command {
    command
        .mut_args(|arg| {
            let number = arg.get_action().takes_values() && !is_text(&arg);
            arg.allow_negative_numbers(number)
        })
        .mut_subcommands(with_negative_numbers)
}

/// Whether an argument's value is a name or a path.
fn is_text(arg: &clap::Arg) -> bool {
    let value = arg.get_value_parser().type_id();
    [
        TypeId::of::<String>(),
        TypeId::of::<OsString>(),
        TypeId::of::<PathBuf>(),
    ]
    .iter()
    .any(|text| value == *text)
}

/// Parses the arguments; a wrong one ends the process with what would be right.
pub(super) fn parse(arguments: &[OsString]) -> Cli {
    let matches = command().get_matches_from(arguments);
    Cli::from_arg_matches(&matches).unwrap_or_else(|error| error.exit())
}

#[cfg(test)]
mod tests {
    use clap::error::ErrorKind;

    use super::*;

    #[test]
    fn a_negative_number_is_a_value_and_not_another_option() {
        let refused = |words: &[&str]| {
            let matches = command().try_get_matches_from([&["tdcr"], words].concat());
            let error = matches.expect_err("this is no valid command");
            (error.kind(), error.to_string())
        };
        for words in [
            &["track", "--path", "circle", "--diameter", "-1"][..],
            &["collect", "--samples", "-1"],
            &["data", "import", "set", "--points", "-2e3"],
        ] {
            let (kind, text) = refused(words);
            assert_eq!(kind, ErrorKind::ValueValidation, "{text}");
            assert!(text.contains("invalid value '-"), "{text}");
        }
        // A folder of that name is a slip.
        let (kind, _) = refused(&["collect", "--out", "-1"]);
        assert_eq!(kind, ErrorKind::UnknownArgument);
    }

    #[test]
    fn help_tells_every_command_once() {
        let mut command = Cli::command();
        command.build();
        let mut found: Vec<&str> = command
            .get_subcommands()
            .map(clap::Command::get_name)
            .collect();
        let mut told: Vec<&str> = STORIES
            .iter()
            .flat_map(|(_, names)| names.iter().copied())
            .collect();
        found.sort_unstable();
        told.sort_unstable();
        assert_eq!(told, found);
        let help = super::command().render_help().to_string();
        for (story, names) in STORIES {
            assert!(help.contains(story));
            assert!(
                names
                    .iter()
                    .all(|name| help.contains(&format!("\n  {name} "))),
                "{help}"
            );
        }
    }
}
