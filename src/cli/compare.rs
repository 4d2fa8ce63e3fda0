//! `tdcr compare`.

use std::fmt::Write;
use std::path::PathBuf;

use clap::Args;
use serde::Serialize;
use tdcr::pages::comparison_page;
use tdcr::pipeline::{
    CompareSettings, Comparer, Comparison, Configuration, Place, Reference, Spread, visibility,
};

use super::console::Console;
use super::output;

/// Compare two data sets, or a captured one with the simulator, configuration by configuration
///
/// Pairs the samples of equal commands and payloads, and says how far their clouds and tips are apart.
#[derive(Debug, Args)]
pub(super) struct CompareArgs {
    /// Folder of a data set
    #[arg(value_name = "A")]
    a: PathBuf,
    /// Folder of another one [default: what the simulator sees under the commands and payloads of A, with perfect cameras]
    #[arg(value_name = "B")]
    b: Option<PathBuf>,
    /// The robot to simulate where there is no B: 2m, 3m, 5m, or the path of a robot file [default: the robot of A]
    #[arg(long, value_name = "ROBOT", conflicts_with_all = ["b", "matched"])]
    robot: Option<String>,
    /// Show the robot's base to the simulator's cameras, where A does not say whether it is in view
    #[arg(long, conflicts_with_all = ["b", "matched"])]
    base: bool,
    #[command(flatten)]
    settings: CompareSettings,
    /// How many of the worst configurations, by Chamfer distance, to list and to show in the report
    #[arg(long, default_value_t = 5, value_name = "N")]
    worst: usize,
    /// Write an HTML page: table, pictures of both clouds over each other, a 3-D view of the worst
    #[arg(long, value_name = "FILE.html")]
    report: Option<PathBuf>,
}

#[derive(Serialize)]
struct Compared<'a> {
    a: &'a PathBuf,
    /// `null` for the simulator.
    b: Option<&'a PathBuf>,
    #[serde(flatten)]
    comparison: &'a Comparison,
}

pub(super) fn run(args: &CompareArgs, console: &Console) -> anyhow::Result<()> {
    if let Some(path) = &args.report {
        output::format("--report", path, &["html"])?;
    }
    let robot = args.robot.as_deref().map(super::load_robot).transpose()?;
    let other = match &args.b {
        Some(b) => Reference::Set(b),
        None => Reference::Simulator {
            robot: robot.as_ref(),
            base: visibility(args.base),
        },
    };
    let comparer =
        Comparer::new(&args.a, other, &args.settings).map_err(super::eval::named_as_option)?;
    let comparison = comparer.run(args.worst, console)?;
    let compared = Compared {
        a: &args.a,
        b: args.b.as_ref(),
        comparison: &comparison,
    };
    console.result(&compared, |compared| text(compared.comparison))?;
    // After the result: a page that cannot be written costs nothing but the page.
    if let Some(path) = &args.report {
        let page = comparison_page(&args.a, args.b.as_deref(), &comparer, &comparison)?;
        output::write(path, page.to_html())?;
    }
    Ok(())
}

/// The table of distances, and the worst configurations.
fn text(comparison: &Comparison) -> String {
    let mut text = format!(
        "{:20}{:>10}{:>10}{:>10}{:>10}\n",
        "", "mean", "median", "95 %", "worst"
    );
    let mut row = |name: &str, per_unit: f64, spread: &Spread| {
        let quantiles = &spread.quantiles;
        let columns = [spread.mean, quantiles.median, quantiles.p95, quantiles.max];
        let [mean, median, p95, worst] = columns.map(|x| x * per_unit);
        // Writing to a string cannot fail.
        let _ = writeln!(
            text,
            "{name:20}{mean:10.4}{median:10.4}{p95:10.4}{worst:10.4}"
        );
    };
    row("CD (1e-4 m²)", 1e4, &comparison.cd);
    row("EMD (mm)", 1e3, &comparison.emd);
    row("sq. EMD (1e-4 m²)", 1e4, &comparison.emd_squared);
    if let Some(tip) = &comparison.tip {
        row("tip (mm)", 1e3, tip);
    }
    for (rank, &k) in comparison.worst.iter().enumerate() {
        text += &worst(rank, &comparison.configurations[k]);
    }
    let [a, b] = comparison.unpaired;
    format!(
        "{text}over {} configurations in common ({a} and {b} samples are in none); CD on {} points, EMD on {}",
        comparison.pairs, comparison.points, comparison.emd_points
    )
}

fn worst(rank: usize, configuration: &Configuration) -> String {
    let place = |Place { split, index }: Place| format!("{} {index}", split.folder());
    let other = configuration.b.filter(|&b| b != configuration.a);
    let other = other.map_or(String::new(), |b| format!(" ({} of B)", place(b)));
    let command: Vec<String> = configuration.command.iter().map(f32::to_string).collect();
    let payload = (configuration.payload).map_or(String::new(), |kg| format!(" --payload {kg}"));
    let tip = (configuration.tip).map_or(String::new(), |tip| format!(", tip {:.3} mm", 1e3 * tip));
    format!(
        "{:>6} {}{other}: CD {:.4}e-4 m², EMD {:.3} mm{tip}   --command {}{payload}\n",
        if rank == 0 { "worst:" } else { "" },
        place(configuration.a),
        1e4 * configuration.distances.cd,
        1e3 * configuration.distances.emd,
        command.join(",")
    )
}
