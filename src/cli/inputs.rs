//! Files that several commands take: surveys and pipelines told apart by what they hold.

use crate::diag::Diagnostics;
use crate::error::Result;
use crate::survey::{self, ReadOptions, RunSettings, Survey};
use std::path::Path;

/// Reads a survey (.xml) or a pipeline (.toml).
///
/// # Errors
/// Those of the readers.
pub fn read_survey(path: &Path, reading: &ReadOptions) -> Result<(Survey, RunSettings, Diagnostics)> {
    if is_pipeline(path) {
        let (pipeline, warnings) = survey::read_pipeline(path, reading)?;
        return Ok((pipeline.survey, pipeline.settings, warnings));
    }
    let (survey, warnings) = survey::read_survey(path, reading)?;
    Ok((survey, RunSettings::default(), warnings))
}

/// Whether the file is a pipeline, or an XML file with a survey in it.
pub fn holds_survey(path: &Path) -> bool {
    let is_xml = path.extension().is_some_and(|e| e.eq_ignore_ascii_case("xml"));
    is_pipeline(path)
        || is_xml && std::fs::read(path).is_ok_and(|bytes| memchr::memmem::find(&bytes, b"<survey").is_some())
}

fn is_pipeline(path: &Path) -> bool {
    path.extension().is_some_and(|e| e.eq_ignore_ascii_case("toml"))
}
