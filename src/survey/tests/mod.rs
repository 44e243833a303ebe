//! Tests with complete documents.

use super::*;
use crate::diag::{Diagnostics, Severity};
use crate::error::Error;
use crate::options::Options;
use std::path::{Path, PathBuf};

mod conformance;
mod hostile;
mod instruments;
mod pipelines;
mod receivers;
mod scenes;
mod surveys;
mod values;

/// A folder of files that is removed when it is dropped.
struct Folder(tempfile::TempDir);

impl Folder {
    fn new(files: &[(&str, &str)]) -> Folder {
        let folder = Folder(tempfile::tempdir().unwrap());
        files.iter().for_each(|(name, text)| folder.write(name, text));
        folder
    }

    fn write(&self, name: &str, text: &str) {
        let path = self.path(name);
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::fs::write(path, text).unwrap();
    }

    fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    fn read(&self, options: &ReadOptions) -> crate::Result<(Survey, Diagnostics)> {
        read_survey(&self.path("survey.xml"), options)
    }
}

/// A mirror scanner as a `<scanner>` of id `mirror`.
const MIRROR: &str = "<scanner id='mirror' optics='rotating' pulseFreqs_Hz='100000,300000' beamDivergence_rad='0.0005' \
    pulseLength_ns='6' scanAngleMax_deg='60' scanAngleEffectiveMax_deg='50' scanFreqMin_Hz='5' scanFreqMax_Hz='120' \
    headRotatePerSecMax_deg='60'/>";

/// A tripod of id `tripod`, an aeroplane of id `plane`.
const PLATFORMS: &str = "<platform id='tripod' type='static'/><platform id='plane' type='LinearPath'><scannerMount z='2'/></platform>";

/// A scene of id `scene` with one part, `a.obj`.
const SCENE: &str = "<scene id='scene'><part><filter type='objloader'>\
    <param type='string' key='filepath' value='a.obj'/></filter></part></scene>";

/// A document with the default assets, the `extra` ones and a survey with those attributes and that content.
fn document(extra: &str, attributes: &str, content: &str) -> String {
    format!(
        "<document>\n{MIRROR}\n{PLATFORMS}\n{SCENE}\n{extra}\n<survey scene='scene' scanner='mirror' {attributes}>\n{content}\n</survey>\n</document>"
    )
}

/// Reads a survey whose document has the default assets.
fn survey_of(extra: &str, attributes: &str, content: &str) -> crate::Result<(Survey, Diagnostics)> {
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

type Pipeline = (Survey, Options);

fn read_pipeline(path: &Path) -> crate::Result<(Pipeline, Diagnostics)> {
    let (survey, options, warnings) = crate::options::read_survey(path, Options::default())?;
    Ok(((survey, options), warnings))
}

/// The report of an input error.
fn report(error: &Error) -> String {
    match error {
        Error::Input(problems) | Error::Limits(problems) => problems.render(false),
        other => other.to_string(),
    }
}

/// The report of the input error that `result` must be.
fn refused<T>(result: crate::Result<(T, Diagnostics)>) -> String {
    match result {
        Ok((_, warnings)) => panic!("should have been refused; warnings:\n{}", warnings.render(false)),
        Err(e) => report(&e),
    }
}

/// Checks that a report contains every text.
#[track_caller]
fn contains(report: &str, texts: &[&str]) {
    for text in texts {
        assert!(report.contains(text), "{text:?} is missing from\n{report}");
    }
}
