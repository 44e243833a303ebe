//! Points in their written form, and the steps before their place in a file: records of one format, and their
//! counts.

use crate::PointRow;
use vlscan_geom::{Aabb, DVec3, Rotation, degrees, radians};

/// A point with all of its properties; a format writes those that it has a place for. Positions are relative
/// to [`CloudSettings::origin`](crate::CloudSettings::origin), so that large coordinates keep their digits.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PointRecord {
    /// Measured position, m. Of a pulse without echo that of the beam's origin.
    pub position: DVec3,
    /// Origin of the beam, m.
    pub origin: DVec3,
    /// Direction of the beam, unit vector.
    pub direction: DVec3,
    /// Position relative to the origin of the beam in the axes of the scanner's mount, m; NaN if unknown.
    pub in_scanner: DVec3,
    /// Attitude of the scanner: from the axes of its mount to the world; `None` if unknown.
    pub scanner: Option<Rotation>,
    /// Position without errors of navigation, m; NaN if unknown.
    pub true_position: DVec3,
    /// Cause of the echo.
    pub cause: Cause,
    /// Measured range, m.
    pub range: f64,
    /// Distance to the surface, m, without noise and errors.
    pub true_range: f64,
    /// Amplitude of the echo, in the unit of the instrument.
    pub amplitude: f64,
    /// Width of the echo, ns; 0 if unknown.
    pub echo_width: f64,
    /// Cosine of the angle between beam and surface normal.
    pub incidence_cosine: f64,
    /// Angle of the beam from straight down across the track, rad, negative to the left of the flight.
    pub scan_angle: f64,
    /// Time of emission, ns after `time_origin`: without one of the GPS week.
    pub time_ns: f64,
    /// The time that `time_ns` counts from, s: 0, or one of adjusted standard GPS time.
    pub time_origin: f64,
    /// Number of the pulse among those of its device, from 1.
    pub pulse_number: u64,
    /// Height above the ground, m; NaN where there is none.
    pub height: f32,
    /// Number of the return, from 1; 0 marks a pulse without echo.
    pub return_number: u32,
    /// Number of returns of the pulse; 0 marks a pulse without echo.
    pub number_of_returns: u32,
    /// Index of the scanner's device, from 0.
    pub device: u32,
    /// Index into [`CloudSettings::parts`](crate::CloudSettings::parts), the names of what was hit;
    /// `u32::MAX` for nothing.
    pub part: u32,
    /// Index of the triangle or voxel; `u32::MAX` for none.
    pub primitive: u32,
    /// Number of the object that was hit.
    pub object: i32,
    /// Class of the surface.
    pub class: i32,
    /// Index of the waveform in [`PointBatch::waves`]; `u32::MAX` for none.
    pub wave: u32,
    /// Number of the leg.
    pub leg: u16,
    /// Fields of a record of LAS that replace those made of the values above.
    pub stored: StoredFields,
}

/// Flags of a point, as point formats from 6 on of LAS have them.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct PointFlags(u8);

impl PointFlags {
    /// The point was not measured, but added.
    pub const SYNTHETIC: PointFlags = PointFlags(1);
    /// The point is to be kept when points are thinned out.
    pub const KEY_POINT: PointFlags = PointFlags(1 << 1);
    /// The point is not to be used, as if it were deleted.
    pub const WITHHELD: PointFlags = PointFlags(1 << 2);
    /// The point lies where flight lines overlap.
    pub const OVERLAP: PointFlags = PointFlags(1 << 3);
    /// The mirror moved from left to right.
    pub const POSITIVE_SCAN: PointFlags = PointFlags(1 << 6);
    /// The point is at the edge of its scan line.
    pub const EDGE: PointFlags = PointFlags(1 << 7);
    /// Bits of the byte that are flags; the others are the scanner channel.
    const MASK: u8 = 0b1100_1111;

