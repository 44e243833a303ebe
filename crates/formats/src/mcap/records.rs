//! Reads the records of an MCAP, and verifies its checksums.

use super::container::{MAGIC, op};
use flate2::Crc;
use std::io::Read;
use std::path::Path;
use vlscan_base::diag::ProblemKind;
use vlscan_base::error::{Error, Result};

/// Kind and length before the content of a record, bytes.
pub(super) const HEAD_BYTES: usize = 9;
/// Maximum length of a record, bytes.
const MAX_RECORD_BYTES: u64 = 1 << 31;

/// A message with the number of its channel.
#[derive(Debug, PartialEq)]
pub(super) struct Message {
    pub channel: u16,
    pub time_ns: u64,
    pub data: Vec<u8>,
}

/// The messages of a file that this program has written, with one message in each chunk.
pub(super) struct Messages<'a> {
    input: Input<'a>,
    bytes: Vec<u8>,
}

impl<'a> Messages<'a> {
    /// Begins to read a file.
    ///
    /// # Errors
    /// [`Error::Io`]; [`Error::Input`] for another file.
    pub fn begin(source: &'a mut dyn Read, path: &'a Path) -> Result<Messages<'a>> {
        let (mut input, mut bytes) = (Input::new(source, path), Vec::new());
        input.read(MAGIC.len() as u64, &mut bytes)?;
        if bytes != MAGIC {
            return Err(wrong(path, "it is no MCAP"));
        }
        Ok(Messages { input, bytes })
    }

    /// The next message in the order of the file; `None` after the last one.
    ///
    /// # Errors
    /// [`Error::Io`]; [`Error::Input`] for a file that is damaged or ends before.
    pub fn read_next(&mut self) -> Result<Option<Message>> {
        loop {
            let at = self.input.at;
            let kind = self.input.record(&mut self.bytes)?;
            if kind == op::DATA_END {
                return Ok(None);
            }
            if kind == op::CHUNK {
                let path = self.input.path;
                let message = message_of(&self.bytes[HEAD_BYTES..]);
                let damaged = || wrong(path, &format!("the record at byte {at} is damaged"));
                return message.map(Some).ok_or_else(damaged);
            }
        }
    }
}

/// The first message of the content of a chunk.
fn message_of(chunk: &[u8]) -> Option<Message> {
    let mut fields = Fields(chunk);
    // Two times, size and checksum; compression; size.
    fields.take(28)?;
    fields.string()?;
    fields.take(8)?;
    let kind = fields.take(1)?[0];
    fields.take(8)?;
    let channel = fields.u16()?;
    // Sequence and two times.
    fields.take(4)?;
    let time_ns = fields.u64()?;
    fields.take(8)?;
    (kind == op::MESSAGE).then(|| Message { channel, time_ns, data: fields.0.to_vec() })
}

/// Compares a checksum with the one in the file; 0 means that the file has none.
pub(super) fn check_sum(stated: u32, sum: &Crc, path: &Path, what: impl Fn() -> String) -> Result<()> {
    if stated == 0 || stated == sum.sum() {
        return Ok(());
    }
    let message = format!("the checksum of {} does not match: the file is damaged", what());
    Err(wrong(path, &message))
}

/// A file that is being read.
pub(super) struct Input<'a> {
    source: &'a mut dyn Read,
    path: &'a Path,
    /// Number of bytes that have been read.
    pub at: u64,
}

impl<'a> Input<'a> {
    /// Begins to read a file.
    pub fn new(source: &'a mut dyn Read, path: &'a Path) -> Input<'a> {
        Input { source, path, at: 0 }
    }

    /// Appends this many bytes of the file to `bytes`.
    pub fn read(&mut self, length: u64, bytes: &mut Vec<u8>) -> Result<()> {
        let read = Read::take(&mut *self.source, length).read_to_end(bytes);
        let read = read.map_err(|e| Error::io("read", self.path, e))? as u64;
        self.at += read;
        if read != length {
            let message = format!(
                "{}: the file ends within its records, after byte {}; is it truncated?",
                self.path.display(),
                self.at
            );
            return Err(Error::input_of(ProblemKind::Truncated, message));
        }
        Ok(())
    }

    /// Reads the next record with its head and returns its kind.
    pub fn record(&mut self, bytes: &mut Vec<u8>) -> Result<u8> {
        let at = self.at;
        bytes.clear();
        self.read(HEAD_BYTES as u64, bytes)?;
        let length = u64::from_le_bytes(std::array::from_fn(|i| bytes[1 + i]));
        if length > MAX_RECORD_BYTES {
            return Err(wrong(self.path, &format!("the record at byte {at} is longer than 2 GB")));
        }
        self.read(length, bytes)?;
        Ok(bytes[0])
    }

    /// Verifies the checksum of the summary, which is not used, and the end of the file.
    pub fn check_summary(mut self) -> Result<()> {
        let (mut sum, mut bytes) = (Crc::new(), Vec::new());
        loop {
            let at = self.at;
            if self.record(&mut bytes)? != op::FOOTER {
                sum.update(&bytes);
                continue;
            }
            // The checksum is the last field of the footer and includes the fields before it.
            let stated = bytes.len().checked_sub(4).filter(|at| *at >= HEAD_BYTES);
            let damaged = || wrong(self.path, &format!("the footer at byte {at} is damaged"));
            let (before, stated) = bytes.split_at(stated.ok_or_else(damaged)?);
            sum.update(before);
            let stated = Fields(stated).u32().ok_or_else(damaged)?;
            check_sum(stated, &sum, self.path, || format!("the summary before byte {at}"))?;
            bytes.clear();
            self.read(MAGIC.len() as u64, &mut bytes)?;
            return match bytes == MAGIC {
                true => Ok(()),
                false => Err(wrong(self.path, "it does not end as an MCAP does: the file is damaged")),
            };
        }
    }
}

/// An error about a file.
pub(super) fn wrong(path: &Path, message: &str) -> Error {
    Error::input(format!("{}: {message}", path.display()))
}

/// Little-endian values of a record, from its beginning.
pub(super) struct Fields<'a>(pub &'a [u8]);

impl<'a> Fields<'a> {
    pub fn take(&mut self, count: usize) -> Option<&'a [u8]> {
        let (taken, rest) = self.0.split_at_checked(count)?;
        self.0 = rest;
        Some(taken)
    }

    pub fn u16(&mut self) -> Option<u16> {
        self.take(2)?.try_into().ok().map(u16::from_le_bytes)
    }

    pub fn u32(&mut self) -> Option<u32> {
        self.take(4)?.try_into().ok().map(u32::from_le_bytes)
    }

    pub fn u64(&mut self) -> Option<u64> {
        self.take(8)?.try_into().ok().map(u64::from_le_bytes)
    }

    pub fn string(&mut self) -> Option<&'a str> {
        let length = self.u32()? as usize;
        std::str::from_utf8(self.take(length)?).ok()
    }
}
