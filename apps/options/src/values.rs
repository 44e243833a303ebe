//! Values with a syntax of their own. Each is parsed by [`FromStr`], on the command line as in a pipeline
//! file, where a number may stand for its text.

pub use super::systems::{Crs, Zone};
use serde::{Deserialize, Deserializer};
use std::str::FromStr;
use std::time::Duration;
use toml::Value;
use vlscan_base::error::Error;
use vlscan_base::quantity::{self, NumberError};
use vlscan_crs::EpsgError;
use vlscan_formats::ColumnListError;
use vlscan_lidar::flight::{TimeError, calendar_day, gps_start};
use vlscan_lidar::pulse::PhysicsOptions;
use vlscan_session::MAX_LATENCY_S;
use vlscan_session::output::Column;
use vlscan_survey::{NavigationErrors, NavigationKeyError, SeedError, parse_seed};
use vlscan_warehouse::{MAX_CHUNK_SIZE, MAX_FACTOR};

/// Reads a value from its text or from a number; `LIST`: or from a list, whose text joins the elements with
/// commas.
fn from_text<'de, const LIST: bool, D, T>(deserializer: D) -> Result<T, D::Error>
where
    D: Deserializer<'de>,
    T: FromStr,
    T::Err: std::fmt::Display,
{
    let text = |value: &Value| match value {
        Value::String(text) => text.clone(),
        other => other.to_string(),
    };
    let text = match Value::deserialize(deserializer)? {
        Value::Array(items) if LIST => items.iter().map(text).collect::<Vec<_>>().join(","),
        value => text(&value),
    };
    text.parse().map_err(serde::de::Error::custom)
}

/// Implements `Deserialize` by `FromStr`.
macro_rules! deserialize_from_text {
    ($list:literal, $($name:ty),*) => {$(
        impl<'de> Deserialize<'de> for $name {
            fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
                from_text::<$list, D, Self>(deserializer)
            }
        }
    )*};
}

deserialize_from_text!(false, Seed, Bytes, ChunkSize, Finite, NotNegative, Positive, GpsStart, Latency, Crs);
deserialize_from_text!(false, Zone, Count<1>, WarehouseFactor, MaxOrder);
deserialize_from_text!(true, Vector, ColumnList);

/// Parses a whole number that is not negative.
///
/// # Errors
/// Another text, or a number that is too large.
pub fn whole<T: FromStr>(text: &str) -> Result<T, ValueError> {
    let is_number = !text.is_empty() && text.bytes().all(|byte| byte.is_ascii_digit());
    let expected = if is_number { "a smaller whole number" } else { "a whole number, 0 or greater" };
    text.parse().map_err(|_| ValueError::Form { expected, found: text.to_owned() })
}

/// Parses a number.
///
/// # Errors
/// Another text.
pub fn number(text: &str) -> Result<f64, ValueError> {
    text.parse().map_err(|_| ValueError::Form { expected: "a number such as 0.001", found: text.to_owned() })
}

