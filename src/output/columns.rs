//! The columns of points in Arrow, Parquet and text with a header. Names and types follow LAS where LAS has the
//! dimension, otherwise PDAL or plain English.

use crate::shards::Records;
use vlscan_base::diag::nearest;

/// Storage type of a column.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    U8,
    U16,
    U32,
    U64,
    I32,
    F32,
    F64,
}

impl Kind {
    /// Bytes per value.
    pub fn width(self) -> usize {
        match self {
            Kind::U8 => 1,
            Kind::U16 => 2,
            Kind::U32 | Kind::I32 | Kind::F32 => 4,
            Kind::U64 | Kind::F64 => 8,
        }
    }
}

macro_rules! columns {
    ($($name:ident $kind:ident $decimals:literal $unit:literal $meaning:literal;)*) => {
        /// A column of points, named like the variant.
        #[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
        pub enum Column {
            $(#[doc = $meaning] $name,)*
        }

        impl Column {
            /// All columns in the order in which they are written.
            pub const ALL: &[Column] = &[$(Column::$name),*];

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

            pub(super) fn kind(self) -> Kind {
                match self { $(Column::$name => Kind::$kind,)* }
            }

            /// Number of decimals in text.
            pub(super) fn decimals(self) -> u8 {
                match self { $(Column::$name => $decimals,)* }
            }
        }
    };
}

columns! {
    X F64 4 "m" "Coordinate, world frame; of a missed pulse that of the beam's origin.";
    Y F64 4 "m" "Coordinate, world frame; of a missed pulse that of the beam's origin.";
    Z F64 4 "m" "Coordinate, world frame; of a missed pulse that of the beam's origin.";
    Intensity U16 0 "" "Amplitude as LAS files have it: 10000 + 1000 log10(Amplitude).";
    ReturnNumber U8 0 "" "Number of the return, from 1, at most 255; 0 marks a missed pulse.";
    NumberOfReturns U8 0 "" "Returns of the pulse, at most 255.";
    Classification U8 0 "" "Class of the surface; 0 where it is no byte, see SurfaceClass.";
    ScanAngle F32 4 "deg" "Deflection of the beam on the scanner.";
    PointSourceId U16 0 "" "Number of the leg plus one.";
    GpsTime F64 9 "s" "Emission of the pulse, second of the GPS week.";
    Amplitude F64 9 "" "Waveform amplitude at the peak.";
    EchoWidth F32 4 "ns" "Width of the fitted Gaussian; 0 when not asked for.";
    Range F64 4 "m" "Measured range, noise and errors included.";
    TrueRange F64 4 "m" "Distance to what was hit, without noise, errors and bins.";
    IncidenceAngle F32 4 "deg" "Angle between beam and surface normal.";
    PulseNumber U64 0 "" "Number of the pulse among those of its device, from 1.";
    Device U16 0 "" "Index of the device, from 0.";
    ObjectId I32 0 "" "Id of the scene part that was hit, or the number that stands for it.";
    Part U32 0 "" "Index of the part in the scene, from 0; 4294967295 for a missed pulse.";
    Primitive U32 0 "" "Index of the triangle or voxel in the scene; 4294967295 for a missed pulse.";
    SurfaceClass I32 0 "" "Class of the surface, whatever its value.";
    BeamOriginX F64 4 "m" "Origin of the beam, world frame.";
    BeamOriginY F64 4 "m" "Origin of the beam, world frame.";
    BeamOriginZ F64 4 "m" "Origin of the beam, world frame.";
    BeamDirectionX F64 9 "" "Direction of the beam, unit vector.";
    BeamDirectionY F64 9 "" "Direction of the beam, unit vector.";
    BeamDirectionZ F64 9 "" "Direction of the beam, unit vector.";
    HeightAboveGround F32 3 "m" "Height above the ground; NaN where there is none.";
    TrueX F64 4 "m" "Position with the pose that was flown, without errors of navigation.";
    TrueY F64 4 "m" "Position with the pose that was flown, without errors of navigation.";
    TrueZ F64 4 "m" "Position with the pose that was flown, without errors of navigation.";
    SurfaceX F64 4 "m" "Where the strongest subray of the echo met a surface, world frame; NaN where noise caused it.";
    SurfaceY F64 4 "m" "Where the strongest subray of the echo met a surface, world frame; NaN where noise caused it.";
    SurfaceZ F64 4 "m" "Where the strongest subray of the echo met a surface, world frame; NaN where noise caused it.";
    NormalX F32 6 "" "Unit normal of that surface, towards the instrument; 0 in voxels, NaN without a surface.";
    NormalY F32 6 "" "Unit normal of that surface, towards the instrument; 0 in voxels, NaN without a surface.";
    NormalZ F32 6 "" "Unit normal of that surface, towards the instrument; 0 in voxels, NaN without a surface.";
    FootprintFraction F32 6 "" "Share of the beam's subrays that are part of the echo; NaN without a surface.";
    Subray U32 0 "" "Number of the strongest subray within the beam, from 0; 4294967295 without a surface.";
    ScannerX F64 4 "m" "Position relative to the beam's origin, in the axes of the scanner's mount.";
    ScannerY F64 4 "m" "Position relative to the beam's origin, in the axes of the scanner's mount.";
    ScannerZ F64 4 "m" "Position relative to the beam's origin, in the axes of the scanner's mount.";
}

impl Column {
    /// Returns the columns written by default; with the columns of the beam where missed pulses are written.
    pub fn default_columns(with_misses: bool) -> Vec<Column> {
        let last = if with_misses { Column::BeamDirectionZ } else { Column::Primitive };
        Column::ALL.iter().copied().filter(|c| *c <= last && *c != Column::SurfaceClass).collect()
    }

    /// What has to be recorded beside echoes for the values.
    pub fn records(self) -> Records {
        match self {
            Column::SurfaceX | Column::SurfaceY | Column::SurfaceZ => {
                Records { truth: true, ..Records::default() }
            }
            Column::NormalX | Column::NormalY | Column::NormalZ => {
                Records { truth: true, ..Records::default() }
            }
            Column::FootprintFraction | Column::Subray => Records { truth: true, ..Records::default() },
            Column::ScannerX | Column::ScannerY | Column::ScannerZ => {
                Records { scanner_axes: true, ..Records::default() }
            }
            _ => Records::default(),
        }
    }

    /// Parses a comma-separated list of column names; case is ignored.
    ///
    /// # Errors
    /// A message that names the fault and the available columns.
    pub fn list(names: &str) -> Result<Vec<Column>, String> {
        let mut columns = Vec::new();
        for name in names.split(',').map(str::trim) {
            let known = Column::ALL.iter().find(|c| c.name().eq_ignore_ascii_case(name));
            let Some(&column) = known else {
                let all = Column::ALL.iter().map(|c| c.name());
                let near =
                    nearest(name, all.clone()).map_or(String::new(), |n| format!(" (did you mean {n}?)"));
                let all: Vec<&str> = all.collect();
                return Err(format!("no column is called {name:?}{near}; there are {}", all.join(", ")));
            };
            if columns.contains(&column) {
                return Err(format!("the column {} is there twice", column.name()));
            }
            columns.push(column);
        }
        Ok(columns)
    }
}

/// Splits a block written by [`ColumnCodec::push`](super::column_codec::ColumnCodec::push) into the bytes of each
/// column.
pub(super) fn slices(
    kinds: impl Iterator<Item = Kind>,
    rows: usize,
    block: &[u8],
) -> impl Iterator<Item = &[u8]> {
    let mut rest = block;
    kinds.map(move |kind| {
        let (head, tail) = rest.split_at((kind.width() * rows).min(rest.len()));
        rest = tail;
        head
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_column_is_known_to_readers_of_points() {
        let names: Vec<&str> = Column::ALL.iter().map(|column| column.name()).collect();
        assert_eq!(vlscan_formats::Columns::find(names.iter().copied()).remarks(&names), [""; 0]);
    }

    #[test]
    fn names_are_found_whatever_their_capitals() {
        assert_eq!(
            Column::list("x, gpstime,Primitive").unwrap(),
            [Column::X, Column::GpsTime, Column::Primitive]
        );
        let unknown = Column::list("X,Intensty").unwrap_err();
        assert!(unknown.contains("did you mean Intensity") && unknown.contains("GpsTime"), "{unknown}");
        assert!(Column::list("X,Y,X").unwrap_err().contains("twice"));
        assert!(Column::list("").is_err());
    }

    #[test]
    fn directions_are_there_where_misses_are() {
        assert!(!Column::default_columns(false).contains(&Column::BeamDirectionX));
        assert!(Column::default_columns(true).contains(&Column::BeamDirectionZ));
        assert!(Column::default_columns(false).contains(&Column::TrueRange));
    }
}
