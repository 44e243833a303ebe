//! Several scanners on one platform: the survey of each, and options that cannot serve all of them.

use super::groups::Options;
use vlscan_base::diag::Diagnostics;
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
    let help = "only `vlscan run`, `index-shards` and `merge --pipeline` take several scanners";
    problems.error(Some(source.place(0..0)), message).help(help);
    Error::Input(Box::new(problems))
}
