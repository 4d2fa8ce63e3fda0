//! Drawings of data sets.

use std::path::Path;

use super::{PageError, SetInfo, set_name};
use crate::pipeline::{Monitor, Survey, Tips};
use crate::report::{DataPage, MotorGroup, SetSummary};

/// Clouds of each data set that a drawing shows, where nobody asks for another number.
pub const CLOUDS_SHOWN: usize = 8;

/// What is drawn of data sets.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum DataDrawing {
    /// All of it, as an HTML page.
    Page,
    /// The workspace, as SVG.
    Workspace,
    /// The clouds of one data set, as PNG.
    Clouds,
}

impl DataDrawing {
    /// What the extension of the file to write asks for, of so many data sets.
    ///
    /// # Errors
    /// [`PageError::DrawingFormat`] for an extension that stands for no drawing, [`PageError::SeveralSets`] where a
    /// picture of clouds is to show several data sets.
    pub fn of(path: &Path, sets: usize) -> Result<Self, PageError> {
        let extension = path.extension().and_then(|extension| extension.to_str());
        match extension {
            Some("png") if sets != 1 => Err(PageError::SeveralSets { found: sets }),
            Some("png") => Ok(Self::Clouds),
            Some("svg") => Ok(Self::Workspace),
            Some("html") => Ok(Self::Page),
            _ => Err(PageError::DrawingFormat {
                path: path.to_owned(),
            }),
        }
    }

    /// Draws the data sets in the folders `dirs`, with up to `clouds` clouds of each.
    ///
    /// # Errors
    /// [`PageError::Stage`] where a data set cannot be read, a robot of it does not settle, or the monitor asks to stop.
    pub fn draw(
        self,
        dirs: &[impl AsRef<Path>],
        clouds: usize,
        monitor: &dyn Monitor,
    ) -> Result<Vec<u8>, PageError> {
        let summary = |dir| summary(AsRef::as_ref(dir), clouds, monitor);
        let sets: Result<Vec<SetSummary>, PageError> = dirs.iter().map(summary).collect();
        let page = DataPage { sets: sets? };
        Ok(match self {
            Self::Clouds => page.sets.first().map_or_else(Vec::new, |set| set.sheet().0),
            Self::Workspace => page.workspace().to_svg().into_bytes(),
            Self::Page => page.to_html().into_bytes(),
        })
    }
}

fn summary(dir: &Path, clouds: usize, monitor: &dyn Monitor) -> Result<SetSummary, PageError> {
    let survey = Survey::open(dir)?;
    let (tips, note) = match survey.tips(monitor)? {
        Tips::Settled(tips) => (tips, "The tips of simulated sets are settled again."),
        Tips::Estimated(tips) => (
            tips,
            "Those of other sets are estimated from the clouds: the mean of the 2 % of the points that are \
             farthest from the lowest.",
        ),
    };
    Ok(SetSummary {
        name: set_name(dir),
        facts: SetInfo::new(dir, &survey)?.facts(),
        motors: (0..survey.motors()).map(|k| survey.motor(k)).collect(),
        groups: MotorGroup::of(survey.robot(), survey.motors()),
        payloads: survey.payloads(),
        tips,
        tips_note: note.to_owned(),
        clouds: survey.clouds(clouds)?,
    })
}
