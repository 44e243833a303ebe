//! The folder with the shards of a run that can be resumed. A mark in it records that a run has created the
//! folder, the progress of the run, and its outputs. The mark is the first file in a new folder and the last
//! one to be removed: a folder that has files but no mark belongs to the user. Only files of runs are
//! removed: the mark, the lock, which is empty, and shards, which are recognised by their names and first
//! bytes.

use crate::output::{OutputRequest, OutputSummary, Target};
use crate::shards::{Fingerprint, PrivateFolder, is_file_of_shards};
use serde::{Deserialize, Serialize};
use std::fs::{self, DirEntry, File, OpenOptions, TryLockError};
use std::io;
use std::path::{Path, PathBuf};
use vlscan_base::diag::ProblemKind;
use vlscan_base::error::{Error, Result};
use vlscan_base::files::{FileWriter, NewFolder, Stamp, fault, is_temporary_name, reads};
use vlscan_base::store::Checksum;

const MARK: &str = "vlscan-resume.json";
const LOCK: &str = "lock";
const PROGRAM: &str = "vlscan run --resume";

/// The contents of the mark.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct Mark {
    program: String,
    state: State,
}

/// How far a run is.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub(super) enum State {
    /// Shards are computed; there are no outputs.
    Shards,
    /// These outputs get their names.
    Merging(RunId),
    /// These outputs are complete, in files with their sizes and times then, and the shards are removed.
    Complete(RunId, Vec<(PathBuf, Option<Stamp>)>),
}

/// Tells runs with other contents, names, formats or options of their outputs apart.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub(super) struct RunId(u64);

impl RunId {
    /// `fingerprint` holds everything that the contents of the run's shards depend on.
    pub fn new(fingerprint: &Fingerprint, outputs: &OutputRequest) -> RunId {
        let target = |target: &Target| match target {
            Target::Stdout => Target::Stdout,
            Target::File(path) => Target::File(absolute(path)),
            Target::Directory(path) => Target::Directory(absolute(path)),
            Target::Helios(path) => Target::Helios(absolute(path)),
        };
        let same_whenever = OutputRequest {
            sinks: outputs.sinks.iter().map(|(to, format)| (target(to), *format)).collect(),
            trajectory: outputs.trajectory.as_ref().map(|(to, format)| (target(to), *format)),
            force: false,
            inputs: Vec::new(),
            companions: Vec::new(),
            ..outputs.clone()
        };
        let mut sum = Checksum::default();
        sum.debug(&(fingerprint, same_whenever));
        RunId(sum.finish())
    }
}

/// A path that means the same file when the next start works in another folder.
fn absolute(path: &Path) -> PathBuf {
    std::path::absolute(path).unwrap_or_else(|_| path.to_path_buf())
}

/// A folder that this process has locked.
#[derive(Debug)]
pub(super) struct ResumeFolder {
    path: PathBuf,
    _lock: File,
    state: State,
}

impl ResumeFolder {
    /// Opens a folder whose state is `known`, see [`ResumeFolder::state_of`]. It is created if it does not
    /// exist.
    ///
    /// # Errors
    /// [`Error::Input`] while another run works in the folder, or if it has done so meanwhile; [`Error::Io`].
    pub fn open(path: &Path, known: Option<&State>) -> Result<ResumeFolder> {
        NewFolder::create_all(path).map_err(|e| Error::io("create", path, e))?.keep();
        if known.is_none() && ResumeFolder::state_of(path)?.is_none() {
            write_mark(path, &State::Shards)?;
        }
        let lock = lock(path)?;
        match ResumeFolder::state_of(path)? {
            Some(state) if state == *known.unwrap_or(&State::Shards) => {
                Ok(ResumeFolder { path: path.to_path_buf(), _lock: lock, state })
            }
            _ => Err(Error::input_of(
                ProblemKind::InUse,
                format!("another run has changed {} meanwhile: repeat the command", path.display()),
            )),
        }
    }

