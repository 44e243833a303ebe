//! Input that is read while it arrives: [`InputStream`] reads bytes on a separate thread, so that the
//! consumer can wait for them with a timeout; [`arrow`] decodes Arrow streams batch by batch, [`rows`] rows
//! of numbers in text and Arrow.

pub mod arrow;
pub mod rows;

use std::io::{ErrorKind, Read};
use std::path::Path;
use std::time::Duration;
use vlscan_base::error::{Error, Result};
use vlscan_base::files::reads;

/// Maximum number of bytes of one read.
const MAX_READ_BYTES: usize = 1 << 16;
/// Maximum number of reads in the queue; when it is full the pipe fills up and its writer blocks.
const MAX_QUEUED_READS: usize = 4;

/// The result of waiting for bytes.
#[derive(Debug)]
pub enum ReadEvent {
    /// Bytes arrived.
    Bytes(Vec<u8>),
    /// No bytes arrived within the timeout.
    Timeout,
    /// The stream has ended.
    End,
    /// The stream cannot be read.
    Error(std::io::Error),
}

/// A byte stream that is read by a separate thread. The thread ends with the stream, or after the read during
/// which this value was dropped.
#[derive(Debug)]
pub struct InputStream {
    reads: flume::Receiver<std::io::Result<Vec<u8>>>,
}

impl InputStream {
    /// Starts the thread that reads `input`.
    pub fn from_reader(mut input: impl Read + Send + 'static) -> InputStream {
        let (sender, reads) = flume::bounded(MAX_QUEUED_READS);
        let failed = sender.clone();
        let started = std::thread::Builder::new().spawn(move || {
            let mut buffer = vec![0; MAX_READ_BYTES];
            loop {
                let read = match input.read(&mut buffer) {
                    Ok(0) => break,
                    Ok(count) => Ok(buffer[..count].to_vec()),
                    Err(e) if e.kind() == ErrorKind::Interrupted => continue,
                    Err(e) => Err(e),
                };
                let failed = read.is_err();
                if sender.send(read).is_err() || failed {
                    break;
                }
            }
        });
        if let Err(e) = started {
            // The receiver exists, and the queue is empty.
            let _ = failed.try_send(Err(e));
        }
        InputStream { reads }
    }

    /// Opens a file, a named pipe, or standard input, see [`is_stdin`].
    ///
    /// # Errors
    /// The error of the operating system when the file cannot be opened.
    pub fn open(path: &Path) -> std::io::Result<InputStream> {
        if is_stdin(path) {
            return Ok(InputStream::from_reader(std::io::stdin()));
        }
        if std::fs::metadata(path).is_ok_and(|m| !m.is_file() && !m.is_dir()) {
            return Ok(InputStream::from_reader(LazyPipe::Closed(path.to_path_buf())));
        }
        reads::open(path).map(InputStream::from_reader)
    }

    /// Waits for bytes; without a timeout until bytes arrive or the stream ends.
    pub fn next(&self, timeout: Option<Duration>) -> ReadEvent {
        let read = match timeout {
            None => self.reads.recv().map_err(|_| ReadEvent::End),
            Some(time) => self.reads.recv_timeout(time).map_err(|e| match e {
                flume::RecvTimeoutError::Timeout => ReadEvent::Timeout,
                flume::RecvTimeoutError::Disconnected => ReadEvent::End,
            }),
        };
        match read {
            Ok(Ok(bytes)) => ReadEvent::Bytes(bytes),
            Ok(Err(e)) => ReadEvent::Error(e),
            Err(other) => other,
        }
    }
}

/// A named pipe that is opened by its first read, on the reading thread: `open` blocks until a writer opens
/// the pipe, and the run must remain interruptible.
enum LazyPipe {
    Closed(std::path::PathBuf),
    Open(std::fs::File),
}

