//! Points as tables: the columns, their values, and the formats that consist of columns. Names and types
//! follow LAS where LAS has the dimension, otherwise PDAL or plain English.
//!
//! | file | contents |
//! |---|---|
//! | `rows` | columns in groups of rows, as Arrow record batches |
//! | `stored` | names of the columns in files of other formats |
//! | `arrow`, `parquet` | Arrow IPC streams and Parquet files |
//! | `light` | labels of the way of light, which other formats have, too |
//! | `geoparquet`, `projjson` | GeoParquet, and coordinate reference systems as it names them |

mod arrow;
#[cfg(feature = "parquet")]
mod geoparquet;
mod light;
#[cfg(feature = "parquet")]
mod parquet;
#[cfg(feature = "parquet")]
mod projjson;
mod rows;
mod stored;

pub(crate) use arrow::arrow;
pub use arrow::{TableColumn, point_schema, schema_of};
pub(crate) use light::LightColumns;
pub use rows::Rows;
#[cfg(feature = "parquet")]
pub(crate) use {
    geoparquet::geoparquet,
    parquet::{ARROW_SCHEMA, parquet},
};

use crate::number::{push_fixed, push_integer};
use crate::record::{EncodedPoints, Needs, PointRecord};
use crate::settings::CloudSettings;
use ::arrow_schema::DataType;
use serde::{Deserialize, Serialize};
use vlscan_base::diag::nearest;
use vlscan_geom::{DVec3, degrees};

/// Storage type of a column.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[allow(missing_docs)]
pub enum ColumnType {
    U8,
    U16,
    U32,
    U64,
    I32,
    F32,
    F64,
}

impl ColumnType {
    /// Bytes per value.
    pub fn width(self) -> usize {
        match self {
            ColumnType::U8 => 1,
            ColumnType::U16 => 2,
            ColumnType::U32 | ColumnType::I32 | ColumnType::F32 => 4,
            ColumnType::U64 | ColumnType::F64 => 8,
        }
    }

    /// The Arrow type.
    pub fn data_type(self) -> DataType {
        match self {
            ColumnType::U8 => DataType::UInt8,
            ColumnType::U16 => DataType::UInt16,
            ColumnType::U32 => DataType::UInt32,
            ColumnType::U64 => DataType::UInt64,
            ColumnType::I32 => DataType::Int32,
            ColumnType::F32 => DataType::Float32,
            ColumnType::F64 => DataType::Float64,
        }
    }
}

/// A value of a column.
trait Value: Copy {
    const KIND: ColumnType;

    fn push_bytes(self, out: &mut Vec<u8>);

    fn push_text<const DECIMALS: u32>(self, out: &mut Vec<u8>);
}

macro_rules! values {
    ($($of:ident $kind:ident $text:expr;)*) => {
        $(impl Value for $of {
            const KIND: ColumnType = ColumnType::$kind;

            #[inline]
            fn push_bytes(self, out: &mut Vec<u8>) {
                out.extend_from_slice(&self.to_le_bytes());
            }

            fn push_text<const DECIMALS: u32>(self, out: &mut Vec<u8>) {
                let push: fn(&mut Vec<u8>, $of) = $text;
                push(out, self);
            }
        })*
    };
}

values! {
    u8 U8 push_integer;
    u16 U16 push_integer;
    u32 U32 push_integer;
    u64 U64 push_integer;
    i32 I32 push_integer;
    f32 F32 |out, value| push_fixed::<DECIMALS>(out, f64::from(value));
    f64 F64 push_fixed::<DECIMALS>;
}