/// A text that is not a value of an option.
#[non_exhaustive]
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum ValueError {
    /// A text that is not a seed.
    #[error(transparent)]
    Seed(#[from] SeedError),
    /// A text that is not a number within its bounds.
    #[error(transparent)]
    Number(#[from] NumberError),
    /// A text of another form.
    #[error("expected {expected}, found {found:?}")]
    Form {
        /// The form with an example.
        expected: &'static str,
        /// The text.
        found: String,
    },
    /// A text that is not a list of columns.
    #[error(transparent)]
    Columns(#[from] ColumnListError),
    /// A text that is not a time.
    #[error(transparent)]
    Time(#[from] TimeError),
    /// A code without a system of points.
    #[error(transparent)]
    Epsg(#[from] EpsgError),
    /// A text that is not a coordinate reference system.
    #[error(
        "expected a coordinate reference system as EPSG:25832, as WKT such as PROJCRS[...], or a file with \
         either, found {found:?}{hint}"
    )]
    Crs {
        /// The text.
        found: String,
        /// A replacement, if one is known.
        hint: String,
    },
    /// Numbers that an error of navigation does not have.
    #[error(transparent)]
    Navigation(#[from] NavigationKeyError),
}

impl ValueError {
    fn form(expected: &'static str, found: &str) -> ValueError {
        ValueError::Form { expected, found: found.to_owned() }
    }
}

/// Seed of all random draws, see [`parse_seed`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Seed(pub u64);

impl FromStr for Seed {
    type Err = ValueError;

    fn from_str(text: &str) -> Result<Seed, ValueError> {
        Ok(Seed(parse_seed(text)?))
    }
}

/// A whole number of at least `MIN` with an optional unit prefix: 250k, 1.5M, 4G, 1T.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Count<const MIN: u64 = 0>(pub u64);

impl<const MIN: u64> FromStr for Count<MIN> {
    type Err = ValueError;

    fn from_str(text: &str) -> Result<Self, ValueError> {
        match quantity::parse_count(text) {
            Some(n) if n >= MIN => Ok(Count(n)),
            _ => Err(ValueError::form("a number such as 250000 or 250k", text)),
        }
    }
}

/// A number of bytes with an optional unit: K, M, G and T are powers of 1024.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Bytes(pub u64);

impl FromStr for Bytes {
    type Err = ValueError;

    fn from_str(text: &str) -> Result<Bytes, ValueError> {
        match quantity::parse_bytes(text) {
            Some(bytes) => Ok(Bytes(bytes)),
            None => Err(ValueError::form("a number of bytes such as 8000000000 or 8G", text)),
        }
    }
}

/// Pulses per chunk.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ChunkSize(pub u32);

impl FromStr for ChunkSize {
    type Err = ValueError;

    fn from_str(text: &str) -> Result<ChunkSize, ValueError> {
        match text.parse() {
            Ok(n @ 1..=MAX_CHUNK_SIZE) => Ok(ChunkSize(n)),
            _ => Err(NumberError { expected: "1 to 16777216 pulses", found: text.to_owned() }.into()),
        }
    }
}

/// Chunks per worker that may wait in the queue.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct WarehouseFactor(pub usize);

impl FromStr for WarehouseFactor {
    type Err = ValueError;

    fn from_str(text: &str) -> Result<WarehouseFactor, ValueError> {
        match text.parse() {
            Ok(n @ 1..=MAX_FACTOR) => Ok(WarehouseFactor(n)),
            _ => Err(NumberError { expected: "1 to 65536 chunks", found: text.to_owned() }.into()),
        }
    }
}

/// Maximum number of mirrors, panes and surfaces of water on the way of light.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct MaxOrder(pub u8);

impl FromStr for MaxOrder {
    type Err = ValueError;

    fn from_str(text: &str) -> Result<MaxOrder, ValueError> {
        match text.parse() {
            Ok(n @ 0..=PhysicsOptions::GREATEST_ORDER) => Ok(MaxOrder(n)),
            _ => Err(NumberError { expected: "0 to 64 mirrors and panes", found: text.to_owned() }.into()),
        }
    }
}

/// Defines a number within bounds.
macro_rules! number {
    ($(#[$doc:meta])* $name:ident, $bounds:expr) => {
        $(#[$doc])*
        #[derive(Clone, Copy, Debug, PartialEq)]
        pub struct $name(pub f64);

        impl FromStr for $name {
            type Err = ValueError;

            fn from_str(text: &str) -> Result<$name, ValueError> {
                Ok($name($bounds.parse(text)?))
            }
        }
    };
}

number! {
    /// A finite number.
    Finite, quantity::NUMBER
}
number! {
    /// A finite number above 0.
    Positive, quantity::POSITIVE
}
number! {
    /// A beam divergence, rad.
    Divergence, quantity::STREAMED_DIVERGENCE
}
number! {
    /// A finite number of at least 0.
    NotNegative, quantity::NOT_NEGATIVE
}

/// Three finite numbers: `0,-0.5,1.2`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Vector(pub [f64; 3]);

impl FromStr for Vector {
    type Err = ValueError;

    fn from_str(text: &str) -> Result<Vector, ValueError> {
        let numbers: Option<Vec<f64>> = text.split(',').map(|n| n.trim().parse().ok()).collect();
        match numbers.map(<[f64; 3]>::try_from) {
            Some(Ok(three)) if three.iter().all(|v| quantity::NUMBER.contains(*v)) => Ok(Vector(three)),
            _ => Err(ValueError::form("three finite numbers such as 0,-0.5,1.2", text)),
        }
    }
}

/// Names of columns, with commas between them.
#[derive(Clone, Debug, PartialEq)]
pub struct ColumnList(pub Vec<Column>);

impl FromStr for ColumnList {
    type Err = ValueError;

    fn from_str(text: &str) -> Result<ColumnList, ValueError> {
        Ok(ColumnList(Column::list(text)?))
    }
}

/// Start of the GPS clock as written; `now` and an empty text are the system's clock.
#[derive(Clone, Debug, PartialEq)]
pub struct GpsStart(String);

impl GpsStart {
    /// The start, ns of the GPS week, see [`gps_start`], and the year and the day of the year, see
    /// [`calendar_day`].
    ///
    /// # Errors
    /// A text that is not a time.
    pub fn resolve(&self, leap_seconds: bool) -> Result<(f64, (u16, u16)), Error> {
        let failed = |e| Error::input(format!("GPS start: {e}"));
        let text = match self.0.trim() {
            "" | "now" => {
                let since = std::time::SystemTime::now().duration_since(std::time::UNIX_EPOCH);
                let before = |_| Error::input("GPS start: the clock of this machine is before 1970");
                since.map_err(before)?.as_secs().to_string()
            }
            text => text.to_owned(),
        };
        Ok((gps_start(&text, leap_seconds).map_err(failed)?, calendar_day(&text).map_err(failed)?))
    }
}

impl GpsStart {
    /// True if it has a fraction of a second, which does not count.
    pub fn has_fraction(&self) -> bool {
        let fraction = self.0.split_once('.').map_or("", |(_, fraction)| fraction);
        fraction.bytes().any(|digit| digit != b'0')
    }
}

impl Default for GpsStart {
    /// A fixed time, so that equal runs give equal bytes.
    fn default() -> GpsStart {
        GpsStart("2024-01-01 00:00:00".to_owned())
    }
}

impl FromStr for GpsStart {
    type Err = ValueError;

    fn from_str(text: &str) -> Result<GpsStart, ValueError> {
        if text.trim() != "now" {
            gps_start(text, false)?;
        }
        Ok(GpsStart(text.to_owned()))
    }
}

/// How long points may wait, at most [`MAX_LATENCY_S`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Latency(pub Duration);

impl FromStr for Latency {
    type Err = ValueError;

    fn from_str(text: &str) -> Result<Latency, ValueError> {
        let seconds = text.trim().parse().ok().filter(|s| (0.0..=MAX_LATENCY_S).contains(s));
        let latency = seconds.and_then(|s| Duration::try_from_secs_f64(s).ok());
        let problem = || NumberError { expected: "seconds from 0 to 3600", found: text.to_owned() };
        Ok(Latency(latency.ok_or_else(problem)?))
    }
}

/// One error of navigation: a key of [`NavigationErrors::set`] and its numbers.
#[derive(Clone, Debug, PartialEq)]
pub struct NavigationError {
    /// The key.
    pub key: String,
    /// One number or three.
    pub numbers: Vec<f64>,
}

impl FromStr for NavigationError {
    type Err = ValueError;

    fn from_str(text: &str) -> Result<NavigationError, ValueError> {
        let numbers =
            |list: &str| list.split(',').map(|n| n.trim().parse().ok()).collect::<Option<Vec<f64>>>();
        let parts = text.split_once('=').and_then(|(key, list)| Some((key.trim(), numbers(list)?)));
        let Some((key, numbers)) = parts else {
            return Err(ValueError::form("KEY=NUMBERS such as position_m=0.02,0.02,0.05", text));
        };
        NavigationErrors::default().set(key, &numbers)?;
        Ok(NavigationError { key: key.to_owned(), numbers })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Compares texts with the values that they stand for; `None` must be refused.
    #[track_caller]
    fn check<T: FromStr + PartialEq + std::fmt::Debug>(cases: &[(&str, Option<T>)]) {
        for (text, expected) in cases {
            assert_eq!(&text.parse::<T>().ok(), expected, "{text}");
        }
    }

    #[test]
    fn values_are_parsed() {
        let count = |n| Some(Count::<0>(n));
        check(&[("250k", count(250_000)), ("1.5M", count(1_500_000)), ("12", count(12)), ("0", count(0))]);
        check::<Count>(&[("-3", None), ("k", None), ("", None), ("5 bananas", None)]);
        check::<Count<1>>(&[("0", None), ("1G", Some(Count(1_000_000_000)))]);
        let bytes = |n| Some(Bytes(n));
        check(&[
            ("4GiB", bytes(4 << 30)),
            ("2G", bytes(2 << 30)),
            ("8000", bytes(8000)),
            ("1kB", bytes(1024)),
        ]);
        check::<Bytes>(&[("5 bananas", None), ("", None), ("-1", None)]);
        check(&[("-0.5, 1,2e-1", Some(Vector([-0.5, 1.0, 0.2]))), ("nan,0,0", None), ("", None)]);
        check::<Vector>(&[("1,2", None), ("1,2,x", None), ("1,2,3,4", None), ("1,,2,3", None)]);
        check(&[("0", Some(NotNegative(0.0))), ("-1", None), ("nan", None), ("inf", None)]);
        check(&[("0.5", Some(Positive(0.5))), ("0", None)]);
        check(&[("1", Some(ChunkSize(1))), ("0", None), ("-32", None), ("16777217", None)]);
        check(&[("65536", Some(WarehouseFactor(65_536))), ("0", None), ("-4", None), ("65537", None)]);
        check(&[("0", Some(MaxOrder(0))), ("64", Some(MaxOrder(64))), ("65", None), ("300", None)]);
        check::<MaxOrder>(&[("-1", None), ("1.5", None), ("nan", None), ("", None)]);
        check(&[
            ("0.25", Some(Latency(Duration::from_millis(250)))),
            ("-1", None),
            ("3601", None),
            ("nan", None),
        ]);
        check(&[
            ("a.wkt", Some(Crs::File("a.wkt".into()))),
            ("EPSG:25832", Some(Crs::Epsg(25832))),
            ("25833", Some(Crs::Epsg(25833))),
        ]);
        check(&[(" PROJCS[\"x\"] ", Some(Crs::Wkt("PROJCS[\"x\"]".to_owned()))), ("[", None)]);
        check::<Crs>(&[
            ("EPSG:1", None),
            ("EPSG:25832+7837", None),
            ("32N", None),
            ("+proj=utm +zone=32", None),
        ]);
        let error = |key: &str, numbers: &[f64]| {
            Some(NavigationError { key: key.to_owned(), numbers: numbers.to_vec() })
        };
        check(&[("position_m=0.1, 0.2,0.3", error("position_m", &[0.1, 0.2, 0.3]))]);
        check::<NavigationError>(&[("position_m", None), ("position_m=", None), ("position_m=a", None)]);
        check::<NavigationError>(&[("position_m=1,2", None), ("position=1", None)]);
    }

    #[test]
    fn errors_tell_what_was_expected_and_found() {
        let error = "5 bananas".parse::<Bytes>().unwrap_err();
        assert!(matches!(error, ValueError::Form { .. }), "{error:?}");
        let text = "expected a number of bytes such as 8000000000 or 8G, found \"5 bananas\"";
        assert_eq!(error.to_string(), text);
        let error = "0".parse::<ChunkSize>().unwrap_err();
        assert_eq!(error.to_string(), format!("expected 1 to {MAX_CHUNK_SIZE} pulses, found 0"));
        let error = "0".parse::<WarehouseFactor>().unwrap_err();
        assert_eq!(error.to_string(), format!("expected 1 to {MAX_FACTOR} chunks, found 0"));
        let error = "65".parse::<MaxOrder>().unwrap_err();
        let greatest = PhysicsOptions::GREATEST_ORDER;
        assert_eq!(error.to_string(), format!("expected 0 to {greatest} mirrors and panes, found 65"));
        let error = "3601".parse::<Latency>().unwrap_err();
        assert_eq!(error.to_string(), format!("expected seconds from 0 to {MAX_LATENCY_S}, found 3601"));
        let error = "32N".parse::<Crs>().unwrap_err().to_string();
        assert!(error.ends_with("found \"32N\"; UTM zone 32N on WGS 84 is EPSG:32632"), "{error}");
    }

    #[test]
    fn numbers_and_lists_stand_for_their_texts() {
        #[derive(serde::Deserialize)]
        struct Table {
            seed: Seed,
            other: Seed,
            lever_arm: Vector,
            columns: ColumnList,
            memory: Bytes,
        }
        let text = "seed = 5\nother = 1.5\nlever_arm = [1, 2.5, -3]\ncolumns = ['X', 'Y']\nmemory = 8000";
        let table: Table = toml::from_str(text).unwrap();
        assert_eq!((table.seed, table.other), (Seed(5), Seed(1.5f64.to_bits())));
        assert_eq!((table.lever_arm, table.memory), (Vector([1.0, 2.5, -3.0]), Bytes(8000)));
        assert_eq!(table.columns.0.len(), 2);
        assert!(toml::from_str::<Table>(&text.replace("[1, 2.5, -3]", "[1, 2]")).is_err());
    }
}
