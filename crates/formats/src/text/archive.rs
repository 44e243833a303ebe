//! Compressed text as HELIOS++ writes it (spec outputs §8): a zlib stream of an archive in which every line
//! is a record.
//!
//! The stream is compressed in independent blocks by idle workers; its bytes depend on the lines alone.

use crate::encode::{Ending, FileBody};
use crate::out::{BlockCompressor, BlockError, Destination, Offload, OutputStream};
use adler2::Adler32;
use flate2::bufread::ZlibDecoder;
use flate2::{Compress, Compression, FlushCompress, Status};
use std::io::{self, BufRead, Read};
use std::path::Path;
use vlscan_base::error::{Error, Result};
use vlscan_base::files::{Patched, is_special};
use vlscan_base::recognise::{Expected, Family, foreign};

/// Minimum bytes of the archive that are compressed as one block; a block ends with a complete record.
const MIN_BLOCK_BYTES: usize = 1 << 18;

const NAME: &[u8; 22] = b"serialization::archive";

/// Sizes in bytes of int, long, float and double, then the number 1 as 32-bit integer, which reveals the byte
/// order.
const NUMBERS: [u8; 8] = [4, 8, 4, 8, 1, 0, 0, 0];

/// Library version in the archives written here; archives of every version are read.
const VERSION: u16 = 18;

/// zlib header: deflate, window of 32 KiB, best compression.
const ZLIB_HEADER: [u8; 2] = [0x78, 0xDA];

/// End of a deflate stream: an empty final block.
const DEFLATE_END: [u8; 2] = [0x03, 0x00];

/// Bytes of an archive before its first record.
fn head() -> Vec<u8> {
    let mut head = (NAME.len() as u64).to_le_bytes().to_vec();
    head.extend_from_slice(NAME);
    head.extend(VERSION.to_le_bytes());
    head.extend(NUMBERS);
    head
}

/// A compressed text that is being written.
struct ArchiveBody {
    plain: Vec<u8>,
    blocks: BlockCompressor,
    sum: Adler32,
}

/// Begins a compressed text, whose lines are appended unchanged.
///
/// # Errors
/// The errors of writing.
pub fn begin_archive(out: &mut OutputStream) -> Result<Box<dyn FileBody>> {
    out.append(&ZLIB_HEADER)?;
    Ok(Box::new(ArchiveBody { plain: head(), blocks: BlockCompressor::new(deflate), sum: Adler32::new() }))
}

impl FileBody for ArchiveBody {
    fn append(&mut self, lines: Vec<u8>, out: &mut OutputStream, offload: &dyn Offload) -> Result<()> {
        for line in lines.split_inclusive(|&byte| byte == b'\n') {
            self.plain.extend((line.len() as u64).to_le_bytes());
            self.plain.extend_from_slice(line);
            if self.plain.len() >= MIN_BLOCK_BYTES {
                self.submit(out, offload)?;
            }
        }
        Ok(())
    }

    fn finish(&mut self, _: &Ending, out: &mut OutputStream, offload: &dyn Offload) -> Result<()> {
        self.submit(out, offload)?;
        self.blocks.finish(|bytes| out.append(bytes))?;
        out.append(&DEFLATE_END)?;
        out.append(&self.sum.checksum().to_be_bytes())
    }
}

impl ArchiveBody {
    fn submit(&mut self, out: &mut OutputStream, offload: &dyn Offload) -> Result<()> {
        self.sum.write_slice(&self.plain);
        self.blocks.submit(&mut self.plain, offload, |bytes| out.append(bytes))
    }
}

/// Compresses one block as a part of a deflate stream that ends at a byte boundary and refers to no earlier
/// block.
fn deflate(plain: &[u8], mut out: Vec<u8>) -> Result<Vec<u8>, BlockError> {
    let mut deflate = Compress::new(Compression::best(), false);
    // Capacity for the worst case: a full output buffer would interrupt the compressor and so change the
    // bytes.
    out.reserve(plain.len() + plain.len() / 8 + 1024);
    loop {
        let done = deflate.total_in() as usize;
        let status = deflate.compress_vec(&plain[done..], &mut out, FlushCompress::Sync);
        match status? {
            Status::Ok | Status::BufError
                if deflate.total_in() as usize == plain.len() && out.len() < out.capacity() =>
            {
                return Ok(out);
            }
            Status::Ok | Status::BufError => out.reserve(out.capacity().max(64)),
            Status::StreamEnd => return Err(BlockError::DeflateEnded),
        }
    }
}

