//! What a study computes of each configuration.

use serde::{Deserialize, Serialize};

use super::column::{Column, Kind};

/// An output, named as the field names it.
#[non_exhaustive]
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Output {
    /// Pose of the tip disc.
    Tip,
    /// How far the loads move the tip from where the command alone puts it.
    Deflection,
    /// Smallest and largest tension, and the margin to the limit.
    Tension,
    /// The potential energy.
    Energy,
    /// What kind of equilibrium it is, and its smallest stiffness.
    Stability,
    /// Compliance of the tip to forces, and its anisotropy.
    Compliance,
    /// The ellipsoid of tip motions under commands of unit norm.
    Manipulability,
    /// The ellipsoid of forces that the tip, fixed in place, exerts under commands of unit norm.
    Force,
    /// What the robot touches, and how hard.
    Contact,
    /// Equilibria found from random poses.
    Equilibria,
    /// The loop of the tip as one tendon is pulled and let go, with friction.
    Hysteresis,
    /// Newton steps, and time on the clock.
    Cost,
    /// How far the clouds of a trained model are from those that cameras see.
    Model,
    /// The reachable workspace of all sampled commands: a row of `summary.csv`.
    Workspace,
    /// The share of directions that the tip takes at a place, over all sampled commands: a row of `summary.csv`.
    Dexterity,
}

/// Whether the tension has a limit.
pub(in crate::study) type Limited = bool;

impl Output {
    /// All outputs.
    pub const ALL: [Self; 15] = [
        Self::Tip,
        Self::Deflection,
        Self::Tension,
        Self::Energy,
        Self::Stability,
        Self::Compliance,
        Self::Manipulability,
        Self::Force,
        Self::Contact,
        Self::Equilibria,
        Self::Hysteresis,
        Self::Cost,
        Self::Model,
        Self::Workspace,
        Self::Dexterity,
    ];