    /// The state of the run that created a folder; `None` if there is no folder, or an empty one.
    ///
    /// # Errors
    /// [`Error::Input`] for a folder, or anything else of its name, that no such run has made.
    pub fn state_of(path: &Path) -> Result<Option<State>> {
        if path.symlink_metadata().is_err() {
            return Ok(None);
        }
        let mark = reads::read_own(&path.join(MARK)).ok();
        let mark: Option<Mark> = mark.and_then(|text| serde_json::from_slice(&text).ok());
        match mark {
            Some(Mark { program, state }) if program == PROGRAM => Ok(Some(state)),
            _ if is_unused(path) => Ok(None),
            _ => Err(Error::input(format!(
                "{} exists and was not made by `{PROGRAM}`, which needs this name for its folder: move it, \
                 or choose another name with -o",
                path.display()
            ))),
        }
    }

    pub fn state(&self) -> &State {
        &self.state
    }

    /// Records the progress of the run.
    ///
    /// # Errors
    /// [`Error::Io`].
    pub fn mark(&mut self, state: State) -> Result<()> {
        write_mark(&self.path, &state)?;
        self.state = state;
        Ok(())
    }

    /// Removes the files of shards, but neither lock nor mark.
    ///
    /// # Errors
    /// [`Error::Io`].
    pub fn remove_shards(&self) -> Result<()> {
        remove_files_of_shards(&self.path)
    }

    /// Removes the folder, or only the run's files in it if there are others. Returns the remaining files.
    ///
    /// # Errors
    /// [`Error::Io`].
    pub fn remove(self) -> Result<Vec<PathBuf>> {
        self.remove_shards()?;
        for name in [LOCK, MARK] {
            let path = self.path.join(name);
            if name == MARK || is_lock(&path) {
                fs::remove_file(&path).map_err(|e| Error::io("remove", &path, e))?;
            }
        }
        let failed = |e| Error::io("remove", &self.path, e);
        let left = fs::read_dir(&self.path).map_err(failed)?.flatten().map(|entry| entry.path());
        let left: Vec<PathBuf> = left.collect();
        if left.is_empty() {
            fs::remove_dir(&self.path).map_err(failed)?;
        }
        Ok(left)
    }
}

impl State {
    /// The state of a run whose outputs are complete.
    pub fn complete(run: RunId, summary: &OutputSummary) -> State {
        let paths = summary.files.iter().filter_map(|file| file.path.as_ref()).map(|path| absolute(path));
        State::Complete(run, paths.map(|path| (path.clone(), stamp(&path))).collect())
    }

    /// True if the outputs are complete and as they were.
    pub fn is_complete(&self) -> bool {
        match self {
            State::Complete(_, files) => {
                files.iter().all(|(path, then)| path.exists() && stamp(path) == *then)
            }
            State::Shards | State::Merging(_) => false,
        }
    }

    /// True if outputs of this run may have their names.
    pub fn has_outputs_of(&self, run: RunId) -> bool {
        match self {
            State::Shards => false,
            State::Merging(of) => *of == run,
            State::Complete(of, _) => *of == run && self.is_complete(),
        }
    }
}

fn stamp(path: &Path) -> Option<Stamp> {
    Stamp::of(&fs::metadata(path).ok()?)
}

/// True if a folder holds nothing, or an unfinished mark, which a run has left that was killed before it
/// marked the folder.
fn is_unused(path: &Path) -> bool {
    let is_left = |entry: &DirEntry| {
        let name = entry.file_name();
        name.as_encoded_bytes().starts_with(MARK.as_bytes()) && is_temporary_name(&name)
    };
    path.symlink_metadata().is_ok_and(|about| about.is_dir())
        && fs::read_dir(path).is_ok_and(|mut entries| entries.all(|entry| entry.is_ok_and(|e| is_left(&e))))
}

fn write_mark(folder: &Path, state: &State) -> Result<()> {
    let mark = Mark { program: PROGRAM.to_owned(), state: state.clone() };
    // JSON has no other names of files.
    let text = serde_json::to_string(&mark).map_err(|_| {
        let message = format!("{}: --resume cannot note outputs whose names are not UTF-8", folder.display());
        Error::input_with_help(message, "run without --resume, or give the outputs other names")
    })?;
    let mut file = FileWriter::create_own(&folder.join(MARK))?;
    file.append((text + "\n").as_bytes())?;
    file.finish().map(drop)
}