/// Expands a compressed text file of this program or of HELIOS++ to the file `to`, or to standard output.
/// Returns the number of lines. Messages refer to the compressed file as `name`.
///
/// # Errors
/// [`Error::Input`] when the input is not such an archive, is damaged or truncated, or when `to` exists and
/// `force` is not set; [`Error::Io`]. After an error no file of the name `to` is left.
pub fn unzip(name: &Path, file: impl BufRead, to: Option<&Path>, force: bool) -> Result<u64> {
    let place = to.map_or(Destination::Stdout, |path| Destination::Path(path.to_path_buf()));
    if let Some(path) = to.filter(|path| !force && !is_special(path) && path.symlink_metadata().is_ok()) {
        return Err(Error::exists(path));
    }
    let mut archive = Archive::open(name, file)?;
    let mut out = OutputStream::open(&place, force, Patched::Never)?;
    let lines = archive.expand(|bytes| out.append(bytes))?;
    out.finish()?;
    Ok(lines)
}

/// Expands a compressed text as [`unzip`] does and passes it to `out` in pieces.
///
/// # Errors
/// As for [`unzip`], and those of `out`.
pub fn expand(name: &Path, file: impl BufRead, out: impl FnMut(&[u8]) -> Result<()>) -> Result<u64> {
    Archive::open(name, file)?.expand(out)
}

/// Minimum bytes of text per write.
const MIN_WRITE_BYTES: usize = 1 << 16;

/// The decompressed archive and the number of bytes read from it.
struct Archive<'n, R> {
    name: &'n Path,
    bytes: ZlibDecoder<R>,
    at: u64,
}

