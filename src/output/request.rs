//! Specification of the outputs of a run.

use super::{Column, Division, Ring, TableContent, TableRequest};
use crate::shards::Records;
use clap::ValueEnum;
use serde::Deserialize;
use std::path::{Path, PathBuf};

/// Format of a point file.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord, ValueEnum, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum PointFormat {
    /// Eleven columns of text as HELIOS++ writes them.
    ///
    /// Spec outputs §3.
    #[value(alias = "txt")]
    Xyz,
    /// Comma-separated values with a line of names.
    ///
    /// See [`Column`].
    Csv,
    /// The text of xyz, compressed.
    ///
    /// Spec outputs §8.
    Bin,
    /// LAS.
    ///
    /// See [`LasSettings`].
    Las,
    /// LAS compressed as LAZ.
    Laz,
    /// LAZ whose chunks are the nodes of an octree; files end in .copc.laz.
    #[value(alias = "copc.laz")]
    Copc,
    /// PLY, little-endian.
    #[value(name = "ply")]
    #[serde(rename = "ply")]
    PlyBinary,
    /// PLY as text.
    PlyAscii,
    /// PLY of rays, as raycloudtools reads it; files end in .raycloud.ply.
    #[value(name = "raycloud", alias = "raycloud.ply")]
    #[serde(rename = "raycloud")]
    RayCloud,
    /// PCD of the Point Cloud Library, binary.
    Pcd,
    /// E57 with a scan and its pose for each leg.
    E57,
    /// MCAP with a message `PointCloud2` of ROS 2 for each revolution, in the axes of the scanner.
    Mcap,
    /// Arrow IPC stream with the columns of csv.
    #[value(alias = "arrows")]
    Arrow,
    /// Parquet with the columns of csv.
    Parquet,
}

impl PointFormat {
    /// Returns the format that the extension of a file name denotes; `None` for names without extension.
    ///
    /// # Errors
    /// The extension, when it denotes no format.
    pub fn of_file(path: &Path) -> Option<Result<PointFormat, String>> {
        // A name that is no Unicode has an extension, too.
        let name = path.file_name()?.to_string_lossy();
        let ends_in = |end: &str| {
            let found = name.len().checked_sub(end.len()).and_then(|at| name.get(at..));
            found.is_some_and(|found| found.eq_ignore_ascii_case(end))
        };
        let extension = match () {
            _ if ends_in(".copc.laz") => "copc.laz",
            _ if ends_in(".raycloud.ply") => "raycloud.ply",
            _ => Path::new(&*name).extension()?.to_str()?,
        };
        Some(PointFormat::from_str(extension, true).map_err(|_| extension.to_owned()))
    }

    /// Returns all names, separated by commas.
    pub fn names() -> String {
        let names = PointFormat::value_variants().iter().filter_map(ValueEnum::to_possible_value);
        names.map(|value| value.get_name().to_owned()).collect::<Vec<_>>().join(", ")
    }

    /// File name extension of the format.
    pub fn extension(self) -> &'static str {
        match self {
            PointFormat::Xyz => "xyz",
            PointFormat::Bin => "bin",
            PointFormat::Las => "las",
            PointFormat::Laz => "laz",
            PointFormat::Copc => "copc.laz",
            PointFormat::PlyBinary | PointFormat::PlyAscii => "ply",
            PointFormat::RayCloud => "raycloud.ply",
            PointFormat::Pcd => "pcd",
            PointFormat::E57 => "e57",
            PointFormat::Mcap => "mcap",
            PointFormat::Csv => "csv",
            PointFormat::Arrow => "arrow",
            PointFormat::Parquet => "parquet",
        }
    }

    /// Whether the header counts the points, so that it can be completed only at the end.
    pub fn counts(self) -> bool {
        self.is_las()
            || matches!(self, PointFormat::PlyBinary | PointFormat::PlyAscii)
            || matches!(self, PointFormat::RayCloud | PointFormat::Pcd)
    }

    /// Whether the format is LAS, compressed or not.
    pub fn is_las(self) -> bool {
        matches!(self, PointFormat::Las | PointFormat::Laz | PointFormat::Copc)
    }

    /// Whether the format has a place for the coordinate reference system.
    pub fn holds_crs(self) -> bool {
        self.is_las()
            || matches!(self, PointFormat::PlyBinary | PointFormat::PlyAscii)
            || matches!(self, PointFormat::Arrow | PointFormat::Parquet)
    }

    /// Whether the format is text that a terminal can show.
    pub fn is_text(self) -> bool {
        matches!(self, PointFormat::Xyz | PointFormat::PlyAscii | PointFormat::Csv)
    }

    /// What has to be recorded beside echoes for the points of the format, whatever else is written. Columns that are chosen
    /// add what they need, see [`Column::records`].
    pub fn records(self) -> Records {
        match self {
            PointFormat::Mcap => Records { scanner_axes: true, ..Records::default() },
            PointFormat::Xyz | PointFormat::Csv | PointFormat::Bin => Records::default(),
            PointFormat::Las | PointFormat::Laz | PointFormat::Copc => Records::default(),
            PointFormat::PlyBinary | PointFormat::PlyAscii | PointFormat::RayCloud => Records::default(),
            PointFormat::Pcd | PointFormat::E57 => Records::default(),
            PointFormat::Arrow | PointFormat::Parquet => Records::default(),
        }
    }

    /// Whether the columns can be chosen.
    pub fn has_columns(self) -> bool {
        matches!(self, PointFormat::Xyz | PointFormat::Csv | PointFormat::Arrow | PointFormat::Parquet)
    }
}

