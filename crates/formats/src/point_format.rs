//! The table of the formats that are written.

use crate::columnar::{Column, arrow};
#[cfg(feature = "parquet")]
use crate::columnar::{geoparquet, parquet};
#[cfg(feature = "e57")]
use crate::e57::e57;
use crate::encode::PointEncoder;
use crate::las::{copc, las, laz};
#[cfg(feature = "mcap")]
use crate::mcap::mcap;
use crate::pcd::pcd;
use crate::ply::{ascii, binary, ray_cloud};
use crate::record::Needs;
use crate::settings::CloudSettings;
use crate::text::{bin, csv, xyz};
use serde::Deserialize;
use std::path::Path;
use std::sync::Arc;
use vlscan_base::diag::Diagnostics;
use vlscan_base::error::{Error, Result};
use vlscan_choice::Choice;

/// Prepares a format for the files of a cloud, and records problems.
type NewEncoder = fn(&CloudSettings, &mut Diagnostics) -> Result<Arc<dyn PointEncoder>>;

/// Facts about a format that do not depend on the cloud.
struct Facts {
    name: &'static str,
    aliases: &'static [&'static str],
    /// File name extension; formats with the same last part of it share that one.
    extension: &'static str,
    flags: u8,
    /// `None` if the format was left out of the build.
    encoder: Option<NewEncoder>,
    /// The feature that builds the encoder; empty for formats that all builds have.
    feature: &'static str,
    /// One line about it.
    help: &'static str,
}

/// It is text that a terminal can show.
const TEXT: u8 = 1;
/// It has a place for the coordinate reference system.
const CRS: u8 = 2;
/// Its columns can be chosen.
const COLUMNS: u8 = 4;
/// It has records of LAS, compressed or not.
const LAS: u8 = 8;
/// It has a place for colours, which it fills if a column of colours is chosen.
const COLOURS: u8 = 32;
/// It has a place for radial velocities, which it fills if a column of them is chosen.
const VELOCITIES: u8 = 64;
/// It has a place for labels of the way of light, which it fills if a column of them is chosen.
const LIGHT: u8 = 128;
/// Its points are in the axes of the scanner, and come in frames.
const FRAMES: u8 = 16;

macro_rules! formats {
    ($(
        $(#[cfg(feature = $feature:literal)])?
        $variant:ident $name:literal $aliases:tt $extension:literal [$($flag:ident)*] $encoder:ident
            $help:literal;
    )*) => {
        /// Format of a point file.
        #[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord, Deserialize)]
        pub enum PointFormat {
            $(
                #[doc = concat!($help, ".")]
                #[serde(rename = $name)]
                $variant,
            )*
        }

        /// The facts in the order of the formats.
        static FACTS: &[Facts] = &[$(Facts {
            name: $name,
            aliases: &$aliases,
            extension: $extension,
            flags: 0 $(| $flag)*,
            $(#[cfg(not(feature = $feature))] encoder: None,)?
            $(#[cfg(feature = $feature)])? encoder: Some($encoder),
            feature: concat!($($feature)?),
            help: $help,
        },)*];

        impl PointFormat {
            /// All formats, with those that this build does not write.
            pub const ALL: &[PointFormat] = &[$(PointFormat::$variant),*];
        }
    };
}

formats! {
    Xyz "xyz" ["txt"] "xyz" [TEXT COLUMNS] xyz "Eleven columns of text as HELIOS++ writes them";
    Csv "csv" [] "csv" [TEXT COLUMNS] csv "Comma-separated values with a line of names";
    Bin "bin" [] "bin" [] bin "The text of xyz, compressed";
    Las "las" [] "las" [CRS LAS COLOURS VELOCITIES LIGHT] las "LAS";
    Laz "laz" [] "laz" [CRS LAS COLOURS VELOCITIES LIGHT] laz "LAS compressed as LAZ";
    Copc "copc" ["copc.laz"] "copc.laz" [CRS LAS COLOURS VELOCITIES LIGHT] copc
        "LAZ whose chunks are the nodes of an octree; files end in .copc.laz";
    PlyBinary "ply" [] "ply" [CRS COLOURS LIGHT] binary "PLY, little-endian";
    PlyAscii "ply-ascii" [] "ply" [TEXT CRS COLOURS LIGHT] ascii "PLY as text";
    RayCloud "raycloud" ["raycloud.ply"] "raycloud.ply" [] ray_cloud
        "PLY of rays, as raycloudtools reads it; files end in .raycloud.ply";
    Pcd "pcd" [] "pcd" [COLOURS VELOCITIES LIGHT] pcd "PCD of the Point Cloud Library, binary";
    #[cfg(feature = "e57")]
    E57 "e57" [] "e57" [COLOURS LIGHT] e57 "E57 with a scan and its pose for each leg";
    #[cfg(feature = "mcap")]
    Mcap "mcap" [] "mcap" [FRAMES COLOURS VELOCITIES LIGHT] mcap
        "MCAP with a message `PointCloud2` of ROS 2 for each revolution, in the axes of the scanner";
    Arrow "arrow" ["arrows"] "arrow" [COLUMNS CRS] arrow "Arrow IPC stream with the columns of csv";
    #[cfg(feature = "parquet")]
    Parquet "parquet" [] "parquet" [COLUMNS CRS] parquet "Parquet with the columns of csv";
    #[cfg(feature = "parquet")]
    GeoParquet "geoparquet" ["geo.parquet"] "geo.parquet" [COLUMNS CRS] geoparquet
        "Parquet with a geometry and its coordinate reference system, for GIS; files end in .geo.parquet";
}

/// Advice for a format that was left out of the build.
pub(crate) fn build_with(feature: &str) -> String {
    format!("build vlscan with the feature {feature}")
}

impl Choice for PointFormat {
    const ALL: &'static [PointFormat] = PointFormat::ALL;

    fn label(self) -> &'static str {
        self.facts().name
    }

    fn aliases(self) -> &'static [&'static str] {
        self.facts().aliases
    }

    fn about(self) -> &'static str {
        self.facts().help
    }

    /// A format that is not built is still a value, for the message of the encoder.
    fn is_hidden(self) -> bool {
        self.facts().encoder.is_none()
    }
}

