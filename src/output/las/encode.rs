//! Points of format 9: records with references to the waveform packets of their pulses.

use super::packets::{FIELD_BYTES, Packet, WavePackets};
use super::record::LasCodec;
use crate::output::codec::{LegFacts, Piece};
use crate::output::layout::Slots;
use vlscan_lidar::pulse::{Batch, Echo, WaveformRecord};

/// Offset in bytes of the reference in a record: after the fields that format 9 shares with format 6.
const FIELD_AT: usize = 30;

/// Encodes the echoes of a batch and the packets of their pulses. All echoes of a pulse refer to the same packet.
pub(in crate::output) fn encode_with_packets(
    codec: &LasCodec,
    packets: &WavePackets,
    leg: &LegFacts,
    slots: &Slots,
    echoes: &[Echo],
    batch: &Batch,
    pieces: &mut Vec<Piece>,
) {
    let first = pieces.len();
    pieces.extend(slots.as_slice().iter().map(|&slot| Piece::new(slot, 0)));
    // Echoes and waveforms are both in order of emission.
    let mut waves = batch.waveforms.iter().peekable();
    let mut latest: Option<(&WaveformRecord, Option<Packet>)> = None;
    for echo in echoes {
        let Some(piece) = pieces.get_mut(first + slots.index_of(echo.device)) else { continue };
        let belongs =
            |wave: &WaveformRecord| (wave.device, wave.pulse_number) == (echo.device, echo.pulse_number);
        if !latest.is_some_and(|(wave, _)| belongs(wave))
            && let Some(wave) = waves.next_if(|wave| belongs(wave))
        {
            let samples = batch.samples.get(wave.first_sample..).unwrap_or_default();
            let samples = &samples[..wave.samples.min(samples.len())];
            latest = Some((wave, packets.push(&mut piece.packets, wave, samples)));
        }
        let field = match latest {
            Some((wave, Some(packet))) if belongs(wave) => packets.field(packet, wave, echo),
            // Descriptor 0: no packet.
            _ => [0; FIELD_BYTES],
        };
        let before = piece.bytes.len();
        piece.push_point(codec, leg, echo);
        if piece.bytes.len() > before {
            piece.bytes.splice(before + FIELD_AT..before + FIELD_AT, field);
        }
    }
}

/// Adds `before`, the position of the first packet in its file, to the packet offsets of encoded points.
pub(in crate::output) fn place_packets(points: &mut [u8], record_length: u16, before: u64) {
    for point in points.chunks_exact_mut(usize::from(record_length)) {
        let Some((descriptor, offset)) =
            point.get_mut(FIELD_AT..FIELD_AT + 9).and_then(<[u8]>::split_first_mut)
        else {
            return;
        };
        if *descriptor != 0 {
            let mut within = [0; 8];
            within.copy_from_slice(offset);
            offset.copy_from_slice(&(u64::from_le_bytes(within) + before).to_le_bytes());
        }
    }
}