/// Format of a trajectory.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum TrajectoryFormat {
    /// `x y z time roll pitch yaw` as HELIOS++ writes it (spec outputs §5).
    #[default]
    Helios,
    /// `time,x,y,z,roll,pitch,yaw` with a header line, seconds, metres (6 decimals) and degrees (9 decimals): what
    /// `--trajectory` reads.
    Csv,
}

/// Destination of an output.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Target {
    /// Standard output.
    Stdout,
    /// One file for all legs. A path that is a pipe or a device is written as a stream.
    File(PathBuf),
    /// One file per active leg or strip, `legNNN_points.EXT`; created when missing.
    Directory(PathBuf),
    /// The layout of HELIOS++ (spec outputs §1): `DIR/<survey>/<YYYY-MM-DD_HH-MM-SS>[_N]/legNNN_points.EXT`, with
    /// `legNNN_trajectory.txt` beside it. A new run directory for every [`OutputPlan::open`](super::OutputPlan::open).
    Helios(PathBuf),
}

/// The file of a shard of a run, see [`crate::shards`].
#[derive(Clone, Debug, PartialEq)]
pub struct ShardOutput {
    /// The file; it is replaced if it exists.
    pub path: PathBuf,
    /// Its head, as [`crate::shards::ShardHead::bytes`] returns it.
    pub head: Vec<u8>,
}

/// Specification of all outputs of a run.
#[derive(Clone, Debug)]
pub struct OutputRequest {
    /// Point clouds.
    pub sinks: Vec<(Target, PointFormat)>,
    /// Whether to write waveforms beside the first point cloud that is not a stream (spec outputs §6):
    /// `legNNN_fullwave.txt` in directories, `STEM_fullwave.txt` beside single files.
    pub waveforms: bool,
    /// Whether to write pulses beside the first point cloud that is not a stream (spec outputs §7):
    /// `legNNN_pulse.txt`, `STEM_pulse.txt`.
    pub pulses: bool,
    /// Whether waveforms and pulses are compressed text, `.bin` instead of `.txt`.
    pub zip: bool,
    /// A trajectory in addition to those of [`Target::Helios`].
    pub trajectory: Option<(Target, TrajectoryFormat)>,
    /// Whether each device of a scanner with several gets its own point file: `_dev<id>` before the extension.
    pub split_by_channel: bool,
    /// Columns of Arrow, Parquet and CSV, and, if set, also of the text format, which has the columns of HELIOS++
    /// otherwise.
    pub columns: Option<Vec<Column>>,
    /// Whether to write pulses without echoes: as records with 0 returns at the beam's origin, among the points in
    /// order of emission. LAS and PLY then contain the beam's direction as well.
    pub misses: bool,
    /// Whether LAS, LAZ and PLY contain labels for machine learning: part, primitive, true range. Column formats
    /// always can.
    pub labels: bool,
    /// Whether LAS and LAZ contain positions without navigation errors. Column formats have them as columns.
    pub true_positions: bool,
    /// Whether points have their height above the ground.
    pub heights: bool,
    /// Duration of the frames of MCAP, s; a revolution of the scanner if `None`.
    pub frame_s: Option<f64>,
    /// How the points of folders are divided among files, instead of by leg.
    pub division: Option<Division>,
    /// Where points are kept; everywhere if `None`.
    pub clip: Option<Ring>,
    /// Whether poses arrive during the run, so that Arrow streams must not wait for full batches.
    pub live: bool,
    /// Settings of LAS and LAZ.
    pub las: LasSettings,
    /// Whether to replace existing files and to write binary data to a terminal.
    pub force: bool,
    /// Whether an earlier run with the same outputs, which was ended, may have written some of them: a file that exists stays if it
    /// holds the same bytes.
    pub goes_on: bool,
    /// Files that the run reads; no output may replace them.
    pub inputs: Vec<PathBuf>,
    /// Files that the caller writes besides the outputs, which are checked with them.
    pub companions: Vec<PathBuf>,
    /// Whether points are counted by part of the scene, see [`Summary`](super::Summary).
    pub counts_parts: bool,
    /// Coordinate reference system as WKT; the one of the survey if `None`.
    pub crs_wkt: Option<String>,
    /// Year and day of the year (from 1) for LAS headers.
    pub creation: (u16, u16),
    /// Name of run directories; `None` for the local time of their creation.
    pub run_stamp: Option<String>,
    /// A shard of a run, which is then the only output.
    pub shard: Option<ShardOutput>,
    /// Tables in memory.
    pub tables: Vec<TableRequest>,
    /// Number of epochs (spec input-formats §3.8); see [`Writer::next_epoch`](super::Writer::next_epoch).
    pub epochs: u32,
}

