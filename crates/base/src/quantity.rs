//! Quantities: bounds of numbers that are read, and counts with unit prefixes, durations and lengths as text.
//!
//! Numbers within the bounds neither overflow nor lose all digits in the computation, so that points are
//! numbers.

/// Bounds of a number that is read, both included.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bounds {
    /// Smallest valid number.
    pub low: f64,
    /// Largest valid number.
    pub high: f64,
    /// The expected number, in words.
    pub expected: &'static str,
    /// Usual values of instruments and flights. Numbers beyond it are read with a warning.
    pub typical: Option<Typical>,
}

/// The range of a quantity in practice, by its amount; 0 is usual, too.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Typical {
    /// Smallest usual absolute value, in `unit`.
    pub low: f64,
    /// Largest usual absolute value, in `unit`.
    pub high: f64,
    /// Unit of the quantity, for messages; `as …` for dimensionless quantities.
    pub unit: &'static str,
    /// A unit that is often written instead, and its factor to `unit`.
    pub mistaken: Option<(&'static str, f64)>,
}

impl Bounds {
    /// Creates bounds from `low` to `high`, both included, without a usual range.
    pub const fn new(low: f64, high: f64, expected: &'static str) -> Bounds {
        Bounds { low, high, expected, typical: None }
    }

    const fn usually(self, low: f64, high: f64, unit: &'static str) -> Bounds {
        Bounds { typical: Some(Typical { low, high, unit, mistaken: None }), ..self }
    }

    const fn mistaken_for(self, unit: &'static str, factor: f64) -> Bounds {
        match self.typical {
            Some(typical) => {
                Bounds { typical: Some(Typical { mistaken: Some((unit, factor)), ..typical }), ..self }
            }
            None => self,
        }
    }

    /// True if `value` is within the bounds; NaN is not.
    #[inline]
    pub fn contains(&self, value: f64) -> bool {
        self.low <= value && value <= self.high
    }

    /// Parses a number within the bounds.
    ///
    /// # Errors
    /// A text that is not such a number.
    pub fn parse(&self, text: &str) -> Result<f64, NumberError> {
        let value = text.trim().parse::<f64>().ok().filter(|value| self.contains(*value));
        value.ok_or_else(|| NumberError { expected: self.expected, found: text.to_owned() })
    }

    /// Describes a number beyond the typical range, with a hint at its probable unit.
    pub fn doubt(&self, value: f64) -> Option<(String, String)> {
        let Typical { low, high, unit, mistaken } = self.typical?;
        if value == 0.0 || !self.contains(value) || (low..=high).contains(&value.abs()) {
            return None;
        }
        let typical = match high < f64::MAX {
            true => format!("{} to {} {unit}", number(low), number(high)),
            false => format!("{} {unit} or more", number(low)),
        };
        let message = format!("is {} {unit}; typical values are {typical}", number(value));
        let converted = mistaken.map(|(other, factor)| (other, value * factor));
        let hint = match converted.filter(|(_, v)| (low..=high).contains(&v.abs())) {
            Some((other, v)) => format!("{} {other} are {} {unit}", number(value), number(v)),
            None => format!("it is read in {unit}"),
        };
        Some((message, hint))
    }
}

/// A text that is not a number within its bounds.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("expected {expected}, found {found}")]
pub struct NumberError {
    /// The numbers that are accepted.
    pub expected: &'static str,
    /// The text.
    pub found: String,
}

/// Any finite number.
pub const ANY: Bounds = Bounds::new(f64::MIN, f64::MAX, "a number");
/// Any number whose products and sums do not overflow, of either sign.
pub const NUMBER: Bounds = Bounds::new(-1e12, 1e12, "a finite number from -1e12 to 1e12");
/// A number above 0, far from underflow and overflow.
pub const POSITIVE: Bounds = Bounds::new(1e-15, 1e15, "a number above 0, from 1e-15 to 1e15");
/// 0, or a positive number far from overflow.
pub const NOT_NEGATIVE: Bounds = Bounds::new(0.0, 1e15, "a number of at least 0, at most 1e15");
/// Time of a channel's pulse within its cycle, µs.
pub const FIRING_OFFSET_US: Bounds = Bounds::new(0.0, 1e6, "a number from 0 to 1e6 µs");
/// Full beam divergence, rad.
pub const DIVERGENCE: Bounds = Bounds::new(1e-9, 1.5, "a number above 0, from 1e-9 to 1.5 rad")
    .usually(1e-6, 0.1, "rad")
    .mistaken_for("mrad", 1e-3);
