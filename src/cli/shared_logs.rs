//! MCAP files that several scanners of a platform share. Each scanner first writes a file of its own to a
//! temporary folder; these files are merged at the end, those of an interrupted run to a partial one.

use super::{Console, messages};
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use vlscan_base::error::{Error, Result};
use vlscan_base::files::{TemporaryFolder, free_name, identity, is_special, is_taken, is_temporary_name};
use vlscan_base::quantity::counted;
use vlscan_formats::{MergedLog, merge_logs};
use vlscan_messages::WrittenFile;
use vlscan_session::output::{FileSummary, FrameNames, OutputRequest, PointFormat, Target};

/// The MCAP file of an output, by its [`identity`].
fn log_of((target, format): &(Target, PointFormat)) -> Option<PathBuf> {
    match target {
        Target::File(path) if *format == PointFormat::Mcap && !is_special(path) => Some(identity(path)),
        _ => None,
    }
}

/// The MCAP files that several scanners name, by their [`identity`], with the path as the first one names it.
#[derive(Default)]
pub struct SharedPaths(BTreeMap<PathBuf, PathBuf>);

impl SharedPaths {
    /// The files that are outputs of several scanners.
    pub fn of<'r>(outputs: impl IntoIterator<Item = &'r OutputRequest>) -> SharedPaths {
        let (mut seen, mut shared) = (BTreeMap::<PathBuf, PathBuf>::new(), BTreeMap::new());
        for output in outputs {
            let mut own = BTreeMap::new();
            for sink in &output.sinks {
                if let (Some(log), Target::File(path)) = (log_of(sink), &sink.0) {
                    own.entry(log).or_insert_with(|| path.clone());
                }
            }
            for (log, path) in own {
                if let Some(first) = seen.get(&log) {
                    shared.insert(log, first.clone());
                } else {
                    seen.insert(log, path);
                }
            }
        }
        SharedPaths(shared)
    }

    /// True if files are shared.
    pub fn any(&self) -> bool {
        !self.0.is_empty()
    }

    /// True if an output goes to a shared file.
    fn has(&self, sink: &(Target, PointFormat)) -> bool {
        log_of(sink).is_some_and(|log| self.0.contains_key(&log))
    }

    /// Prepares the outputs of a scanner that shares a file: its name becomes that of its frame, and shared
    /// files follow those beside which others are written. `resumes` is true for a run that can be resumed.
    ///
    /// # Errors
    /// [`Error::Input`] for names that cannot be part of a topic, and for options that need a file of the
    /// scanner alone.
    pub fn prepare(&self, scanner: &str, resumes: bool, output: &mut OutputRequest) -> Result<()> {
        if !output.sinks.iter().any(|sink| self.has(sink)) {
            return Ok(());
        }
        output.sinks.sort_by_key(|sink| self.has(sink));
        let names_frame = output.cloud.frame_names.sensor != FrameNames::default().sensor;
        scanner.clone_into(&mut output.cloud.frame_names.sensor);
        let is_topic = |c: char| c.is_ascii_alphanumeric() || c == '_';
        let has_own_file =
            output.sinks.iter().any(|sink| !self.has(sink) && !matches!(sink.0, Target::Stdout));
        let refused = if !scanner.chars().all(is_topic) || scanner.starts_with(|c: char| c.is_ascii_digit()) {
            "its name is part of topics, and needs to consist of letters, digits and `_` with a letter first"
        } else if names_frame {
            "--sensor-frame names one frame, but each scanner has the frame of its name"
        } else if resumes {
            "--resume needs files of each scanner alone"
        } else if output.split_by_channel {
            "--split-by-channel needs files of each scanner alone"
        } else if (output.waveforms || output.pulses) && !has_own_file {
            "waveforms and pulses are written beside a file of the scanner alone"
        } else {
            return Ok(());
        };
        Err(Error::input_with_help(
            format!("the scanner `{scanner}` shares an MCAP file: {refused}"),
            "give each [[scanner]] an `output` of its own",
        ))
    }

    /// The places of a scanner's outputs without the shared files.
    pub fn without_shared(&self, mut places: BTreeSet<PathBuf>) -> BTreeSet<PathBuf> {
        places.retain(|place| !self.0.contains_key(place));
        places
    }

    /// Begins the shared files.
    ///
    /// # Errors
    /// [`Error::Io`] when a temporary folder cannot be made.
    pub fn begin(&self) -> Result<Vec<SharedLog>> {
        self.0.iter().map(|(log, path)| SharedLog::begin(log, path)).collect()
    }
}

/// An MCAP file that several scanners share.
pub struct SharedLog {
    log: PathBuf,
    path: PathBuf,
    folder: TemporaryFolder,
    /// Names and files of the scanners.
    parts: Vec<(String, PathBuf)>,
}

impl SharedLog {
    fn begin(log: &Path, path: &Path) -> Result<SharedLog> {
        let folder = TemporaryFolder::next_to(log)?;
        Ok(SharedLog { log: log.to_path_buf(), path: path.to_path_buf(), folder, parts: Vec::new() })
    }