    /// The flags in byte 15 of a record of format 6.
    pub fn of_format_6(byte: u8) -> PointFlags {
        PointFlags(byte & PointFlags::MASK)
    }

    /// The flags in bytes 14 and 15 of a record of format 1.
    pub fn of_format_1(returns: u8, class: u8) -> PointFlags {
        PointFlags(returns & 0b1100_0000 | class >> 5)
    }

    /// Byte 15 of a record of format 6, without the scanner channel.
    #[inline]
    pub(crate) fn format_6(self) -> u8 {
        self.0
    }

    /// The flags of bytes 14 and 15 of a record of format 1, which has none for overlaps.
    #[inline]
    pub(crate) fn format_1(self) -> (u8, u8) {
        (self.0 & 0b1100_0000, (self.0 & 0b111) << 5)
    }

    /// True if all flags of `other` are set.
    pub fn has(self, other: PointFlags) -> bool {
        self.0 & other.0 == other.0
    }

    /// The flags of both.
    #[must_use]
    pub fn with(self, other: PointFlags) -> PointFlags {
        PointFlags(self.0 | other.0)
    }

    /// True if no flag is set.
    pub fn is_empty(self) -> bool {
        self.0 == 0
    }
}

/// Fields of a record of LAS that are written unchanged, for copies.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct StoredFields {
    /// The 16 bits of intensity; `None`: those of the [amplitude](PointRecord::digital_intensity).
    pub intensity: Option<u16>,
    /// Point source id; `None`: the number of the leg plus one.
    pub point_source: Option<u16>,
    /// Angle between beam and surface normal, degrees; `None`: that of the cosine.
    pub incidence_deg: Option<f32>,
    /// Flags.
    pub flags: PointFlags,
    /// User data.
    pub user_data: u8,
    /// Red, green and blue with 16 bits; `None`: those of the [cause](Cause::colour).
    pub colour: Option<[u16; 3]>,
}

/// The true cause of an echo. Positions are relative to
/// [`CloudSettings::origin`](crate::CloudSettings::origin).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Cause {
    /// Point of the surface that was hit, m; NaN if no surface caused the echo.
    pub surface: DVec3,
    /// Unit normal there, towards the instrument; 0 in voxels.
    pub normal: DVec3,
    /// Share of the beam that is part of the echo.
    pub fraction: f64,
    /// Number of the strongest subray within the beam, from 0; `u32::MAX` without a surface.
    pub subray: u32,
    /// Way of the light: 0 straight, 1 through panes, 2 over mirrors, 3 to the surface of water, 4 into
    /// water, 5 through water, 6 into fog, rain, snow or dust, 7 to a single drop or flake, 8 to a mirror or
    /// pane that sends it straight back.
    pub path: u8,
    /// Number of mirrors, panes and surfaces of water on the way.
    pub order: u8,
    /// Red, green and blue of the surface, of sRGB with 8 bits; black without a colour.
    pub colour: [u8; 3],
    /// Radial velocity, positive away from the instrument, and its standard deviation over the light of the
    /// echo, m/s; NaN if they are not known.
    pub velocity: [f64; 2],
}

impl Cause {
    /// Nothing is known.
    pub const UNKNOWN: Cause = Cause {
        surface: DVec3::NAN,
        normal: DVec3::NAN,
        fraction: f64::NAN,
        subray: u32::MAX,
        path: 0,
        order: 0,
        colour: [0; 3],
        velocity: [f64::NAN; 2],
    };
}