impl<'n, R: BufRead> Archive<'n, R> {
    /// Begins to read the archive and checks that it is one.
    fn open(name: &'n Path, mut file: R) -> Result<Archive<'n, R>> {
        let first = file.fill_buf().map_err(|e| Error::io("read", name, e))?;
        let found = foreign(name, first, &Expected::COMPRESSED)
            .filter(|found| !matches!(found.kind.family, Family::Binary | Family::Empty));
        let mut archive = Archive { name, bytes: ZlibDecoder::new(file), at: 0 };
        // Compressed bytes can look like numbers: an archive is recognised by its expanded content.
        match (archive.check_head(), found) {
            (Ok(()), _) => Ok(archive),
            (Err(_), Some(found)) => Err(found.error(name)),
            (Err(problem), None) => Err(problem),
        }
    }

    /// Passes all records to `out` and returns their number.
    fn expand(&mut self, mut out: impl FnMut(&[u8]) -> Result<()>) -> Result<u64> {
        let (mut text, mut lines) = (Vec::new(), 0);
        while let Some(length) = self.length()? {
            self.copy(length, &mut text, &mut out)?;
            lines += 1;
        }
        out(&text)?;
        let file = self.bytes.get_mut();
        if !file.fill_buf().map_err(|e| Error::io("read", self.name, e))?.is_empty() {
            return Err(self.wrong("something follows the end of the compressed text"));
        }
        Ok(lines)
    }

    fn check_head(&mut self) -> Result<()> {
        let mut head = [0; 40];
        let read = self.fill(&mut head)?;
        if read < 40 || head[..8] != 22u64.to_le_bytes() || head[8..30] != NAME[..] {
            return Err(self.wrong(
                "not a compressed text: expected an archive that begins with \"serialization::archive\"",
            ));
        }
        if head[32..] != NUMBERS {
            let found = &head[32..];
            return Err(self.wrong(format!(
                "written on another kind of machine: expected sizes and order of numbers {NUMBERS:?}, found \
                 {found:?}"
            )));
        }
        Ok(())
    }

    /// Returns the length of the next record, in bytes; `None` at the end of the archive.
    fn length(&mut self) -> Result<Option<u64>> {
        let mut length = [0; 8];
        match self.fill(&mut length)? {
            0 => Ok(None),
            8 => Ok(Some(u64::from_le_bytes(length))),
            _ => Err(self.early()),
        }
    }

    /// Copies one record of `left` bytes. The length comes from the file, so no memory is reserved for it.
    fn copy(
        &mut self,
        mut left: u64,
        text: &mut Vec<u8>,
        out: &mut impl FnMut(&[u8]) -> Result<()>,
    ) -> Result<()> {
        let mut piece = [0; 4096];
        while left > 0 {
            let needed = usize::try_from(left).unwrap_or(usize::MAX).min(piece.len());
            if self.fill(&mut piece[..needed])? < needed {
                return Err(self.early());
            }
            text.extend_from_slice(&piece[..needed]);
            left -= needed as u64;
            if text.len() >= MIN_WRITE_BYTES {
                out(text)?;
                text.clear();
            }
        }
        Ok(())
    }

    fn fill(&mut self, out: &mut [u8]) -> Result<usize> {
        let mut filled = 0;
        while filled < out.len() {
            match self.bytes.read(&mut out[filled..]) {
                Ok(0) => break,
                Ok(n) => filled += n,
                Err(e) if e.kind() == io::ErrorKind::Interrupted => {}
                Err(e) => {
                    self.at += filled as u64;
                    return Err(self.broken(e));
                }
            }
        }
        self.at += filled as u64;
        Ok(filled)
    }

    fn broken(&self, error: io::Error) -> Error {
        match error.kind() {
            io::ErrorKind::UnexpectedEof => {
                self.wrong(format!("the file ends too early, after {} bytes of content", self.at))
            }
            io::ErrorKind::InvalidData | io::ErrorKind::InvalidInput => {
                self.wrong(format!("no valid zlib stream after {} bytes of content: {error}", self.at))
            }
            _ => Error::io("read", self.name, error),
        }
    }

    fn early(&self) -> Error {
        self.wrong(format!("the last record ends too early, after {} bytes of content", self.at))
    }

    fn wrong(&self, what: impl std::fmt::Display) -> Error {
        Error::input(format!("{}: {what}", self.name.display()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::out::NoOffload;
    use crate::record::Tally;
    use proptest::prelude::*;
    use std::fs;
    use std::io::Write as _;

    fn compressed(parts: &[&[u8]]) -> Vec<u8> {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.bin");
        let mut out = OutputStream::open(&Destination::Path(path.clone()), false, Patched::Never).unwrap();
        let mut body = begin_archive(&mut out).unwrap();
        parts.iter().for_each(|lines| body.append(lines.to_vec(), &mut out, &NoOffload).unwrap());
        let end = Ending { tally: &Tally::EMPTY, is_partial: false, packets_at: None };
        body.finish(&end, &mut out, &NoOffload).unwrap();
        out.finish().unwrap();
        fs::read(path).unwrap()
    }

    fn expanded(bytes: &[u8]) -> Result<(u64, Vec<u8>)> {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.txt");
        let done = unzip(Path::new("a.bin"), bytes, Some(&path), false);
        let left: Vec<_> = fs::read_dir(&dir).unwrap().map(|e| e.unwrap().file_name()).collect();
        assert_eq!(left.len(), usize::from(done.is_ok()), "{left:?}");
        done.map(|lines| (lines, fs::read(path).unwrap()))
    }

    fn zlib(content: &[u8]) -> Vec<u8> {
        let mut zlib = flate2::write::ZlibEncoder::new(Vec::new(), Compression::best());
        zlib.write_all(content).unwrap();
        zlib.finish().unwrap()
    }

    #[test]
    fn the_layout_of_the_specification() {
        let bytes = compressed(&[b"1.0 2.0\n", b"3\n"]);
        assert_eq!(bytes[..2], [0x78, 0xDA]);
        let mut content = Vec::new();
        flate2::read::ZlibDecoder::new(&bytes[..]).read_to_end(&mut content).unwrap();
        let mut expected =
            b"\x16\0\0\0\0\0\0\0serialization::archive\x12\0\x04\x08\x04\x08\x01\0\0\0".to_vec();
        assert_eq!(expected.len(), 40);
        expected.extend_from_slice(b"\x08\0\0\0\0\0\0\x001.0 2.0\n\x02\0\0\0\0\0\0\x003\n");
        assert_eq!(content, expected);
    }

    #[test]
    fn many_blocks_are_read_back_and_do_not_depend_on_batches() {
        let text: String =
            (0..60_000u64).map(|i| format!("{i} {}.{:04}\n", i * 7919 % 1013, i * i % 9973)).collect();
        let whole = compressed(&[text.as_bytes()]);
        assert!(text.len() > 3 * MIN_BLOCK_BYTES && whole.len() < text.len() / 2);
        let lines: Vec<&[u8]> = text.as_bytes().split_inclusive(|&b| b == b'\n').collect();
        assert!(compressed(&lines) == whole);
        let (count, back) = expanded(&whole).unwrap();
        assert_eq!(count, 60_000);
        assert!(back == text.as_bytes());
    }

    #[test]
    fn empty_text_is_read_back() {
        assert_eq!(expanded(&compressed(&[])).unwrap(), (0, Vec::new()));
    }

    #[test]
    fn an_archive_of_the_reference_is_read() {
        let mut content = head();
        content[30] = 19;
        for line in ["a b\n", "c\n"] {
            content.extend((line.len() as u64).to_le_bytes());
            content.extend_from_slice(line.as_bytes());
        }
        assert_eq!(expanded(&zlib(&content)).unwrap(), (2, b"a b\nc\n".to_vec()));
    }

    #[test]
    fn damaged_files_are_refused_with_the_reason() {
        let good = compressed(&[b"1 2 3\n", b"4 5 6\n"]);
        let with = |change: &dyn Fn(&mut Vec<u8>)| {
            let mut content = head();
            change(&mut content);
            zlib(&content)
        };
        let mut flipped = good.clone();
        *flipped.last_mut().unwrap() ^= 1;
        for (bytes, reason) in [
            (Vec::new(), "too early"),
            (b"1 2 3\n".to_vec(), "expected compressed text"),
            (good[..good.len() - 5].to_vec(), "too early"),
            (flipped, "no valid zlib stream"),
            ([&good[..], b"x"].concat(), "something follows"),
            (zlib(b"hello"), "expected an archive"),
            (with(&|c| c[8] = b'S'), "expected an archive"),
            (with(&|c| c[32] = 8), "another kind of machine"),
            (with(&|c| c.extend(u64::MAX.to_le_bytes())), "record ends too early"),
            (with(&|c| c.extend([1, 0, 0])), "record ends too early"),
        ] {
            let message = expanded(&bytes).unwrap_err().to_string();
            assert!(message.contains(reason) && message.contains("a.bin"), "{message}");
        }
    }

    #[test]
    fn an_existing_file_is_kept() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.txt");
        fs::write(&path, "mine").unwrap();
        let bytes = compressed(&[b"new\n"]);
        assert!(unzip(Path::new("a"), &bytes[..], Some(&path), false).is_err());
        assert_eq!(fs::read(&path).unwrap(), b"mine");
        unzip(Path::new("a"), &bytes[..], Some(&path), true).unwrap();
        assert_eq!(fs::read(&path).unwrap(), b"new\n");
    }

    #[test]
    fn an_archive_whose_bytes_are_plausible_as_poses_is_expanded() {
        let lines = [
            "$4&%\"Y&I*z:L#5\n",
            "e jM0d&II$SU'7I9nz:A0ou01+\n",
            ",M1YRNuI\n",
            "$w'2B[c I!l9p=#,bJt#*MJu3~'\n",
            "{3f\"4|w**]\n",
        ];
        let bytes = compressed(&[lines.concat().as_bytes()]);
        assert!(vlscan_base::recognise::is_sbet(&bytes), "choose other lines");
        let (count, text) = expanded(&bytes).unwrap();
        assert_eq!((count, text), (5, lines.concat().into_bytes()));
    }

    proptest! {
        #[test]
        fn any_lines(lines in proptest::collection::vec("[ -~]{0,40}\n", 0..50)) {
            let text = lines.concat();
            let (count, back) = expanded(&compressed(&[text.as_bytes()])).unwrap();
            prop_assert_eq!((count as usize, back), (lines.len(), text.into_bytes()));
        }

        #[test]
        fn any_bytes_end_without_a_panic(bytes: Vec<u8>, content: Vec<u8>) {
            let _ = expanded(&bytes);
            let _ = expanded(&zlib(&[head(), content].concat()));
        }
    }
}
