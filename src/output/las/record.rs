//! Point data records.

use super::format::{LasFormat, MAX_CLASS_1};
use crate::output::codec::{LegFacts, PointCodec, incidence_degrees, seconds};
use crate::output::ground::{Ground, height_above};
use crate::output::objects::ObjectIds;
use crate::output::request::{ExtraDimensions, IntensityMapping, LasVersion};
use std::sync::Arc;
use vlscan_geom::{DVec3, degrees};
use vlscan_lidar::pulse::{Echo, EchoTruth};

/// Encoder of echoes as point data records, without the fields of waveform packets.
pub(in crate::output) struct LasCodec<'a> {
    pub format: &'a LasFormat,
    pub objects: &'a ObjectIds,
    /// True causes of the echoes of the batch.
    pub truths: &'a [EchoTruth],
    pub ground: Option<&'a Arc<dyn Ground>>,
}

/// `1000·log10(a) = DECIBEL·ln(a)`.
const DECIBEL: f64 = 1000.0 * std::f64::consts::LOG10_E;

/// Flag "withheld" of formats 6 and 1, set for missed pulses.
const WITHHELD_6: u8 = 1 << 2;
const WITHHELD_1: u8 = 1 << 7;

const MAX_RECORD_BYTES: usize = 116;
/// Equivalent of `f64::round_ties_even` for magnitudes below 2^51, without the function call on processors that lack
/// the instruction. Larger numbers keep about their magnitude.
#[inline(always)]
fn round_half_even(x: f64) -> f64 {
    const UNIT_IS_LAST_DIGIT: f64 = 1.5 * (1u64 << 52) as f64;
    (x + UNIT_IS_LAST_DIGIT) - UNIT_IS_LAST_DIGIT
}

impl PointCodec for LasCodec<'_> {
    const TYPICAL_BYTES: usize = MAX_RECORD_BYTES;

    fn push(&self, out: &mut Vec<u8>, leg: &LegFacts, echo: &Echo) -> Option<DVec3> {
        let stored = self.stored(echo.position)?;
        let mut record = Record { bytes: [0; MAX_RECORD_BYTES], at: 0 };
        self.put_base(&mut record, stored, leg, echo);
        self.put_extra(&mut record, echo);
        out.extend_from_slice(&record.bytes[..record.at]);
        Some(stored)
    }
}