impl PointFormat {
    fn facts(self) -> &'static Facts {
        &FACTS[self as usize]
    }

    /// One line about the format.
    pub fn help(self) -> &'static str {
        self.facts().help
    }

    fn is(self, flag: u8) -> bool {
        self.facts().flags & flag != 0
    }

    /// The format of a name or alias in upper or lower case.
    pub fn of_name(name: &str) -> Option<PointFormat> {
        let is_it = |known: &str| known.eq_ignore_ascii_case(name);
        let found =
            |format: &PointFormat| is_it(format.name()) || format.facts().aliases.iter().any(|a| is_it(a));
        PointFormat::ALL.iter().copied().find(found)
    }

    /// Returns the format that the extension of a file name denotes; `None` for names without extension.
    ///
    /// # Errors
    /// The extension, when it denotes no format.
    pub fn of_file(path: &Path) -> Option<Result<PointFormat, UnknownExtension>> {
        // A name that is not valid Unicode has an extension, too.
        let name = path.file_name()?.to_string_lossy();
        let ends_in = |format: &PointFormat| {
            let end = format.extension();
            let at = name.len().checked_sub(end.len() + 1).filter(|_| end.contains('.'))?;
            let found = name.get(at..)?.strip_prefix('.')?;
            found.eq_ignore_ascii_case(end).then_some(*format)
        };
        if let Some(format) = PointFormat::ALL.iter().find_map(ends_in) {
            return Some(Ok(format));
        }
        let extension = Path::new(&*name).extension()?.to_str()?;
        Some(PointFormat::of_name(extension).ok_or_else(|| UnknownExtension(extension.to_owned())))
    }

    /// [`PointFormat::of_file`] of a name that needs an extension.
    ///
    /// # Errors
    /// An extension that denotes no format, or none.
    pub fn required(path: &Path) -> Result<PointFormat, UnknownExtension> {
        PointFormat::of_file(path).unwrap_or_else(|| Err(UnknownExtension(String::new())))
    }

    /// True if a file with the extension of this format may hold the other: the last part of its extension is
    /// the same.
    pub fn shares_extension(self, other: PointFormat) -> bool {
        other.extension().rsplit('.').next() == Some(self.extension())
    }

    /// The name.
    pub fn name(self) -> &'static str {
        self.facts().name
    }

    /// Returns the names of the formats that this build writes, separated by commas.
    pub fn names() -> String {
        let built = FACTS.iter().filter(|facts| facts.encoder.is_some());
        built.map(|facts| facts.name).collect::<Vec<_>>().join(", ")
    }

    /// File name extension of the format.
    pub fn extension(self) -> &'static str {
        self.facts().extension
    }

    /// True if the format is LAS, compressed or not.
    pub fn is_las(self) -> bool {
        self.is(LAS)
    }

    /// True if the format has a place for the coordinate reference system.
    pub fn holds_crs(self) -> bool {
        self.is(CRS)
    }

    /// True if the format is text that a terminal can show.
    pub fn is_text(self) -> bool {
        self.is(TEXT)
    }

    /// True if the columns can be chosen.
    pub fn has_columns(self) -> bool {
        self.is(COLUMNS)
    }

    /// True if files of other columns have colours, too, if a column of colours is chosen.
    pub fn has_colours(self) -> bool {
        self.is(COLOURS)
    }

    /// True if files of other columns have radial velocities, too, if a column of them is chosen.
    pub fn has_velocities(self) -> bool {
        self.is(VELOCITIES)
    }

    /// True if files of other columns have labels of the way of light, too, if a column of them is chosen.
    pub fn has_light_labels(self) -> bool {
        self.is(LIGHT)
    }

    /// The columns that settings choose and for which none of these formats, whose columns cannot be chosen,
    /// has a place.
    pub fn unused_columns(formats: &[PointFormat], settings: &CloudSettings) -> Vec<Column> {
        use Column::{
            BeamOriginX, BeamOriginY, BeamOriginZ, FootprintFraction, HeightAboveGround, NormalX, NormalY,
            NormalZ, ScannerX, ScannerY, ScannerZ, Subray, TrueX, TrueY, TrueZ,
        };
        let has = |of: fn(PointFormat) -> bool| formats.iter().any(|format| of(*format));
        let is_unused = |column: &Column| match column {
            HeightAboveGround => !settings.heights,
            TrueX | TrueY | TrueZ => !settings.true_positions,
            BeamOriginX | BeamOriginY | BeamOriginZ | NormalX | NormalY | NormalZ | ScannerX | ScannerY
            | ScannerZ | FootprintFraction | Subray => true,
            column if column.needs().colour => !has(PointFormat::has_colours),
            column if column.needs().velocity => !has(PointFormat::has_velocities),
            column if column.is_light_label() => !has(PointFormat::has_light_labels),
            _ => false,
        };
        settings.columns.iter().flatten().copied().filter(is_unused).collect()
    }

    /// True if points come in frames, whose duration can be chosen.
    pub fn has_frames(self) -> bool {
        self.is(FRAMES)
    }

    /// Needs of the format besides the settings; columns that are chosen add what they need, see
    /// [`Column::needs`](crate::Column::needs).
    pub fn needs(self) -> Needs {
        Needs { in_scanner: self.is(FRAMES), ..Needs::default() }
    }

    /// Prepares the format for the files of a cloud; problems of the settings are recorded in `problems`.
    ///
    /// # Errors
    /// [`Error::Input`] for a format that this build does not write, [`Error::Internal`].
    pub fn encoder(
        self,
        settings: &CloudSettings,
        problems: &mut Diagnostics,
    ) -> Result<Arc<dyn PointEncoder>> {
        let facts = self.facts();
        let new = facts.encoder.ok_or_else(|| {
            let message = format!("this build does not write {}", self.name());
            Error::unsupported(message, build_with(facts.feature))
        })?;
        new(settings, problems)
    }
}

