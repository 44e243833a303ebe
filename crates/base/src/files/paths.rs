//! Names of files: links, devices, and names in the folder of another file.

use std::ffi::OsString;
use std::fs;
use std::io;
use std::path::{Path, PathBuf};

/// Maximum number of links that lead to a file, as in Linux.
const MAX_LINKS: usize = 40;

/// True if an option of the command line means standard output: `-`, or a name of it.
pub fn means_stdout(path: &Path) -> bool {
    path.as_os_str() == "-" || is_stdout(path)
}

/// True if the path denotes standard output.
pub fn is_stdout(path: &Path) -> bool {
    ["/dev/stdout", "/dev/fd/1", "/proc/self/fd/1"].iter().any(|name| path == Path::new(name))
}

/// True if the path is a pipe, a terminal, a device or a descriptor of this process, which is written
/// directly.
pub fn is_special(path: &Path) -> bool {
    fs::metadata(path).is_ok_and(|m| !m.is_file() && !m.is_dir()) || is_descriptor(path)
}

/// True if the path is an open file of this process, such as `/dev/fd/3`. It must not be replaced: others
/// that have it open would not see it.
fn is_descriptor(path: &Path) -> bool {
    let folder = path.parent().and_then(|folder| fs::canonicalize(folder).ok());
    folder.is_some_and(|folder| folder.starts_with("/proc") && folder.ends_with("fd"))
}

/// Follows symbolic links to the file that they denote, which need not exist. A path that is not a link is
/// returned unchanged.
///
/// # Errors
/// The links form a circle, or cannot be read.
pub fn resolve(path: &Path) -> io::Result<PathBuf> {
    let mut path = path.to_path_buf();
    for _ in 0..MAX_LINKS {
        match fs::symlink_metadata(&path) {
            Ok(about) if about.is_symlink() => {
                let target = fs::read_link(&path)?;
                path = folder_of(&path).join(target);
            }
            _ => return Ok(path),
        }
    }
    Err(io::Error::other(format!("more than {MAX_LINKS} symbolic links")))
}

/// Returns a path that is equal for all names of the same file, whether it exists or not: the canonical
/// folder and the name of the file that links lead to.
pub fn identity(path: &Path) -> PathBuf {
    let path = resolve(path).unwrap_or_else(|_| path.to_path_buf());
    let folder = fs::canonicalize(folder_of(&path));
    match (folder, path.file_name()) {
        (Ok(folder), Some(name)) => folder.join(name),
        _ => fs::canonicalize(&path).unwrap_or(path),
    }
}

/// The folder of a file; `.` for a bare name.
pub(super) fn folder_of(path: &Path) -> &Path {
    path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."))
}

/// Returns `dir/stem.ext` with `suffix` after the stem, and with another extension if one is given.
/// `.copc.laz` is one extension; a leading point belongs to the stem.
pub fn with_suffix(path: &Path, suffix: &str, extension: Option<&str>) -> PathBuf {
    let stem = path.file_stem().unwrap_or_default();
    let own = path.extension().map(OsString::from);
    let is_laz = own.as_ref().is_some_and(|e| e.eq_ignore_ascii_case("laz"));
    let octree = Path::new(stem).extension().filter(|e| is_laz && e.eq_ignore_ascii_case("copc"));
    let (stem, own) = match (octree, own) {
        (Some(octree), Some(laz)) => {
            let mut both = octree.to_os_string();
            both.push(".");
            both.push(laz);
            (Path::new(stem).file_stem().unwrap_or_default(), Some(both))
        }
        (_, own) => (stem, own),
    };
    let mut name = stem.to_os_string();
    name.push(suffix);
    if let Some(extension) = extension.map(OsString::from).or(own) {
        name.push(".");
        name.push(extension);
    }
    path.with_file_name(name)
}

/// Returns the first of `a.SUFFIX.laz`, `a.SUFFIX-2.laz` … for `a.laz` that is not `taken`.
pub fn free_name(path: &Path, suffix: &str, taken: impl Fn(&Path) -> bool) -> PathBuf {
    let name = |number: u32| match number {
        1 => with_suffix(path, &format!(".{suffix}"), None),
        _ => with_suffix(path, &format!(".{suffix}-{number}"), None),
    };
    (1..u32::MAX).map(name).find(|name| !taken(name)).unwrap_or_else(|| name(u32::MAX))
}