impl Default for PointRecord {
    /// A single return at the origin, of which nothing else is known.
    fn default() -> PointRecord {
        PointRecord {
            position: DVec3::ZERO,
            origin: DVec3::ZERO,
            direction: DVec3::ZERO,
            in_scanner: DVec3::NAN,
            scanner: None,
            true_position: DVec3::NAN,
            cause: Cause::UNKNOWN,
            range: 0.0,
            true_range: 0.0,
            amplitude: 0.0,
            echo_width: 0.0,
            incidence_cosine: 1.0,
            scan_angle: 0.0,
            time_ns: 0.0,
            time_origin: 0.0,
            pulse_number: 0,
            height: f32::NAN,
            return_number: 1,
            number_of_returns: 1,
            device: 0,
            part: u32::MAX,
            primitive: u32::MAX,
            object: 0,
            class: 0,
            wave: u32::MAX,
            leg: 0,
            stored: StoredFields::default(),
        }
    }
}

impl PointRecord {
    /// True if the record represents a pulse without echo.
    #[inline]
    pub fn is_miss(&self) -> bool {
        self.number_of_returns == 0
    }

    /// Time of emission, s: of the GPS week, or adjusted standard GPS time.
    #[inline]
    pub(crate) fn seconds(&self) -> f64 {
        self.time_origin + self.time_ns / 1e9
    }

    /// True if its time lies outside of the week.
    #[inline]
    pub(crate) fn has_adjusted_time(&self) -> bool {
        let seconds = self.seconds();
        !(0.0..=WEEK_S).contains(&seconds) && seconds.is_finite()
    }

    /// Angle between beam and surface normal, degrees.
    #[inline]
    pub(crate) fn incidence_degrees(&self) -> f32 {
        let of_cosine = || degrees(libm::acos(self.incidence_cosine.clamp(-1.0, 1.0))) as f32;
        self.stored.incidence_deg.unwrap_or_else(of_cosine)
    }

    /// The amplitude as 16-bit intensity of LAS: `10000 + 1000·log10(amplitude)`, hundredths of a decibel
    /// above −100 dB. Amplitudes of different surveys differ by ten powers of ten, and none of them comes out
    /// as 0 or saturated. 0 for amplitudes that are not positive. An intensity that was
    /// [stored](StoredFields::intensity) stays as it is.
    #[inline]
    pub fn digital_intensity(&self) -> u16 {
        if let Some(stored) = self.stored.intensity {
            return stored;
        }
        // The conversion saturates, and NaN becomes 0.
        match self.amplitude > 0.0 {
            true => round_half_even(10_000.0 + DECIBEL * libm::log(self.amplitude)).max(1.0) as u16,
            false => 0,
        }
    }

    /// The stored point source id, or the number of the leg plus one, because 0 means "unknown" in LAS;
    /// saturated.
    #[inline]
    pub(crate) fn source_id(&self) -> u16 {
        self.stored.point_source.unwrap_or(self.leg.saturating_add(1))
    }

    /// Number of the return and of returns, saturated to 8 bits.
    #[inline]
    pub(crate) fn returns(&self) -> [u8; 2] {
        [self.return_number, self.number_of_returns].map(|count| u8::try_from(count).unwrap_or(u8::MAX))
    }

    /// The colour of the surface with 16 bits, as LAS files have it: 256 times the 8 bits. A colour that was
    /// [stored](StoredFields::colour) stays as it is.
    #[inline]
    pub(crate) fn colour_u16(&self) -> [u16; 3] {
        self.stored.colour.unwrap_or_else(|| self.cause.colour.map(|component| u16::from(component) << 8))
    }

    /// Sets the colour to one of 16 bits, of which formats with 8 bits write the upper ones.
    pub fn set_colour(&mut self, colour: [u16; 3]) {
        self.stored.colour = Some(colour);
        self.cause.colour = colour.map(|component| (component >> 8) as u8);
    }

    /// Index of the device, saturated to 16 bits.
    #[inline]
    pub(crate) fn device_u16(&self) -> u16 {
        u16::try_from(self.device).unwrap_or(u16::MAX)
    }
}

/// `1000·log10(a) = DECIBEL·ln(a)`.
const DECIBEL: f64 = 1000.0 * std::f64::consts::LOG10_E;

