//! Several scanners on one platform: the survey of each, and options that cannot serve all of them.

use super::groups::Options;
use std::path::Path;
use vlscan_base::diag::{Diagnostics, nearest};
use vlscan_base::error::{Error, Result};
use vlscan_base::files::is_special;
use vlscan_survey::{PlatformKind, Source, Survey};
use vlscan_tables::input::is_stdin;

/// The survey of a scanner, with the options of its run.
#[derive(Clone, Debug)]
pub struct ScannerSurvey {
    /// Name of the scanner; `None` if the file has no `[[scanner]]` tables.
    pub scanner: Option<String>,
    /// The survey.
    pub survey: Survey,
    /// The options.
    pub options: Options,
}

impl ScannerSurvey {
    /// Checks the survey of one of the scanners on a platform.
    ///
    /// # Errors
    /// Mounts of legs, which would replace those of the scanners; for several scanners, poses that can be
    /// read only once.
    pub(super) fn check(&self, has_several: bool) -> Result<()> {
        if let Some(leg) = self.survey.legs.iter().find(|leg| leg.platform.mount.is_some()) {
            let mut problems = Diagnostics::default();
            let message = "the mount of a leg would replace that of every [[scanner]]";
            let help = "leave out `mount` and `platform` of the leg";
            problems.error(leg.place.clone(), message).help(help);
            return Err(Error::Input(Box::new(problems)));
        }
        match &self.survey.platform.kind {
            PlatformKind::Stream(stream)
                if has_several
                    && stream.content.is_none()
                    && (is_stdin(&stream.path) || is_special(&stream.path)) =>
            {
                Err(Error::input_with_help(
                    format!(
                        "the poses of {} can be read only once, but each [[scanner]] reads them",
                        stream.path.display()
                    ),
                    "write them to a file first, and name it with `path` of [trajectory]",
                ))
            }
            _ => Ok(()),
        }
    }
}

/// Checks that no option names a file that every scanner would write.
///
/// # Errors
/// The first such option.
pub(super) fn check_several(options: &Options) -> Result<()> {
    let output = &options.output;
    let named = [
        ("-o", !output.out.is_empty()),
        ("--output", output.output.is_some()),
        ("--trajectory-out", options.trajectory_out.is_some()),
        ("--parts", options.part_table.is_some()),
        ("--schedule-log", options.schedule.schedule_log.is_some()),
    ];
    match named.iter().find(|(_, is_given)| *is_given) {
        Some((option, _)) => Err(Error::input_with_help(
            format!("{option} names a single output, but the pipeline has several scanners"),
            "leave it out: each [[scanner]] has its `output`",
        )),
        None => Ok(()),
    }
}

/// The error of a command that takes one scanner and finds several.
pub(super) fn refuse_several(source: &Source, count: usize) -> Error {
    let mut problems = Diagnostics::default();
    let message = format!("the file has {count} [[scanner]] tables, but this command takes a single scanner");
    let help = "choose one with --scanner NAME in `vlscan trajectory` and `pulses`; for other commands keep \
                one of the tables as [scanner] in a copy of the file; `vlscan run`, `index-shards` and \
                `merge --pipeline` take all";
    problems.error(Some(source.place(0..0)), message).help(help);
    Error::Input(Box::new(problems))
}

/// The error of a file without the scanner `name`, but with those of these names.
pub(super) fn no_scanner(file: &Path, name: &str, names: &[String]) -> Error {
    let file = file.display();
    if names.is_empty() {
        return Error::input_with_help(
            format!("--scanner {name}: {file} has no [[scanner]] tables"),
            "leave out --scanner",
        );
    }
    let help = match nearest(name, names.iter().map(String::as_str)) {
        Some(near) => format!("did you mean `{near}`?"),
        None => format!("its scanners are {}", names.join(", ")),
    };
    Error::input_with_help(format!("--scanner {name}: {file} has no scanner of this name"), help)
}