/// Full beam divergence of a pulse in a stream, rad.
pub const STREAMED_DIVERGENCE: Bounds = Bounds::new(0.0, 1.5, "a number of at least 0, at most 1.5 rad");
/// Maximum range of a scanner, m; any large number means none.
pub const MAX_RANGE: Bounds = Bounds::new(1e-15, f64::MAX, "a number above 0");
/// Atmospheric visibility, km; any large number means air without extinction.
pub const VISIBILITY: Bounds = Bounds::new(1e-15, f64::MAX, "a number above 0").usually(0.01, f64::MAX, "km");
/// A fraction above 0, for instance a reflectance.
pub const FRACTION: Bounds = Bounds::new(1e-15, 1.0, "a fraction above 0, at most 1");
/// Coordinates and differences of them, m: also of places on Earth that were written in millimetres.
pub const COORDINATE: Bounds = Bounds::new(-1e10, 1e10, "metres from -1e10 to 1e10");
/// Angles of an attitude as written, in any unit: many turns of a heading, but no other quantity.
pub const ATTITUDE: Bounds = Bounds::new(-1e6, 1e6, "an angle from -1e6 to 1e6");
/// Times in any scale, s and ns.
pub const TIME: Bounds = Bounds::new(-1e11, 1e11, "seconds from -1e11 to 1e11");
/// Times in any scale, ns; messages state the bounds in seconds.
pub const TIME_NS: Bounds = Bounds::new(-1e20, 1e20, "seconds from -1e11 to 1e11");
/// Maximum duration of a leg or a trajectory, s: 31 days.
pub const MAX_DURATION: f64 = 31.0 * 86_400.0;

/// Mechanical and usable half angles of a mirror, degrees.
pub const HALF_ANGLE: Bounds = NUMBER.usually(0.01, 360.0, "degrees");
/// Largest half angles of a deflector, degrees; a negative limit would mirror the pattern.
pub const HALF_ANGLE_LIMIT: Bounds = NOT_NEGATIVE.usually(0.01, 360.0, "degrees");
/// Angles about an axis: of a head, of a mount, of a deflection, degrees.
pub const ANGLE: Bounds = NUMBER.usually(1e-6, 1e5, "degrees");
/// Turning rates of a head, degrees per second.
pub const HEAD_RATE: Bounds = NUMBER.usually(1e-4, 1e5, "°/s");
/// Lines or periods of a mirror per second.
pub const SCAN_FREQ: Bounds =
    NOT_NEGATIVE.usually(1e-3, 20_000.0, "Hz").mistaken_for("per minute", 1.0 / 60.0);