/// A file name extension that denotes no format.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("no format is called {0:?}; choose {known}", known = PointFormat::names())]
pub struct UnknownExtension(pub String);

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn formats_of_fixed_columns_lack_those_of_tables() {
        use Column::{Doppler, HeightAboveGround, Path, Range, Red, Subray, TrueX, X};
        let chosen = vec![X, Range, Path, Subray, Red, Doppler, HeightAboveGround, TrueX];
        let mut settings = CloudSettings { columns: Some(chosen), ..CloudSettings::default() };
        let unused = |formats: &[PointFormat], settings: &CloudSettings| {
            PointFormat::unused_columns(formats, settings)
        };
        let las = [PointFormat::Las];
        assert_eq!(unused(&las, &settings), [Subray, HeightAboveGround, TrueX]);
        assert_eq!(unused(&[PointFormat::PlyBinary], &settings), [Subray, Doppler, HeightAboveGround, TrueX]);
        let both = [PointFormat::PlyBinary, PointFormat::Pcd];
        assert_eq!(unused(&both, &settings), [Subray, HeightAboveGround, TrueX]);
        (settings.heights, settings.true_positions) = (true, true);
        assert_eq!(unused(&las, &settings), [Subray]);
        settings.columns = None;
        assert!(unused(&las, &settings).is_empty());
    }

    #[test]
    fn what_was_left_out_is_known_and_names_its_feature() {
        for (format, feature, is_built) in [
            (PointFormat::E57, "e57", cfg!(feature = "e57")),
            (PointFormat::Mcap, "mcap", cfg!(feature = "mcap")),
            (PointFormat::Parquet, "parquet", cfg!(feature = "parquet")),
            (PointFormat::GeoParquet, "parquet", cfg!(feature = "parquet")),
        ] {
            let path = Path::new("a").with_extension(format.extension());
            assert_eq!(PointFormat::of_file(&path), Some(Ok(format)));
            assert_eq!(PointFormat::names().split(", ").any(|name| name == format.name()), is_built);
            match format.encoder(&CloudSettings::default(), &mut Diagnostics::default()) {
                Err(Error::Input(problems)) => {
                    let said = problems.text();
                    assert!(!is_built && said.contains(&build_with(feature)), "{said}");
                }
                encoder => assert!(is_built && encoder.is_ok()),
            }
        }
    }
}
