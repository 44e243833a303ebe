//! Point data records.

use super::{LasFormat, ObjectIds};
use crate::geom::{DVec3, degrees};
use crate::output::encode::PointCodec;
use crate::output::plan::LegFacts;
use crate::output::request::{ExtraDimensions, IntensityMapping, LasVersion};
use crate::output::text::seconds;
use crate::pulse::{Echo, EchoTruth};

/// Packs echoes as points.
pub(in crate::output) struct LasCodec<'a> {
    pub format: &'a LasFormat,
    pub objects: &'a ObjectIds,
    /// What really caused the echoes of the batch.
    pub truths: &'a [EchoTruth],
}

/// 1000·log10(a) = DECIBEL·ln(a)
const DECIBEL: f64 = 1000.0 * std::f64::consts::LOG10_E;

/// The bit that marks points as not to be used: missed pulses.
const WITHHELD_6: u8 = 1 << 2;
const WITHHELD_1: u8 = 1 << 7;

/// The nearest whole number, of two the even one, as far as 2^51: `f64::round_ties_even`, which is a call where there is no
/// instruction for it. Larger numbers stay about as large.
#[inline(always)]
fn round_half_even(x: f64) -> f64 {
    const UNIT_IS_LAST_DIGIT: f64 = 1.5 * (1u64 << 52) as f64;
    (x + UNIT_IS_LAST_DIGIT) - UNIT_IS_LAST_DIGIT
}

/// Bytes of the longest record.
const LONGEST: usize = 112;

impl PointCodec for LasCodec<'_> {
    const SIZE: usize = LONGEST;

    fn push(&self, out: &mut Vec<u8>, leg: &LegFacts, echo: &Echo) -> Option<DVec3> {
        let stored = self.stored(echo.position)?;
        let mut record = Record { bytes: [0; LONGEST], at: 0 };
        match self.format.version {
            LasVersion::V14 => self.format_6(&mut record, stored, leg, echo),
            LasVersion::V10 => self.format_1(&mut record, stored, leg, echo),
        }
        self.extra(&mut record, echo);
        out.extend_from_slice(&record.bytes[..record.at]);
        Some(stored)
    }
}

impl LasCodec<'_> {
    /// Integer coordinates, if 32 bits hold them.
    fn stored(&self, position: DVec3) -> Option<DVec3> {
        let scaled = (position + self.format.shift) / self.format.scale;
        let stored = DVec3::from(scaled.to_array().map(round_half_even));
        let limit = f64::from(i32::MAX);
        // NaN is not within the limit either.
        let holds = stored.x.abs() <= limit && stored.y.abs() <= limit && stored.z.abs() <= limit;
        holds.then_some(stored)
    }

    fn format_6(&self, record: &mut Record, stored: DVec3, leg: &LegFacts, echo: &Echo) {
        // X, Y, Z
        stored.to_array().into_iter().for_each(|c| record.put((c as i32).to_le_bytes()));
        // Intensity
        record.put(self.format.digital_intensity(echo.intensity).to_le_bytes());
        // Return number, number of returns
        record.put([at_most(echo.return_number, 15) | at_most(echo.number_of_returns, 15) << 4]);
        // Classification flags, scanner channel, scan direction flag, edge of flight line
        record.put([((echo.device & 3) as u8) << 4 | if echo.is_miss() { WITHHELD_6 } else { 0 }]);
        // Classification
        record.put([u8::try_from(echo.classification).unwrap_or(0)]);
        // User data
        record.put([0]);
        // Scan angle, 0.006 degrees
        record.put(
            (round_half_even((degrees(echo.scan_angle) / 0.006).clamp(-30_000.0, 30_000.0)) as i16)
                .to_le_bytes(),
        );
        // Point source ID
        record.put(leg.source_id.to_le_bytes());
        // GPS time
        record.put(seconds(echo.time_ns).to_le_bytes());
    }

    fn format_1(&self, record: &mut Record, stored: DVec3, leg: &LegFacts, echo: &Echo) {
        // X, Y, Z
        stored.to_array().into_iter().for_each(|c| record.put((c as i32).to_le_bytes()));
        // Intensity
        record.put(self.format.digital_intensity(echo.intensity).to_le_bytes());
        // Return number, number of returns, scan direction flag, edge of flight line
        record.put([at_most(echo.return_number, 7) | at_most(echo.number_of_returns, 7) << 3]);
        // Classification
        let class = u8::try_from(echo.classification).ok().filter(|&c| c < 32).unwrap_or(0);
        record.put([class | if echo.is_miss() { WITHHELD_1 } else { 0 }]);
        // Scan angle rank, degrees
        record.put([degrees(echo.scan_angle).clamp(-90.0, 90.0).round_ties_even() as i8 as u8]);
        // User data
        record.put([0]);
        // Point source ID
        record.put(leg.source_id.to_le_bytes());
        // GPS time
        record.put(seconds(echo.time_ns).to_le_bytes());
    }

    fn extra(&self, record: &mut Record, echo: &Echo) {
        if self.format.extra == ExtraDimensions::None {
            return;
        }
        // echo_width
        record.put(echo.echo_width.to_le_bytes());
        // fullwaveIndex
        record.put((echo.pulse_number as u32).to_le_bytes());
        // hitObjectId
        record.put(self.objects.ids.get(echo.part as usize).copied().unwrap_or(0).to_le_bytes());
        // heliosAmplitude
        record.put(echo.intensity.to_le_bytes());
        if self.format.extra == ExtraDimensions::Helios {
            return;
        }
        // device
        record.put(u16::try_from(echo.device).unwrap_or(u16::MAX).to_le_bytes());
        // range
        record.put((echo.range as f32).to_le_bytes());
        // incidence_angle
        record.put(incidence_degrees(echo).to_le_bytes());
        if self.format.groups.labels {
            // part
            record.put(echo.part.to_le_bytes());
            // primitive
            record.put(echo.primitive.to_le_bytes());
            // true_range
            record.put((echo.true_range as f32).to_le_bytes());
        }
        if self.format.groups.directions {
            // BeamDirectionX, BeamDirectionY, BeamDirectionZ
            echo.direction.to_array().into_iter().for_each(|d| record.put((d as f32).to_le_bytes()));
        }
        if self.format.groups.true_positions {
            // TrueX, TrueY, TrueZ; the format's offset and shift together are the scene's shift.
            let place = echo.true_position(self.truths) + self.format.offset + self.format.shift;
            place.to_array().into_iter().for_each(|c| record.put(c.to_le_bytes()));
        }
    }
}

impl LasFormat {
    /// The 16 bits of intensity that stand for an amplitude.
    pub fn digital_intensity(&self, amplitude: f64) -> u16 {
        // Conversions saturate, and NaN becomes 0.
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

/// Angle between beam and surface normal, degrees.
pub(in crate::output) fn incidence_degrees(echo: &Echo) -> f32 {
    degrees(libm::acos(echo.incidence_cosine.clamp(-1.0, 1.0))) as f32
}

fn at_most(count: u32, most: u8) -> u8 {
    u8::try_from(count).unwrap_or(u8::MAX).min(most)
}

struct Record {
    bytes: [u8; LONGEST],
    at: usize,
}

impl Record {
    fn put<const N: usize>(&mut self, field: [u8; N]) {
        self.bytes[self.at..self.at + N].copy_from_slice(&field);
        self.at += N;
    }
}
