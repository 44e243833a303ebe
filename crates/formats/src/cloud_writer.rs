//! Writes a cloud in one thread.

use crate::encode::{EncodedFile, PointEncoder};
use crate::out::{Destination, NoOffload, OutputStream};
use crate::point_format::PointFormat;
use crate::record::{EncodedPoints, PointBatch, PointRecord, Tally};
use crate::settings::CloudSettings;
use std::path::Path;
use std::sync::Arc;
use vlscan_base::diag::Diagnostics;
use vlscan_base::error::{Error, Result};
use vlscan_base::files::{FileGroup, refuse_existing};

/// A cloud that is being written. The file appears under its name once it is [finished](CloudWriter::finish);
/// if the writer is dropped, there is no file.
pub struct CloudWriter {
    encoder: Arc<dyn PointEncoder>,
    file: EncodedFile,
}

impl CloudWriter {
    /// Begins a file, which replaces an existing one if `replace` is set. Warnings are recorded in `found`.
    ///
    /// # Errors
    /// [`Error::Input`] for settings that the format cannot follow, and for a file that exists;
    /// [`Error::Io`].
    pub fn create(
        path: &Path,
        replace: bool,
        format: PointFormat,
        settings: &CloudSettings,
        found: &mut Diagnostics,
    ) -> Result<CloudWriter> {
        refuse_existing(path, replace)?;
        if settings.las.packets.is_some() {
            return Err(Error::input("waveform packets are not written by a CloudWriter"));
        }
        let encoder = format.encoder(settings, found)?;
        if found.is_fatal(false) {
            return Err(Error::Input(Box::new(std::mem::take(found))));
        }
        let out = OutputStream::open(&Destination::Path(path.to_path_buf()), replace, encoder.patched())?;
        let file = EncodedFile::begin(out, |out| encoder.clone().begin(out))?;
        Ok(CloudWriter { encoder, file })
    }

    /// Writes points. Their frames last 0.1 s, in formats that have frames.
    ///
    /// # Errors
    /// [`Error::Io`], and [`Error::Input`] for more points than the format can count.
    pub fn write(&mut self, points: &[PointRecord]) -> Result<()> {
        let batch = PointBatch { points, waves: &[], frame_ns: PointBatch::FRAME_NS };
        let mut encoded = EncodedPoints::with_capacity(points.len() * self.encoder.typical_bytes());
        self.encoder.encode(&batch, &mut encoded);
        self.file.append(encoded.bytes, &encoded.tally, &NoOffload)
    }

    /// Completes the file and returns the counts of its points.
    ///
    /// # Errors
    /// [`Error::Io`].
    pub fn finish(self) -> Result<Tally> {
        let mut group = FileGroup::default();
        let tally = self.finish_in(&mut group)?;
        group.commit()?;
        Ok(tally)
    }

    /// [`CloudWriter::finish`] of a file that gets its name with the others of a group.
    ///
    /// # Errors
    /// [`Error::Io`].
    pub fn finish_in(self, group: &mut FileGroup) -> Result<Tally> {
        let (out, tally) = self.file.finish(false, &NoOffload, |_| Ok(None))?;
        out.finish_in(group, None)?;
        Ok(tally)
    }
}