/// Turns of a prism per second.
pub const ROTOR_FREQ: Bounds = NUMBER.usually(1e-3, 1000.0, "Hz").mistaken_for("per minute", 1.0 / 60.0);
/// Angle of a wedge prism, degrees.
pub const WEDGE: Bounds = NUMBER.usually(0.01, 60.0, "degrees");
/// Refractive index of a prism or of air.
pub const REFRACTIVE_INDEX: Bounds = POSITIVE.usually(1.0, 5.0, "as a refractive index");
/// Length of a pulse, ns.
pub const PULSE_LENGTH_NS: Bounds = POSITIVE.usually(0.01, 1000.0, "ns").mistaken_for("s", 1e9);
/// Energy of a pulse, µJ.
pub const PULSE_ENERGY_UJ: Bounds = POSITIVE.usually(1e-6, 1e6, "µJ").mistaken_for("J", 1e6);
/// Average optical power of a laser, W.
pub const AVERAGE_POWER_W: Bounds = POSITIVE.usually(1e-6, 500.0, "W").mistaken_for("mW", 1e-3);
/// Optical efficiency of a receiver.
pub const EFFICIENCY: Bounds = POSITIVE.usually(1e-4, 1.0, "as a fraction").mistaken_for("per cent", 0.01);
/// Beam quality factor M², 1 for an ideal Gaussian beam.
pub const BEAM_QUALITY: Bounds = POSITIVE.usually(1.0, 1000.0, "as M²");
/// Diameters of apertures and receivers, m.
pub const APERTURE: Bounds = NOT_NEGATIVE.usually(1e-4, 2.0, "m").mistaken_for("mm", 1e-3);
/// Diameter of a receiver's aperture, m; must be above 0.
pub const RECEIVER_DIAMETER: Bounds = POSITIVE.usually(1e-4, 2.0, "m").mistaken_for("mm", 1e-3);
/// Standard deviation of a measured range, m.
pub const ACCURACY: Bounds = NOT_NEGATIVE.usually(1e-6, 1.0, "m").mistaken_for("mm", 1e-3);
/// Photoelectrons of an echo right at the threshold of a receiver.
pub const THRESHOLD_PHOTONS: Bounds = Bounds::new(1.0, 1e6, "a whole number from 1 to 1000000");
/// Standard deviation of a receiver's noise, W.
pub const NOISE_POWER_W: Bounds = POSITIVE.usually(1e-15, 1e-3, "W").mistaken_for("nW", 1e-9);
/// Photocurrent per optical power, A/W; avalanche photodiodes have up to about 100.
pub const RESPONSIVITY: Bounds = POSITIVE.usually(1e-3, 200.0, "A/W").mistaken_for("mA/W", 1e-3);
/// Electrical bandwidth of a receiver, Hz.
pub const BANDWIDTH: Bounds = POSITIVE.usually(1e5, 1e11, "Hz").mistaken_for("MHz", 1e6);
/// Range that an echo at the threshold is measured too far, m.
pub const RANGE_WALK: Bounds = NUMBER.usually(1e-6, 5.0, "m").mistaken_for("mm", 1e-3);
/// Share of echoes that a receiver loses.
pub const DROPOUT_RATE: Bounds = Bounds::new(0.0, 0.999, "a share of at least 0, at most 0.999");
/// Share of a mirror's sweep in which it reverses.
pub const TURNING_PART: Bounds = Bounds::new(0.0, 1.0, "a share from 0 to 1");
/// Dead time of a receiver, ns.
pub const DEAD_TIME_NS: Bounds = NOT_NEGATIVE.usually(1e-3, 1e5, "ns").mistaken_for("s", 1e9);
/// Nearest range of a scanner, m.
pub const MIN_RANGE: Bounds = NOT_NEGATIVE.usually(1e-4, 2000.0, "m").mistaken_for("mm", 1e-3);
/// Speed of a platform, m/s; negative ones turn it round.
pub const SPEED: Bounds = NUMBER.usually(1e-3, 340.0, "m/s").mistaken_for("km/h", 1.0 / 3.6);
/// Width of a bin of a waveform and of the window around a peak, ns.
pub const BIN_NS: Bounds = POSITIVE.usually(1e-3, 1000.0, "ns").mistaken_for("ps", 1e-3);
/// Interval of the samples of a trajectory, s.
pub const SAMPLE_INTERVAL: Bounds = NOT_NEGATIVE.usually(1e-6, 3600.0, "s").mistaken_for("ms", 1e-3);
/// Warm-up of the optics, s.
pub const WARMUP: Bounds = NOT_NEGATIVE.usually(1e-6, 3600.0, "s").mistaken_for("ms", 1e-3);
/// Factor on the size of a part.
pub const SCALE: Bounds = POSITIVE.usually(1e-6, 1e6, "as a factor");
/// Distance of the scanner to what measured a trajectory, m, along an axis.
pub const LEVER_ARM: Bounds = NUMBER.usually(1e-4, 20.0, "m").mistaken_for("mm", 1e-3);
/// Misalignment of a scanner to what measured a trajectory, degrees.
pub const BORESIGHT: Bounds = NUMBER.usually(1e-6, 180.0, "degrees");
/// Difference of two heights above different surfaces, m: geoids are within 110 m of the ellipsoid.
pub const HEIGHT_OFFSET: Bounds = NUMBER.usually(1e-4, 10_000.0, "m").mistaken_for("mm", 1e-3);
/// Classes of points: LAS has a byte for them.
pub const CLASSES: std::ops::RangeInclusive<i32> = 0..=255;
/// Wavelengths of lasers, nm: whole numbers.
pub const WAVELENGTH_NM: Bounds =
    Bounds::new(1.0, 1e6, "a whole number from 1 to 1000000").usually(200.0, 20_000.0, "nm");