/// Type, decimals in text, unit, value of a point `p` (with the origin of points in the world) and meaning of
/// every column.
macro_rules! columns {
    ($($name:ident $of:ident $decimals:literal $unit:literal $value:expr, $meaning:literal;)*) => {
        /// A column of points, named like the variant. It is stored by its name.
        #[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
        #[serde(into = "String", try_from = "String")]
        pub enum Column {
            $(#[doc = $meaning] $name,)*
        }

        impl Column {
            /// All columns, and behind them [`Column::EXACT`].
            const EVERY: &[Column] = &[$(Column::$name),*];

            /// All columns in the order in which they are written.
            pub const ALL: &[Column] = Column::EVERY.split_at(Column::ExactScanAngle as usize).0;

            /// Values of a point that its columns lack. Tables in memory have them in addition to their
            /// columns, so that files can be made of them; files do not have them.
            pub const EXACT: &[Column] = Column::EVERY.split_at(Column::ExactScanAngle as usize).1;

            /// Columns of [`Column::EXACT`] that only frames of a scanner (MCAP) need.
            pub const OF_FRAMES: &[Column] = Column::EVERY.split_at(Column::ExactTime as usize).1;

            /// Name of the column.
            pub fn name(self) -> &'static str {
                match self { $(Column::$name => stringify!($name),)* }
            }

            /// Unit of the values; empty for plain numbers.
            pub fn unit(self) -> &'static str {
                match self { $(Column::$name => $unit,)* }
            }

            /// Description of the values.
            pub fn meaning(self) -> &'static str {
                match self { $(Column::$name => $meaning,)* }
            }

            /// Storage type of the values.
            pub fn kind(self) -> ColumnType {
                match self { $(Column::$name => <$of as Value>::KIND,)* }
            }

            /// Appends the values of points, little-endian.
            pub(crate) fn push_bytes(self, out: &mut Vec<u8>, points: &[PointRecord], origin: DVec3) {
                match self { $(Column::$name => push_values::<$of>(out, points, origin, $value),)* }
            }

            /// Appends the value of a point as text.
            pub(crate) fn push_text(self, out: &mut Vec<u8>, point: &PointRecord, origin: DVec3) {
                match self {
                    $(Column::$name => value::<$of>(point, origin, $value).push_text::<$decimals>(out),)*
                }
            }
        }
    };
}

#[inline]
fn push_values<T: Value>(
    out: &mut Vec<u8>,
    points: &[PointRecord],
    origin: DVec3,
    value: impl Fn(&PointRecord, DVec3) -> T,
) {
    points.iter().for_each(|point| value(point, origin).push_bytes(out));
}

#[inline]
fn value<T>(point: &PointRecord, origin: DVec3, value: impl Fn(&PointRecord, DVec3) -> T) -> T {
    value(point, origin)
}