impl LasCodec<'_> {
    /// Returns integer coordinates, if they fit into 32 bits.
    fn stored(&self, position: DVec3) -> Option<DVec3> {
        let scaled = (position + self.format.shift) / self.format.scale;
        let stored = DVec3::from(scaled.to_array().map(round_half_even));
        let limit = f64::from(i32::MAX);
        // A NaN fails these comparisons too.
        let holds = stored.x.abs() <= limit && stored.y.abs() <= limit && stored.z.abs() <= limit;
        holds.then_some(stored)
    }

    /// Writes the fields defined by the format: 6 of LAS 1.4, 1 of LAS 1.0.
    fn put_base(&self, record: &mut Record, stored: DVec3, leg: &LegFacts, echo: &Echo) {
        let (withheld, angle) = (echo.is_miss(), degrees(echo.scan_angle));
        // X, Y, Z
        stored.to_array().into_iter().for_each(|c| record.put((c as i32).to_le_bytes()));
        // Intensity
        record.put(self.format.digital_intensity(echo.intensity).to_le_bytes());
        match self.format.version {
            LasVersion::V14 => {
                // Return number, number of returns
                record.put([clamped(echo.return_number, 15) | clamped(echo.number_of_returns, 15) << 4]);
                // Classification flags, scanner channel, scan direction flag, edge of flight line
                record.put([((echo.device & 3) as u8) << 4 | if withheld { WITHHELD_6 } else { 0 }]);
                // Classification
                record.put([u8::try_from(echo.classification).unwrap_or(0)]);
                // User data
                record.put([0]);
                // Scan angle, 0.006 degrees
                let steps = round_half_even((angle / 0.006).clamp(-30_000.0, 30_000.0));
                record.put((steps as i16).to_le_bytes());
            }
            LasVersion::V10 => {
                // Return number, number of returns, scan direction flag, edge of flight line
                record.put([clamped(echo.return_number, 7) | clamped(echo.number_of_returns, 7) << 3]);
                // Classification and its flags
                let class = match echo.classification {
                    class @ 0..=MAX_CLASS_1 => class as u8,
                    _ => 0,
                };
                record.put([class | if withheld { WITHHELD_1 } else { 0 }]);
                // Scan angle rank, degrees
                record.put([angle.clamp(-90.0, 90.0).round_ties_even() as i8 as u8]);
                // User data
                record.put([0]);
            }
        }
        // Point source ID
        record.put(leg.source_id.to_le_bytes());
        // GPS time
        record.put(seconds(echo.time_ns).to_le_bytes());
    }

    /// Writes the extra bytes, in the order described by [`super::vlr`].
    fn put_extra(&self, record: &mut Record, echo: &Echo) {
        let LasFormat { extra, groups, .. } = self.format;
        if *extra == ExtraDimensions::None {
            return;
        }
        // echo_width
        record.put(echo.echo_width.to_le_bytes());
        // fullwaveIndex
        record.put((echo.pulse_number as u32).to_le_bytes());
        // hitObjectId
        record.put(self.objects.of_part(echo.part).to_le_bytes());
        // heliosAmplitude
        record.put(echo.intensity.to_le_bytes());
        if *extra == ExtraDimensions::Helios {
            return;
        }
        // device
        record.put(u16::try_from(echo.device).unwrap_or(u16::MAX).to_le_bytes());
        // range
        record.put((echo.range as f32).to_le_bytes());
        // incidence_angle
        record.put(incidence_degrees(echo).to_le_bytes());
        if groups.labels {
            // part
            record.put(echo.part.to_le_bytes());
            // primitive
            record.put(echo.primitive.to_le_bytes());
            // true_range
            record.put((echo.true_range as f32).to_le_bytes());
        }
        if groups.directions {
            // BeamDirectionX, BeamDirectionY, BeamDirectionZ
            echo.direction.to_array().into_iter().for_each(|d| record.put((d as f32).to_le_bytes()));
        }
        if groups.true_positions {
            // TrueX, TrueY, TrueZ; offset and shift of the format add up to the scene's shift.
            let position = echo.true_position(self.truths) + self.format.offset + self.format.shift;
            position.to_array().into_iter().for_each(|c| record.put(c.to_le_bytes()));
        }
        if groups.heights {
            // HeightAboveGround
            record.put(height_above(self.ground, echo.position).to_le_bytes());
        }
    }
}

impl LasFormat {
    /// Converts an amplitude to the 16-bit intensity.
    pub fn digital_intensity(&self, amplitude: f64) -> u16 {
        // The conversion saturates, and NaN becomes 0.
        match self.intensity {
            IntensityMapping::Decibel if amplitude > 0.0 => {
                round_half_even(10_000.0 + DECIBEL * libm::log(amplitude)).max(1.0) as u16
            }
            IntensityMapping::Decibel => 0,
            IntensityMapping::Linear { full_scale } => {
                (65_535.0 * amplitude / full_scale).round_ties_even() as u16
            }
            IntensityMapping::Helios => (65_535.0 * amplitude / 1e6) as u16,
        }
    }
}

fn clamped(count: u32, max: u8) -> u8 {
    u8::try_from(count).unwrap_or(u8::MAX).min(max)
}

struct Record {
    bytes: [u8; MAX_RECORD_BYTES],
    at: usize,
}

impl Record {
    fn put<const N: usize>(&mut self, field: [u8; N]) {
        self.bytes[self.at..self.at + N].copy_from_slice(&field);
        self.at += N;
    }
}
