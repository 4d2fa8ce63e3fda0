//! The page and the pictures of a study.

use std::io::Write;
use std::path::Path;

use nalgebra::Vector3;
use tdcr_base::files::write_atomically;
use tdcr_sim::scene::Scene;

use super::outputs::draw;
use super::{dexterity, hysteresis, training};
use crate::report::{
    Aspect, Figure, Ink, Mark, Panel, Scale, Shape, StudyFigure, StudyPage, Surface, Window,
    counted, sections,
};
use crate::study::error::StudyError;
use crate::study::outputs::dexterity::Dexterity;
use crate::study::outputs::record::Record;
use crate::study::outputs::summary::{Group, Groups};
use crate::study::outputs::table::Table;
use crate::study::outputs::workspace::{Workspace, bounds};
use crate::study::spec::case;
use crate::study::spec::cases::Cases;
use crate::study::spec::models::Models;
use crate::study::spec::variable::{phrase, plain};
use crate::study::spec::{Output, Variable};

/// Workspaces that are drawn, at most.
const WORKSPACES: usize = 6;
/// Maps of dexterity beside each other, at most.
const DEXTERITIES: usize = 3;
/// Thickness of the slice whose tips are drawn, as a share of the extent.
const SLICE: f64 = 0.06;

/// Writes `report.html` and `figures/*.svg`.
pub(in crate::study) fn write(
    cases: &Cases,
    record: &Record,
    table: &Table,
    dir: &Path,
) -> Result<(), StudyError> {
    let study = &record.study;
    let mut figures = Vec::new();
    let mut surfaces = Vec::new();
    let mut dexterities = Vec::new();
    let groups = match study.want.iter().any(|want| want.is_of_tips()) {
        true => groups(record, table)?,
        false => Vec::new(),
    };
    for mut group in groups {
        let name = combination(cases, group.combination);
        if study.want.contains(&Output::Dexterity) && dexterities.len() < DEXTERITIES {
            let found = Dexterity::new(group.axes.take(), study.dexterity_radius);
            dexterities.push((name.clone(), found));
        }
        if study.want.contains(&Output::Workspace) {
            let workspace = Workspace::new(group.tips.take(), study.alpha);
            figures.push(section_figure(
                &workspace,
                &name,
                surfaces.len(),
                &study.robot_phrase(),
                // The row was computed among them.
                &case::scene(
                    study,
                    &cases.case(group.combination * study.samples()).settings,
                )
                .unwrap_or_default(),
            ));
            surfaces.push(Surface {
                name,
                points: workspace
                    .shape
                    .points()
                    .iter()
                    .map(|p| (*p).into())
                    .collect(),
                triangles: workspace.shape.boundary(),
            });
        }
    }
    figures.extend(dexterity::figure(&dexterities, &study.robot_phrase()));
    figures.extend(draw(cases, record, table)?);
    if study.want.contains(&Output::Hysteresis) {
        figures.extend(hysteresis::figure(study, cases, &study.robot_phrase()));
    }
    figures.extend(training::figure(study));
    let folder = dir.join("figures");
    let fail = |path: &Path| {
        let path = path.to_owned();
        move |source| StudyError::Write { path, source }
    };
    std::fs::create_dir_all(&folder).map_err(fail(&folder))?;
    for StudyFigure { name, svg } in &figures {
        let path = folder.join(format!("{name}.svg"));
        write_atomically(&path, |file| file.write_all(svg.as_bytes())).map_err(fail(&path))?;
    }
    let page = StudyPage {
        title: study.title.clone(),
        headline: format!(
            "{} of {} settled.",
            record.settled,
            counted(record.rows, "configuration")
        ),
        figures,
        surfaces,
        surfaces_note: "The boundary of the places that the tip reaches under the sampled commands: their alpha shape.".to_owned(),
        summary: summary(record),
    };
    let path = dir.join("report.html");
    write_atomically(&path, |file| file.write_all(page.to_html().as_bytes())).map_err(fail(&path))
}