/// Equivalent of `f64::round_ties_even` for magnitudes below 2^51, without the function call on processors
/// that lack the instruction. Larger numbers keep about their magnitude.
#[inline(always)]
pub(crate) fn round_half_even(x: f64) -> f64 {
    const UNIT_IS_LAST_DIGIT: f64 = 1.5 * (1u64 << 52) as f64;
    (x + UNIT_IS_LAST_DIGIT) - UNIT_IS_LAST_DIGIT
}

/// Values of a [`PointRecord`] that only some formats and columns write, and that need not be computed for
/// others.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Needs {
    /// [`PointRecord::cause`] without colour and velocity.
    pub cause: bool,
    /// [`Cause::colour`].
    pub colour: bool,
    /// [`Cause::velocity`].
    pub velocity: bool,
    /// [`PointRecord::in_scanner`] and [`PointRecord::scanner`].
    pub in_scanner: bool,
    /// [`PointRecord::true_position`].
    pub true_position: bool,
    /// [`PointRecord::height`].
    pub height: bool,
}

impl Needs {
    /// Needs of either.
    #[must_use]
    pub fn union(self, other: Needs) -> Needs {
        Needs {
            cause: self.cause || other.cause,
            colour: self.colour || other.colour,
            velocity: self.velocity || other.velocity,
            in_scanner: self.in_scanner || other.in_scanner,
            true_position: self.true_position || other.true_position,
            height: self.height || other.height,
        }
    }
}

/// A digitised waveform.
#[derive(Clone, Copy, Debug)]
pub struct Wave<'a> {
    /// Index of the scanner's device.
    pub device: u32,
    /// Travel time of the first sample, ns.
    pub start_ns: f64,
    /// Amplitudes, one bin of the device after the other.
    pub samples: &'a [f64],
}

/// Points of one leg, in order of emission.
#[derive(Clone, Copy, Debug)]
pub struct PointBatch<'a> {
    /// The points.
    pub points: &'a [PointRecord],
    /// Waveforms that points refer to.
    pub waves: &'a [Wave<'a>],
    /// Duration of a frame, for formats that have frames, ns.
    pub frame_ns: f64,
}

impl PointBatch<'_> {
    /// Duration of the frames of instruments that do not spin, ns.
    pub const FRAME_NS: f64 = 1e8;
}

/// A waveform packet of LAS among those of a piece of a file.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Packet {
    pub descriptor: u8,
    pub offset: u64,
    pub bytes: u32,
}

/// Encoded points of one file.
#[derive(Clone, Debug)]
pub struct EncodedPoints {
    /// Records of the format.
    pub bytes: Vec<u8>,
    /// Waveform packets that the records refer to; their offsets count from the first of them.
    pub packets: Vec<u8>,
    /// Counts of the records.
    pub tally: Tally,
    /// The waveform that was encoded last, and its packet.
    pub(crate) last_packet: Option<(u32, Packet)>,
}

impl EncodedPoints {
    /// No points yet, and room for `capacity` bytes.
    pub fn with_capacity(capacity: usize) -> EncodedPoints {
        EncodedPoints {
            bytes: Vec::with_capacity(capacity),
            packets: Vec::new(),
            tally: Tally::EMPTY,
            last_packet: None,
        }
    }

    /// Encodes points one after the other and counts them. `encode` appends the record of a point and returns
    /// its coordinates as stored, or `None`, with nothing appended, when the format cannot represent them.
    #[inline]
    pub(crate) fn extend(
        &mut self,
        points: &[PointRecord],
        mut encode: impl FnMut(&mut Vec<u8>, &PointRecord) -> Option<DVec3>,
    ) {
        for point in points {
            match encode(&mut self.bytes, point) {
                Some(stored) => self.tally.count_point(stored, point),
                None => self.tally.left_out += 1,
            }
        }
    }

    /// True if points can be appended: offsets of packets count from the first packet of the piece.
    pub fn is_joinable(&self) -> bool {
        self.packets.is_empty()
    }

