//! Commented studies to start from.

/// A study to start from, which runs as it is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Starter {
    /// Deflection under payloads.
    Payload,
    /// Numbers of modules.
    Modules,
    /// Stiffness of the joints.
    Stiffness,
    /// Reachable workspaces.
    Workspace,
    /// Friction of tendons.
    Friction,
}

impl Starter {
    /// All of them.
    pub const ALL: [Self; 5] = [
        Self::Payload,
        Self::Modules,
        Self::Stiffness,
        Self::Workspace,
        Self::Friction,
    ];

    /// Its name on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::Payload => "payload",
            Self::Modules => "modules",
            Self::Stiffness => "stiffness",
            Self::Workspace => "workspace",
            Self::Friction => "friction",
        }
    }

    /// The file.
    pub fn text(self) -> &'static str {
        match self {
            Self::Payload => include_str!("starters/payload.toml"),
            Self::Modules => include_str!("starters/modules.toml"),
            Self::Stiffness => include_str!("starters/stiffness.toml"),
            Self::Workspace => include_str!("starters/workspace.toml"),
            Self::Friction => include_str!("starters/friction.toml"),
        }
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

    use super::*;
    use crate::study::Study;
    use std::path::Path;

    #[test]
    fn starters_are_studies_and_say_so() {
        for starter in Starter::ALL {
            let study = Study::parse(starter.text(), Path::new(""), Path::new("starter.toml"));
            assert!(!study.unwrap().title.is_empty());
            let comments = starter
                .text()
                .lines()
                .filter(|line| line.starts_with('#'))
                .count();
            assert!(comments >= 5, "{}", starter.name());
        }
    }
}
