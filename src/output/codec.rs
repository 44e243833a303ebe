//! What all formats of point records share: the facts of the leg, the codec of a record, and the bytes that a batch
//! contributes to a file.

use super::layout::Slots;
use super::summary::Tally;
use crate::geom::{DVec3, degrees};
use crate::pulse::Echo;

/// What a record says of its leg.
#[derive(Clone, Copy, Debug)]
pub(super) struct LegFacts {
    /// Number of the leg, saturated to 16 bits.
    pub number: u16,
    /// Number of the leg plus one, because 0 means "unknown" in LAS.
    pub source_id: u16,
}

impl LegFacts {
    pub fn new(number: u32) -> LegFacts {
        let number = u16::try_from(number).unwrap_or(u16::MAX);
        LegFacts { number, source_id: number.saturating_add(1) }
    }
}

/// What a batch contributes to one file.
#[derive(Debug)]
pub(super) struct Piece {
    pub slot: u32,
    pub bytes: Vec<u8>,
    pub tally: Tally,
    /// Waveform packets of LAS points; the offsets in `bytes` count from their beginning.
    pub packets: Vec<u8>,
    /// Whether `bytes` are a block of columns, to which nothing can be appended.
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

    /// Appends a point and counts it.
    pub fn push_point(&mut self, codec: &impl PointCodec, leg: &LegFacts, echo: &Echo) {
        match codec.push(&mut self.bytes, leg, echo) {
            Some(stored) => self.tally.count_point(stored, echo.return_number),
            None => self.tally.left_out += 1,
        }
    }
}

/// How an echo becomes a record of one format.
pub(super) trait PointCodec {
    /// Typical bytes per record, to reserve memory.
    const TYPICAL_BYTES: usize;

    /// Appends the record; returns its coordinates as stored, or `None` when the format cannot hold them and nothing
    /// was appended.
    fn push(&self, out: &mut Vec<u8>, leg: &LegFacts, echo: &Echo) -> Option<DVec3>;
}

/// Encodes points and appends one piece per file of `slots`.
pub(super) fn encode_points<C: PointCodec>(
    codec: &C,
    leg: &LegFacts,
    slots: &Slots,
    echoes: &[Echo],
    pieces: &mut Vec<Piece>,
) {
    let first = pieces.len();
    // Memory is reserved where all echoes go to one file; devices share them in unknown parts.
    let capacity = if matches!(slots, Slots::One(_)) { echoes.len() * C::TYPICAL_BYTES } else { 0 };
    pieces.extend(slots.as_slice().iter().map(|&slot| Piece::new(slot, capacity)));
    for echo in echoes {
        if let Some(piece) = pieces.get_mut(first + slots.index_of(echo.device)) {
            piece.push_point(codec, leg, echo);
        }
    }
}

/// Seconds of the GPS week for nanoseconds of the week.
pub(super) fn seconds(time_ns: f64) -> f64 {
    time_ns / 1e9
}

/// Angle between beam and surface normal, degrees.
pub(super) fn incidence_degrees(echo: &Echo) -> f32 {
    degrees(libm::acos(echo.incidence_cosine.clamp(-1.0, 1.0))) as f32
}

/// A count that saturates at 255.
pub(super) fn byte(count: u32) -> u8 {
    u8::try_from(count).unwrap_or(u8::MAX)
}