/// Counts, of which 0 often means no limit.
pub const COUNT: Bounds = Bounds::new(0.0, u32::MAX as f64, "a whole number of at least 0");
/// Counts of things of which there is at least one.
pub const COUNT_ABOVE_0: Bounds = Bounds::new(1.0, u32::MAX as f64, "a whole number above 0");
/// Pulses per second.
pub const PULSE_FREQ: Bounds = Bounds::new(1.0, i32::MAX as f64, "a whole number above 0");
/// Rings of subrays of a pulse; a pulse of the largest number has about 3 million subrays.
pub const QUALITY: Bounds = Bounds::new(1.0, 512.0, "a whole number from 1 to 512");
/// Standard deviation of noise of any quantity.
pub const DEVIATION: Bounds = Bounds::new(0.0, 1e12, "a number of at least 0, at most 1e12");
/// Reflectance of a material.
pub const REFLECTANCE: Bounds = Bounds::new(0.0, 1.0, "a reflectance from 0 to 1");
/// Roughness of a surface, degrees.
pub const ROUGHNESS: Bounds = Bounds::new(0.0, 90.0, "a roughness of 0 to 90 degrees");
/// Size of the elements of foliage, m.
pub const ELEMENT_SIZE: Bounds = Bounds::new(0.0, 100.0, "a size of 0 to 100 m");
/// Share of the light that a mirror reflects.
pub const MIRROR: Bounds = Bounds::new(0.0, 1.0, "a share from 0 to 1");
/// Refractive index of a pane.
pub const PANE_INDEX: Bounds = Bounds::new(1.0, 5.0, "a refractive index from 1 to 5");
/// Thickness of a sheet of a pane, m.
pub const PANE_THICKNESS: Bounds = Bounds::new(0.0, 1.0, "a thickness of 0 to 1 m");
/// Absorption within a pane, 1/m.
pub const PANE_ABSORPTION: Bounds = Bounds::new(0.0, 1e6, "an absorption of 0 to 1e6 per metre");
/// Number of sheets of a pane.
pub const PANE_SHEETS: Bounds = Bounds::new(1.0, 2.0, "1 or 2 sheets");
/// Attenuation of light in water, 1/m.
pub const WATER_ATTENUATION: Bounds = Bounds::new(0.0, 1e4, "an attenuation of 0 to 1e4 per metre");
/// Depth at which a white disk disappears, m.
pub const SECCHI_DEPTH: Bounds = Bounds::new(0.01, 100.0, "a Secchi depth of 0.01 to 100 m");
/// Light that water scatters straight back, 1/(m·sr).
pub const WATER_BACKSCATTER: Bounds = Bounds::new(0.0, 10.0, "a backscatter of 0 to 10 per metre and sr");
/// Wind speed, m/s.
pub const WIND_SPEED: Bounds = Bounds::new(0.0, 50.0, "a wind speed of 0 to 50 m/s");
/// Direction of the wind, degrees.
pub const WIND_DIRECTION: Bounds = Bounds::new(-360.0, 360.0, "a direction of -360 to 360 degrees");
/// Duration of a chirp, s.
pub const CHIRP_S: Bounds =
    Bounds::new(1e-9, 10.0, "seconds from 1e-9 to 10").usually(1e-7, 0.1, "s").mistaken_for("µs", 1e-6);