    /// Its name in files.
    pub fn name(self) -> &'static str {
        match self {
            Self::Tip => "tip",
            Self::Deflection => "deflection",
            Self::Tension => "tension",
            Self::Energy => "energy",
            Self::Stability => "stability",
            Self::Compliance => "compliance",
            Self::Manipulability => "manipulability",
            Self::Force => "force",
            Self::Contact => "contact",
            Self::Equilibria => "equilibria",
            Self::Hysteresis => "hysteresis",
            Self::Cost => "cost",
            Self::Model => "model",
            Self::Workspace => "workspace",
            Self::Dexterity => "dexterity",
        }
    }

    /// Whether it is of all sampled commands together, as the tips of their rows tell.
    pub(in crate::study) fn is_of_tips(self) -> bool {
        matches!(self, Self::Workspace | Self::Dexterity)
    }

    /// Its columns in the table; what [is of tips](Self::is_of_tips) needs those of the tip.
    pub(in crate::study) fn columns(self, limited: Limited) -> Vec<Column> {
        let number = |name, unit| Column::new(name, unit, Kind::Number);
        let whole = |name| Column::new(name, "", Kind::Whole);
        match self {
            Self::Tip => vec![
                number("tip_x", "m"),
                number("tip_y", "m"),
                number("tip_z", "m"),
                number("tip_qw", ""),
                number("tip_qx", ""),
                number("tip_qy", ""),
                number("tip_qz", ""),
            ],
            Self::Deflection => vec![number("deflection", "m"), number("sag", "m")],
            Self::Tension => {
                let mut columns = vec![number("tension_min", "N"), number("tension_max", "N")];
                if limited {
                    columns.push(number("tension_margin", "N"));
                }
                columns
            }
            Self::Energy => vec![number("energy", "J")],
            Self::Stability => vec![
                Column::new("stability", "", Kind::Text),
                Column::new("examined", "", Kind::Text),
                number("smallest_stiffness", "N m/rad"),
            ],
            Self::Compliance => vec![
                number("compliance_min", "m/N"),
                number("compliance_max", "m/N"),
                number("anisotropy", ""),
            ],
            Self::Manipulability => vec![
                number("motion_min", "m per command"),
                number("motion_mid", "m per command"),
                number("motion_max", "m per command"),
                number("manipulability", "m\u{b3} per command\u{b3}"),
            ],
            Self::Force => vec![
                number("force_min", "N per command"),
                number("force_mid", "N per command"),
                number("force_max", "N per command"),
            ],
            Self::Contact => vec![
                whole("contacts"),
                number("contact_max", "N"),
                number("contact_sum", "N"),
                number("penetration", "m"),
                number("gap", "m"),
            ],
            Self::Equilibria => vec![whole("equilibria"), number("equilibria_apart", "m")],
            Self::Hysteresis => vec![
                number("loop_width", "m"),
                number("loop_area", "m x command"),
                number("loop_loss", "J"),
            ],
            Self::Cost => vec![whole("newton_steps"), number("settle_time", "s")],
            Self::Model => vec![
                number("model_cd", "m\u{b2}"),
                number("model_emd", "m"),
                number("model_tip", "m"),
                number("floor_cd", "m\u{b2}"),
                number("floor_emd", "m"),
            ],
            Self::Workspace | Self::Dexterity => Vec::new(),
        }
    }

    /// What its figures are titled.
    pub(in crate::study) fn heading(self) -> &'static str {
        match self {
            Self::Tip => "Place of the tip",
            Self::Deflection => "Deflection under load",
            Self::Tension => "Tendon tension",
            Self::Energy => "Potential energy",
            Self::Stability => "Stability",
            Self::Compliance => "Compliance of the tip",
            Self::Manipulability => "Manipulability",
            Self::Force => "Forces of the tip held in place",
            Self::Contact => "Contact",
            Self::Equilibria => "Equilibria",
            Self::Hysteresis => "Hysteresis",
            Self::Cost => "Cost of settling",
            Self::Model => "Error of the trained model",
            Self::Workspace => "Workspace",
            Self::Dexterity => "Dexterity",
        }
    }

    /// What a figure on a column is titled; the column's name otherwise.
    pub(in crate::study) fn title(column: &str) -> Option<&'static str> {
        Some(match column {
            "tip_x" => "Tip position x",
            "tip_y" => "Tip position y",
            "tip_z" => "Tip height",
            "deflection" => "Deflection of the tip",
            "sag" => "Sag of the tip",
            "tension_min" => "Smallest tendon tension",
            "tension_max" => "Largest tendon tension",
            "tension_margin" => "Margin to the tension limit",
            "energy" => "Potential energy",
            "smallest_stiffness" => "Smallest stiffness",
            "compliance_min" => "Smallest tip compliance",
            "compliance_max" => "Largest tip compliance",
            "anisotropy" => "Anisotropy of the tip compliance",
            "motion_min" => "Shortest axis of the motion ellipsoid",
            "motion_mid" => "Middle axis of the motion ellipsoid",
            "motion_max" => "Longest axis of the motion ellipsoid",
            "manipulability" => "Manipulability",
            "force_min" => "Shortest axis of the force ellipsoid",
            "force_mid" => "Middle axis of the force ellipsoid",
            "force_max" => "Longest axis of the force ellipsoid",
            "contacts" => "Contacts",
            "contact_max" => "Largest contact force",
            "contact_sum" => "Sum of contact forces",
            "penetration" => "Deepest penetration",
            "gap" => "Smallest gap to obstacles",
            "equilibria" => "Equilibria found",
            "equilibria_apart" => "Largest distance between equilibria",
            "loop_width" => "Width of the hysteresis loop",
            "loop_area" => "Area of the hysteresis loop",
            "loop_loss" => "Energy lost in the holes in a hysteresis loop",
            "newton_steps" => "Newton steps",
            "settle_time" => "Time to settle",
            "model_cd" => "Chamfer distance",
            "model_emd" => "Earth mover's distance",
            "model_tip" => "Error of the predicted tip",
            "volume" => "Volume of the workspace",
            _ => return None,
        })
    }

    /// The column whose values a figure on this one shows as a dashed line: what no better predictor would be below.
    pub(in crate::study) fn reference(column: &str) -> Option<&'static str> {
        match column {
            "model_cd" => Some("floor_cd"),
            "model_emd" => Some("floor_emd"),
            _ => None,
        }
    }

    /// Whether a column is such a reference.
    pub(in crate::study) fn is_reference(column: &str) -> bool {
        matches!(column, "floor_cd" | "floor_emd")
    }
}