impl Default for OutputRequest {
    fn default() -> OutputRequest {
        OutputRequest {
            sinks: Vec::new(),
            waveforms: false,
            pulses: false,
            zip: false,
            trajectory: None,
            split_by_channel: false,
            columns: None,
            misses: false,
            labels: false,
            true_positions: false,
            heights: false,
            frame_s: None,
            division: None,
            clip: None,
            live: false,
            las: LasSettings::default(),
            force: false,
            goes_on: false,
            inputs: Vec::new(),
            companions: Vec::new(),
            counts_parts: false,
            crs_wkt: None,
            creation: (0, 0),
            run_stamp: None,
            shard: None,
            tables: Vec::new(),
            epochs: 1,
        }
    }
}

impl OutputRequest {
    /// What has to be recorded beside echoes and poses for all outputs: the one place where formats, columns and tables say
    /// what they need. A run records it, a merge refuses shards without it.
    pub fn records(&self) -> Records {
        let has_table = |content| self.tables.iter().any(|table| table.content == content);
        let own = Records {
            waveforms: self.waveforms || self.las.packets.is_some() || has_table(TableContent::Waveforms),
            pulses: self.pulses || self.misses || has_table(TableContent::Pulses),
            ..Records::default()
        };
        let formats = self.sinks.iter().map(|(_, format)| format.records());
        let columns = self.columns.iter().flatten().map(|column| column.records());
        formats.chain(columns).fold(own, Records::union)
    }
}

/// LAS version.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum LasVersion {
    /// 1.4 with point data record format 6.
    #[default]
    V14,
    /// 1.0 with point data record format 1 (`--las10`).
    V10,
}

/// Mapping of an amplitude to the 16-bit intensity of LAS. The amplitude itself is in the extra bytes.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum IntensityMapping {
    /// `10000 + 1000·log10(amplitude)`, hundredths of a decibel above −100 dB: amplitudes of different surveys differ by
    /// ten powers of ten, and none of them comes out as 0 or saturated. 0 for amplitudes that are not positive.
    #[default]
    Decibel,
    /// `65535·amplitude/full_scale`.
    Linear {
        /// Amplitude of the highest intensity.
        full_scale: f64,
    },
    /// As HELIOS++: `65535·amplitude/10⁶`, rounded down, which is nearly always 0 (spec outputs trap 8).
    Helios,
}

/// Dimensions in the extra bytes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum ExtraDimensions {
    /// `echo_width`, `fullwaveIndex`, `hitObjectId`, `heliosAmplitude`, and then `device`, `range`, `incidence_angle`.
    #[default]
    All,
    /// The first four, as HELIOS++.
    Helios,
    /// No extra bytes: for programs that refuse them.
    None,
}

/// Settings of LAS and LAZ (spec outputs §4).
#[derive(Clone, Debug, Default, PartialEq)]
pub struct LasSettings {
    /// LAS version.
    pub version: LasVersion,
    /// Metres per unit of the coordinates; `None`: 0.0001, or the next power of ten at which the scene fits into 32
    /// bits.
    pub scale: Option<f64>,
    /// Mapping of amplitudes to intensities.
    pub intensity: IntensityMapping,
    /// Dimensions in the extra bytes.
    pub extra: ExtraDimensions,
    /// Number of points in the header of LAS on a pipe, which is then written without delay, with the scene's box as
    /// bounds: more points are an error, and most readers tolerate fewer. `None`: the points are spooled, and the
    /// header is exact. On a seekable output the header is always patched at the end.
    pub at_most: Option<u64>,
    /// Waveforms as packets that the points refer to (LAS 1.4 with point format 9); `None`: no packets, point format
    /// 6.
    pub packets: Option<PacketPlace>,
}

/// Location of the waveform packets of LAS.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum PacketPlace {
    /// In the file of the points, as an extended variable length record after them.
    Inside,
    /// In a file of the same name with the extension .wdp.
    Beside,
}