/// Probability of a false alarm.
pub const FALSE_ALARM: Bounds = Bounds::new(1e-15, 0.5, "a probability of 1e-15 to 0.5");
/// Number of pixels of a receiver.
pub const PIXELS: Bounds = Bounds::new(1.0, 4096.0, "a whole number from 1 to 4096");
/// Dark counts of a pixel, 1/s.
pub const DARK_COUNTS: Bounds = Bounds::new(0.0, 1e12, "a rate of 0 to 1e12 per second");
/// Probability of an afterpulse.
pub const AFTERPULSE: Bounds = Bounds::new(0.0, 0.9, "a probability of 0 to 0.9");
/// Meteorological optical range of fog, m.
pub const OPTICAL_RANGE: Bounds =
    Bounds::new(0.1, 1e9, "metres from 0.1 to 1e9").usually(5.0, 1e6, "m").mistaken_for("km", 1e3);
/// Rainfall, mm/h.
pub const RAIN_RATE: Bounds = Bounds::new(0.0, 1000.0, "a rate of 0 to 1000 mm/h");
/// Snowfall, mm/h of melted water.
pub const SNOW_RATE: Bounds = Bounds::new(0.0, 200.0, "a rate of 0 to 200 mm/h of melted water");
/// Extinction by dust, 1/m.
pub const DUST: Bounds = Bounds::new(0.0, 100.0, "an extinction of 0 to 100 per metre");
/// Extinction over light that is scattered straight back, sr.
pub const LIDAR_RATIO: Bounds =
    Bounds::new(0.1, 1e6, "a lidar ratio of 0.1 to 1e6 sr").usually(1.0, 1e3, "sr");
/// Factor on the light that drops return.
pub const DROP_FACTOR: Bounds = Bounds::new(0.0, 1000.0, "a factor of 0 to 1000");
/// Height of the surface of water, m.
pub const WATER_LEVEL: Bounds = Bounds::new(-1e5, 1e5, "a height of -1e5 to 1e5 m");
/// Field of view of a receiver, full angle, rad.
pub const FIELD_OF_VIEW: Bounds = Bounds::new(0.0, 3.2, "an angle of 0 to 3.2 rad");
/// Coefficient R_A of a retro-reflector, cd/(lx·m²).
pub const RETRO: Bounds = Bounds::new(0.0, 1e5, "a coefficient of 0 to 1e5 cd/(lx·m²)");

/// Formats a number for a message: six digits, or as many as three decimals need, without zeros at its end.
/// Digits that arithmetic has left over do not appear.
pub fn number(value: f64) -> String {
    let size = value.abs();
    if value == 0.0 || !value.is_finite() {
        return format!("{}", value + 0.0);
    }
    if !(1e-5..1e15).contains(&size) {
        let text = format!("{value:.5e}");
        let (digits, exponent) = text.split_once('e').unwrap_or((&text, "0"));
        return format!("{}e{exponent}", without_zeros(digits));
    }
    let before_point = size.log10().floor() as i32 + 1;
    let decimals = (6 - before_point).clamp(3, 11) as usize;
    without_zeros(&format!("{value:.decimals$}")).to_owned()
}

/// Formats a number with a number of decimals for a report. A number that rounds to zero has no sign.
pub fn fixed(value: f64, decimals: usize) -> String {
    without_sign_of_zero(format!("{value:.decimals$}"))
}

/// [`fixed`] with the sign of positive numbers, for differences.
pub fn signed(value: f64, decimals: usize) -> String {
    without_sign_of_zero(format!("{value:+.decimals$}"))
}

