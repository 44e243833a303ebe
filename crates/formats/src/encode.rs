//! The two halves of a format: points become records in any number of threads, and records a file in one.

use crate::out::{Offload, OutputStream};
use crate::record::{EncodedPoints, PointBatch, Tally};
use std::fmt::Debug;
use std::sync::Arc;
use vlscan_base::error::Result;
use vlscan_base::files::Patched;
use vlscan_geom::Aabb;

/// A format that is prepared for the files of one cloud; shared by the threads that encode. Made by
/// [`PointFormat::encoder`](crate::PointFormat::encoder).
pub trait PointEncoder: Debug + Send + Sync {
    /// Typical bytes of a point, for the reservation of memory.
    fn typical_bytes(&self) -> usize {
        0
    }

    /// Encodes points and counts them.
    fn encode(&self, batch: &PointBatch, out: &mut EncodedPoints);

    /// When bytes of a file are replaced at its end, if they are.
    fn patched(&self) -> Patched {
        Patched::Never
    }

    /// Begins a file: writes everything before the first point. A header that is not yet known is left blank,
    /// so that an incomplete file is not mistaken for a complete one.
    ///
    /// # Errors
    /// The errors of writing.
    fn begin(self: Arc<Self>, out: &mut OutputStream) -> Result<Box<dyn FileBody>>;

    /// The box around stored coordinates in the world, m.
    fn world(&self, stored: &Aabb) -> Aabb {
        *stored
    }

    /// Location of waveform packets, if the format has them and they are requested.
    fn packets(&self) -> Option<crate::las::PacketPlace> {
        None
    }

    /// Adds `before`, the position of the first packet in its file, to the packet offsets of encoded points.
    fn place_packets(&self, _points: &mut [u8], _before: u64) {}
}

/// How a file ended.
#[derive(Clone, Copy, Debug)]
pub struct Ending<'a> {
    /// Counts of all its points.
    pub tally: &'a Tally,
    /// True if points are missing because the run ended early.
    pub is_partial: bool,
    /// Position of the waveform packets in the file, if they follow the points.
    pub packets_at: Option<u64>,
}

/// One file from its first point to its last.
pub trait FileBody: Send {
    /// Appends encoded points.
    ///
    /// # Errors
    /// The errors of writing.
    fn append(&mut self, bytes: Vec<u8>, out: &mut OutputStream, offload: &dyn Offload) -> Result<()> {
        out.append_piece(bytes, offload)
    }

    /// Fails when the header cannot represent the number of points.
    ///
    /// # Errors
    /// [`Error::Input`](vlscan_base::Error::Input).
    fn check_count(&self, _records: u64) -> Result<()> {
        Ok(())
    }

    /// Writes the collected bytes, for readers of live streams.
    ///
    /// # Errors
    /// The errors of writing.
    fn flush(&mut self, _out: &mut OutputStream) -> Result<()> {
        Ok(())
    }

    /// Closes handles of collected points until the next append.
    fn close_handle(&mut self) {}

    /// Writes everything after the last point.
    ///
    /// # Errors
    /// The errors of writing.
    fn finish(&mut self, _end: &Ending, _out: &mut OutputStream, _offload: &dyn Offload) -> Result<()> {
        Ok(())
    }

    /// The header that replaces a blank one, once everything else is written.
    fn head(&self, _end: &Ending) -> Option<Vec<u8>> {
        None
    }
}

/// A file of records that are written unchanged.
pub struct Plain;

impl FileBody for Plain {}

/// A file whose header counts the records, which are written unchanged.
pub(crate) struct Counted<H> {
    /// Returns the header for the counts of the records and a state; its length depends on neither.
    head: H,
}

impl<H: Fn(&Tally, &str) -> Vec<u8> + Send + 'static> Counted<H> {
    /// Writes blanks in the place of the header.
    pub fn begin(head: H, out: &mut OutputStream) -> Result<Box<dyn FileBody>> {
        out.append(&vec![b' '; head(&Tally::EMPTY, "").len()])?;
        Ok(Box::new(Counted { head }))
    }
}

impl<H: Fn(&Tally, &str) -> Vec<u8> + Send> FileBody for Counted<H> {
    fn head(&self, end: &Ending) -> Option<Vec<u8>> {
        Some((self.head)(end.tally, crate::settings::state(end.is_partial)))
    }
}

/// A file that is being written: its bytes, its body and its counts.
pub struct EncodedFile {
    out: OutputStream,
    body: Box<dyn FileBody>,
    tally: Tally,
}

impl EncodedFile {
    /// Begins a file with what `begin` writes.
    ///
    /// # Errors
    /// The errors of `begin`.
    pub fn begin(
        mut out: OutputStream,
        begin: impl FnOnce(&mut OutputStream) -> Result<Box<dyn FileBody>>,
    ) -> Result<EncodedFile> {
        let body = begin(&mut out)?;
        Ok(EncodedFile { out, body, tally: Tally::EMPTY })
    }

    /// The bytes.
    pub fn out(&mut self) -> &mut OutputStream {
        &mut self.out
    }

    /// Counts of the points so far.
    pub fn tally(&self) -> &Tally {
        &self.tally
    }

    /// Appends encoded points.
    ///
    /// # Errors
    /// The errors of writing, and more points than the format can count.
    pub fn append(&mut self, bytes: Vec<u8>, tally: &Tally, offload: &dyn Offload) -> Result<()> {
        self.tally.add(tally);
        self.body.append(bytes, &mut self.out, offload)?;
        self.body.check_count(self.tally.records)
    }

    /// Writes the collected bytes, for readers of a live stream.
    ///
    /// # Errors
    /// The errors of writing.
    pub fn flush_live(&mut self) -> Result<()> {
        if self.out.is_stream() { self.body.flush(&mut self.out) } else { Ok(()) }
    }

    /// Closes file handles until the next append.
    ///
    /// # Errors
    /// Errors of writing the buffer.
    pub fn close_handle(&mut self) -> Result<()> {
        self.body.close_handle();
        self.out.close_handle()
    }

    /// Writes everything after the last point, calls `trailer`, which may append packets and return their
    /// position, and completes the header. Returns the stream, which is to be
    /// [finished](OutputStream::finish), and the counts.
    ///
    /// # Errors
    /// The errors of writing, and of `trailer`.
    pub fn finish(
        mut self,
        is_partial: bool,
        offload: &dyn Offload,
        trailer: impl FnOnce(&mut OutputStream) -> Result<Option<u64>>,
    ) -> Result<(OutputStream, Tally)> {
        let mut end = Ending { tally: &self.tally, is_partial, packets_at: None };
        self.body.finish(&end, &mut self.out, offload)?;
        end.packets_at = trailer(&mut self.out)?;
        if let Some(head) = self.body.head(&end) {
            self.out.patch(0, &head)?;
        }
        Ok((self.out, self.tally))
    }
}
