//! The command line of `vlscan fit`.

use clap::{Args, ValueEnum};
use std::path::PathBuf;
use vlscan_fit::flight::FlightLineName;
use vlscan_options::Bytes;
use vlscan_options::values::{Vector, number};

/// `vlscan fit`.
#[derive(Debug, Args)]
pub struct FitArgs {
    /// The recorded cloud: LAS or LAZ, or another format with GPS times and scan angles; - for stdin. With
    /// --calibration the recording of one revolution: Parquet with the columns beam, column, range_mm,
    /// reflectivity and, if there is one, signal.
    pub cloud: PathBuf,
    /// The pipeline file to write; the trajectory gets its name with .trajectory.csv, the mirror's wander
    /// with .wander.txt, pulse times with .pulses.txt, a scan pattern with .pattern.csv.
    #[arg(short, long = "output", value_name = "FILE.toml", value_parser = super::files())]
    pub out: PathBuf,
    /// Fit noise and detection of the spinning sensor with this calibration file (Ouster, JSON) instead of a
    /// flight.
    #[arg(long, value_name = "SENSOR.json")]
    pub calibration: Option<PathBuf>,
    /// Columns of a revolution that are fitted; the others test the fit.
    #[arg(long, value_name = "HALF", default_value = "even", requires = "calibration")]
    pub half: FittedHalf,
    /// Write the planes of the revolution, which the fit is based on, as a mesh and scene of the pipeline.
    #[arg(long, value_name = "FILE.obj", value_parser = super::files(), requires = "calibration")]
    pub planes: Option<PathBuf>,
    /// Fit the flight line of this point source, such as 7, or one of several of a source by its number in
    /// the order of time, such as 7.2: turns and pauses divide a flight. [default: the one with the most
    /// points]
    #[arg(long, value_name = "N[.NUMBER]", conflicts_with = "calibration")]
    pub flight_line: Option<FlightLineName>,
    /// Extend the fitted flight by this time beyond the recording: straight, with the last attitude and the
    /// pulses of the fitted patterns.
    #[arg(
        long,
        value_name = "SECONDS",
        default_value_t = 0.0,
        hide_default_value = true,
        conflicts_with = "calibration",
        value_parser = number
    )]
    pub extend: f64,
    /// Memory of the points, e.g. 8G, at about 36 bytes for each of LAS and LAZ and 56 of other files. Of a
    /// flight line with more points the scan lines of one second in 2, 3 ... are fitted, with a warning; with
    /// --still-at more points are an error. [default: 1G]
    #[arg(long, value_name = "SIZE", conflicts_with = "calibration")]
    pub max_memory: Option<Bytes>,
    /// Write the scan pattern of a sensor that stood still at this place while it recorded, instead of a
    /// flight: the directions of its pulses over time.
    #[arg(
        long,
        value_name = "X,Y,Z",
        allow_hyphen_values = true,
        conflicts_with_all = ["calibration", "flight_line", "extend"]
    )]
    pub still_at: Option<Vector>,
    /// Write the table of what was estimated as JSON.
    #[arg(long)]
    pub json: bool,
    /// Replace existing files.
    #[arg(long)]
    pub force: bool,
}

/// Half of the columns of a revolution.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum FittedHalf {
    /// Columns 0, 2, 4 and so on
    Even,
    /// Columns 1, 3, 5 and so on
    Odd,
}
