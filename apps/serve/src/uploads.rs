//! Uploads: files of a form are received into a folder of their own, archives expanded by a confined process,
//! everything hashed, and only then listed under the name that their owner gives them.

use crate::archives::{Unpacking, is_archive};
use crate::beneath::{BLOCK, Beneath, EntryKind};
use crate::config::ServeArgs;
use crate::names;
use crate::records::Kind;
use crate::reservations::Reservation;
use crate::store::{FileKind, Store, StoreError, Upload, UploadFile, now};
use crate::tokens::{hex, random_name};
use axum::extract::Multipart;
use axum::extract::multipart::{Field, MultipartError};
use sha2::{Digest as _, Sha256};
use std::collections::BTreeSet;
use std::fs;
use std::io::{self, Read as _};
use std::path::{Path, PathBuf};
use std::time::Duration;
use tokio::io::AsyncWriteExt as _;

/// Longest wait for the next bytes of an upload.
const MAX_WAIT: Duration = Duration::from_secs(60);
/// Longest time of an upload.
pub const MAX_TIME: Duration = Duration::from_secs(3600);
/// Longest text of a form's field, bytes.
const MAX_TEXT: usize = 4096;
/// Highest number that is added to a name that is taken.
const MAX_NUMBER: u32 = 1000;
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

