//! Files below a folder that the processes of a job can write. Whatever a job leaves there, names lead to
//! regular files below the folder only: the system resolves them without links (`openat2`), so that nothing
//! is checked first and opened later.

use std::fs::File;
use std::io::{self, Read as _};
use std::path::{Path, PathBuf};

/// Bytes that a file or folder takes on the disk besides its content.
pub const BLOCK: u64 = 4096;
/// Deepest folder below one of a job.
const MAX_DEPTH: usize = 64;

/// A folder that others may have filled.
#[derive(Debug)]
pub struct Beneath {
    folder: system::Folder,
}

/// Something below a folder.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Entry {
    /// Its path.
    pub path: PathBuf,
    /// Kind of the entry.
    pub kind: EntryKind,
    /// Bytes of a file.
    pub bytes: u64,
    /// Bytes that it takes on the disk.
    pub space: u64,
}

/// Disk space, bytes, of a file or folder with this content: a block besides the content, or the space that
/// the system has given it, which can be more than the content.
pub(crate) fn space(content: u64, allocated: u64) -> u64 {
    content.saturating_add(BLOCK).max(allocated)
}

/// Kind of an entry.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum EntryKind {
    /// A regular file.
    File,
    /// A folder.
    Folder,
    /// A link, a pipe, a socket or a device.
    Other,
}

impl Beneath {
    /// The folder at a path, whose parents no job can change.
    ///
    /// # Errors
    /// If there is no folder.
    pub fn of(folder: &Path) -> io::Result<Beneath> {
        Ok(Beneath { folder: system::Folder::open(folder)? })
    }

    /// A folder below this one.
    ///
    /// # Errors
    /// For anything but a folder, and for names that lead through a link or out of the folder.
    pub fn folder(&self, path: impl AsRef<Path>) -> io::Result<Beneath> {
        Ok(Beneath { folder: self.folder.inner(path.as_ref())? })
    }

    /// Opens a regular file for reading.
    ///
    /// # Errors
    /// For anything but a regular file, and for names that lead through a link or out of the folder.
    pub fn file(&self, path: impl AsRef<Path>) -> io::Result<File> {
        let file = self.folder.file(path.as_ref())?;
        match file.metadata()?.is_file() {
            true => Ok(file),
            false => Err(io::Error::new(io::ErrorKind::InvalidInput, "not a regular file")),
        }
    }

    /// Reads a regular file of at most this many bytes.
    ///
    /// # Errors
    /// As for [`Beneath::file`], and for larger files.
    pub fn read(&self, path: impl AsRef<Path>, max_bytes: u64) -> io::Result<Vec<u8>> {
        let mut bytes = Vec::new();
        self.file(path)?.take(max_bytes.saturating_add(1)).read_to_end(&mut bytes)?;
        match bytes.len() as u64 > max_bytes {
            true => Err(io::ErrorKind::FileTooLarge.into()),
            false => Ok(bytes),
        }
    }

    /// Everything below the folder. What vanishes meanwhile is left out.
    ///
    /// # Errors
    /// Errors of folders, more than `most` entries, and very deep folders.
    pub fn entries(&self, most: usize) -> io::Result<Vec<Entry>> {
        let mut found = Vec::new();
        let mut folders = vec![PathBuf::new()];
        while let Some(inner) = folders.pop() {
            if inner.components().count() > MAX_DEPTH {
                return Err(io::Error::other(format!("folders are nested more than {MAX_DEPTH} deep")));
            }
            match self.folder.list(&inner, &mut found, most) {
                Err(error) if error.kind() == io::ErrorKind::NotFound => continue,
                listed => listed?,
            }
            if found.len() > most {
                return Err(io::Error::other(format!("there are more than {most} files and folders")));
            }
            let of_inner = |entry: &&Entry| entry.path.parent() == Some(inner.as_path());
            let inner_folders = found.iter().rev().take_while(of_inner);
            folders.extend(
                inner_folders.filter(|entry| entry.kind == EntryKind::Folder).map(|entry| entry.path.clone()),
            );
        }
        Ok(found)
    }
}

#[cfg(target_os = "linux")]
mod system {
    use super::{Entry, EntryKind};
    use rustix::fs::{AtFlags, CWD, Dir, FileType, Mode, OFlags, ResolveFlags, openat, openat2, statat};
    use std::fs::File;
    use std::io;
    use std::os::fd::OwnedFd;
    use std::os::unix::ffi::OsStrExt as _;
    use std::path::Path;

    const WITHIN: ResolveFlags =
        ResolveFlags::BENEATH.union(ResolveFlags::NO_SYMLINKS).union(ResolveFlags::NO_MAGICLINKS);

    #[derive(Debug)]
    pub struct Folder(OwnedFd);

    impl Folder {
        pub fn open(folder: &Path) -> io::Result<Folder> {
            let flags = OFlags::PATH | OFlags::DIRECTORY | OFlags::NOFOLLOW | OFlags::CLOEXEC;
            Ok(Folder(openat(CWD, folder, flags, Mode::empty())?))
        }

        fn within(&self, path: &Path, flags: OFlags) -> io::Result<OwnedFd> {
            let path = if path.as_os_str().is_empty() { Path::new(".") } else { path };
            let flags = flags | OFlags::RDONLY | OFlags::CLOEXEC;
            Ok(openat2(&self.0, path, flags, Mode::empty(), WITHIN)?)
        }

