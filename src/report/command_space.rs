//! The section on errors over the space of commands: where predictions are bad.

use tdcr_base::stats::{quantile, sorted};

use super::PerTest;
use super::color_scale::color_at;
use super::figure::{Aspect, Figure, Ink, Mark, Panel, Scale, Shape, Spacing};
use super::html::{column_decimals, fixed};
use super::motors::MotorGroup;
use super::sections::{CD_TITLE, CD_UNIT, figure};

/// Maps over pairs of motors, at most, and how many lie side by side.
const MAPS: usize = 24;
const ACROSS: usize = 3;
/// Shares of the test commands with the first and the last colour.
const ENDS: [f64; 2] = [0.05, 0.95];

/// A plot of the error over the distance to the training data, and maps of it over pairs of motors that belong together;
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
    let apart = apart(tests, &cds, &colors).map_or_else(String::new, |plot| {
        figure(
            "figures",
            &plot.to_svg(),
            "A dot is a test command. The distance is Euclidean, each number of a command in units of its range in the \
             training data. Dots that rise to the right say that more training commands would help.",
        )
    });
    let maps: String = maps(tests, motors, &cds, &colors)
        .iter()
        .map(Figure::to_svg)
        .collect();
    format!(
        "<section><h2>Errors over the commands</h2>{}{apart}<div class=\"figures maps\">{maps}</div>\
         <p class=\"note\">Each map shows the test commands over two motors of a module; the others differ from dot to \
         dot. Dark dots that lie together mark commands that the network predicts badly.</p></section>",
        colors.legend(),
    )
}

/// The error over the distance to the nearest training command; `None` where no command has a place.
fn apart(tests: &PerTest, cds: &[f64], colors: &Colors) -> Option<Figure> {
    let places = tests.apart.iter().zip(cds).map(|(&apart, &cd)| [apart, cd]);
    let shown = |place: &[f64; 2]| place[0].is_finite() && Spacing::Log.shows(place[1]);
    let any = places.clone().any(|place| shown(&place));
    any.then(|| Figure {
        title: "Chamfer distance over the distance to the nearest training command".to_owned(),
        caption: String::new(),
        panels: vec![Panel {
            title: String::new(),
            x: Scale::linear("Distance to the nearest training command (ranges)"),
            y: Scale::log(CD_TITLE),
            aspect: Aspect::Free,
            marks: dots(places, cds, colors),
        }],
    })
}

/// The test commands over pairs of motors, a figure or more for each group of them.
fn maps(tests: &PerTest, motors: &[MotorGroup], cds: &[f64], colors: &Colors) -> Vec<Figure> {
    let mut left = MAPS;
    let mut figures = Vec::new();
    for group in motors {
        let panels = pairs(group).into_iter().take(left);
        let panels = panels.filter_map(|pair| map(tests, pair, group, cds, colors));
        let panels: Vec<Panel> = panels.collect();
        left -= panels.len();
        let title = match group.name.as_str() {
            "" => "Chamfer distance over two motors".to_owned(),
            name => format!("Chamfer distance over two motors, {name}"),
        };
        figures.extend(panels.chunks(ACROSS).map(|panels| Figure {
            title: title.clone(),
            caption: String::new(),
            panels: panels.to_vec(),
        }));
    }
    figures
}

/// Pairs of neighbouring motors in a group, around it: a module's tendons stand in a circle.
fn pairs(group: &MotorGroup) -> Vec<[usize; 2]> {
    let motors = &group.motors;
    let last = motors.end.saturating_sub(1);
    // Two motors make one pair, not two.
    let closing = (motors.len() > 2).then_some([last, motors.start]);
    let open = (motors.start..last).map(|k| [k, k + 1]);
    open.chain(closing).collect()
}

/// The test commands over two motors; `None` where none has a place.
fn map(
    tests: &PerTest,
    pair: [usize; 2],
    group: &MotorGroup,
    cds: &[f64],
    colors: &Colors,
) -> Option<Panel> {
    let axis = |motor| Scale::linear(&format!("Motor {} ({})", motor + 1, group.unit_name()));
    let value = |command: &[f64], motor: usize| {
        let value = command.get(motor);
        value.map_or(f64::NAN, |&value| group.shown(value))
    };
    let places = (tests.commands.iter()).map(|command| pair.map(|motor| value(command, motor)));
    let any = places.clone().any(|[x, y]| x.is_finite() && y.is_finite());
    any.then(|| Panel {
        title: String::new(),
        x: axis(pair[0]),
        y: axis(pair[1]),
        aspect: Aspect::Free,
        marks: dots(places, cds, colors),
    })
}

/// Dots at places, coloured by their error, the worst on top.
fn dots(places: impl Iterator<Item = [f64; 2]>, cds: &[f64], colors: &Colors) -> Vec<Mark> {
    let mut dots: Vec<([f64; 2], f64)> = places.zip(cds.iter().copied()).collect();
    dots.sort_by(|(_, a), (_, b)| a.total_cmp(b));
    let color = |dot: &([f64; 2], f64)| colors.of_value(dot.1);
    let alike = dots.chunk_by(|a, b| color(a) == color(b));
    let mark = |dots: &[([f64; 2], f64)]| Mark {
        name: String::new(),
        shape: Shape::Discs,
        ink: Ink::Of(color(&dots[0])),
        points: dots.iter().map(|(place, _)| *place).collect(),
    };
    alike.map(mark).collect()
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
        let found: Vec<[usize; 2]> = groups.iter().flat_map(pairs).collect();
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
