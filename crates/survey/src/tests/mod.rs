//! Tests with complete documents.

use super::*;
use crate::testkit::documents::*;
use std::path::{Path, PathBuf};
use vlscan_base::diag::{Diagnostics, Severity};
use vlscan_base::error::Error;
use vlscan_render::Render as _;

mod conformance;
mod hostile;
mod instruments;
mod limits;
mod ouster;
mod patterns;
mod pulse_times;
mod receivers;
mod scan_motion;
mod scenes;
mod surveys;
mod values;
mod weather;

/// Reads a survey whose document has the default assets.
fn survey_of(extra: &str, attributes: &str, content: &str) -> vlscan_base::Result<(Survey, Diagnostics)> {
    let folder = Folder::new(&[("survey.xml", &document(extra, attributes, content)), ("a.obj", "")]);
    folder.read(&ReadOptions::default())
}

/// Reads a survey on the aeroplane, which must cause no diagnostics.
fn clean(extra: &str, content: &str) -> Survey {
    let (survey, warnings) =
        survey_of(extra, "platform='plane'", content).unwrap_or_else(|e| panic!("{}", report(&e)));
    assert!(warnings.is_empty(), "{}", warnings.render(false));
    survey
}

/// Reads the survey of a pipeline file.
fn read_pipeline(path: &Path) -> vlscan_base::Result<(Survey, Diagnostics)> {
    let source = Source::read(path)?;
    let reading = ReadOptions { assets: vec![source.folder().to_path_buf()], ..ReadOptions::default() };
    let (read, warnings) = read_pipeline_survey(source.tables()?, &reading)?;
    Ok((read.survey, warnings))
}