/// Why an upload is refused.
#[derive(Debug, thiserror::Error)]
pub enum UploadError {
    /// It is not as it should be.
    #[error("{0}")]
    Wrong(String),
    /// It is larger than allowed.
    #[error("{0}")]
    TooLarge(String),
    /// The owner has an upload of that name.
    #[error("there is an upload `{0}` already; choose another name, or remove that one first")]
    Taken(String),
    /// The form is not from a page of the service.
    #[error("the form is from an older page; load the page again")]
    Forged,
    /// The connection.
    #[error("the upload ended early: {0}")]
    Form(#[from] MultipartError),
    /// The store.
    #[error(transparent)]
    Store(#[from] StoreError),
}

impl From<io::Error> for UploadError {
    fn from(error: io::Error) -> UploadError {
        UploadError::Store(StoreError::Files(error))
    }
}

/// Files that were received, in a folder that is removed unless they are listed.
#[derive(Debug)]
pub struct Received {
    folder: tempfile::TempDir,
    /// The name that the form gives, if any.
    name: Option<String>,
    /// True if a number is added to a name that is taken.
    is_numbered: bool,
    first: String,
    files: BTreeSet<PathBuf>,
    /// Disk space of the files.
    space: Reservation,
}

/// Receives the files of a form for an owner. `is_genuine` judges the field `csrf`, which forms of pages
/// begin with; `None` where none is needed.
///
/// # Errors
/// [`UploadError`].
pub async fn receive(
    mut form: Multipart,
    owner: &str,
    store: &Store,
    limits: &ServeArgs,
    is_genuine: Option<&(dyn Fn(&str) -> bool + Sync)>,
) -> Result<Received, UploadError> {
    let folder = tempfile::tempdir_in(store.incoming())?;
    let mut received = Received::new(folder, owner, store);
    let mut room = Room {
        bytes: 0,
        max_bytes: limits.max_upload,
        listed: store.listed_bytes(owner)?,
        max_stored: limits.max_stored,
    };
    let mut is_admitted = is_genuine.is_none();
    while let Some(mut field) = form.next_field().await? {
        let Some(file_name) = field.file_name().map(str::to_owned) else {
            let key = field.name().unwrap_or_default().to_owned();
            let text = text_of(&mut field).await?;
            match key.as_str() {
                "csrf" => is_admitted = is_admitted || is_genuine.is_some_and(|is_genuine| is_genuine(&text)),
                "name" if !text.trim().is_empty() => received.name = Some(text.trim().to_owned()),
                "taken" => received.is_numbered = text == "number",
                _ => {}
            }
            continue;
        };
        if !is_admitted {
            return Err(UploadError::Forged);
        }
        // Browsers send an empty file where none was chosen.
        if file_name.is_empty() {
            continue;
        }
        let Some(path) = names::relative_path(&file_name) else {
            return Err(UploadError::Wrong(format!(
                "`{file_name}` cannot be the name of a file here; rename it"
            )));
        };
        if received.first.is_empty() {
            received.first.clone_from(&file_name);
        }
        if received.files.len() >= limits.max_files {
            return Err(UploadError::TooLarge(format!("an upload has at most {} files", limits.max_files)));
        }
        let target = received.folder.path().join(&path);
        if !received.files.insert(path) {
            return Err(UploadError::Wrong(format!("the upload has two files `{file_name}`")));
        }
        room.take(&mut received.space, BLOCK)?;
        receive_file(&mut field, &target, &mut received.space, &mut room).await?;
    }
    if !is_admitted {
        return Err(UploadError::Forged);
    }
    match received.files.is_empty() {
        true => {
            Err(UploadError::Wrong("the upload has no files; choose some in the field `file`".to_owned()))
        }
        false => Ok(received),
    }
}

/// Room for an upload.
struct Room {
    /// Bytes that have been received.
    bytes: u64,
    /// Maximum number of these bytes.
    max_bytes: u64,
    /// Disk space of the owner at the start, bytes, without uploads that are being received.
    listed: u64,
    /// Maximum disk space of an owner, bytes.
    max_stored: u64,
}

impl Room {
    /// Reserves disk space.
    fn take(&self, space: &mut Reservation, bytes: u64) -> Result<(), UploadError> {
        match self.listed.saturating_add(space.add(bytes)) > self.max_stored {
            true => Err(too_much(self.max_stored)),
            false => Ok(()),
        }
    }
}

fn too_much(max_stored: u64) -> UploadError {
    UploadError::TooLarge(format!(
        "your uploads and jobs would take more than {max_stored} bytes; remove some first"
    ))
}

/// Receives a file of an upload.
async fn receive_file(
    field: &mut Field<'_>,
    target: &Path,
    space: &mut Reservation,
    room: &mut Room,
) -> Result<(), UploadError> {
    if let Some(parent) = target.parent() {
        tokio::fs::create_dir_all(parent).await?;
    }
    let mut file = tokio::fs::File::create_new(target).await?;
    while let Some(chunk) = next_chunk(field).await? {
        room.bytes += chunk.len() as u64;
        if room.bytes > room.max_bytes {
            return Err(UploadError::TooLarge(format!("an upload has at most {} bytes", room.max_bytes)));
        }
        room.take(space, chunk.len() as u64)?;
        file.write_all(&chunk).await?;
    }
    Ok(file.flush().await?)
}

async fn next_chunk(field: &mut Field<'_>) -> Result<Option<axum::body::Bytes>, UploadError> {
    match tokio::time::timeout(MAX_WAIT, field.chunk()).await {
        Ok(chunk) => Ok(chunk?),
        Err(_) => Err(UploadError::Wrong(format!("no bytes came for {} s", MAX_WAIT.as_secs()))),
    }
}

async fn text_of(field: &mut Field<'_>) -> Result<String, UploadError> {
    let mut text = Vec::new();
    while let Some(chunk) = next_chunk(field).await? {
        text.extend_from_slice(&chunk);
        if text.len() > MAX_TEXT {
            return Err(UploadError::TooLarge(format!("a field of the form has at most {MAX_TEXT} bytes")));
        }
    }
    String::from_utf8(text).map_err(|_| UploadError::Wrong("a field of the form is not UTF-8".to_owned()))
}

impl Received {
    fn new(folder: tempfile::TempDir, owner: &str, store: &Store) -> Received {
        Received {
            folder,
            name: None,
            is_numbered: false,
            first: String::new(),
            files: BTreeSet::new(),
            space: Reservation::new(&store.receiving, owner),
        }
    }

    /// Texts of the program itself as an upload under a name, or a name with a number if that is taken.
    ///
    /// # Errors
    /// [`UploadError`].
    pub fn of_texts(
        store: &Store,
        owner: &str,
        name: &str,
        texts: &[(&'static str, String)],
    ) -> Result<Received, UploadError> {
        let folder = tempfile::tempdir_in(store.incoming())?;
        let mut received = Received::new(folder, owner, store);
        for (file, text) in texts {
            fs::write(received.folder.path().join(file), text)?;
            received.files.insert(PathBuf::from(file));
        }
        received.name = Some(name.to_owned());
        received.is_numbered = true;
        Ok(received)
    }

    /// Expands archives, hashes the files and lists the upload.
    ///
    /// # Errors
    /// [`UploadError`].
    pub fn list(mut self, owner: &str, store: &Store, limits: &ServeArgs) -> Result<Upload, UploadError> {
        let name = match &self.name {
            Some(name) if names::is_upload_name(name) => name.clone(),
            Some(name) => {
                return Err(UploadError::Wrong(format!(
                    "`{name}` cannot be the name of an upload: expected letters, digits, - . _ and +, and another name than those of the \
                     service's own files (data, jobs, job.toml …)"
                )));
            }
            None => names::upload_name_from(
                self.first.split_once(['/', '\\']).map_or(self.first.as_str(), |(folder, _)| folder),
            ),
        };
        // The folder that a browser sends a folder's files with is the upload itself.
        let mut root = self.folder.path().to_owned();
        let work = tempfile::tempdir_in(store.incoming())?;
        let only = self.files.first().filter(|_| self.files.len() == 1).map(|path| root.join(path));
        if let Some(archive) = only
            && is_archive(&archive)?
        {
            root = self.expand(&archive, work.path(), owner, store, limits)?;
        }
        let root = inner_folder(&root)?;
        let Contents { files, folders, sha256 } = hash_files(&root, limits)?;
        let blocks = folders.saturating_add(files.len() as u64).saturating_mul(BLOCK);
        let taken = files.iter().map(|file| file.bytes).fold(blocks, u64::saturating_add);
        let others = store.stored_bytes(owner)?.saturating_sub(self.space.bytes());
        if others.saturating_add(taken) > limits.max_stored {
            return Err(too_much(limits.max_stored));
        }
        self.space.set(taken);
        let mut upload = Upload {
            id: random_name(16),
            name: name.clone(),
            files: files.len() as u64,
            folders,
            bytes: files.iter().map(|file| file.bytes).sum(),
            sha256,
            created: now(),
        };
        let target = store.upload_folder(&upload.id);
        fs::rename(&root, &target)?;
        sync_folder(&store.root().join("uploads"))?;
        let paths: Vec<String> = files.iter().map(|file| file.path.clone()).collect();
        if let Err(error) = store.keep(Kind::Upload, &upload.id, &paths) {
            store.discard(Kind::Upload, &upload.id)?;
            return Err(error.into());
        }
        let most = if self.is_numbered { MAX_NUMBER } else { 1 };
        for number in 1..=most {
            upload.name = if number == 1 { name.clone() } else { format!("{name}-{number}") };
            if store.add_upload(owner, &upload, &files)? {
                // The database counts it from now on.
                self.space.set(0);
                return Ok(upload);
            }
        }
        store.discard(Kind::Upload, &upload.id)?;
        Err(UploadError::Taken(name))
    }

    /// Expands an archive within the room that its owner has, of which it takes no more than the directory of
    /// the archive says. Returns the folder of its files.
    fn expand(
        &mut self,
        archive: &Path,
        work: &Path,
        owner: &str,
        store: &Store,
        limits: &ServeArgs,
    ) -> Result<PathBuf, UploadError> {
        let unpacking = Unpacking::new(archive, work, limits)?;
        let stated = unpacking.stated_size()?;
        self.space.add(stated.bytes.saturating_add(stated.files.saturating_mul(BLOCK)));
        if store.stored_bytes(owner)? > limits.max_stored {
            return Err(too_much(limits.max_stored));
        }
        unpacking.expand(stated.bytes)
    }
}

/// The folder itself, or the only thing in it if that is a folder. The folder `data` stays: files of HELIOS++
/// name others by it.
fn inner_folder(folder: &Path) -> io::Result<PathBuf> {
    let entries: Vec<_> = fs::read_dir(folder)?.collect::<io::Result<_>>()?;
    match entries.as_slice() {
        [only] if only.file_type()?.is_dir() && only.file_name() != names::DATA => Ok(only.path()),
        _ => Ok(folder.to_owned()),
    }
}

/// Contents of an upload.
struct Contents {
    /// All files, sorted.
    files: Vec<UploadFile>,
    /// Number of folders, its own included.
    folders: u64,
    /// Hash over the names and contents of all files.
    sha256: String,
}

/// Lists and hashes the files of an upload, and writes them to the disk.
fn hash_files(root: &Path, limits: &ServeArgs) -> Result<Contents, UploadError> {
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
    let line = String::from_utf8_lossy(&line[..line.len().min(MAX_TEXT)]).to_lowercase();
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
fn sync_folder(folder: &Path) -> io::Result<()> {
    fs::File::open(folder)?.sync_all()
}

#[cfg(not(unix))]
fn sync_folder(_: &Path) -> io::Result<()> {
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_only_folder_of_an_upload_is_the_upload_unless_files_are_named_by_it() {
        for (made, inner) in [("wood/a", "wood"), ("data/scenes/a", ""), ("wood/data/a", "wood"), ("a", "")] {
            let folder = tempfile::tempdir().unwrap();
            let path = folder.path().join(made);
            fs::create_dir_all(path.parent().unwrap()).unwrap();
            fs::write(path, "").unwrap();
            assert_eq!(inner_folder(folder.path()).unwrap(), folder.path().join(inner), "{made}");
        }
    }

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
