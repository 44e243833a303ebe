//! GPS time (spec kinematics §1.2).

use chrono::{DateTime, Datelike, NaiveDateTime, Utc};

pub(super) const WEEK_NS: f64 = 604_800e9;
const WEEK_S: i64 = 604_800;
/// POSIX seconds of the origin of GPS time that the reference uses, 9 s after the true one.
const REFERENCE_GPS_ORIGIN: i64 = 315_964_809;

/// POSIX seconds of 1980-01-06 00:00:00 UTC, when GPS time began.
const GPS_ORIGIN: i64 = 315_964_800;
/// POSIX seconds of the first second after each leap second since the origin of GPS time (IERS Bulletin C).
/// GPS time is ahead of UTC by the number of leap seconds so far. None has been announced since the last one,
/// and UTC will have none after 2035 at the latest (CGPM 2022, resolution 4).
const LEAP_SECONDS: [i64; 18] = [
    362_793_600,   // 1981-07-01
    394_329_600,   // 1982-07-01
    425_865_600,   // 1983-07-01
    489_024_000,   // 1985-07-01
    567_993_600,   // 1988-01-01
    631_152_000,   // 1990-01-01
    662_688_000,   // 1991-01-01
    709_948_800,   // 1992-07-01
    741_484_800,   // 1993-07-01
    773_020_800,   // 1994-07-01
    820_454_400,   // 1996-01-01
    867_715_200,   // 1997-07-01
    915_148_800,   // 1999-01-01
    1_136_073_600, // 2006-01-01
    1_230_768_000, // 2009-01-01
    1_341_100_800, // 2012-07-01
    1_435_708_800, // 2015-07-01
    1_483_228_800, // 2017-01-01
];

/// Year and day of the year (from 1) at which runs start by default: fixed, so that equal runs give equal
/// bytes.
pub const DEFAULT_DAY: (u16, u16) = (2024, 1);

/// GPS time of week at the start of [`DEFAULT_DAY`], ns, as [`gps_start`] counts it.
pub const fn default_gps_start(leap_seconds: bool) -> f64 {
    if leap_seconds { 86_418e9 } else { 86_391e9 }
}

/// A text that is not a time.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum TimeError {
    /// It has a colon, and is not a calendar time.
    #[error("expected a time like 2024-01-31 12:00:00, found `{0}`")]
    Calendar(String),
    /// It is neither a number nor a calendar time.
    #[error("expected POSIX seconds or a time like 2024-01-31 12:00:00, found `{0}`")]
    Posix(String),
}

/// GPS time of week, ns, at which a run starts: now if `text` is empty, otherwise a UTC time
/// `YYYY-MM-DD hh:mm:ss` or POSIX seconds, whose fraction is ignored (spec outputs §2.4). With `leap_seconds`
/// it counts from the true origin and includes the leap seconds of UTC, which POSIX time does not count
/// (IS-GPS-200, §20.3.3.5.2.4); without, it counts from the origin of the reference and has none.
///
/// # Errors
/// A text that is not a time.
pub fn gps_start(text: &str, leap_seconds: bool) -> Result<f64, TimeError> {
    let posix = posix_seconds(text)?;
    let since_origin = if leap_seconds {
        // A leap second has the POSIX time of the second after it, but precedes it.
        let counted = posix - i64::from(text.trim().ends_with(":60"));
        let leaps = LEAP_SECONDS.partition_point(|&from| from <= counted) as i64;
        posix.saturating_sub(GPS_ORIGIN).saturating_add(leaps)
    } else {
        posix.saturating_sub(REFERENCE_GPS_ORIGIN)
    };
    Ok(since_origin.rem_euclid(WEEK_S) as f64 * 1e9)
}

/// Year and day of the year (from 1), in UTC, of a time as [`gps_start`] parses it: the creation date of
/// files, which must not depend on when a run is repeated. (0, 0) before 1970 and after 9999.
///
/// # Errors
/// As [`gps_start`].
pub fn calendar_day(text: &str) -> Result<(u16, u16), TimeError> {
    let date = DateTime::from_timestamp(posix_seconds(text)?, 0);
    Ok(match date {
        Some(date) if (1970..=9999).contains(&date.year()) => (date.year() as u16, date.ordinal() as u16),
        _ => (0, 0),
    })
}

fn posix_seconds(text: &str) -> Result<i64, TimeError> {
    let text = text.trim();
    if text.is_empty() {
        return Ok(Utc::now().timestamp());
    }
    if text.contains(':') {
        return utc_seconds(text).ok_or_else(|| TimeError::Calendar(text.to_owned()));
    }
    let whole = text.split_once('.').map_or(text, |(whole, fraction)| {
        if fraction.bytes().all(|b| b.is_ascii_digit()) { whole } else { text }
    });
    whole.parse().map_err(|_| TimeError::Posix(text.to_owned()))
}

