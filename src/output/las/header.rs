//! The public header block.

use super::LasFormat;
use crate::output::request::{LasVersion, PacketPlace};
use crate::output::summary::Tally;

/// What stands behind the points, and where.
#[derive(Clone, Copy)]
pub(super) enum Behind {
    Nothing,
    /// Waveform packets.
    Packets(u64),
    /// The list of the octree's nodes.
    Octree(u64),
}

/// The header, field by field as the specification of LAS lists them.
pub(super) fn header(
    format: &LasFormat,
    compressed: bool,
    vlrs: &[&[u8]],
    tally: &Tally,
    behind: Behind,
) -> Vec<u8> {
    let modern = format.version == LasVersion::V14;
    let size: u16 = if modern { 375 } else { 227 };
    let data = usize::from(size) + vlrs.iter().map(|vlr| vlr.len()).sum::<usize>();
    let mut out = Vec::with_capacity(data);
    // File signature
    out.extend_from_slice(b"LASF");
    // File source ID
    out.extend(0u16.to_le_bytes());
    // Global encoding: GPS week time; a coordinate system as WKT is the only kind that formats 6 and 9 may have; where the
    // waveform packets are
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
    out.extend(fixed_text::<32>(concat!("vlscan ", env!("CARGO_PKG_VERSION"))));
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
    // Legacy number of point records, and by return: not for format 6
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
        let (packets_at, record_at) = match behind {
            Behind::Nothing => (0, None),
            Behind::Packets(at) => (at, Some(at)),
            Behind::Octree(at) => (0, Some(at)),
        };
        out.extend(packets_at.to_le_bytes());
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

/// Counts by return number where higher ones than `most` were stored as `most`.
fn by_return(tally: &Tally, most: usize) -> [u64; 15] {
    let mut counts = tally.by_return;
    let above: u64 = counts[most..].iter().sum();
    counts[most - 1] += above;
    counts[most..].fill(0);
    counts
}

/// A text of at most `N − 1` ASCII characters, filled up with NUL.
pub(super) fn fixed_text<const N: usize>(text: &str) -> [u8; N] {
    let mut bytes = [0; N];
    for (byte, c) in bytes[..N - 1].iter_mut().zip(text.chars()) {
        *byte = if c.is_ascii() && !c.is_ascii_control() { c as u8 } else { b'?' };
    }
    bytes
}