        pub fn inner(&self, path: &Path) -> io::Result<Folder> {
            Ok(Folder(self.within(path, OFlags::PATH | OFlags::DIRECTORY)?))
        }

        pub fn file(&self, path: &Path) -> io::Result<File> {
            // Pipes are not waited for.
            Ok(File::from(self.within(path, OFlags::NONBLOCK | OFlags::NOCTTY)?))
        }

        pub fn list(&self, inner: &Path, found: &mut Vec<Entry>, most: usize) -> io::Result<()> {
            let folder = self.within(inner, OFlags::DIRECTORY)?;
            for entry in Dir::read_from(&folder)? {
                let entry = entry?;
                let name = entry.file_name();
                if matches!(name.to_bytes(), b"." | b"..") {
                    continue;
                }
                let about = match statat(&folder, name, AtFlags::SYMLINK_NOFOLLOW) {
                    Err(rustix::io::Errno::NOENT) => continue,
                    about => about?,
                };
                let kind = match FileType::from_raw_mode(about.st_mode) {
                    FileType::RegularFile => EntryKind::File,
                    FileType::Directory => EntryKind::Folder,
                    _ => EntryKind::Other,
                };
                let bytes = u64::try_from(about.st_size).unwrap_or(0);
                let path = inner.join(std::ffi::OsStr::from_bytes(name.to_bytes()));
                let content = if kind == EntryKind::File { bytes } else { 0 };
                // Blocks of 512 bytes, whatever the file system has.
                let allocated = u64::try_from(about.st_blocks).unwrap_or(0).saturating_mul(512);
                found.push(Entry { path, kind, bytes, space: super::space(content, allocated) });
                if found.len() > most {
                    break;
                }
            }
            Ok(())
        }
    }
}

/// Systems without the sandbox, whose jobs are trusted.
#[cfg(not(target_os = "linux"))]
mod system {
    use super::{Entry, EntryKind};
    use std::fs::File;
    use std::io;
    use std::path::{Path, PathBuf};

    #[derive(Debug)]
    pub struct Folder(PathBuf);

    impl Folder {
        pub fn open(folder: &Path) -> io::Result<Folder> {
            std::fs::read_dir(folder)?;
            Ok(Folder(folder.canonicalize()?))
        }

        pub fn inner(&self, path: &Path) -> io::Result<Folder> {
            Folder::open(&self.0.join(path))
        }

        pub fn file(&self, path: &Path) -> io::Result<File> {
            let path = self.0.join(path).canonicalize()?;
            match path.starts_with(&self.0) {
                true => File::open(path),
                false => Err(io::ErrorKind::NotFound.into()),
            }
        }

        pub fn list(&self, inner: &Path, found: &mut Vec<Entry>, _: usize) -> io::Result<()> {
            for entry in std::fs::read_dir(self.0.join(inner))? {
                let entry = entry?;
                let about = entry.metadata()?;
                let kind = match (about.is_file(), about.is_dir()) {
                    (true, _) => EntryKind::File,
                    (_, true) => EntryKind::Folder,
                    _ => EntryKind::Other,
                };
                let content = if kind == EntryKind::File { about.len() } else { 0 };
                let space = super::space(content, 0);
                found.push(Entry { path: inner.join(entry.file_name()), kind, bytes: about.len(), space });
            }
            Ok(())
        }
    }
}

#[cfg(all(test, target_os = "linux"))]
mod tests {
    use super::*;
    use std::os::unix::fs::symlink;

    #[test]
    fn names_lead_to_regular_files_below_the_folder_only() {
        let all = tempfile::tempdir().unwrap();
        let at = |name: &str| all.path().join("out").join(name);
        std::fs::create_dir_all(at("a/b")).unwrap();
        std::fs::write(all.path().join("secret"), "secret").unwrap();
        std::fs::write(at("a/b/file"), "text").unwrap();
        symlink("../secret", at("link")).unwrap();
        symlink("a", at("folder")).unwrap();
        symlink("/", at("root")).unwrap();
        assert!(std::process::Command::new("mkfifo").arg(at("pipe")).status().unwrap().success());
        let out = Beneath::of(&all.path().join("out")).unwrap();
        assert_eq!(out.read("a/b/file", 4).unwrap(), b"text");
        assert!(out.read("a/b/file", 3).is_err(), "more bytes");
        for name in [
            "link",
            "folder/b/file",
            "root/etc/passwd",
            "../secret",
            "a/../../secret",
            "/etc/passwd",
            "pipe",
            "a",
            "",
            "absent",
            "a/b/file/x",
        ] {
            assert!(out.file(name).is_err(), "{name}");
        }
        assert!(Beneath::of(&at("folder")).is_err() && Beneath::of(&at("absent")).is_err());
        let mut kinds: Vec<_> = out.entries(100).unwrap().into_iter().map(|e| (e.path, e.kind)).collect();
        kinds.sort_by(|a, b| a.0.cmp(&b.0));
        let expected = [
            ("a", EntryKind::Folder),
            ("a/b", EntryKind::Folder),
            ("a/b/file", EntryKind::File),
            ("folder", EntryKind::Other),
            ("link", EntryKind::Other),
            ("pipe", EntryKind::Other),
            ("root", EntryKind::Other),
        ];
        assert_eq!(kinds, expected.map(|(path, kind)| (PathBuf::from(path), kind)));
        assert!(out.entries(6).is_err());
        std::fs::create_dir_all(at(&"d/".repeat(MAX_DEPTH + 1))).unwrap();
        assert!(out.entries(1000).is_err(), "folders without end");
    }
}
