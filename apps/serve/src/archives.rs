//! Zip archives among uploads: a confined process measures them by their directory and expands them.

use crate::beneath::{BLOCK, Beneath};
use crate::config::{ConfineArgs, ExpandArgs, ServeArgs};
use crate::execution::{End, Setting};
use crate::names;
use crate::terms::Terms;
use crate::uploads::UploadError;
use std::ffi::OsString;
use std::fs;
use std::io::{self, Read as _, Write as _};
use std::path::{Path, PathBuf};

/// Memory and processor time of the process that expands an archive.
const EXPAND_MEMORY: u64 = 1 << 30;
const EXPAND_SECONDS: u64 = 300;
/// Room on the disk without which an archive counts as too large for the disk, not as damaged, bytes.
const MIN_ROOM: usize = 1 << 20;
/// Longest statement of a size, bytes.
const MAX_SIZE: u64 = 4096;
/// Name of an archive for the process that expands it.
const ARCHIVE: &str = "archive.zip";
/// First bytes of a zip archive.
const ZIP: &[u8] = b"PK\x03\x04";

/// An archive that processes which can reach nothing else measure and expand.
#[derive(Debug)]
pub(crate) struct Unpacking<'a> {
    setting: Setting,
    work: &'a Path,
    max_files: usize,
    max_bytes: u64,
}

impl<'a> Unpacking<'a> {
    /// Moves the archive to the empty folder `work`.
    ///
    /// # Errors
    /// Errors of files.
    pub(crate) fn new(
        archive: &Path,
        work: &'a Path,
        limits: &ServeArgs,
    ) -> Result<Unpacking<'a>, UploadError> {
        let [inputs, out, tmp] = ["in", "out", "tmp"].map(|name| work.join(name));
        for folder in [&inputs, &out, &tmp] {
            fs::create_dir(folder)?;
        }
        fs::rename(archive, inputs.join(ARCHIVE))?;
        let folders = (limits.max_files as u64).saturating_mul(names::MAX_DEPTH as u64 + 1);
        let setting = Setting {
            root: work.to_owned(),
            folder: work.to_owned(),
            restrictions: ConfineArgs {
                read: vec![inputs],
                write: vec![out, tmp],
                memory: Some(EXPAND_MEMORY),
                time: Some(EXPAND_SECONDS),
                file_size: Some(limits.max_upload),
                no_sandbox: limits.no_sandbox,
                program: vec![crate::program::own_program()?.into_os_string()],
            },
            within_inputs: true,
            max_time: EXPAND_SECONDS,
            // The archive and its files, which the process counts itself.
            max_disk: limits.max_upload.saturating_mul(2).saturating_add(folders.saturating_mul(BLOCK)),
            terms: Terms::default(),
        };
        Ok(Unpacking { setting, work, max_files: limits.max_files, max_bytes: limits.max_upload })
    }

    /// The size that the directory of the archive states, within the limits of an upload.
    ///
    /// # Errors
    /// [`UploadError`] for a damaged archive, and one beyond the limits.
    pub(crate) fn stated_size(&self) -> Result<StatedSize, UploadError> {
        let name = "size.json";
        self.execute(self.max_bytes, &["--size"], Some(&self.work.join(name)))?;
        let size = Beneath::of(self.work)?.read(name, MAX_SIZE)?;
        Ok(serde_json::from_slice(&size).map_err(io::Error::other)?)
    }

    /// Expands the archive if its files have no more than this many bytes. Returns the folder of its files.
    ///
    /// # Errors
    /// [`UploadError`] for a damaged archive, and one beyond the limits.
    pub(crate) fn expand(&self, max_bytes: u64) -> Result<PathBuf, UploadError> {
        self.execute(max_bytes, &[], None)?;
        Ok(self.work.join("out"))
    }

    fn execute(&self, max_bytes: u64, options: &[&str], stdout: Option<&Path>) -> Result<(), UploadError> {
        let limits = [format!("--max-bytes={max_bytes}"), format!("--max-files={}", self.max_files)];
        let limits = limits.iter().map(String::as_str);
        let words = ["expand"].into_iter().chain(limits).chain(options.iter().copied());
        let words = words.chain(["--", ARCHIVE, "../out"]).map(OsString::from);
        let words: Vec<OsString> = words.collect();
        let out = self.work.join("out");
        let mut prepare = || crate::steps::empty(&out);
        let log = self.work.join("log");
        match self.setting.execute(&words, &log, stdout, &mut prepare, &mut || Ok(true))? {
            End::Success => Ok(()),
            End::Failure(message) | End::NotDivisible(message) => {
                check_room(self.work)?;
                let message = message.trim_start_matches("error: ");
                Err(UploadError::Wrong(format!("the archive cannot be expanded: {message}")))
            }
            End::GivenUp => Err(UploadError::Wrong("the archive was not expanded".to_owned())),
        }
    }
}