    /// Appends points that are [joinable](EncodedPoints::is_joinable).
    pub fn append(&mut self, next: &EncodedPoints) {
        self.bytes.extend_from_slice(&next.bytes);
        self.tally.add(&next.tally);
    }
}

/// Counts of the records in a file or in a part of it; the counts of parts add up.
#[derive(Clone, Debug, PartialEq)]
pub struct Tally {
    /// Number of records.
    pub records: u64,
    /// Points left out because the format cannot represent them: coordinates that are not finite or exceed
    /// the 32 bits of LAS.
    pub left_out: u64,
    /// Points by return number: first returns at index 0, the fifteenth and later returns at index 14.
    pub by_return: [u64; 15],
    /// Box around the coordinates as stored: metres, or integers of LAS.
    pub bounds: Aabb,
    /// Box around the origins of beams, relative to [`CloudSettings::origin`](crate::CloudSettings::origin),
    /// m; infinite if an origin is unknown.
    pub origins: Aabb,
    /// True if a time lies outside of the week, which times in adjusted standard GPS time do.
    pub has_adjusted_times: bool,
}

/// Seconds of a week.
pub(crate) const WEEK_S: f64 = 604_800.0;

impl Tally {
    /// No records.
    pub const EMPTY: Tally = Tally {
        records: 0,
        left_out: 0,
        by_return: [0; 15],
        bounds: Aabb::EMPTY,
        origins: Aabb::EMPTY,
        has_adjusted_times: false,
    };

    /// Counts a point with these coordinates as stored.
    #[inline]
    pub fn count_point(&mut self, stored: DVec3, point: &PointRecord) {
        self.records += 1;
        // A missed pulse has return number 0.
        if let Some(nth) = point.return_number.min(15).checked_sub(1) {
            self.by_return[nth as usize] += 1;
        }
        self.has_adjusted_times |= point.has_adjusted_time();
        self.bounds = self.bounds.with(stored);
        self.origins = match point.origin.is_finite() {
            true => self.origins.with(point.origin),
            false => Aabb { min: DVec3::NEG_INFINITY, max: DVec3::INFINITY },
        };
    }

    /// Adds the counts of others.
    pub fn add(&mut self, other: &Tally) {
        self.records += other.records;
        self.left_out += other.left_out;
        for (mine, theirs) in self.by_return.iter_mut().zip(&other.by_return) {
            *mine += theirs;
        }
        self.bounds = self.bounds.union(other.bounds);
        self.origins = self.origins.union(other.origins);
        self.has_adjusted_times |= other.has_adjusted_times;
    }
}

impl From<&PointRow> for PointRecord {
    /// The point as it was read, with its position in the world; a point of return 0 of 0 that is not a miss
    /// becomes the only return of its pulse.
    fn from(row: &PointRow) -> PointRecord {
        PointRecord {
            position: row.position,
            amplitude: row.intensity.into(),
            class: row.class.into(),
            return_number: row.return_number.into(),
            number_of_returns: match row.is_miss {
                true => 0,
                false => u32::from(row.return_number.max(row.number_of_returns)).max(1),
            },
            scan_angle: radians(row.scan_angle),
            object: row.object as i32,
            leg: row.leg,
            device: row.channel.into(),
            time_ns: row.time * 1e9,
            ..PointRecord::default()
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn colours_have_256_times_their_8_bits() {
        let cause = Cause { colour: [255, 146, 0], ..Cause::UNKNOWN };
        let mut point = PointRecord { cause, ..PointRecord::default() };
        assert_eq!(point.colour_u16(), [65_280, 37_376, 0]);
        // Files with 257 times the bits have the same upper eight.
        point.set_colour([65_535, 37_522, 257]);
        assert_eq!((point.colour_u16(), point.cause.colour), ([65_535, 37_522, 257], [255, 146, 1]));
    }
}