columns! {
    X f64 4 "m" |p, o| p.position.x + o.x, "Coordinate, world frame; of a missed pulse that of the beam's origin.";
    Y f64 4 "m" |p, o| p.position.y + o.y, "Coordinate, world frame; of a missed pulse that of the beam's origin.";
    Z f64 4 "m" |p, o| p.position.z + o.z, "Coordinate, world frame; of a missed pulse that of the beam's origin.";
    Intensity u16 0 "" |p, _| p.digital_intensity(), "Amplitude as LAS files have it: 10000 + 1000 log10(Amplitude).";
    ReturnNumber u8 0 "" |p, _| p.returns()[0], "Number of the return, from 1, at most 255; 0 marks a missed pulse.";
    NumberOfReturns u8 0 "" |p, _| p.returns()[1], "Returns of the pulse, at most 255.";
    Classification u8 0 "" |p, _| u8::try_from(p.class).unwrap_or(0), "Class of the surface; 0 where it is no byte, see SurfaceClass.";
    ScanAngle f32 4 "deg" |p, _| degrees(p.scan_angle) as f32, "Angle of the beam from straight down across the track, negative to the left of the flight; with the physics of HELIOS++ its deflection on the scanner.";
    PointSourceId u16 0 "" |p, _| p.source_id(), "Number of the leg plus one.";
    GpsTime f64 9 "s" |p, _| p.seconds(), "Emission of the pulse, second of the GPS week; beyond 604800 adjusted standard GPS time (GPS seconds less 1e9).";
    Amplitude f64 9 "" |p, _| p.amplitude, "Waveform amplitude at the peak.";
    EchoWidth f32 4 "ns" |p, _| p.echo_width as f32, "Width of the fitted Gaussian; 0 when not asked for.";
    Range f64 4 "m" |p, _| p.range, "Measured range, noise and errors included.";
    TrueRange f64 4 "m" |p, _| p.true_range, "Distance to what was hit, without noise, errors and bins.";
    IncidenceAngle f32 4 "deg" |p, _| p.incidence_degrees(), "Angle between beam and surface normal.";
    PulseNumber u64 0 "" |p, _| p.pulse_number, "Number of the pulse among those of its device, from 1.";
    Device u16 0 "" |p, _| p.device_u16(), "Index of the device, from 0.";
    ObjectId i32 0 "" |p, _| p.object, "Id of the scene part that was hit, or the number that stands for it.";
    Part u32 0 "" |p, _| p.part, "Index of the part in the scene, from 0; 4294967295 for a missed pulse.";
    Primitive u32 0 "" |p, _| p.primitive, "Index of the triangle or voxel in the scene; 4294967295 for a missed pulse.";
    SurfaceClass i32 0 "" |p, _| p.class, "Class of the surface, whatever its value.";
    BeamOriginX f64 4 "m" |p, o| p.origin.x + o.x, "Origin of the beam, world frame.";
    BeamOriginY f64 4 "m" |p, o| p.origin.y + o.y, "Origin of the beam, world frame.";
    BeamOriginZ f64 4 "m" |p, o| p.origin.z + o.z, "Origin of the beam, world frame.";
    BeamDirectionX f64 9 "" |p, _| p.direction.x, "Direction of the beam, unit vector.";
    BeamDirectionY f64 9 "" |p, _| p.direction.y, "Direction of the beam, unit vector.";
    BeamDirectionZ f64 9 "" |p, _| p.direction.z, "Direction of the beam, unit vector.";
    HeightAboveGround f32 4 "m" |p, _| p.height, "Height above the ground; NaN where there is none.";
    TrueX f64 4 "m" |p, o| p.true_position.x + o.x, "Position with the pose that was flown, without errors of navigation.";
    TrueY f64 4 "m" |p, o| p.true_position.y + o.y, "Position with the pose that was flown, without errors of navigation.";
    TrueZ f64 4 "m" |p, o| p.true_position.z + o.z, "Position with the pose that was flown, without errors of navigation.";
    SurfaceX f64 4 "m" |p, o| p.cause.surface.x + o.x, "Where the strongest subray of the echo met a surface, world frame; NaN where noise caused it.";
    SurfaceY f64 4 "m" |p, o| p.cause.surface.y + o.y, "Where the strongest subray of the echo met a surface, world frame; NaN where noise caused it.";
    SurfaceZ f64 4 "m" |p, o| p.cause.surface.z + o.z, "Where the strongest subray of the echo met a surface, world frame; NaN where noise caused it.";
    NormalX f32 4 "" |p, _| p.cause.normal.x as f32, "Unit normal of that surface, towards the instrument; 0 in voxels, NaN without a surface.";
    NormalY f32 4 "" |p, _| p.cause.normal.y as f32, "Unit normal of that surface, towards the instrument; 0 in voxels, NaN without a surface.";
    NormalZ f32 4 "" |p, _| p.cause.normal.z as f32, "Unit normal of that surface, towards the instrument; 0 in voxels, NaN without a surface.";
    FootprintFraction f32 4 "" |p, _| p.cause.fraction as f32, "Share of the beam's subrays that are part of the echo; NaN without a surface.";
    Subray u32 0 "" |p, _| p.cause.subray, "Number of the strongest subray within the beam, from 0; 4294967295 without a surface.";
    ScannerX f64 4 "m" |p, _| p.in_scanner.x, "Position relative to the beam's origin, in the axes of the scanner's mount.";
    ScannerY f64 4 "m" |p, _| p.in_scanner.y, "Position relative to the beam's origin, in the axes of the scanner's mount.";
    ScannerZ f64 4 "m" |p, _| p.in_scanner.z, "Position relative to the beam's origin, in the axes of the scanner's mount.";
    Path u8 0 "" |p, _| p.cause.path, "Way of the light: 0 straight, 1 through panes, 2 over mirrors (a ghost); 3 surface, 4 column, 5 bottom of water; 6 fog, rain, snow or dust, 7 a drop or flake; 8 straight back from a mirror or pane.";
    PathOrder u8 0 "" |p, _| p.cause.order, "Number of mirrors, panes and surfaces of water on the way of the light.";
    Red u16 0 "" |p, _| p.colour_u16()[0], "Red of the surface, 256 times the 8 bits of sRGB; 0 in all three for a surface without a colour.";
    Green u16 0 "" |p, _| p.colour_u16()[1], "Green of the surface, 256 times the 8 bits of sRGB; 0 in all three for a surface without a colour.";
    Blue u16 0 "" |p, _| p.colour_u16()[2], "Blue of the surface, 256 times the 8 bits of sRGB; 0 in all three for a surface without a colour.";
    Doppler f64 9 "m/s" |p, _| p.cause.velocity[0], "Radial velocity, positive away from the instrument; NaN where it is not known.";
    DopplerWidth f64 9 "m/s" |p, _| p.cause.velocity[1], "Standard deviation of the radial velocity over the light of the echo; NaN where it is not known.";
    ExactScanAngle f64 9 "rad" |p, _| p.scan_angle, "ScanAngle with all its digits.";
    RestX f32 9 "m" |p, o| rest(p.position.x, o.x), "What X, relative to the origin of the scene, has lost in the world frame.";
    RestY f32 9 "m" |p, o| rest(p.position.y, o.y), "What Y, relative to the origin of the scene, has lost in the world frame.";
    RestZ f32 9 "m" |p, o| rest(p.position.z, o.z), "What Z, relative to the origin of the scene, has lost in the world frame.";
    ExactEchoWidth f64 9 "ns" |p, _| p.echo_width, "EchoWidth with all its digits.";
    ExactTime f64 9 "ns" |p, _| p.time_ns, "GpsTime with all its digits, after the second that the times of the run count from.";
    AttitudeW f64 9 "" |p, _| p.scanner.map_or(f64::NAN, |r| r.w), "Attitude of the scanner, quaternion from the axes of its mount to the world; NaN if unknown.";
    AttitudeX f64 9 "" |p, _| p.scanner.map_or(f64::NAN, |r| r.u.x), "Attitude of the scanner, quaternion from the axes of its mount to the world; NaN if unknown.";
    AttitudeY f64 9 "" |p, _| p.scanner.map_or(f64::NAN, |r| r.u.y), "Attitude of the scanner, quaternion from the axes of its mount to the world; NaN if unknown.";
    AttitudeZ f64 9 "" |p, _| p.scanner.map_or(f64::NAN, |r| r.u.z), "Attitude of the scanner, quaternion from the axes of its mount to the world; NaN if unknown.";
}