/// Returns the error of a full disk, which the process that expands an archive may not even have been able to
/// report.
fn check_room(folder: &Path) -> io::Result<()> {
    fs::write(folder.join("room"), vec![0; MIN_ROOM])
}

/// True for a zip archive, by its name and its beginning.
///
/// # Errors
/// Errors of files.
pub(crate) fn is_archive(path: &Path) -> io::Result<bool> {
    let mut start = [0; 4];
    let is_named = path.extension().is_some_and(|ending| ending.eq_ignore_ascii_case("zip"));
    Ok(is_named && fs::File::open(path)?.read_exact(&mut start).is_ok() && start == ZIP)
}

/// An archive that cannot be expanded.
#[non_exhaustive]
#[derive(Debug, thiserror::Error)]
pub enum ExpandError {
    /// The system.
    #[error("{0}")]
    System(#[from] io::Error),
    /// An archive whose directory cannot be read.
    #[error("the archive is damaged: {0}")]
    Damaged(zip::result::ZipError),
    /// A file in the archive that cannot be expanded.
    #[error("the archive is damaged: {0}")]
    DamagedFile(io::Error),
    /// An entry, by its name, that is neither a file nor a folder.
    #[error("`{0}` is no file")]
    NoFile(String),
    /// More files than this maximum.
    #[error("it has more than {0} files")]
    Files(usize),
    /// A name that leads elsewhere.
    #[error("`{0}` cannot be the name of a file here")]
    Name(String),
    /// A file that cannot be created.
    #[error("`{name}`: {error}")]
    Create {
        /// Its name in the archive.
        name: String,
        /// The error of the operating system.
        error: io::Error,
    },
    /// More bytes than this maximum.
    #[error("it has more than {0} bytes when it is expanded")]
    Bytes(u64),
    /// A file, by its name, that is larger than the directory of the archive states.
    #[error("the archive is damaged: `{0}` is larger than its directory says")]
    Larger(String),
}

/// Size of the files of an archive.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub(crate) struct StatedSize {
    /// Bytes of all files.
    pub bytes: u64,
    /// Number of files.
    pub files: u64,
}

/// Expands a zip archive within limits, or prints the size that its directory states: the command of the
/// confined process.
///
/// # Errors
/// [`ExpandError`].
pub fn expand(args: &ExpandArgs) -> Result<(), ExpandError> {
    let file = fs::File::open(&args.archive)?;
    let mut archive = zip::ZipArchive::new(file).map_err(ExpandError::Damaged)?;
    match args.size {
        true => {
            let size = measure(&mut archive, args)?;
            let size = serde_json::to_vec(&size).map_err(io::Error::other)?;
            let mut stdout = io::stdout();
            stdout.write_all(&size)?;
            Ok(stdout.flush()?)
        }
        false => unpack(&mut archive, args),
    }
}

/// True for files that systems add to archives of their own.
fn is_aside(name: &str) -> bool {
    name.starts_with("__MACOSX/") || name.rsplit('/').next() == Some(".DS_Store")
}

/// The size that the directory of an archive states.
fn measure(archive: &mut zip::ZipArchive<fs::File>, args: &ExpandArgs) -> Result<StatedSize, ExpandError> {
    let mut size = StatedSize::default();
    for number in 0..archive.len() {
        let entry = archive.by_index_raw(number).map_err(ExpandError::Damaged)?;
        let name = entry.name().map_err(ExpandError::Damaged)?;
        if entry.is_dir() || is_aside(&name) {
            continue;
        }
        size.files += 1;
        size.bytes = size.bytes.saturating_add(entry.size());
        if size.files > args.max_files as u64 {
            return Err(ExpandError::Files(args.max_files));
        }
        if size.bytes > args.max_bytes {
            return Err(ExpandError::Bytes(args.max_bytes));
        }
    }
    Ok(size)
}

