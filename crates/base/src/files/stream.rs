//! Pipes, terminals and devices. A run that is stopped waits a limited time for a reader that takes nothing.

use std::fs::File;
use std::io::{self, Seek, SeekFrom, Write};
use std::sync::OnceLock;
use std::time::{Duration, Instant};

/// When waiting for readers ends.
static DEADLINE: OnceLock<Instant> = OnceLock::new();

/// Limits the time that this process waits for readers of its streams from now on. A stream whose reader
/// takes nothing until then fails as one whose reader has closed it.
pub fn limit_waiting(time: Duration) {
    let _ = DEADLINE.set(Instant::now() + time);
}

/// A stream open for writing.
#[derive(Debug)]
pub(super) struct Stream {
    file: File,
    /// True if a write may wait for a reader.
    #[cfg(unix)]
    waits: bool,
    /// True if a write that would have to wait returns instead.
    #[cfg(unix)]
    returns: bool,
}

#[cfg(unix)]
mod unix {
    use super::*;
    use rustix::event::{PollFd, PollFlags, Timespec, poll};
    use std::fs::OpenOptions;
    use std::os::fd::{AsFd, AsRawFd};
    use std::os::unix::fs::{FileTypeExt, OpenOptionsExt};

    /// Bytes that can be written without waiting once a stream is ready: POSIX guarantees them for pipes.
    const PIPE_BUF: usize = 4096;
    /// Interval at which the deadline is checked.
    const CHECK_PERIOD: Timespec = Timespec { tv_sec: 0, tv_nsec: 100_000_000 };

    impl Stream {
        pub fn new(file: File) -> Stream {
            let kind = file.metadata().map(|about| about.file_type());
            let waits = !kind.as_ref().is_ok_and(|kind| kind.is_file());
            let is_pipe = kind.is_ok_and(|kind| kind.is_fifo());
            // Another description of the same pipe has separate flags, so that the writes of other processes
            // are not affected. Linux opens one by this name; elsewhere, and without permission, writes are
            // small.
            let name = format!("/proc/self/fd/{}", file.as_fd().as_raw_fd());
            let flags = rustix::fs::OFlags::NONBLOCK.bits() as i32;
            let again = || OpenOptions::new().write(true).custom_flags(flags).open(name).ok();
            match if is_pipe { again() } else { None } {
                Some(file) => Stream { file, waits, returns: true },
                None => Stream { file, waits, returns: false },
            }
        }

        /// Waits until the reader takes bytes.
        fn wait(&self) -> io::Result<()> {
            loop {
                let mut ready = [PollFd::new(&self.file, PollFlags::OUT)];
                match poll(&mut ready, Some(&CHECK_PERIOD)) {
                    Ok(0) => {}
                    Err(rustix::io::Errno::INTR) => {}
                    Ok(_) => return Ok(()),
                    Err(e) => return Err(e.into()),
                }
                if DEADLINE.get().is_some_and(|deadline| Instant::now() >= *deadline) {
                    return Err(io::Error::new(
                        io::ErrorKind::BrokenPipe,
                        "the reader accepts no more bytes",
                    ));
                }
            }
        }

        pub fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
            if !self.waits {
                return self.file.write(bytes);
            }
            if !self.returns {
                self.wait()?;
                return self.file.write(&bytes[..bytes.len().min(PIPE_BUF)]);
            }
            loop {
                match self.file.write(bytes) {
                    Err(e) if e.kind() == io::ErrorKind::WouldBlock => self.wait()?,
                    written => return written,
                }
            }
        }

        /// True if every write goes to the end of the file (`>>`).
        pub(super) fn appends(&self) -> bool {
            rustix::fs::fcntl_getfl(&self.file).is_ok_and(|flags| flags.contains(rustix::fs::OFlags::APPEND))
        }
    }

    /// Standard output without the line buffer of the standard library.
    pub fn stdout_file() -> io::Result<File> {
        io::stdout().as_fd().try_clone_to_owned().map(File::from)
    }

    pub fn stderr_file() -> io::Result<File> {
        io::stderr().as_fd().try_clone_to_owned().map(File::from)
    }
}

#[cfg(not(unix))]
mod other {
    use super::*;

    impl Stream {
        pub fn new(file: File) -> Stream {
            Stream { file }
        }

        pub fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
            self.file.write(bytes)
        }

        /// Always false: shells on this platform seek to the end instead of opening the file for appending.
        pub(super) fn appends(&self) -> bool {
            false
        }
    }

    #[cfg(windows)]
    pub fn stdout_file() -> io::Result<File> {
        use std::os::windows::io::AsHandle;
        io::stdout().as_handle().try_clone_to_owned().map(File::from)
    }

    #[cfg(windows)]
    pub fn stderr_file() -> io::Result<File> {
        use std::os::windows::io::AsHandle;
        io::stderr().as_handle().try_clone_to_owned().map(File::from)
    }
}

#[cfg(not(unix))]
pub(super) use other::{stderr_file, stdout_file};
#[cfg(unix)]
pub(super) use unix::{stderr_file, stdout_file};

impl Stream {
    /// True if bytes at the beginning can be replaced later. The name alone does not decide (`/dev/stdout`,
    /// `<(…)`), and in a file that the shell opened for appending, or that is not empty, offsets do not count
    /// from the first byte of the stream.
    pub fn is_seekable(&mut self) -> bool {
        matches!(self.file.stream_position(), Ok(0)) && !self.appends()
    }

    pub fn write_all(&mut self, mut bytes: &[u8]) -> io::Result<()> {
        while !bytes.is_empty() {
            match self.write(bytes) {
                Ok(0) => return Err(io::ErrorKind::WriteZero.into()),
                Ok(n) => bytes = &bytes[n..],
                Err(e) if e.kind() == io::ErrorKind::Interrupted => {}
                Err(e) => return Err(e),
            }
        }
        Ok(())
    }

    pub fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        self.file.seek(to)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs;

    #[test]
    fn only_empty_files_that_do_not_append_are_seekable() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a");
        let is_seekable = |file| Stream::new(file).is_seekable();
        assert!(is_seekable(File::create(&path).unwrap()), "standard output as `> a`");
        fs::write(&path, "before").unwrap();
        assert!(!is_seekable(File::options().append(true).open(&path).unwrap()), "`>> a`");
        let mut later = File::options().write(true).open(&path).unwrap();
        later.seek(SeekFrom::End(0)).unwrap();
        assert!(!is_seekable(later), "`(echo; vlscan) > a`");
    }

    #[cfg(unix)]
    #[test]
    fn a_pipe_takes_more_than_it_holds() {
        let (mut reader, writer) = io::pipe().unwrap();
        let bytes: Vec<u8> = (0..1_000_000u32).map(|i| (i % 251) as u8).collect();
        let sent = bytes.clone();
        let sending = std::thread::spawn(move || {
            let mut stream = Stream::new(File::from(std::os::fd::OwnedFd::from(writer)));
            let mut at = 0;
            while at < sent.len() {
                at += stream.write(&sent[at..]).unwrap();
            }
        });
        let mut received = Vec::new();
        io::Read::read_to_end(&mut reader, &mut received).unwrap();
        sending.join().unwrap();
        assert!(received == bytes);
    }
}
