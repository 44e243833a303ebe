//! Lists, hashes and classifies the files of an upload.

use super::error::UploadError;
use crate::beneath::{Beneath, EntryKind};
use crate::config::ServeArgs;
use crate::names;
use crate::store::{FileKind, UploadFile};
use crate::tokens::hex;
use sha2::{Digest as _, Sha256};
use std::collections::BTreeSet;
use std::io::{self, Read as _};
use std::path::Path;

/// Longest part of the first line of a table in which names of columns are looked for, bytes.
const MAX_LINE: usize = 4096;
/// Words of columns of trees, which point clouds of forests may have, too.
const OF_TREES: [&str; 7] = ["species", "baumart", "art", "dbh", "bhd", "crown", "kronendurchmesser"];
/// Words of the column that inventories need besides the places of trees.
const OF_HEIGHTS: [&str; 10] = [
    "height",
    "h",
    "ht",
    "hgt",
    "treeheight",
    "totalheight",
    "h\u{f6}he",
    "hoehe",
    "baumh\u{f6}he",
    "baumhoehe",
];
/// Words of columns that only point clouds have.
const OF_CLOUDS: [&str; 8] = [
    "intensity",
    "amplitude",
    "reflectance",
    "return",
    "returns",
    "returnnumber",
    "classification",
    "gpstime",
];

/// Contents of an upload.
pub(super) struct Contents {
    /// All files, sorted.
    pub files: Vec<UploadFile>,
    /// Number of folders, its own included.
    pub folders: u64,
    /// Hash over the names and contents of all files.
    pub sha256: String,
}

/// Lists and hashes the files of an upload, and writes them to the disk.
pub(super) fn hash_files(root: &Path, limits: &ServeArgs) -> Result<Contents, UploadError> {
    let folder = Beneath::of(root)?;
    let mut paths = BTreeSet::new();
    let mut folders = 1;
    // Each path has at most so many folders.
    for entry in folder.entries(limits.max_files.saturating_mul(names::MAX_DEPTH))? {
        match entry.kind {
            EntryKind::Folder => {
                folders += 1;
                sync_folder(&root.join(entry.path))?;
            }
            EntryKind::File => {
                paths.insert(entry.path);
            }
            EntryKind::Other => {
                return Err(UploadError::Wrong("the upload has something that is no file".to_owned()));
            }
        }
    }
    sync_folder(root)?;
    if paths.is_empty() {
        return Err(UploadError::Wrong("the archive has no files".to_owned()));
    }
    if paths.len() > limits.max_files {
        return Err(UploadError::TooLarge(format!("an upload has at most {} files", limits.max_files)));
    }
    let mut all = Sha256::new();
    let mut buffer = vec![0; 256 << 10];
    let mut files = Vec::new();
    for path in paths {
        let text = path.to_str().ok_or_else(|| UploadError::Wrong("a name that is not UTF-8".to_owned()))?;
        let text = text.replace('\\', "/");
        let mut file = folder.file(&path)?;
        let mut hash = Sha256::new();
        let mut bytes = 0;
        let mut kind = FileKind::Other;
        loop {
            let read = file.read(&mut buffer)?;
            if read == 0 {
                break;
            }
            if bytes == 0 {
                kind = kind_of(&path, &buffer[..read]);
            }
            hash.update(&buffer[..read]);
            bytes += read as u64;
        }
        file.sync_all()?;
        all.update(format!("{}:{text}:{bytes}:", text.len()));
        all.update(hash.finalize());
        files.push(UploadFile { path: text, bytes, kind });
    }
    Ok(Contents { files, folders, sha256: hex(&all.finalize()) })
}

/// Kind of a file by its ending and beginning.
fn kind_of(path: &Path, start: &[u8]) -> FileKind {
    let ending = path.extension().and_then(|ending| ending.to_str()).unwrap_or_default();
    match ending.to_ascii_lowercase().as_str() {
        "xml" => kind_of_document(start),
        "csv" | "txt" | "tsv" if is_inventory(start) => FileKind::Inventory,
        _ => FileKind::Other,
    }
}

/// True if the first line of a table names heights and other sizes of trees, and nothing that only point
/// clouds have.
fn is_inventory(start: &[u8]) -> bool {
    let line = start.split(|byte| *byte == b'\n').next().unwrap_or_default();
    let line = String::from_utf8_lossy(&line[..line.len().min(MAX_LINE)]).to_lowercase();
    let has = |known: &[&str]| line.split(|c: char| !c.is_alphanumeric()).any(|word| known.contains(&word));
    has(&OF_TREES) && has(&OF_HEIGHTS) && !has(&OF_CLOUDS)
}

/// Kind of an XML document by its beginning.
fn kind_of_document(start: &[u8]) -> FileKind {
    let has = |tag: &[u8]| start.windows(tag.len()).any(|window| window == tag);
    match (has(b"<survey"), has(b"<scene")) {
        (true, _) => FileKind::Survey,
        (_, true) => FileKind::Scene,
        _ => FileKind::Other,
    }
}

#[cfg(unix)]
pub(super) fn sync_folder(folder: &Path) -> io::Result<()> {
    std::fs::File::open(folder)?.sync_all()
}

#[cfg(not(unix))]
pub(super) fn sync_folder(_: &Path) -> io::Result<()> {
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs;

    #[test]
    fn kinds_of_files_follow_from_their_beginnings() {
        for (name, start, kind) in [
            ("a.XML", "<document><scene id='a'>", FileKind::Scene),
            ("a.xml", "<document><survey scene='a'>", FileKind::Survey),
            ("a.csv", "Baum;X;Y;H\u{f6}he;BHD;Art\n1;2", FileKind::Inventory),
            ("a.csv", "x,y,height,species", FileKind::Inventory),
            ("a.txt", "time x y z roll pitch yaw\n0 0 0 0 0 0 0 dbh", FileKind::Other),
            ("a.csv", "tree_id,x,y,tree_height,dbh", FileKind::Inventory),
            ("a.csv", "x,y,z,particle,intensity", FileKind::Other),
            ("a.csv", "x,y,z,species", FileKind::Other),
            ("a.csv", "x,y,z,height_above_ground,species,intensity", FileKind::Other),
            ("a.xyz", "species", FileKind::Other),
        ] {
            assert_eq!(kind_of(Path::new(name), start.as_bytes()), kind, "{name}: {start}");
        }
    }

    #[test]
    fn folders_count() {
        let folder = tempfile::tempdir().unwrap();
        fs::create_dir_all(folder.path().join("a/b")).unwrap();
        fs::write(folder.path().join("a/b/c"), "").unwrap();
        let limits = <crate::config::Cli as clap::Parser>::parse_from(["serve"]).serve;
        let found = hash_files(folder.path(), &limits).unwrap();
        assert_eq!((found.files.len(), found.folders), (1, 3));
    }

    #[test]
    fn the_hash_depends_on_names_and_contents() {
        let limits = <crate::config::Cli as clap::Parser>::parse_from(["serve"]).serve;
        let hash = |files: &[(&str, &str)]| {
            let folder = tempfile::tempdir().unwrap();
            files.iter().for_each(|(name, text)| fs::write(folder.path().join(name), text).unwrap());
            hash_files(folder.path(), &limits).unwrap().sha256
        };
        let first = hash(&[("a", "1"), ("b", "2")]);
        assert_eq!(first, hash(&[("b", "2"), ("a", "1")]));
        assert!(
            [hash(&[("a", "2"), ("b", "1")]), hash(&[("a", "12")]), hash(&[("a", "1"), ("c", "2")])]
                .iter()
                .all(|other| *other != first)
        );
    }
}