fn without_sign_of_zero(text: String) -> String {
    match text.strip_prefix(['+', '-']) {
        Some(digits) if digits.bytes().all(|b| matches!(b, b'0' | b'.')) => digits.to_owned(),
        _ => text,
    }
}

fn without_zeros(digits: &str) -> &str {
    if digits.contains('.') { digits.trim_end_matches('0').trim_end_matches('.') } else { digits }
}

/// Parses a whole number with an optional unit prefix: 250k, 1.5M, 4G, 1T.
pub fn parse_count(text: &str) -> Option<u64> {
    let (digits, unit) = split_unit(text);
    let n = scaled(digits, unit, 1000.0)?;
    // 0.3k is 300 but for its last digit.
    ((0.0..1e18).contains(&n) && (n - n.round()).abs() <= 1e-9 * n.abs()).then(|| n.round() as u64)
}

/// A number of bytes with an optional unit: K, M, G and T are powers of 1024, and B or iB may follow.
pub fn parse_bytes(text: &str) -> Option<u64> {
    let (digits, unit) = split_unit(text);
    let unit = unit.to_ascii_uppercase();
    let prefix = unit.strip_suffix("IB").or(unit.strip_suffix('B')).unwrap_or(&unit);
    scaled(digits, prefix, 1024.0).filter(|bytes| (0.0..1e19).contains(bytes)).map(|bytes| bytes as u64)
}

/// The number in `digits` times the power of `base` that a unit prefix stands for.
pub fn scaled(digits: &str, prefix: &str, base: f64) -> Option<f64> {
    let exponent = match prefix {
        "" => 0,
        "k" | "K" => 1,
        "m" | "M" => 2,
        "g" | "G" => 3,
        "t" | "T" => 4,
        _ => return None,
    };
    Some(digits.parse::<f64>().ok()? * base.powi(exponent))
}

/// The number at the start of a text, and its unit.
pub fn split_unit(text: &str) -> (&str, &str) {
    let text = text.trim();
    let digits = text.bytes().take_while(|b| b.is_ascii_digit() || *b == b'.').count();
    (&text[..digits], text[digits..].trim())
}

/// Formats a number with a unit prefix and three digits: 1.23 M.
pub fn amount(n: f64) -> String {
    for (limit, unit) in [(1e12, " T"), (1e9, " G"), (1e6, " M"), (1e3, " k")] {
        if n >= limit {
            return format!("{:.2}{unit}", n / limit);
        }
    }
    fixed(n, 0)
}

/// Formats a count with its noun: 1 point, 2000 points.
pub fn counted<T: std::fmt::Display + PartialEq + From<u8>>(count: T, noun: &str) -> String {
    let ending = if count == T::from(1) { "" } else { "s" };
    format!("{count} {noun}{ending}")
}

/// Formats a count as [`amount`] does, with its noun: 1 point, 2.00 k points.
pub fn amount_of(count: f64, noun: &str) -> String {
    let ending = if count == 1.0 { "" } else { "s" };
    format!("{} {noun}{ending}", amount(count))
}

/// Formats a number of bytes with a unit prefix and three digits: 1.23 MB.
pub fn bytes(n: u64) -> String {
    let separator = if n < 1000 { " " } else { "" };
    format!("{}{separator}B", amount(n as f64))
}

/// Formats a duration as h:mm:ss, or as seconds below a minute, with two decimals below ten.
pub fn duration(seconds: f64) -> String {
    if !seconds.is_finite() || seconds > 1e7 {
        return "?".to_owned();
    }
    if seconds < 0.1 {
        return format!("{:.1} ms", seconds * 1e3);
    }
    if seconds < 9.995 {
        return format!("{seconds:.2} s");
    }
    let s = seconds.round() as u64;
    if s < 60 { format!("{s} s") } else { format!("{}:{:02}:{:02}", s / 3600, s / 60 % 60, s % 60) }
}

