//! Complete documents for tests: folders of files, a survey with its assets, reports of errors.

use crate::{ReadOptions, Survey, read_survey};
use std::path::PathBuf;
use vlscan_base::diag::Diagnostics;
use vlscan_base::error::Error;
use vlscan_render::Render as _;

/// A folder of files that is removed when it is dropped.
pub struct Folder(pub tempfile::TempDir);

impl Folder {
    pub fn new(files: &[(&str, &str)]) -> Folder {
        let folder = Folder(tempfile::tempdir().unwrap());
        files.iter().for_each(|(name, text)| folder.write(name, text));
        folder
    }

    pub fn write(&self, name: &str, text: &str) {
        let path = self.path(name);
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::fs::write(path, text).unwrap();
    }

    pub fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    pub fn read(&self, options: &ReadOptions) -> vlscan_base::Result<(Survey, Diagnostics)> {
        read_survey(&self.path("survey.xml"), options)
    }
}

/// A mirror scanner as a `<scanner>` of id `mirror`.
pub const MIRROR: &str = "<scanner id='mirror' optics='rotating' pulseFreqs_Hz='100000,300000' beamDivergence_rad='0.0005' \
    pulseLength_ns='6' scanAngleMax_deg='60' scanAngleEffectiveMax_deg='50' scanFreqMin_Hz='5' scanFreqMax_Hz='120' \
    headRotatePerSecMax_deg='60'/>";

/// A tripod of id `tripod`, an aeroplane of id `plane`.
pub const PLATFORMS: &str = "<platform id='tripod' type='static'/><platform id='plane' type='LinearPath'><scannerMount z='2'/></platform>";

/// A scene of id `scene` with one part, `a.obj`.
pub const SCENE: &str = "<scene id='scene'><part><filter type='objloader'>\
    <param type='string' key='filepath' value='a.obj'/></filter></part></scene>";

/// A document with the default assets, the `extra` ones and a survey with those attributes and that content.
pub fn document(extra: &str, attributes: &str, content: &str) -> String {
    format!(
        "<document>\n{MIRROR}\n{PLATFORMS}\n{SCENE}\n{extra}\n<survey scene='scene' scanner='mirror' {attributes}>\n{content}\n</survey>\n</document>"
    )
}

/// The report of an input error.
pub fn report(error: &Error) -> String {
    match error {
        Error::Input(problems) | Error::Limits(problems) => problems.render(false),
        other => other.to_string(),
    }
}

/// The report of the input error that `result` must be.
pub fn refused<T>(result: vlscan_base::Result<(T, Diagnostics)>) -> String {
    match result {
        Ok((_, warnings)) => panic!("should have been refused; warnings:\n{}", warnings.render(false)),
        Err(e) => report(&e),
    }
}

/// Checks that a report contains every text.
#[track_caller]
pub fn contains(report: &str, texts: &[&str]) {
    for text in texts {
        assert!(report.contains(text), "{text:?} is missing from\n{report}");
    }
}
