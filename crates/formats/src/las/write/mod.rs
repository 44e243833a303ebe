//! LAS 1.4 with point data record format 6, or 9 with waveform packets, 7 and 10 with colours, and LAS 1.0
//! with format 1 (spec outputs §4).
//!
//! | file | contents |
//! |---|---|
//! | `format` | version, scale, offset and extra bytes of all files of a run |
//! | `header`, `vlr` | the public header block; variable length records |
//! | `record` | point data records |
//! | `packets` | waveform packets, and points that refer to them |
//!
//! Conventions of the dimensions:
//! * coordinates: rounded to the scale, relative to an offset of integral metres near the scene's centre;
//! * `PointSourceId`: number of the leg plus one, because 0 means "unknown";
//! * `ScannerChannel` (format 6): device modulo 4; the extra dimension `device` holds the index itself;
//! * `ScanAngle`: of the beam from straight down across the track, negative to the left of the flight, in
//!   steps of 0.006° up to ±180° (format 6), or whole degrees, of which there are ±90 (format 1);
//! * `Intensity`: see [`PointRecord::digital_intensity`](crate::PointRecord::digital_intensity);
//! * `Classification`: 0 where the material's class exceeds 255 (31 in format 1) or is negative;
//! * return numbers above 15 (format 1: 7) are stored as 15 (7), and counted as such in the header.

mod format;
mod header;
mod packets;
mod record;
mod vlr;

pub(super) use format::LasFormat;
pub use packets::{PACKETS_HEADER_BYTES, packets_header};

use super::copc::{self, CopcStream, Octree};
use super::laz::{self, LazStream};
use super::{LasVersion, PacketPlace};
use crate::encode::{Ending, FileBody, PointEncoder};
use crate::out::{Offload, OutputStream};
use crate::record::{EncodedPoints, PointBatch, Tally};
use crate::settings::{CloudSettings, state};
use ::laz::LazVlr;
use std::sync::Arc;
use vlscan_base::diag::Diagnostics;
use vlscan_base::error::{Error, Result};
use vlscan_base::files::Patched;
use vlscan_geom::Aabb;

/// Points as records of LAS.
#[derive(Debug)]
struct Las {
    format: LasFormat,
    compression: Compression,
}

#[derive(Debug)]
enum Compression {
    None,
    /// Chunks of fixed size.
    Laz(LazVlr),
    /// Chunks that are the nodes of an octree.
    Copc(LazVlr),
}

/// LAS files.
pub(crate) fn las(settings: &CloudSettings, problems: &mut Diagnostics) -> Result<Arc<dyn PointEncoder>> {
    let format = LasFormat::new(settings, problems);
    Ok(Arc::new(Las { format, compression: Compression::None }))
}

/// LAZ files.
pub(crate) fn laz(settings: &CloudSettings, problems: &mut Diagnostics) -> Result<Arc<dyn PointEncoder>> {
    let format = LasFormat::new(settings, problems);
    let compression = Compression::Laz(laz::laszip(&format)?);
    Ok(Arc::new(Las { format, compression }))
}

/// COPC files.
pub(crate) fn copc(settings: &CloudSettings, problems: &mut Diagnostics) -> Result<Arc<dyn PointEncoder>> {
    let format = LasFormat::new(settings, problems);
    if format.version == LasVersion::V10 {
        problems.error(None, "COPC is LAS 1.4").help("leave out --las10, or write plain LAZ");
    }
    if format.packets.is_some() {
        problems.error(None, "COPC has no waveform packets").help("write plain LAZ for them");
    }
    let compression = Compression::Copc(copc::laszip(&format)?);
    Ok(Arc::new(Las { format, compression }))
}

impl Las {
    fn laszip(&self) -> Option<&LazVlr> {
        match &self.compression {
            Compression::None => None,
            Compression::Laz(laszip) | Compression::Copc(laszip) => Some(laszip),
        }
    }
}

impl PointEncoder for Las {
    fn typical_bytes(&self) -> usize {
        if self.format.packets.is_some() { 0 } else { record::MAX_RECORD_BYTES }
    }

