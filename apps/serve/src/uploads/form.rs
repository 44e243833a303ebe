//! Receives the files of a form.

use super::Received;
use super::error::{UploadError, too_much};
use crate::beneath::BLOCK;
use crate::config::ServeArgs;
use crate::names;
use crate::reservations::Reservation;
use crate::store::Store;
use axum::extract::Multipart;
use axum::extract::multipart::Field;
use std::path::Path;
use std::time::Duration;
use tokio::io::AsyncWriteExt as _;

/// Longest wait for the next bytes of an upload.
const MAX_WAIT: Duration = Duration::from_secs(60);
/// Longest time of an upload.
pub const MAX_TIME: Duration = Duration::from_secs(3600);
/// Longest text of a form's field, bytes.
const MAX_TEXT: usize = 4096;

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