/// Formats a length (m) in m or km with up to three digits.
pub fn metres(length: f64) -> String {
    match length.abs() {
        m if m >= 10_000.0 => fixed(length / 1000.0, 0) + " km",
        m if m >= 1000.0 => fixed(length / 1000.0, 1) + " km",
        m if m >= 10.0 => fixed(length, 0) + " m",
        _ => fixed(length, 1) + " m",
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nouns_follow_their_counts() {
        assert_eq!([0u64, 1, 2000].map(|n| counted(n, "point")), ["0 points", "1 point", "2000 points"]);
        assert_eq!(counted(1usize, "pulse"), "1 pulse");
        assert_eq!([1.0, 2000.0].map(|n| amount_of(n, "point")), ["1 point", "2.00 k points"]);
    }

    #[test]
    fn numbers_in_messages_have_no_left_over_digits() {
        for (value, text) in [
            (329.540_219_808_979_7, "329.54"),
            (6.100_000_000_034_925, "6.1"),
            (125.000_000_000_000_01, "125"),
            (345_600.123_456, "345600.123"),
            (-0.000_123_456_789, "-0.000123457"),
            (0.0, "0"),
            (-0.0, "0"),
            (1e-9, "1e-9"),
            (2.5e20, "2.5e20"),
            (100.0, "100"),
            (999_999.999_9, "1000000"),
            (f64::NAN, "NaN"),
            (f64::INFINITY, "inf"),
        ] {
            assert_eq!(number(value), text);
        }
    }

    #[test]
    fn zeros_have_no_sign() {
        for (value, decimals, text, with_sign) in [
            (-0.0, 1, "0.0", "0.0"),
            (-0.04, 1, "0.0", "0.0"),
            (0.04, 1, "0.0", "0.0"),
            (-0.4, 0, "0", "0"),
            (-0.06, 1, "-0.1", "-0.1"),
            (12.345, 2, "12.35", "+12.35"),
            (-10.0, 0, "-10", "-10"),
            (f64::NEG_INFINITY, 1, "-inf", "-inf"),
            (f64::NAN, 1, "NaN", "NaN"),
        ] {
            assert_eq!((&*fixed(value, decimals), &*signed(value, decimals)), (text, with_sign));
        }
        assert_eq!((&*metres(-0.01), &*number(-0.0)), ("0.0 m", "0"));
    }

    #[test]
    fn unusual_numbers_are_doubted_with_the_unit_that_they_may_be_in() {
        let (message, hint) = ROTOR_FREQ.doubt(-7294.0).unwrap();
        assert_eq!(message, "is -7294 Hz; typical values are 0.001 to 1000 Hz");
        let (message, _) = VISIBILITY.doubt(0.001).unwrap();
        assert_eq!(message, "is 0.001 km; typical values are 0.01 km or more");
        assert_eq!(hint, "-7294 per minute are -121.567 Hz");
        assert_eq!(DIVERGENCE.doubt(0.3).unwrap().1, "0.3 mrad are 0.0003 rad");
        assert_eq!(PULSE_LENGTH_NS.doubt(4e-9).unwrap().1, "4e-9 s are 4 ns");
        assert_eq!(AVERAGE_POWER_W.doubt(1e12).unwrap().1, "it is read in W");
        for typical in
            [DIVERGENCE.doubt(0.0003), ROTOR_FREQ.doubt(0.0), NUMBER.doubt(1e11), DIVERGENCE.doubt(9.0)]
        {
            assert_eq!(typical, None);
        }
    }

    #[test]
    fn quantities_are_short() {
        assert_eq!(amount(950.0), "950");
        assert_eq!([bytes(656), bytes(5_600_000_000)], ["656 B", "5.60 GB"]);
        assert_eq!(amount(1_234_567.0), "1.23 M");
        assert_eq!(
            [0.002_34, 0.1234, 9.994, 9.996, 42.4].map(duration),
            ["2.3 ms", "0.12 s", "9.99 s", "10 s", "42 s"]
        );
        assert_eq!(duration(3725.0), "1:02:05");
        assert_eq!([9.94, 123.4, 1234.0, 12_345.0].map(metres), ["9.9 m", "123 m", "1.2 km", "12 km"]);
    }
}
