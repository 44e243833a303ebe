//! What a run is asked to write.

use super::Column;
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
    /// Arrow IPC stream with the columns of csv.
    #[value(alias = "arrows")]
    Arrow,
    /// Parquet with the columns of csv.
    Parquet,
}

impl PointFormat {
    /// The format that the extension of a file's name tells; `None` for names without extension.
    ///
    /// # Errors
    /// The extension, where no format is called so.
    pub fn of_file(path: &Path) -> Option<Result<PointFormat, &str>> {
        let name = path.file_name()?.to_str()?;
        let copc = name.len().checked_sub(".copc.laz".len()).and_then(|at| name.get(at..));
        let extension = match copc {
            Some(end) if end.eq_ignore_ascii_case(".copc.laz") => "copc.laz",
            _ => path.extension()?.to_str()?,
        };
        Some(PointFormat::from_str(extension, true).map_err(|_| extension))
    }

    /// All names, with commas between them.
    pub fn names() -> String {
        let names = PointFormat::value_variants().iter().filter_map(ValueEnum::to_possible_value);
        names.map(|value| value.get_name().to_owned()).collect::<Vec<_>>().join(", ")
    }

    /// Extension of its files.
    pub fn extension(self) -> &'static str {
        match self {
            PointFormat::Xyz => "xyz",
            PointFormat::Bin => "bin",
            PointFormat::Las => "las",
            PointFormat::Laz => "laz",
            PointFormat::Copc => "copc.laz",
            PointFormat::PlyBinary | PointFormat::PlyAscii => "ply",
            PointFormat::Csv => "csv",
            PointFormat::Arrow => "arrow",
            PointFormat::Parquet => "parquet",
        }
    }

    /// Whether its header counts the points, and so is complete only at the end.
    pub fn counts(self) -> bool {
        self.is_las() || matches!(self, PointFormat::PlyBinary | PointFormat::PlyAscii)
    }

    /// Whether it is LAS, compressed or not.
    pub fn is_las(self) -> bool {
        matches!(self, PointFormat::Las | PointFormat::Laz | PointFormat::Copc)
    }

    /// Whether it is text that a terminal can show.
    pub fn is_text(self) -> bool {
        matches!(self, PointFormat::Xyz | PointFormat::PlyAscii | PointFormat::Csv)
    }

    /// Whether its columns can be chosen.
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

/// Where something is written.
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

/// Everything that a run is asked to write.
#[derive(Clone, Debug)]
pub struct OutputRequest {
    /// Point clouds.
    pub sinks: Vec<(Target, PointFormat)>,
    /// Waveforms beside the first point cloud that is not a stream (spec outputs §6): `legNNN_fullwave.txt` in
    /// directories, `STEM_fullwave.txt` beside single files.
    pub waveforms: bool,
    /// Pulses in the same way (spec outputs §7): `legNNN_pulse.txt`, `STEM_pulse.txt`.
    pub pulses: bool,
    /// Waveforms and pulses as compressed text, `.bin` instead of `.txt`.
    pub zip: bool,
    /// A trajectory besides those of [`Target::Helios`].
    pub trajectory: Option<(Target, TrajectoryFormat)>,
    /// One point file per device of a scanner with several: `_dev<id>` before the extension.
    pub split_by_channel: bool,
    /// Columns of Arrow, Parquet, CSV and, when they are chosen, of the text that has HELIOS++'s columns otherwise.
    pub columns: Option<Vec<Column>>,
    /// Write pulses without echoes, too: as records with 0 returns at the beam's origin, among the points in the order of
    /// emission. LAS and PLY get the beam's direction as well.
    pub misses: bool,
    /// Labels for learning in LAS, LAZ and PLY: part, primitive, true range. Columns have them anyway.
    pub labels: bool,
    /// Positions without errors of navigation in LAS and LAZ. Columns have them by name.
    pub true_positions: bool,
    /// Whether poses arrive while points leave, so that Arrow streams do not wait for full batches.
    pub live: bool,
    /// Settings of LAS and LAZ.
    pub las: LasSettings,
    /// Replace files that exist, and write binary data to a terminal.
    pub force: bool,
    /// Coordinate reference system as WKT; the survey's own if `None`.
    pub crs_wkt: Option<String>,
    /// Year and day of the year (from 1) for LAS headers.
    pub creation: (u16, u16),
    /// Name of run directories; `None` takes the local time when they are created.
    pub run_stamp: Option<String>,
    /// How often the survey is flown (spec input-formats §3.8); see [`Writer::next_epoch`](super::Writer::next_epoch).
    pub plays: u32,
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
            live: false,
            las: LasSettings::default(),
            force: false,
            crs_wkt: None,
            creation: (0, 0),
            run_stamp: None,
            plays: 1,
        }
    }
}

/// Version of LAS.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum LasVersion {
    /// 1.4 with point data record format 6.
    #[default]
    V14,
    /// 1.0 with point data record format 1 (`--las10`).
    V10,
}

/// How an amplitude becomes the 16-bit intensity of LAS. The amplitude itself is in the extra bytes.
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

/// Which dimensions stand in the extra bytes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum ExtraDimensions {
    /// `echo_width`, `fullwaveIndex`, `hitObjectId`, `heliosAmplitude`, and then `device`, `range`, `incidence_angle`.
    #[default]
    All,
    /// The first four, as HELIOS++.
    Helios,
    /// None.
    None,
}

/// Settings of LAS and LAZ (spec outputs §4).
#[derive(Clone, Debug, Default, PartialEq)]
pub struct LasSettings {
    /// Version.
    pub version: LasVersion,
    /// Metres per unit of the coordinates; `None`: 0.0001, or the next power of ten that holds the scene.
    pub scale: Option<f64>,
    /// Intensity.
    pub intensity: IntensityMapping,
    /// Extra bytes.
    pub extra: ExtraDimensions,
    /// LAS on a pipe leaves at once, with this as the number of points in its header, and the scene's box as theirs: more
    /// points than that are an error, and fewer are what most readers bear. `None`: it is spooled, and the header is exact.
    /// Where the header can be completed at the end, it is.
    pub at_most: Option<u64>,
    /// Waveforms as packets that the points refer to (LAS 1.4 with point format 9); `None`: no packets, point format 6.
    pub packets: Option<PacketPlace>,
}

/// Where the waveform packets of LAS stand.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum PacketPlace {
    /// In the file of the points, as an extended variable length record after them.
    Inside,
    /// In a file of the same name with the extension .wdp.
    Beside,
}