    fn encode(&self, batch: &PointBatch, out: &mut EncodedPoints) {
        match &self.format.packets {
            None => out.extend(batch.points, |bytes, point| self.format.push(bytes, point)),
            Some(packets) => self.format.encode_with_packets(packets, batch, out),
        }
    }

    fn patched(&self) -> Patched {
        match (&self.compression, self.format.at_most) {
            (Compression::None, Some(_)) => Patched::IfPossible,
            _ => Patched::Always,
        }
    }

    fn begin(self: Arc<Self>, out: &mut OutputStream) -> Result<Box<dyn FileBody>> {
        let (laszip, octree) = (self.laszip(), Octree::EMPTY);
        let is_octree = matches!(self.compression, Compression::Copc(_));
        let octree = is_octree.then_some(octree);
        let max_points = match (&self.compression, out.is_seekable()) {
            (Compression::None, false) => {
                let at_most = self.format.at_most.unwrap_or(0);
                out.append(&self.format.stream_head(at_most))?;
                MaxPoints::Streamed(at_most)
            }
            _ => {
                let head = self.format.head(laszip, octree.as_ref(), &Tally::EMPTY, None, "");
                out.append(&vec![0; head.len()])?;
                MaxPoints::Format
            }
        };
        let format = &self.format;
        let points = match &self.compression {
            Compression::None => Points::Plain,
            Compression::Laz(laszip) => {
                Points::Laz(LazStream::begin(laszip.clone(), format.record_length(), out)?)
            }
            Compression::Copc(laszip) => {
                Points::Copc(Some(Box::new(CopcStream::begin(laszip.clone(), format, out)?)))
            }
        };
        Ok(Box::new(LasBody { las: self, points, octree, max_points }))
    }

    fn world(&self, stored: &Aabb) -> Aabb {
        self.format.world(stored)
    }

    fn packets(&self) -> Option<PacketPlace> {
        self.format.packet_place()
    }

    fn place_packets(&self, points: &mut [u8], before: u64) {
        let places = (self.format.record_length(), self.format.packet_offset());
        packets::place_packets(points, places, before);
    }
}

/// A file that is being written.
struct LasBody {
    las: Arc<Las>,
    points: Points,
    octree: Option<Octree>,
    max_points: MaxPoints,
}

enum Points {
    Plain,
    Laz(LazStream),
    /// `None` once the octree is written.
    Copc(Option<Box<CopcStream>>),
}

/// How many points the header can count.
enum MaxPoints {
    /// As many as the version of LAS allows.
    Format,
    /// As many as the header of a stream that cannot be patched has promised.
    Streamed(u64),
}

impl FileBody for LasBody {
    fn append(&mut self, records: Vec<u8>, out: &mut OutputStream, offload: &dyn Offload) -> Result<()> {
        match &mut self.points {
            Points::Plain => out.append_piece(records, offload),
            Points::Laz(laz) => laz.append(&records, out, offload),
            Points::Copc(copc) => copc.iter_mut().try_for_each(|copc| copc.append(&records)),
        }
    }

    fn check_count(&self, records: u64) -> Result<()> {
        let max = self.las.format.max_points();
        match self.max_points {
            MaxPoints::Streamed(at_most) if records > at_most => {
                Err(Error::input(format!("more points than --las-at-most {at_most}")))
            }
            MaxPoints::Format if records > max => {
                Err(Error::input(format!("a file of LAS 1.0 holds at most {max} points; write LAS 1.4")))
            }
            _ => Ok(()),
        }
    }

    fn finish(&mut self, end: &Ending, out: &mut OutputStream, offload: &dyn Offload) -> Result<()> {
        match &mut self.points {
            Points::Plain => Ok(()),
            Points::Laz(laz) => laz.finish(out, offload),
            Points::Copc(copc) => {
                if let Some(copc) = copc.take() {
                    self.octree = Some(copc.finish(&self.las.format, end.tally, out, offload)?);
                }
                Ok(())
            }
        }
    }

    fn head(&self, end: &Ending) -> Option<Vec<u8>> {
        if matches!(self.max_points, MaxPoints::Streamed(_)) {
            return None;
        }
        let (laszip, state) = (self.las.laszip(), state(end.is_partial));
        Some(self.las.format.head(laszip, self.octree.as_ref(), end.tally, end.packets_at, state))
    }
}
