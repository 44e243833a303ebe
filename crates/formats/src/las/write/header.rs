//! The public header block and the variable length records after it.

use super::format::LasFormat;
use super::vlr::{self, fixed_text};
use crate::las::copc::Octree;
use crate::las::{LasVersion, PacketPlace};
use crate::record::Tally;
use crate::settings::SOFTWARE;

impl LasFormat {
    /// Returns header and variable length records of a file with the counts and bounds of `tally`, and with packets
    /// at position `packets_at` of that file, or with points that form an octree; `state` describes how the run ended. The length
    /// depends on the compression alone.
    pub fn head(
        &self,
        laszip: Option<&::laz::LazVlr>,
        octree: Option<&Octree>,
        tally: &Tally,
        packets_at: Option<u64>,
        state: &str,
    ) -> Vec<u8> {
        let info = octree.map(|octree| vlr::record("copc", 1, "COPC info", &octree.info));
        let compression = laszip.map(vlr::laszip);
        let state = Some(vlr::state(state));
        let vlrs: Vec<&[u8]> =
            info.iter().chain(&compression).chain(&self.vlrs).chain(&state).map(Vec::as_slice).collect();
        // The extended variable length record after the points.
        let record_at = packets_at.or(octree.map(|octree| octree.hierarchy_at));
        let mut head = header(self, laszip.is_some(), &vlrs, tally, packets_at, record_at);
        vlrs.iter().for_each(|vlr| head.extend_from_slice(vlr));
        head
    }

    /// Returns the header of a stream that cannot be patched: the maximum number of points, and the bounds of the
    /// scene.
    pub fn stream_head(&self, at_most: u64) -> Vec<u8> {
        let mut by_return = [0; 15];
        by_return[0] = at_most;
        let tally = Tally { records: at_most, left_out: 0, by_return, bounds: self.reach };
        self.head(None, None, &tally, None, "streamed")
    }
}

/// Returns the public header block, field by field in the order of the LAS specification.
fn header(
    format: &LasFormat,
    compressed: bool,
    vlrs: &[&[u8]],
    tally: &Tally,
    packets_at: Option<u64>,
    record_at: Option<u64>,
) -> Vec<u8> {
    let modern = format.version == LasVersion::V14;
    let size: u16 = if modern { 375 } else { 227 };
    let data = usize::from(size) + vlrs.iter().map(|vlr| vlr.len()).sum::<usize>();
    let mut out = Vec::with_capacity(data);
    // File signature
    out.extend_from_slice(b"LASF");
    // File source ID
    out.extend(0u16.to_le_bytes());
    // Global encoding: GPS week time; WKT, the only kind of coordinate system allowed for formats 6 and 9; location
    // of the waveform packets
    let packets = match format.packet_place() {
        None => 0u16,
        Some(PacketPlace::Inside) => 2,
        Some(PacketPlace::Beside) => 4,
    };
    out.extend((packets | if modern { 0x10 } else { 0 }).to_le_bytes());
    // Project ID
    out.extend([0; 16]);
    // Version major, minor
    out.extend(if modern { [1, 4] } else { [1, 0] });
    // System identifier
    out.extend(fixed_text::<32>(&format.system));
    // Generating software
    out.extend(fixed_text::<32>(SOFTWARE));
    // File creation day of year, year
    let (year, day) = format.creation;
    out.extend(day.to_le_bytes());
    out.extend(year.to_le_bytes());
    // Header size
    out.extend(size.to_le_bytes());
    // Offset to point data
    out.extend((data as u32).to_le_bytes());
    // Number of variable length records
    out.extend((vlrs.len() as u32).to_le_bytes());
    // Point data record format; the highest bit marks compression
    out.push(format.point_format() | if compressed { 0x80 } else { 0 });
    // Point data record length
    out.extend(format.record_length().to_le_bytes());
    // Legacy number of point records, and by return: 0 for formats 6 and above
    let by_return = by_return(tally, if modern { 15 } else { 7 });
    let legacy = |count: u64| if modern { 0 } else { u32::try_from(count).unwrap_or(u32::MAX) };
    out.extend(legacy(tally.records).to_le_bytes());
    by_return[..5].iter().for_each(|&count| out.extend(legacy(count).to_le_bytes()));
    // Scale factors
    [format.scale; 3].iter().for_each(|scale| out.extend(scale.to_le_bytes()));
    // Offsets
    format.offset.to_array().iter().for_each(|offset| out.extend(offset.to_le_bytes()));
    // Max and min of X, Y, Z
    let world = format.world(&tally.bounds);
    for axis in 0..3 {
        let (max, min) = if world.is_empty() { (0.0, 0.0) } else { (world.max[axis], world.min[axis]) };
        out.extend(f64::to_le_bytes(max));
        out.extend(f64::to_le_bytes(min));
    }
    if modern {
        // Start of waveform data packet record
        out.extend(packets_at.unwrap_or(0).to_le_bytes());
        // Start of first extended variable length record, number of them
        out.extend(record_at.unwrap_or(0).to_le_bytes());
        out.extend(u32::from(record_at.is_some()).to_le_bytes());
        // Number of point records, and by return
        out.extend(tally.records.to_le_bytes());
        by_return.iter().for_each(|count| out.extend(count.to_le_bytes()));
    }
    debug_assert_eq!(out.len(), usize::from(size));
    out
}

/// Counts by return number; returns above `max` were stored as `max`.
fn by_return(tally: &Tally, max: usize) -> [u64; 15] {
    let mut counts = tally.by_return;
    let above: u64 = counts[max..].iter().sum();
    counts[max - 1] += above;
    counts[max..].fill(0);
    counts
}
