//! The section on errors over the space of commands: where predictions are bad.

use tdcr_base::stats::{quantile, sorted};

use super::PerTest;
use super::chart::{AxisStyle, Dot, dot_chart};
use super::color_scale::color_at;
use super::figure::Spacing;
use super::html::{column_decimals, fixed};
use super::motors::MotorGroup;
use super::sections::{CD_TITLE, CD_UNIT, figure};

/// Maps over pairs of motors, at most.
const MAPS: usize = 24;
/// Shares of the test commands with the first and the last colour.
const ENDS: [f64; 2] = [0.05, 0.95];

/// A chart of the error over the distance to the training data, and maps of it over pairs of motors that belong together;
/// nothing where the commands are not known.
pub(crate) fn section(per_test: Option<&PerTest>, motors: &[MotorGroup]) -> String {
    let Some(tests) = per_test.filter(|tests| !tests.commands.is_empty()) else {
        return String::new();
    };
    let evaluated = tests.methods.iter().take(1);
    let cds: Vec<f64> = evaluated
        .flat_map(|method| method.values.iter().map(|cd| cd / CD_UNIT))
        .collect();
    let Some(colors) = Colors::of(&cds) else {
        return String::new();
    };
    let apart = dot_chart(
        "Chamfer distance over the distance to the nearest training command",
        &AxisStyle {
            title: "Distance to the nearest training command (ranges)",
            spacing: Spacing::Linear,
        },
        &AxisStyle {
            title: CD_TITLE,
            spacing: Spacing::Log,
        },
        &dots(
            tests.apart.iter().copied().zip(cds.iter().copied()),
            &cds,
            &colors,
        ),
    );
    let apart = apart.map_or_else(String::new, |chart| {
        figure(
            "single",
            &chart,
            "A dot is a test command. The distance is Euclidean, each number of a command in units of its range in the \
             training data. Dots that rise to the right say that more training commands would help.",
        )
    });
    let maps: String = pairs(motors)
        .into_iter()
        .take(MAPS)
        .filter_map(|pair| map(tests, pair, &cds, &colors))
        .collect();
    format!(
        "<section><h2>Errors over the commands</h2>{}{apart}<div class=\"maps\">{maps}</div>\
         <p class=\"note\">Each map shows the test commands over two motors of a module; the others differ from dot to \
         dot. Dark dots that lie together mark commands that the network predicts badly.</p></section>",
        colors.legend(),
    )
}

/// Pairs of neighbouring motors in each group, around it: a module's tendons stand in a circle.
fn pairs(motors: &[MotorGroup]) -> Vec<[(usize, &MotorGroup); 2]> {
    let of_group = |group| {
        let MotorGroup { motors, .. }: &MotorGroup = group;
        let last = motors.end.saturating_sub(1);
        // Two motors make one pair, not two.
        let closing = (motors.len() > 2).then_some([last, motors.start]);
        let open = (motors.start..last).map(|k| [k, k + 1]);
        open.chain(closing)
            .map(move |pair| pair.map(|motor| (motor, group)))
    };
    motors.iter().flat_map(of_group).collect()
}

/// The test commands over two motors.
fn map(
    tests: &PerTest,
    pair: [(usize, &MotorGroup); 2],
    cds: &[f64],
    colors: &Colors,
) -> Option<String> {
    let titles = pair.map(|(motor, group)| format!("Motor {} ({})", motor + 1, group.unit_name()));
    let [x, y] = titles.each_ref().map(|title| AxisStyle {
        title,
        spacing: Spacing::Linear,
    });
    let value = |command: &[f64], (motor, group): (usize, &MotorGroup)| {
        command
            .get(motor)
            .map_or(f64::NAN, |&value| group.shown(value))
    };
    let places = (tests.commands.iter()).map(|c| (value(c, pair[0]), value(c, pair[1])));
    let name = format!("Chamfer distance over {} and {}", titles[0], titles[1]);
    dot_chart(&name, &x, &y, &dots(places, cds, colors))
}

/// Dots at places, coloured by their error, the worst on top.
fn dots(places: impl Iterator<Item = (f64, f64)>, cds: &[f64], colors: &Colors) -> Vec<Dot> {
    let mut dots: Vec<(f64, Dot)> = places
        .zip(cds)
        .map(|(place, &cd)| {
            let color = colors.of_value(cd);
            (cd, Dot { place, color })
        })
        .collect();
    dots.sort_by(|a, b| a.0.total_cmp(&b.0));
    dots.into_iter().map(|(_, dot)| dot).collect()
}

/// Colours of errors, on a logarithmic scale between quantiles.
struct Colors {
    ends: [f64; 2],
}

impl Colors {
    fn of(cds: &[f64]) -> Option<Self> {
        let shown = sorted(cds.iter().copied().filter(|&x| Spacing::Log.shows(x)));
        let ends = ENDS.map(|share| quantile(&shown, share));
        (!shown.is_empty()).then_some(Self { ends })
    }

    fn of_value(&self, cd: f64) -> [u8; 3] {
        let [low, high] = self.ends;
        match high > low {
            true => color_at((cd.max(low) / low).ln() / (high / low).ln()),
            // All are alike.
            false => color_at(0.0),
        }
    }

    fn legend(&self) -> String {
        let decimals = column_decimals(self.ends);
        let [low, high] = self.ends.map(|end| fixed(end, decimals));
        format!(
            "<ul class=\"legend\"><li>{CD_TITLE}: {low} or less <i class=\"scale\"></i> {high} or more, logarithmic</li></ul>"
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pairs_go_around_each_group_of_motors() {
        let group = |motors| MotorGroup {
            name: String::new(),
            motors,
            unit: None,
        };
        let groups = [
            group(0..3),
            group(3..7),
            group(7..9),
            group(9..10),
            group(10..10),
        ];
        let found: Vec<[usize; 2]> = pairs(&groups).iter().map(|p| p.map(|(k, _)| k)).collect();
        let expected = [
            [0, 1],
            [1, 2],
            [2, 0],
            [3, 4],
            [4, 5],
            [5, 6],
            [6, 3],
            [7, 8],
        ];
        assert_eq!(found, expected);
    }
}
