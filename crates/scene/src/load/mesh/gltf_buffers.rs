//! Buffers of glTF documents: the binary chunk of a GLB file, files next to the document, base64 within it.

use super::GltfError;
use crate::text::{Source, shown};
use base64::Engine;
use serde::Deserialize;
use std::ops::Range;
use std::path::{Component, Path, PathBuf};

#[derive(Debug, Deserialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct BufferJson {
    uri: Option<String>,
    byte_length: usize,
}

/// Bytes of a buffer.
pub(super) enum Buffer {
    /// The binary chunk of the document's own file, as a range of it.
    Chunk(std::ops::Range<usize>),
    File(Source),
    Inline(Vec<u8>),
}

impl Buffer {
    /// The bytes; those of a chunk are a part of the `document`.
    pub fn bytes<'b>(&'b self, document: &'b Source) -> &'b [u8] {
        match self {
            Buffer::Chunk(range) => &document.bytes()[range.clone()],
            Buffer::File(source) => source.bytes(),
            Buffer::Inline(bytes) => bytes,
        }
    }
}

/// The JSON of a document and the place of its binary chunk.
pub(super) type Chunks<'b> = (&'b [u8], Option<Range<usize>>);

pub(super) fn split_chunks(bytes: &[u8]) -> Result<Chunks<'_>, GltfError> {
    if !bytes.starts_with(b"glTF") {
        return Ok((bytes, None));
    }
    let number = |at: usize| {
        let four = bytes.get(at..at + 4)?;
        Some(u32::from_le_bytes([four[0], four[1], four[2], four[3]]) as usize)
    };
    let version = number(4).ok_or(GltfError::Truncated)?;
    if version != 2 {
        return Err(GltfError::GlbVersion(version));
    }
    let length = number(12).ok_or(GltfError::Truncated)?;
    let text = bytes.get(20..20 + length).ok_or(GltfError::Truncated)?;
    let at = 20 + length;
    let chunk = match number(at) {
        Some(length) if bytes.get(at + 4..at + 8) == Some(b"BIN\0") => {
            let range = at + 8..at + 8 + length;
            bytes.get(range.clone()).ok_or(GltfError::Truncated)?;
            Some(range)
        }
        _ => None,
    };
    Ok((text, chunk))
}

/// Opens a buffer. A file whose name has `\` between folders is warned of.
pub(super) fn open_buffer(
    path: &Path,
    index: usize,
    buffer: &BufferJson,
    chunk: &Option<Range<usize>>,
    warnings: &mut Vec<String>,
) -> Result<Buffer, GltfError> {
    let opened = match (&buffer.uri, chunk) {
        (None, Some(range)) if index == 0 => Buffer::Chunk(range.clone()),
        (None, _) => return Err(GltfError::EmptyBuffer(index)),
        (Some(uri), _) => match uri.strip_prefix("data:") {
            Some(data) => {
                let text = data.split_once(";base64,").ok_or(GltfError::NotBase64)?.1;
                let decoded = base64::engine::general_purpose::STANDARD.decode(text);
                Buffer::Inline(decoded.map_err(|e| GltfError::Base64 { index, what: e.to_string() })?)
            }
            None if uri.contains("://") => {
                return Err(GltfError::Remote(uri.clone()));
            }
            None => {
                let written = decode_percent(uri);
                let with_slashes = written.replace('\\', "/");
                let is_respelled = with_slashes != written && !path.with_file_name(&written).exists();
                if is_respelled {
                    warnings.push(format!(
                        "there is no file `{}`; `{with_slashes}` is read",
                        shown(written.as_bytes())
                    ));
                }
                let name = PathBuf::from(if is_respelled { with_slashes } else { written });
                let is_sibling =
                    name.components().all(|c| matches!(c, Component::Normal(_) | Component::CurDir));
                let file = path.with_file_name(&name);
                if !is_sibling {
                    let name = shown(&name.as_os_str().as_encoded_bytes()[..name.as_os_str().len().min(200)]);
                    return Err(GltfError::Elsewhere(name));
                }
                if file.metadata().is_ok_and(|about| !about.is_file()) {
                    return Err(GltfError::NotRegular { file });
                }
                Buffer::File(Source::open(&file).map_err(|source| GltfError::Buffer { file, source })?)
            }
        },
    };
    let length = match &opened {
        Buffer::Chunk(range) => range.len(),
        Buffer::File(source) => source.bytes().len(),
        Buffer::Inline(bytes) => bytes.len(),
    };
    if length < buffer.byte_length {
        return Err(GltfError::ShortBuffer { index, held: length, stated: buffer.byte_length });
    }
    Ok(opened)
}

/// A relative URI as a path: `%20` is a blank.
pub(super) fn decode_percent(uri: &str) -> String {
    let bytes = uri.as_bytes();
    let mut decoded = Vec::with_capacity(bytes.len());
    let mut at = 0;
    while at < bytes.len() {
        let hex = uri.get(at + 1..at + 3).and_then(|two| u8::from_str_radix(two, 16).ok());
        match (bytes[at], hex) {
            (b'%', Some(byte)) => {
                decoded.push(byte);
                at += 3;
            }
            (byte, _) => {
                decoded.push(byte);
                at += 1;
            }
        }
    }
    String::from_utf8_lossy(&decoded).into_owned()
}