/// What was run, but for times: the page is the same whoever draws it.
fn summary(record: &Record) -> Vec<(String, String)> {
    let study = &record.study;
    let mut rows = vec![
        ("Robot".to_owned(), study.robot_name.clone()),
        ("Configurations".to_owned(), record.rows.to_string()),
        ("Seed".to_owned(), study.seed.to_string()),
        ("Version of tdcr".to_owned(), record.tdcr_version.clone()),
    ];
    if !study.scene.is_empty() {
        let names = study
            .scene
            .obstacles()
            .iter()
            .map(|obstacle| obstacle.name.as_str());
        rows.insert(
            1,
            ("Obstacles".to_owned(), names.collect::<Vec<_>>().join(", ")),
        );
    }
    let name = |what: &Variable| match study.unit(what) {
        "" => what.name().to_owned(),
        unit => format!("{what} ({unit})"),
    };
    for (path, model) in study.models.iter().flat_map(Models::all) {
        rows.push((format!("Model: {path}"), model.phrase()));
    }
    for (what, value) in &study.set {
        rows.push((format!("Fixed: {}", name(what)), value.to_string()));
    }
    for levels in &study.levels {
        let ends = [levels.values.first(), levels.values.last()];
        let text = match ends {
            [Some(first), Some(last)] if levels.values.len() > 8 => {
                format!(
                    "{} values, {} to {}",
                    levels.values.len(),
                    plain(first),
                    plain(last)
                )
            }
            _ => levels
                .values
                .iter()
                .map(plain)
                .collect::<Vec<_>>()
                .join(", "),
        };
        rows.push((format!("Varied: {}", name(&levels.what)), text));
    }
    if let Some(sample) = study.sample {
        let text = format!("{} points, {}", sample.count, sample.design.name());
        for sampled in &study.sampled {
            let range = sampled
                .range
                .map_or("the tendons' ranges".to_owned(), |[low, high]| {
                    format!("{low} to {high}")
                });
            rows.push((
                format!("Sampled: {}", name(&sampled.what)),
                format!("{range}; {text}"),
            ));
        }
    }
    rows
}

/// The tips of the first combinations of levels.
fn groups(record: &Record, table: &Table) -> Result<Vec<Group>, StudyError> {
    let mut groups = Groups::new(table.columns, &[], record.study.samples());
    let mut found: Vec<Group> = Vec::new();
    table.rows(|row, cells| {
        if let Some(ended) = groups.add(row, &cells)
            && found.len() < WORKSPACES
        {
            found.push(ended);
        }
        Ok(())
    })?;
    if found.len() < WORKSPACES {
        found.extend(groups.group.take());
    }
    Ok(found)
}

/// The values of a combination, a phrase.
fn combination(cases: &Cases, combination: usize) -> String {
    match phrase(&cases.levels(combination)) {
        none if none.is_empty() => "all commands".to_owned(),
        phrase => phrase,
    }
}

/// A length (m) in whole millimetres, never the negative zero.
fn millimetres(length: f64) -> f64 {
    (1e3 * length).round() + 0.0
}

/// Two sections of a workspace: the tips nearby, the outline of the alpha shape, and that of obstacles.
fn section_figure(
    workspace: &Workspace,
    name: &str,
    number: usize,
    robot: &str,
    scene: &Scene,
) -> StudyFigure {
    let points = workspace.shape.points();
    let (low, high) = bounds(points);
    let middle = (low + high) / 2.0;
    let extent = (high - low).max();
    let panel = |title: String, normal: Vector3<f64>, [right, up]: [usize; 2]| {
        let flat = |p: &Vector3<f64>| [1e3 * p[right], 1e3 * p[up]];
        let near = points
            .iter()
            .filter(|p| ((*p - middle).dot(&normal)).abs() < SLICE * extent / 2.0);
        let outline = workspace.shape.outline(&middle, &normal);
        let mark = |shape, ink, points| Mark {
            name: String::new(),
            shape,
            ink,
            points,
        };
        let window = Window::around(points.iter().map(flat));
        let obstacles = sections(scene, &normal, &middle, window, flat);
        let axis = |k: usize| Scale::linear(["x (mm)", "y (mm)", "z (mm)"][k]);
        Panel {
            title,
            x: axis(right),
            y: axis(up),
            aspect: Aspect::Equal,
            marks: vec![
                mark(Shape::Specks, Ink::Blue, near.map(flat).collect()),
                mark(
                    Shape::Segments,
                    Ink::Black,
                    outline.iter().map(flat).collect(),
                ),
                obstacles,
            ],
        }
    };
    let area = |normal| 1e4 * workspace.shape.section(&middle, &normal);
    let (y, z) = (Vector3::y(), Vector3::z());
    let figure = Figure {
        title: format!("Reachable workspace: {name}"),
        caption: format!(
            "Sections through the middle of all tips. Black: outline of the alpha shape of {} tips (alpha {:.1} mm, volume {:.3} \
             dm\u{b3}); blue: tips within {:.0} mm of the plane{}. {robot}",
            points.len(),
            1e3 * workspace.shape.alpha,
            1e3 * workspace.shape.volume,
            1e3 * SLICE * extent / 2.0,
            match scene.obstacles().is_empty() {
                true => "",
                false => "; vermilion: obstacles",
            }
        ),
        panels: vec![
            panel(
                format!(
                    "y = {:.0} mm: {:.0} cm\u{b2}",
                    millimetres(middle.y),
                    area(y)
                ),
                y,
                [0, 2],
            ),
            panel(
                format!(
                    "z = {:.0} mm: {:.0} cm\u{b2}",
                    millimetres(middle.z),
                    area(z)
                ),
                z,
                [0, 1],
            ),
        ],
    };
    StudyFigure {
        name: format!("workspace-{}", number + 1),
        svg: figure.to_svg(),
    }
}
