//! Definitions shared by all formats of point records: the facts of the leg, the codec of a record, and the bytes
//! that a batch contributes to a file.

use super::layout::Slots;
use super::summary::Tally;
use vlscan_geom::{DVec3, degrees};
use vlscan_lidar::pulse::Echo;

/// Values of the leg that every record repeats.
#[derive(Clone, Copy, Debug)]
pub(super) struct LegFacts {
    pub number: u16,
    /// Number of the leg plus one, because 0 means "unknown" in LAS; saturated.
    pub source_id: u16,
}

impl LegFacts {
    pub fn new(number: u32) -> LegFacts {
        let number = u16::try_from(number).unwrap_or(u16::MAX);
        LegFacts { number, source_id: number.saturating_add(1) }
    }
}

/// The contribution of one batch to one file.
#[derive(Debug)]
pub(super) struct Piece {
    pub slot: u32,
    pub bytes: Vec<u8>,
    pub tally: Tally,
    /// Waveform packets of LAS points; the offsets in `bytes` count from the first of them.
    pub packets: Vec<u8>,
    /// Whether `bytes` is a block of columns, to which nothing can be appended.
    pub is_block: bool,
}

impl Piece {
    pub fn new(slot: u32, capacity: usize) -> Piece {
        Piece {
            slot,
            bytes: Vec::with_capacity(capacity),
            tally: Tally::EMPTY,
            packets: Vec::new(),
            is_block: false,
        }
    }

    /// Encodes a point and counts it.
    pub fn push_point(&mut self, codec: &impl PointCodec, leg: &LegFacts, echo: &Echo) {
        match codec.push(&mut self.bytes, leg, echo) {
            Some(stored) => self.tally.count_point(stored, echo.return_number),
            None => self.tally.left_out += 1,
        }
    }
}

/// Encoder of echoes as records of one format.
pub(super) trait PointCodec {
    /// Typical bytes per record, for the reservation of memory.
    const TYPICAL_BYTES: usize;

    /// Appends the record. Returns its coordinates as stored, or `None`, with nothing appended, when the format
    /// cannot represent them.
    fn push(&self, out: &mut Vec<u8>, leg: &LegFacts, echo: &Echo) -> Option<DVec3>;
}

/// Encodes the points of a batch and appends one piece per file of `slots`.
pub(super) fn encode_points<C: PointCodec>(
    codec: &C,
    leg: &LegFacts,
    slots: &Slots,
    echoes: &[Echo],
    pieces: &mut Vec<Piece>,
) {
    let first = pieces.len();
    // With one file per device the share of each device is unknown, so nothing is reserved.
    let capacity = if matches!(slots, Slots::One(_)) { echoes.len() * C::TYPICAL_BYTES } else { 0 };
    pieces.extend(slots.as_slice().iter().map(|&slot| Piece::new(slot, capacity)));
    for echo in echoes {
        if let Some(piece) = pieces.get_mut(first + slots.index_of(echo.device)) {
            piece.push_point(codec, leg, echo);
        }
    }
}

/// Converts nanoseconds of the GPS week to seconds.
pub(super) fn seconds(time_ns: f64) -> f64 {
    time_ns / 1e9
}

/// Angle between beam and surface normal, in degrees.
pub(super) fn incidence_degrees(echo: &Echo) -> f32 {
    degrees(libm::acos(echo.incidence_cosine.clamp(-1.0, 1.0))) as f32
}

/// Saturating conversion of a count to 8 bits.
pub(super) fn byte(count: u32) -> u8 {
    u8::try_from(count).unwrap_or(u8::MAX)
}