/// POSIX seconds of `YYYY-MM-DD hh:mm:ss` in UTC; a leap second, 23:59:60, has the number of the second after
/// it.
fn utc_seconds(text: &str) -> Option<i64> {
    // The parser also takes numbers without leading zeros, and counts second 60 as a part of second 59.
    if text.len() != 19 {
        return None;
    }
    let format = if text.contains('T') { "%Y-%m-%dT%H:%M:%S" } else { "%Y-%m-%d %H:%M:%S" };
    let time = NaiveDateTime::parse_from_str(text, format).ok()?;
    Some(time.and_utc().timestamp() + i64::from(text.ends_with(":60")))
}

/// `now − then` in ns, both times of week, at most one week apart.
#[inline]
pub(super) fn elapsed_ns(now: f64, then: f64) -> f64 {
    let elapsed = now - then;
    if elapsed < 0.0 { elapsed + WEEK_NS } else { elapsed }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn days_count_from_the_first_of_january() {
        assert_eq!(calendar_day("2024-01-01 00:00:00"), Ok((2024, 1)));
        assert_eq!(calendar_day("2024-12-31 23:59:59"), Ok((2024, 366)));
        assert_eq!(calendar_day("0"), Ok((1970, 1)));
        assert_eq!(calendar_day("951782400"), Ok((2000, 60)));
        assert!(calendar_day("noon").is_err());
    }

    #[test]
    fn the_default_start_is_the_first_of_january_2024() {
        let start = "2024-01-01 00:00:00";
        assert_eq!(calendar_day(start), Ok(DEFAULT_DAY));
        for leap_seconds in [false, true] {
            assert_eq!(gps_start(start, leap_seconds), Ok(default_gps_start(leap_seconds)));
        }
    }

    #[test]
    fn corrected_start_times_count_leap_seconds() {
        // 2024-01-01 was a Monday, and 18 leap seconds had passed since 1980.
        assert_eq!(gps_start("2024-01-01 00:00:00", true), Ok(86_418e9));
        assert_eq!(gps_start("1704067200", true), Ok(86_418e9));
        // The origin, a Sunday, and the second before it.
        assert_eq!(gps_start("1980-01-06 00:00:00", true), Ok(0.0));
        assert_eq!(gps_start("1980-01-05 23:59:59", true), Ok(604_799e9));
        // Across the leap second at the end of 2016, a Saturday, GPS time advances by one second each.
        for (text, second) in [
            ("2016-12-31 23:59:59", 16.0),
            ("2016-12-31 23:59:60", 17.0),
            ("2017-01-01 00:00:00", 18.0),
            ("2017-01-01 00:00:01", 19.0),
        ] {
            assert_eq!(gps_start(text, true), Ok(second * 1e9), "{text}");
        }
        // Each entry of the table is a midnight at the beginning of January or July.
        for from in LEAP_SECONDS {
            let (_, day) = calendar_day(&from.to_string()).unwrap();
            assert!(from % 86_400 == 0 && [1, 182, 183].contains(&day), "{from} is day {day}");
        }
    }

    #[test]
    fn start_times() {
        // spec kinematics §1.8 example 3
        assert_eq!(gps_start("2024-01-01 00:00:00", false), Ok(86_391e9));
        assert_eq!(gps_start("1704067200", false), Ok(86_391e9));
        assert_eq!(gps_start("1704067200.75", false), Ok(86_391e9));
        assert_eq!(gps_start("2000000000", false), Ok(271_991e9));
        assert_eq!(gps_start("2022-01-01 00:00:00", false), Ok(518_391e9));
        assert_eq!(gps_start("2024-02-29T12:00:00", false), gps_start("1709208000", false));
        assert!((0.0..WEEK_NS).contains(&gps_start("0", false).unwrap()));
        assert!((0.0..WEEK_NS).contains(&gps_start("", false).unwrap()));
    }

    #[test]
    fn malformed_start_times_say_what_was_expected() {
        for text in [
            "12:00",
            "2023-02-29 00:00:00",
            "2024-13-01 00:00:00",
            "2024-01-01 24:00:00",
            "soon",
            "1.x",
            "1e9",
        ] {
            assert!(gps_start(text, false).unwrap_err().to_string().contains(text), "{text}");
        }
        assert!(gps_start("é:00000000000000000", false).is_err());
    }

    #[test]
    fn intervals_span_the_end_of_the_week() {
        assert_eq!(elapsed_ns(5.0, 3.0), 2.0);
        assert_eq!(elapsed_ns(1e9, WEEK_NS - 1e9), 2e9);
    }
}