/// Writes the files of an archive, within limits of what they contain, not of what its directory states.
fn unpack(archive: &mut zip::ZipArchive<fs::File>, args: &ExpandArgs) -> Result<(), ExpandError> {
    let mut left = args.max_bytes;
    let mut files = 0;
    for number in 0..archive.len() {
        let mut entry = archive.by_index(number).map_err(ExpandError::Damaged)?;
        let name = entry.name().map_err(ExpandError::Damaged)?.into_owned();
        if entry.is_dir() || is_aside(&name) {
            continue;
        }
        if !entry.is_file() {
            return Err(ExpandError::NoFile(name));
        }
        files += 1;
        if files > args.max_files {
            return Err(ExpandError::Files(args.max_files));
        }
        let path = names::relative_path(&name).ok_or_else(|| ExpandError::Name(name.clone()))?;
        let target = args.folder.join(path);
        if let Some(parent) = target.parent() {
            fs::create_dir_all(parent)?;
        }
        let out = fs::File::create_new(&target);
        let mut out = out.map_err(|error| ExpandError::Create { name: name.clone(), error })?;
        let stated = entry.size();
        let most = left.min(stated);
        let copied = io::copy(&mut (&mut entry).take(most.saturating_add(1)), &mut out);
        let copied = copied.map_err(ExpandError::DamagedFile)?;
        if copied > stated {
            return Err(ExpandError::Larger(name));
        }
        if copied > left {
            return Err(ExpandError::Bytes(args.max_bytes));
        }
        left -= copied;
        out.flush()?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::beneath::EntryKind;
    use zip::write::SimpleFileOptions;

    fn archive(files: &[(&str, &[u8])]) -> tempfile::NamedTempFile {
        let file = tempfile::Builder::new().suffix(".zip").tempfile().unwrap();
        let mut zip = zip::ZipWriter::new(file.reopen().unwrap());
        for (name, content) in files {
            zip.start_file(*name, SimpleFileOptions::default()).unwrap();
            zip.write_all(content).unwrap();
        }
        zip.finish().unwrap();
        file
    }

    fn args(archive: &Path, folder: &Path, max_bytes: u64) -> ExpandArgs {
        let (archive, folder) = (archive.to_owned(), folder.to_owned());
        ExpandArgs { archive, folder, max_bytes, max_files: 3, size: false }
    }

    fn measured(archive: &Path, max_bytes: u64) -> Result<StatedSize, ExpandError> {
        let mut zip = zip::ZipArchive::new(fs::File::open(archive).unwrap()).unwrap();
        measure(&mut zip, &args(archive, Path::new(""), max_bytes))
    }

    fn expanded(files: &[(&str, &[u8])], max_bytes: u64) -> Result<Vec<String>, ExpandError> {
        let (zip, folder) = (archive(files), tempfile::tempdir().unwrap());
        expand(&args(zip.path(), folder.path(), max_bytes))?;
        let entries = Beneath::of(folder.path()).unwrap().entries(100).unwrap();
        let files = entries.into_iter().filter(|entry| entry.kind == EntryKind::File);
        let mut paths: Vec<String> = files.map(|file| file.path.display().to_string()).collect();
        paths.sort();
        Ok(paths)
    }

    #[test]
    fn archives_are_expanded_within_their_limits() {
        let found = expanded(&[("a/b.obj", b"v 0 0 0"), ("c.mtl", b""), ("__MACOSX/x", b"")], 100).unwrap();
        assert_eq!(found, ["a/b.obj", "c.mtl"]);
        let bomb = vec![0; 1 << 20];
        assert!(matches!(expanded(&[("a", &bomb)], 1000), Err(ExpandError::Bytes(1000))));
        let four: [(&str, &[u8]); 4] = [("a", b""), ("b", b""), ("c", b""), ("d", b"")];
        assert!(expanded(&four, 100).unwrap_err().to_string().contains("more than 3 files"));
        for name in ["../a", "/etc/a", "a/../../b", "C:/a", ".ssh/a"] {
            let refused = expanded(&[(name, b"x")], 100).unwrap_err();
            assert!(refused.to_string().contains("cannot be the name"), "{name}: {refused}");
        }
    }

    #[test]
    fn archives_are_measured_by_their_directory_and_take_no_more() {
        let zip = archive(&[("a", &[0; 1000]), ("__MACOSX/x", b"xyz"), ("b", b"")]);
        assert_eq!(measured(zip.path(), 1000).unwrap(), StatedSize { bytes: 1000, files: 2 });
        assert!(matches!(measured(zip.path(), 999), Err(ExpandError::Bytes(999))));
        let many = archive(&["a", "b", "c", "d"].map(|name| (name, b"".as_slice())));
        assert!(matches!(measured(many.path(), 1), Err(ExpandError::Files(3))));
        // The directory says 10 bytes.
        let mut bytes = fs::read(zip.path()).unwrap();
        let entry = bytes.windows(4).position(|start| start == b"PK\x01\x02").unwrap();
        bytes[entry + 24..entry + 28].copy_from_slice(&10_u32.to_le_bytes());
        fs::write(zip.path(), bytes).unwrap();
        assert_eq!(measured(zip.path(), 1000).unwrap().bytes, 10);
        let folder = tempfile::tempdir().unwrap();
        let refused = expand(&args(zip.path(), folder.path(), 10)).unwrap_err();
        assert!(refused.to_string().starts_with("the archive is damaged"), "{refused}");
        assert!(fs::metadata(folder.path().join("a")).unwrap().len() <= 11);
    }
}
