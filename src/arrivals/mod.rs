//! Bytes as they arrive: a thread reads what comes, so that whoever waits for it can also wait for something else or give
//! up waiting; and the tables that some of them are ([`arrow`], [`ply`]).

pub mod arrow;
pub mod ply;

use std::io::{ErrorKind, Read};
use std::path::Path;
use std::time::Duration;

/// Bytes of one read at most.
const READ: usize = 1 << 16;
/// Reads that may wait to be taken: with a full pipe the writer waits, not our memory.
const WAITING: usize = 4;

/// What waiting for bytes came to.
#[derive(Debug)]
pub enum Arrival {
    /// Some arrived.
    Bytes(Vec<u8>),
    /// None within the time given.
    Nothing,
    /// None will any more.
    End,
    /// The stream cannot be read.
    Failed(std::io::Error),
}

/// A stream that a thread of its own reads. The thread ends with the stream, or with the value once a read returns.
#[derive(Debug)]
pub struct Arrivals {
    reads: flume::Receiver<std::io::Result<Vec<u8>>>,
}

impl Arrivals {
    /// Begins to read `input`.
    pub fn of(mut input: impl Read + Send + 'static) -> Arrivals {
        let (sender, reads) = flume::bounded(WAITING);
        std::thread::spawn(move || {
            let mut buffer = vec![0; READ];
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
        Arrivals { reads }
    }

    /// Opens a file, a named pipe, or standard input, see [`is_stdin`].
    ///
    /// # Errors
    /// The operating system's, when it cannot be opened.
    pub fn open(path: &Path) -> std::io::Result<Arrivals> {
        if is_stdin(path) {
            return Ok(Arrivals::of(std::io::stdin()));
        }
        if std::fs::metadata(path).is_ok_and(|m| !m.is_file() && !m.is_dir()) {
            return Ok(Arrivals::of(Late::Closed(path.to_path_buf())));
        }
        std::fs::File::open(path).map(Arrivals::of)
    }

    /// Waits for bytes; for ever without `patience`.
    pub fn next(&self, patience: Option<Duration>) -> Arrival {
        let read = match patience {
            None => self.reads.recv().map_err(|_| Arrival::End),
            Some(time) => self.reads.recv_timeout(time).map_err(|e| match e {
                flume::RecvTimeoutError::Timeout => Arrival::Nothing,
                flume::RecvTimeoutError::Disconnected => Arrival::End,
            }),
        };
        match read {
            Ok(Ok(bytes)) => Arrival::Bytes(bytes),
            Ok(Err(e)) => Arrival::Failed(e),
            Err(other) => other,
        }
    }
}

/// A named pipe that is opened with its first read: opening waits for a writer, and meanwhile the run may be ended.
enum Late {
    Closed(std::path::PathBuf),
    Open(std::fs::File),
}

impl Read for Late {
    fn read(&mut self, to: &mut [u8]) -> std::io::Result<usize> {
        if let Late::Closed(path) = self {
            *self = Late::Open(std::fs::File::open(path)?);
        }
        match self {
            Late::Open(file) => file.read(to),
            Late::Closed(_) => Ok(0),
        }
    }
}

/// Whether the name stands for standard input: `-`, `STDIN`, `/dev/stdin`.
pub fn is_stdin(path: &Path) -> bool {
    ["-", "STDIN", "/dev/stdin"].iter().any(|name| path.as_os_str() == *name)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bytes_come_in_order_and_then_the_end() {
        let text: Vec<u8> = (0..300_000u32).map(|i| i as u8).collect();
        let arrivals = Arrivals::of(std::io::Cursor::new(text.clone()));
        let mut taken = Vec::new();
        while let Arrival::Bytes(bytes) = arrivals.next(None) {
            assert!(bytes.len() <= READ);
            taken.extend(bytes);
        }
        assert!(taken == text && matches!(arrivals.next(None), Arrival::End));
    }

    #[test]
    fn waiting_may_come_to_nothing() {
        let (reader, writer) = std::io::pipe().unwrap();
        let arrivals = Arrivals::of(reader);
        assert!(matches!(arrivals.next(Some(Duration::from_millis(1))), Arrival::Nothing));
        drop(writer);
        assert!(matches!(arrivals.next(None), Arrival::End));
    }
}