    /// Replaces the shared file among the outputs of a scanner by a temporary one.
    pub fn redirect(&mut self, scanner: &str, output: &mut OutputRequest) {
        for sink in &mut output.sinks {
            if log_of(sink).as_ref() == Some(&self.log) {
                let part = self.folder.path().join(format!("{scanner}.mcap"));
                sink.0 = Target::File(part.clone());
                self.parts.push((scanner.to_owned(), part));
            }
        }
    }

    /// Writes the shared file after the runs of all scanners; `replace` replaces an existing one.
    ///
    /// # Errors
    /// The errors of [`merge_logs`].
    pub fn write(&self, replace: bool, console: &Console) -> Result<()> {
        let merged = merge_logs(&self.parts, &self.path, replace, false)?;
        show(&self.path, merged, console);
        Ok(())
    }

    /// Writes what was measured before a run ended early as `NAME.partial.mcap`, if there is anything.
    ///
    /// # Errors
    /// The errors of [`merge_logs`].
    pub fn write_partial(&self, replace: bool, console: &Console) -> Result<()> {
        let partial = |path: &Path| free_name(path, "partial", |path| !replace && is_taken(path));
        let found = self.parts.iter().filter_map(|(name, path)| {
            let begun = free_name(path, "partial", |_| false);
            let path = [path.clone(), begun].into_iter().find(|path| path.is_file())?;
            Some((name.clone(), path))
        });
        let found: Vec<(String, PathBuf)> = found.collect();
        if found.is_empty() {
            return Ok(());
        }
        let path = partial(&self.path);
        let merged = merge_logs(&found, &path, replace, true)?;
        show(&path, merged, console);
        console.say(format!("what was measured so far is in {}", path.display()));
        Ok(())
    }
}

/// Shows that a file was written.
fn show(path: &Path, merged: MergedLog, console: &Console) {
    let count = counted(merged.messages, "message");
    let text = format!("{}  {count}, {} bytes", path.display(), merged.bytes);
    let file = WrittenFile {
        format: Some(PointFormat::Mcap.name().to_owned()),
        bytes: Some(merged.bytes),
        ..messages::written(path, "points")
    };
    console.wrote(file, text);
}

/// True if a file is the temporary one of a scanner.
pub fn is_part(file: &FileSummary) -> bool {
    let folder = file.path.as_deref().and_then(Path::parent).and_then(Path::file_name);
    folder.is_some_and(is_temporary_name)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn outputs(sinks: &[(&str, PointFormat)]) -> OutputRequest {
        let mut request = OutputRequest::default();
        request.sinks = sinks.iter().map(|(path, format)| (Target::File(path.into()), *format)).collect();
        request
    }

    #[test]
    fn only_mcap_files_of_several_scanners_are_shared() {
        let front = outputs(&[("a.mcap", PointFormat::Mcap), ("a.las", PointFormat::Las)]);
        let rear = outputs(&[("b.mcap", PointFormat::Mcap), ("./a.mcap", PointFormat::Mcap)]);
        let top = outputs(&[("a.las", PointFormat::Las)]);
        let shared = SharedPaths::of([&front, &rear, &top]);
        assert_eq!(shared.0.values().collect::<Vec<_>>(), [Path::new("a.mcap")]);
        let places = ["a.mcap", "b.mcap"].map(|path| identity(Path::new(path)));
        let left = shared.without_shared(BTreeSet::from(places));
        assert_eq!(left, BTreeSet::from([identity(Path::new("b.mcap"))]));
    }

    #[test]
    fn a_scanner_that_shares_a_file_needs_a_name_for_topics_and_files_of_its_own_for_others() {
        let both = [("a.mcap", PointFormat::Mcap), ("a.las", PointFormat::Las)];
        let shared = SharedPaths::of([&outputs(&both), &outputs(&both[..1])]);
        let mut output = outputs(&both);
        output.pulses = true;
        shared.prepare("front", false, &mut output).unwrap();
        assert_eq!(output.sinks[0], (Target::File("a.las".into()), PointFormat::Las));
        assert_eq!(output.cloud.frame_names.sensor, "front");
        let mut alone = outputs(&[("b.mcap", PointFormat::Mcap)]);
        shared.prepare("a-b", true, &mut alone).unwrap();
        assert_eq!(alone.cloud.frame_names.sensor, "lidar");
        let refused = |scanner: &str, resumes: bool, change: fn(&mut OutputRequest)| {
            let mut output = outputs(&both[..1]);
            change(&mut output);
            shared.prepare(scanner, resumes, &mut output).unwrap_err().to_string()
        };
        assert!(refused("a-b", false, |_| ()).contains("part of topics"));
        assert!(refused("1st", false, |_| ()).contains("part of topics"));
        assert!(refused("front", true, |_| ()).contains("--resume needs files"));
        let frame = |output: &mut OutputRequest| output.cloud.frame_names.sensor = "roof".to_owned();
        assert!(refused("front", false, frame).contains("--sensor-frame names one frame"));
        assert!(
            refused("front", false, |output| output.split_by_channel = true).contains("--split-by-channel")
        );
        assert!(refused("front", false, |output| output.pulses = true).contains("waveforms and pulses"));
    }
}