/// Rounding error of a coordinate relative to an origin when it becomes one of the world.
fn rest(coordinate: f64, origin: f64) -> f32 {
    (coordinate - ((coordinate + origin) - origin)) as f32
}

impl Column {
    /// Returns the columns written by default; with the columns of the beam where missed pulses are written.
    pub fn default_columns(with_misses: bool) -> Vec<Column> {
        let last = if with_misses { Column::BeamDirectionZ } else { Column::Primitive };
        Column::ALL.iter().copied().filter(|c| *c <= last && *c != Column::SurfaceClass).collect()
    }

    /// Needs of the column's values.
    pub fn needs(self) -> Needs {
        match self {
            Column::SurfaceX | Column::SurfaceY | Column::SurfaceZ => {
                Needs { cause: true, ..Needs::default() }
            }
            Column::NormalX | Column::NormalY | Column::NormalZ => Needs { cause: true, ..Needs::default() },
            Column::FootprintFraction | Column::Subray | Column::Path | Column::PathOrder => {
                Needs { cause: true, ..Needs::default() }
            }
            Column::Red | Column::Green | Column::Blue => Needs { colour: true, ..Needs::default() },
            Column::Doppler | Column::DopplerWidth => Needs { velocity: true, ..Needs::default() },
            Column::ScannerX | Column::ScannerY | Column::ScannerZ => {
                Needs { in_scanner: true, ..Needs::default() }
            }
            Column::AttitudeW | Column::AttitudeX | Column::AttitudeY | Column::AttitudeZ => {
                Needs { in_scanner: true, ..Needs::default() }
            }
            Column::TrueX | Column::TrueY | Column::TrueZ => {
                Needs { true_position: true, ..Needs::default() }
            }
            Column::HeightAboveGround => Needs { height: true, ..Needs::default() },
            _ => Needs::default(),
        }
    }

    /// Parses a comma-separated list of column names; case is ignored.
    ///
    /// # Errors
    /// An unknown name, or one that occurs twice.
    pub fn list(names: &str) -> Result<Vec<Column>, ColumnListError> {
        let mut columns = Vec::new();
        for name in names.split(',').map(str::trim) {
            let known = Column::ALL.iter().find(|c| c.name().eq_ignore_ascii_case(name));
            let Some(&column) = known else { return Err(ColumnListError::Unknown(name.to_owned())) };
            if columns.contains(&column) {
                return Err(ColumnListError::Repeated(column));
            }
            columns.push(column);
        }
        Ok(columns)
    }
}

impl From<Column> for String {
    fn from(column: Column) -> String {
        column.name().to_owned()
    }
}

impl TryFrom<String> for Column {
    type Error = ColumnListError;

    fn try_from(name: String) -> Result<Column, ColumnListError> {
        let known = Column::EVERY.iter().copied().find(|column| column.name() == name);
        known.ok_or(ColumnListError::Unknown(name))
    }
}

/// Points as rows of columns.
#[derive(Debug)]
pub(crate) struct TableEncoder {
    pub columns: Vec<Column>,
    /// World position of the origin of points, m.
    origin: DVec3,
}

impl TableEncoder {
    pub fn new(columns: Vec<Column>, settings: &CloudSettings) -> TableEncoder {
        TableEncoder { columns, origin: settings.origin }
    }

