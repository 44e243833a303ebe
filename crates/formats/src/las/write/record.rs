//! Point data records.

use super::format::{LasFormat, MAX_CLASS_1};
use crate::las::{ExtraDimensions, LasVersion};
use crate::record::{PointRecord, WEEK_S, round_half_even};
use vlscan_geom::{DVec3, degrees};

/// Flag "withheld" of formats 6 and 1, set for missed pulses.
const WITHHELD_6: u8 = 1 << 2;
const WITHHELD_1: u8 = 1 << 7;

/// Adjusted standard GPS time is GPS time less this, s.
const ADJUSTMENT_S: f64 = 1e9;

/// Bytes of a record with all extra bytes but the labels of the way of light.
pub(super) const MAX_RECORD_BYTES: usize = 132;
impl LasFormat {
    /// Appends the record of a point, without the fields of waveform packets. Returns its coordinates as
    /// stored, or `None`, with nothing appended, if they do not fit into 32 bits.
    #[inline]
    pub fn push(&self, out: &mut Vec<u8>, point: &PointRecord) -> Option<DVec3> {
        let stored = self.stored(point.position)?;
        let mut record = Record { bytes: [0; MAX_RECORD_BYTES], at: 0 };
        self.put_base(&mut record, stored, point);
        self.put_extra(&mut record, point);
        out.extend_from_slice(&record.bytes[..record.at]);
        if self.extra == ExtraDimensions::All {
            // Offset and shift of the format add up to the scene's shift.
            self.groups.light.push_bytes(out, point, self.offset + self.shift);
        }
        Some(stored)
    }

    /// Returns integer coordinates, if they fit into 32 bits.
    fn stored(&self, position: DVec3) -> Option<DVec3> {
        let scaled = (position + self.shift) / self.scale;
        let stored = DVec3::from(scaled.to_array().map(round_half_even));
        let limit = f64::from(i32::MAX);
        // A NaN fails these comparisons too.
        let holds = stored.x.abs() <= limit && stored.y.abs() <= limit && stored.z.abs() <= limit;
        holds.then_some(stored)
    }

    /// Writes the fields defined by the format: 6, 7 or those of 9 and 10 without the packet of LAS 1.4, 1 of
    /// LAS 1.0.
    fn put_base(&self, record: &mut Record, stored: DVec3, point: &PointRecord) {
        let (withheld, angle) = (point.is_miss(), degrees(point.scan_angle));
        // X, Y, Z
        stored.to_array().into_iter().for_each(|c| record.put((c as i32).to_le_bytes()));
        // Intensity
        record.put(point.digital_intensity().to_le_bytes());
        match self.version {
            LasVersion::V14 => {
                // Return number, number of returns
                record.put([clamped(point.return_number, 15) | clamped(point.number_of_returns, 15) << 4]);
                // Classification flags, scanner channel, scan direction flag, edge of flight line
                record.put([((point.device & 3) as u8) << 4
                    | point.stored.flags.format_6()
                    | if withheld { WITHHELD_6 } else { 0 }]);
                // Classification
                record.put([u8::try_from(point.class).unwrap_or(0)]);
                // User data
                record.put([point.stored.user_data]);
                // Scan angle, 0.006 degrees
                let steps = round_half_even((angle / 0.006).clamp(-30_000.0, 30_000.0));
                record.put((steps as i16).to_le_bytes());
            }
            LasVersion::V10 => {
                let (line_flags, class_flags) = point.stored.flags.format_1();
                // Return number, number of returns, scan direction flag, edge of flight line
                let returns = clamped(point.return_number, 7) | clamped(point.number_of_returns, 7) << 3;
                record.put([returns | line_flags]);
                // Classification and its flags
                let class = match point.class {
                    class @ 0..=MAX_CLASS_1 => class as u8,
                    _ => 0,
                };
                record.put([class | class_flags | if withheld { WITHHELD_1 } else { 0 }]);
                // Scan angle rank, degrees
                record.put([angle.clamp(-90.0, 90.0).round_ties_even() as i8 as u8]);
                // User data
                record.put([point.stored.user_data]);
            }
        }
        // Point source ID
        record.put(point.source_id().to_le_bytes());
        // GPS time: LAS 1.0 has the time of the week only
        let seconds = match self.version {
            LasVersion::V10 if point.has_adjusted_time() => {
                (point.seconds() + ADJUSTMENT_S).rem_euclid(WEEK_S)
            }
            _ => point.seconds(),
        };
        record.put(seconds.to_le_bytes());
        if self.colours {
            // Red, green, blue
            point.colour_u16().into_iter().for_each(|component| record.put(component.to_le_bytes()));
            if self.packets.is_some() {
                // Near infrared
                record.put([0; 2]);
            }
        }
    }

    /// Writes the extra bytes, in the order described by [`super::vlr`].
    fn put_extra(&self, record: &mut Record, point: &PointRecord) {
        let LasFormat { extra, groups, .. } = self;
        if *extra == ExtraDimensions::None {
            return;
        }
        // echo_width
        record.put(point.echo_width.to_le_bytes());
        // fullwaveIndex
        record.put((point.pulse_number as u32).to_le_bytes());
        // hitObjectId
        record.put(point.object.to_le_bytes());
        // heliosAmplitude
        record.put(point.amplitude.to_le_bytes());
        if *extra == ExtraDimensions::Helios {
            return;
        }
        // device
        record.put(point.device_u16().to_le_bytes());
        // range
        record.put((point.range as f32).to_le_bytes());
        // incidence_angle
        record.put(point.incidence_degrees().to_le_bytes());
        if groups.labels {
            // part
            record.put(point.part.to_le_bytes());
            // primitive
            record.put(point.primitive.to_le_bytes());
            // true_range
            record.put((point.true_range as f32).to_le_bytes());
        }
        if groups.directions {
            // BeamDirectionX, BeamDirectionY, BeamDirectionZ
            point.direction.to_array().into_iter().for_each(|d| record.put((d as f32).to_le_bytes()));
        }
        if groups.true_positions {
            // TrueX, TrueY, TrueZ; offset and shift of the format add up to the scene's shift.
            let position = point.true_position + self.offset + self.shift;
            position.to_array().into_iter().for_each(|c| record.put(c.to_le_bytes()));
        }
        if groups.heights {
            // HeightAboveGround
            record.put(point.height.to_le_bytes());
        }
        if groups.velocities {
            // Doppler, DopplerWidth
            point.cause.velocity.into_iter().for_each(|v| record.put((v as f32).to_le_bytes()));
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
