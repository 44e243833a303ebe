//! The public header block and the variable length records after it.

use super::format::LasFormat;
use super::vlr::{self, fixed_text};
use crate::las::copc::Octree;
use crate::las::{LasVersion, PacketPlace};
use crate::record::Tally;
use crate::settings::SOFTWARE;
use las::raw::header::{Evlr, LargeFile};
use las::{Version, raw};
use vlscan_geom::DVec3;

impl LasFormat {
    /// Returns header and variable length records of a file with the counts and bounds of `tally`, and with
    /// packets at position `packets_at` of that file, or with points that form an octree; `state` describes
    /// how the run ended. The length depends on the compression alone.
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

    /// Returns the header of a stream that cannot be patched: the maximum number of points, and the bounds of
    /// the scene.
    pub fn stream_head(&self, at_most: u64) -> Vec<u8> {
        let mut by_return = [0; 15];
        by_return[0] = at_most;
        let tally = Tally { records: at_most, by_return, bounds: self.reach, ..Tally::EMPTY };
        self.head(None, None, &tally, None, "streamed")
    }
}

/// Returns the public header block.
fn header(
    format: &LasFormat,
    compressed: bool,
    vlrs: &[&[u8]],
    tally: &Tally,
    packets_at: Option<u64>,
    record_at: Option<u64>,
) -> Vec<u8> {
    let modern = format.version == LasVersion::V14;
    let version = if modern { Version::new(1, 4) } else { Version::new(1, 0) };
    let data = usize::from(version.header_size()) + vlrs.iter().map(|vlr| vlr.len()).sum::<usize>();
    let packets = match format.packet_place() {
        None => 0,
        Some(PacketPlace::Inside) => 2,
        Some(PacketPlace::Beside) => 4,
    };
    let by_return = by_return(tally, if modern { 15 } else { 7 });
    // The fields of earlier versions are 0 for formats 6 and above.
    let legacy = |count: u64| if modern { 0 } else { u32::try_from(count).unwrap_or(u32::MAX) };
    let world = format.world(&tally.bounds);
    let (min, max) = if world.is_empty() { (DVec3::ZERO, DVec3::ZERO) } else { (world.min, world.max) };
    let (year, day) = format.creation;
    let is_adjusted = format.adjusted_times || tally.has_adjusted_times;
    let header = raw::Header {
        // Adjusted standard GPS time or that of the week; WKT, the only kind of coordinate system allowed for
        // formats 6 and 9; location of the packets.
        global_encoding: packets | if modern { 0x10 | u16::from(is_adjusted) } else { 0 },
        version,
        system_identifier: fixed_text(&format.system),
        generating_software: fixed_text(SOFTWARE),
        file_creation_day_of_year: day,
        file_creation_year: year,
        header_size: version.header_size(),
        offset_to_point_data: data as u32,
        number_of_variable_length_records: vlrs.len() as u32,
        // The highest bit marks compression.
        point_data_record_format: format.point_format() | if compressed { 0x80 } else { 0 },
        point_data_record_length: format.record_length(),
        number_of_point_records: legacy(tally.records),
        number_of_points_by_return: std::array::from_fn(|i| legacy(by_return[i])),
        x_scale_factor: format.scale,
        y_scale_factor: format.scale,
        z_scale_factor: format.scale,
        x_offset: format.offset.x,
        y_offset: format.offset.y,
        z_offset: format.offset.z,
        max_x: max.x,
        min_x: min.x,
        max_y: max.y,
        min_y: min.y,
        max_z: max.z,
        min_z: min.z,
        start_of_waveform_data_packet_record: packets_at,
        evlr: Some(Evlr {
            start_of_first_evlr: record_at.unwrap_or(0),
            number_of_evlrs: record_at.is_some().into(),
        }),
        large_file: Some(LargeFile {
            number_of_point_records: tally.records,
            number_of_points_by_return: by_return,
        }),
        ..raw::Header::default()
    };
    let mut out = Vec::with_capacity(data);
    // Writing to a vector cannot fail.
    let _ = header.write_to(&mut out);
    debug_assert_eq!(out.len(), usize::from(version.header_size()));
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