impl Read for LazyPipe {
    fn read(&mut self, to: &mut [u8]) -> std::io::Result<usize> {
        if let LazyPipe::Closed(path) = self {
            *self = LazyPipe::Open(reads::open(path)?);
        }
        match self {
            LazyPipe::Open(file) => file.read(to),
            LazyPipe::Closed(_) => Ok(0),
        }
    }
}

/// Maximum number of bytes that are read at once from anything but a regular file.
const MAX_DEVICE_BYTES: u64 = 1 << 28;

/// Reads a complete file of at most `max_bytes`.
///
/// # Errors
/// The error of the operating system; [`ErrorKind::FileTooLarge`] for more bytes.
pub fn read_file(path: &Path, max_bytes: u64) -> std::io::Result<Vec<u8>> {
    let file = reads::open(path)?;
    let about = file.metadata()?;
    let max_bytes = if about.is_file() { max_bytes } else { max_bytes.min(MAX_DEVICE_BYTES) };
    let mut bytes = Vec::new();
    if about.len() <= max_bytes {
        bytes.reserve_exact(usize::try_from(about.len()).unwrap_or(0));
        file.take(max_bytes + 1).read_to_end(&mut bytes)?;
        if bytes.len() as u64 <= max_bytes {
            return Ok(bytes);
        }
    }
    let message = format!("it has more than {max_bytes} bytes, the maximum");
    Err(std::io::Error::new(ErrorKind::FileTooLarge, message))
}

/// Reads a complete text of at most `max_bytes`, also from a pipe or a device.
///
/// # Errors
/// [`Error::Io`], also for more bytes; [`Error::Input`] for bytes that are not UTF-8.
pub fn read_text(path: &Path, max_bytes: u64) -> Result<String> {
    let bytes = read_file(path, max_bytes).map_err(|e| Error::open(path, e))?;
    String::from_utf8(bytes).map_err(|_| {
        let message = format!("{}: expected text in UTF-8", path.display());
        Error::input_with_help(message, "save it as UTF-8 in a text editor")
    })
}

/// True if the path means standard input: `-`, `STDIN`, `/dev/stdin`.
pub fn is_stdin(path: &Path) -> bool {
    ["-", "STDIN", "/dev/stdin"].iter().any(|name| path.as_os_str() == *name)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bytes_arrive_in_order_and_then_the_end() {
        let text: Vec<u8> = (0..300_000u32).map(|i| i as u8).collect();
        let input = InputStream::from_reader(std::io::Cursor::new(text.clone()));
        let mut read = Vec::new();
        while let ReadEvent::Bytes(bytes) = input.next(None) {
            assert!(bytes.len() <= MAX_READ_BYTES);
            read.extend(bytes);
        }
        assert!(read == text && matches!(input.next(None), ReadEvent::End));
    }

    #[test]
    fn files_are_read_up_to_a_limit() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("f");
        std::fs::write(&path, [7; 100]).unwrap();
        assert_eq!(read_file(&path, 100).unwrap(), [7; 100]);
        assert_eq!(read_file(&path, 99).unwrap_err().kind(), ErrorKind::FileTooLarge);
        #[cfg(unix)]
        {
            let endless = Path::new("/dev/zero");
            assert_eq!(read_file(endless, 99).unwrap_err().kind(), ErrorKind::FileTooLarge);
            assert!(read_text(endless, 99).unwrap_err().to_string().contains("more than 99 bytes"));
        }
        assert_eq!(read_text(&path, 100).unwrap().len(), 100);
        std::fs::write(&path, [0xff]).unwrap();
        assert!(matches!(read_text(&path, 100), Err(Error::Input(_))));
    }

    #[test]
    fn waiting_times_out() {
        let (reader, writer) = std::io::pipe().unwrap();
        let input = InputStream::from_reader(reader);
        assert!(matches!(input.next(Some(Duration::from_millis(1))), ReadEvent::Timeout));
        drop(writer);
        assert!(matches!(input.next(None), ReadEvent::End));
    }
}