/// Removes the files of shards from a folder, and the private folders in it, unless these hold something
/// else.
fn remove_files_of_shards(folder: &Path) -> Result<()> {
    let failed = |e| Error::io("remove", folder, e);
    for entry in fs::read_dir(folder).map_err(failed)? {
        let entry = entry.map_err(failed)?;
        let (path, name) = (entry.path(), entry.file_name());
        let removed = match entry.file_type() {
            Ok(kind) if kind.is_dir() && PrivateFolder::is_name(&name) => {
                remove_files_of_shards(&path)?;
                match fs::remove_dir(&path) {
                    Err(e) if e.kind() == io::ErrorKind::DirectoryNotEmpty => Ok(()),
                    removed => removed,
                }
            }
            Ok(kind) if kind.is_file() && (is_temporary_name(&name) || is_file_of_shards(&path)) => {
                fs::remove_file(&path)
            }
            _ => Ok(()),
        };
        removed.map_err(|e| Error::io("remove", &path, e))?;
    }
    Ok(())
}

/// True if a file is a lock, which holds nothing.
fn is_lock(path: &Path) -> bool {
    path.symlink_metadata().is_ok_and(|about| about.is_file() && about.len() == 0)
}

/// Makes sure that no other run works in the folder until the file is dropped.
fn lock(folder: &Path) -> Result<File> {
    let path = folder.join(LOCK);
    if path.symlink_metadata().is_ok() && !is_lock(&path) {
        return Err(Error::input(format!(
            "{} was not made by `{PROGRAM}`, which needs this name for a file: move it to another folder, \
             then repeat the command",
            path.display()
        )));
    }
    let opened =
        fault::point().and_then(|()| OpenOptions::new().write(true).create(true).truncate(false).open(&path));
    let file = opened.map_err(|e| Error::io("create", &path, e))?;
    match file.try_lock() {
        Err(TryLockError::WouldBlock) => {
            Err(Error::input_of(ProblemKind::InUse, format!("another run is using {}", folder.display())))
        }
        // Some file systems have no locks.
        Err(TryLockError::Error(_)) | Ok(()) => Ok(file),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use vlscan_base::files::testkit::names;

    fn open(path: &Path) -> Result<ResumeFolder> {
        ResumeFolder::open(path, ResumeFolder::state_of(path)?.as_ref())
    }

    #[test]
    fn only_marked_folders_are_used_and_only_files_of_parts_are_removed() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.laz.shards");
        fs::create_dir_all(path.join("thesis")).unwrap();
        fs::write(path.join("thesis/chapter.txt"), "precious").unwrap();
        assert!(open(&path).is_err());
        fs::remove_dir_all(&path).unwrap();
        fs::write(&path, "a file").unwrap();
        assert!(open(&path).is_err());
        fs::remove_file(&path).unwrap();
        // A folder of `vlscan run --shard` is not one of a run that can be resumed, nor is one with a file of
        // the user's that is called as the lock or as a temporary file.
        for name in ["shard-000000-of-000002.vlshard", LOCK, "thesis.vlscan-0123abcd.part"] {
            fs::create_dir(&path).unwrap();
            fs::write(path.join(name), "precious").unwrap();
            assert!(open(&path).is_err(), "{name}");
            assert_eq!(names(&path), [name]);
            fs::remove_dir_all(&path).unwrap();
        }
        // What a run leaves that is killed before it marks its folder.
        fs::create_dir(&path).unwrap();
        fs::write(path.join(format!("{MARK}.vlscan-0123abcd.part")), "{").unwrap();

        let mut folder = open(&path).unwrap();
        assert_eq!(*folder.state(), State::Shards);
        folder.mark(State::Merging(RunId(7))).unwrap();
        assert!(ResumeFolder::open(&path, None).is_err(), "it is locked");
        drop(folder);
        let folder = open(&path).unwrap();
        assert_eq!(*folder.state(), State::Merging(RunId(7)));
        let private = ["unfinished-0123456789abcdef", "unfinished-00000000000000ff"];
        private.iter().for_each(|name| fs::create_dir(path.join(name)).unwrap());
        let temporary = "shard-000001-of-000002.vlshard.vlscan-0123abcd.part";
        fs::write(path.join(private[0]).join(temporary), "VLSP").unwrap();
        for (name, text) in [
            ("shard-000000-of-000002.vlshard", "VLSHARD\n and more"),
            ("flight.vlindex", "VLINDEX\n and more"),
            ("shard-000001-of-000002.vlshard", "precious"),
            ("notes.txt", "precious"),
            ("shard-of-my-thesis.txt", "precious"),
            ("unfinished-00000000000000ff/notes.txt", "precious"),
        ] {
            fs::write(path.join(name), text).unwrap();
        }
        folder.remove_shards().unwrap();
        let kept = ["notes.txt", "shard-000001-of-000002.vlshard", "shard-of-my-thesis.txt", private[1]];
        assert_eq!(names(&path), [&[LOCK][..], &kept, &[MARK]].concat());
        assert_eq!(folder.remove().unwrap().len(), kept.len());
        assert_eq!(names(&path), kept);
        assert_eq!(names(&path.join(private[1])), ["notes.txt"]);
        assert!(open(&path).is_err());
    }

    #[test]
    fn a_lock_with_contents_is_a_file_of_the_user() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.laz.shards");
        drop(open(&path).unwrap());
        fs::write(path.join(LOCK), "precious").unwrap();
        assert!(open(&path).unwrap_err().to_string().contains("lock was not made by"));
        fs::remove_file(path.join(LOCK)).unwrap();
        let folder = open(&path).unwrap();
        fs::write(path.join(LOCK), "precious").unwrap();
        assert_eq!(folder.remove().unwrap(), [path.join(LOCK)]);
        assert_eq!(fs::read(path.join(LOCK)).unwrap(), b"precious");
    }

    #[test]
    fn what_another_run_does_meanwhile_is_noticed() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.laz.shards");
        let mut folder = open(&path).unwrap();
        let known = ResumeFolder::state_of(&path).unwrap();
        folder.mark(State::Merging(RunId(7))).unwrap();
        drop(folder);
        let refused = ResumeFolder::open(&path, known.as_ref()).unwrap_err();
        assert!(refused.to_string().contains("meanwhile: repeat the command"), "{refused}");
    }

    #[test]
    fn runs_are_told_apart_by_their_contents_and_outputs() {
        use crate::output::PointFormat;
        let id = |seed: u32, request: OutputRequest| {
            let mut fingerprint = Fingerprint::default();
            fingerprint.flight("seed", seed);
            RunId::new(&fingerprint, &request)
        };
        let to = |path: &str| OutputRequest {
            sinks: vec![(Target::File(path.into()), PointFormat::Laz)],
            ..OutputRequest::default()
        };
        let own = id(1, to("a.laz"));
        let mut labelled = to("a.laz");
        labelled.cloud.labels = true;
        let whole = std::path::absolute("a.laz").unwrap();
        assert_eq!(own, id(1, to(whole.to_str().unwrap())));
        assert_eq!(own, id(1, OutputRequest { force: true, inputs: vec!["s.xml".into()], ..to("a.laz") }));
        for other in [
            id(2, to("a.laz")),
            id(1, to("b.laz")),
            id(1, labelled),
            id(1, OutputRequest { sinks: [to("a.laz").sinks, to("b.laz").sinks].concat(), ..to("a.laz") }),
        ] {
            assert_ne!(own, other);
            assert!(!State::Merging(own).has_outputs_of(other) && State::Merging(own).has_outputs_of(own));
            assert!(!State::Complete(own, Vec::new()).has_outputs_of(other));
        }
        assert!(State::Complete(own, Vec::new()).has_outputs_of(own) && !State::Shards.has_outputs_of(own));
    }

    #[test]
    fn complete_outputs_are_known_as_long_as_they_stay() {
        let dir = tempfile::tempdir().unwrap();
        let output = dir.path().join("a.laz");
        fs::write(&output, "points").unwrap();
        let state = State::Complete(RunId(u64::MAX), vec![(output.clone(), stamp(&output))]);
        let text = serde_json::to_string(&state).unwrap();
        assert_eq!(serde_json::from_str::<State>(&text).unwrap(), state);
        assert!(state.is_complete() && !State::Shards.is_complete());
        fs::write(&output, "others").unwrap();
        fs::remove_file(&output).unwrap();
        assert!(!state.is_complete());
    }
}