    /// Counts points with their positions in the world.
    fn count(&self, points: &[PointRecord], out: &mut EncodedPoints) {
        points.iter().for_each(|p| out.tally.count_point(p.position + self.origin, p));
    }

    /// Appends a block: the number of points, all values of the first column, then all values of the second,
    /// and so on; little-endian.
    pub fn push_block(&self, points: &[PointRecord], out: &mut EncodedPoints) {
        let width: usize = self.columns.iter().map(|column| column.kind().width()).sum();
        out.bytes.reserve(4 + width * points.len());
        out.bytes.extend_from_slice(&(points.len() as u32).to_le_bytes());
        self.columns.iter().for_each(|column| column.push_bytes(&mut out.bytes, points, self.origin));
        self.count(points, out);
    }

    /// Appends a line for each point.
    pub fn push_lines(&self, points: &[PointRecord], separator: u8, out: &mut EncodedPoints) {
        for point in points {
            for column in &self.columns {
                column.push_text(&mut out.bytes, point, self.origin);
                out.bytes.push(separator);
            }
            out.bytes.pop();
            out.bytes.push(b'\n');
        }
        self.count(points, out);
    }

    /// The line of the names of columns.
    pub fn heading(&self, separator: u8) -> Vec<u8> {
        let names: Vec<&str> = self.columns.iter().map(|column| column.name()).collect();
        let mut line = names.join(&char::from(separator).to_string()).into_bytes();
        line.push(b'\n');
        line
    }
}

/// A list of column names that cannot be used.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum ColumnListError {
    /// No column has this name.
    #[error("no column is called {0:?}{near}; there are {all}", near = near(.0), all = all_names())]
    Unknown(String),
    /// A column that occurs twice.
    #[error("the column {} occurs twice", .0.name())]
    Repeated(Column),
}

fn near(name: &str) -> String {
    let found = nearest(name, Column::ALL.iter().map(|c| c.name()));
    found.map_or(String::new(), |near| format!(" (did you mean {near}?)"))
}

fn all_names() -> String {
    Column::ALL.iter().map(|c| c.name()).collect::<Vec<_>>().join(", ")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_column_is_known_to_readers_of_points() {
        let names: Vec<&str> = Column::ALL.iter().map(|column| column.name()).collect();
        assert_eq!(crate::Columns::find(names.iter().copied()).remarks(&names), [""; 0]);
    }

    #[test]
    fn names_are_found_whatever_their_capitals() {
        assert_eq!(
            Column::list("x, gpstime,Primitive").unwrap(),
            [Column::X, Column::GpsTime, Column::Primitive]
        );
        let unknown = Column::list("X,Intensty").unwrap_err().to_string();
        assert!(unknown.contains("did you mean Intensity") && unknown.contains("GpsTime"), "{unknown}");
        assert_eq!(Column::list("X,Y,X"), Err(ColumnListError::Repeated(Column::X)));
        assert!(Column::list("").is_err());
    }

    #[test]
    fn columns_are_stored_by_their_names() {
        let columns = [Column::GpsTime, Column::ExactTime];
        let text = serde_json::to_string(&columns).unwrap();
        assert_eq!(text, r#"["GpsTime","ExactTime"]"#);
        assert_eq!(serde_json::from_str::<[Column; 2]>(&text).unwrap(), columns);
        assert!(serde_json::from_str::<Column>("\"Nothing\"").is_err());
    }

    #[test]
    fn directions_are_there_where_misses_are() {
        assert!(!Column::default_columns(false).contains(&Column::BeamDirectionX));
        assert!(Column::default_columns(true).contains(&Column::BeamDirectionZ));
        assert!(Column::default_columns(false).contains(&Column::TrueRange));
    }

    #[test]
    fn rows_are_lines() {
        let columns = vec![Column::X, Column::ReturnNumber, Column::ObjectId];
        let table = TableEncoder::new(columns, &CloudSettings::default());
        let point = |x, return_number, object| PointRecord {
            position: DVec3::new(x, 0.0, 0.0),
            return_number,
            object,
            ..PointRecord::default()
        };
        let mut out = EncodedPoints::with_capacity(0);
        out.bytes = table.heading(b',');
        table.push_lines(&[point(1.5, 1, -7), point(-2.0, 300, 8)], b',', &mut out);
        assert_eq!(
            String::from_utf8(out.bytes).unwrap(),
            "X,ReturnNumber,ObjectId\n1.5000,1,-7\n-2.0000,255,8\n"
        );
    }
}
