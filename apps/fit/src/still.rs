//! The scan pattern of a sensor that stood still while it recorded.
//!
//! A pulse points from the sensor to its first return. Pulses without a return are not in a recording, and so
//! not in the pattern.

use libm::{atan2, hypot};
use serde::Serialize;
use std::fmt::Write as _;
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use vlscan_base::diag::Diagnostics;
use vlscan_base::error::{Error, Result};
use vlscan_base::files::reads::refuse_input_of;
use vlscan_base::files::{FileGroup, refuse_existing};
use vlscan_formats::{Attribute, AttributeSet, PointRow, PointSink, read_points};
use vlscan_geom::{DVec3, degrees};

/// Maximum number of pulses of a pattern.
const MAX_PULSES: usize = 1 << 24;
/// Distance from the sensor up to which a point has no direction, m.
const MIN_RANGE: f64 = 1e-3;
/// Extension of the pattern beside the pipeline file.
const PATTERN: &str = "pattern.csv";

/// The scan pattern of a recording.
#[derive(Clone, Debug)]
pub struct StillPattern {
    /// World position of the sensor, m.
    origin: DVec3,
    /// Pulses by time, then channel; no two of a channel have one time.
    pulses: Vec<Pulse>,
    channels: usize,
}

/// A pulse with a return.
#[derive(Clone, Copy, Debug)]
struct Pulse {
    /// s.
    time: f64,
    channel: u16,
    /// Number of the return.
    number: u8,
    /// Position of the return, m.
    position: DVec3,
}

/// Figures of a pattern.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct StillFigures {
    /// Number of pulses.
    pub pulses: usize,
    /// Number of channels.
    pub channels: usize,
    /// Time from the first pulse to the last, s.
    pub duration_s: f64,
    /// Times of pulses per second on average.
    pub times_per_s: f64,
}

/// The files of a pattern.
#[derive(Clone, Debug)]
pub struct StillFiles {
    /// The pipeline file.
    pub pipeline: PathBuf,
    /// The table of directions: text.
    pub pattern: PathBuf,
}

#[derive(Default)]
struct Points {
    attributes: AttributeSet,
    rows: Vec<Pulse>,
}

impl PointSink for Points {
    fn start(&mut self, attributes: AttributeSet) {
        self.attributes = attributes;
    }

    fn point(&mut self, row: &PointRow, _object: Option<&str>) -> Result<ControlFlow<()>> {
        if !row.is_miss && row.position.is_finite() && row.time.is_finite() {
            self.rows.push(Pulse {
                time: row.time,
                channel: row.channel,
                number: row.return_number,
                position: row.position,
            });
        }
        Ok(ControlFlow::Continue(()))
    }
}

impl StillFiles {
    /// The pipeline file, and the pattern next to it.
    pub fn new(pipeline: &Path) -> StillFiles {
        StillFiles { pipeline: pipeline.to_path_buf(), pattern: pipeline.with_extension(PATTERN) }
    }

    /// Checks that the files can be written.
    ///
    /// # Errors
    /// [`Error::Input`]: a file exists and `force` is not set, or is the recorded cloud.
    pub fn check(&self, cloud: &Path, force: bool) -> Result<()> {
        self.all().try_for_each(|path| {
            refuse_existing(path, force)?;
            refuse_input_of(path, [cloud])
        })
    }

    /// All files, the pipeline first.
    pub fn all(&self) -> impl Iterator<Item = &PathBuf> {
        [&self.pipeline, &self.pattern].into_iter()
    }
}

impl StillPattern {
    /// Reads the pattern of a sensor that stood at `origin`, m, while it recorded `cloud`.
    ///
    /// # Errors
    /// Files that cannot be read; [`Error::Input`] for clouds without times, with several pulses of one time,
    /// or with too few or too many pulses.
    pub fn read(cloud: &Path, origin: DVec3, found: &mut Diagnostics) -> Result<StillPattern> {
        let mut points = Points::default();
        found.extend(read_points(cloud, &mut points)?);
        let name = cloud.display();
        if !points.attributes.has(Attribute::Time) {
            return Err(Error::input(format!("{name} has no times of points, expected those of pulses")));
        }
        let mut rows = points.rows;
        rows.retain(|row| (row.position - origin).length() > MIN_RANGE);
        rows.sort_by(|a, b| {
            a.time.total_cmp(&b.time).then(a.channel.cmp(&b.channel)).then(a.number.cmp(&b.number))
        });
        let mut pulses: Vec<Pulse> = Vec::new();
        for row in rows {
            let first = pulses.last().filter(|last| last.time == row.time && last.channel == row.channel);
            match first {
                Some(first) if first.number == row.number && first.position != row.position => {
                    let message = format!(
                        "{name}: several pulses of channel {} have the time {}",
                        row.channel, row.time
                    );
                    let help = "record the time of each pulse, and the channels of sensors with several";
                    return Err(Error::input_with_help(message, help));
                }
                Some(_) => {}
                None => pulses.push(row),
            }
        }
        let times = pulses.first().zip(pulses.last()).map(|(first, last)| last.time - first.time);
        if times.is_none_or(|duration| duration <= 0.0) {
            return Err(Error::input(format!("{name} has fewer than two times of pulses")));
        }
        if pulses.len() > MAX_PULSES {
            let message = format!("{name} has {} pulses, a pattern has at most {MAX_PULSES}", pulses.len());
            return Err(Error::input_with_help(message, "cut a part of the recording"));
        }
        let mut channels: Vec<u16> = pulses.iter().map(|pulse| pulse.channel).collect();
        channels.sort_unstable();
        channels.dedup();
        Ok(StillPattern { origin, pulses, channels: channels.len() })
    }

    /// Figures of the pattern.
    pub fn figures(&self) -> StillFigures {
        let (first, last) = (self.pulses[0].time, self.pulses[self.pulses.len() - 1].time);
        let duration_s = last - first;
        let changes = self.pulses.windows(2).filter(|pair| pair[1].time > pair[0].time).count();
        StillFigures {
            pulses: self.pulses.len(),
            channels: self.channels,
            duration_s,
            times_per_s: changes as f64 / duration_s,
        }
    }

    /// Writes the pattern and the pipeline file. `command` is the command line that made them.
    ///
    /// # Errors
    /// [`Error::Io`], after which none of the files is written; a file exists and `force` is not set.
    pub fn write(&self, files: &StillFiles, command: &str, force: bool) -> Result<()> {
        let mut group = FileGroup::default();
        group.write(&files.pattern, force, self.table().as_bytes())?;
        group.write(&files.pipeline, force, self.pipeline(files, command).as_bytes())?;
        group.commit()
    }

    /// The table of directions.
    fn table(&self) -> String {
        let channel = if self.channels > 1 { "channel," } else { "" };
        let mut text = format!("time_s,{channel}azimuth_deg,elevation_deg\n");
        let start = self.pulses[0].time;
        for pulse in &self.pulses {
            let DVec3 { x, y, z } = pulse.position - self.origin;
            let (azimuth, elevation) = (degrees(atan2(x, y)), degrees(atan2(z, hypot(x, y))));
            let channel = if self.channels > 1 { format!("{},", pulse.channel) } else { String::new() };
            // Writing to a string does not fail.
            let _ = writeln!(text, "{:.9},{channel}{azimuth:?},{elevation:?}", pulse.time - start);
        }
        text
    }

    fn pipeline(&self, files: &StillFiles, command: &str) -> String {
        let StillFigures { pulses, channels, duration_s, times_per_s } = self.figures();
        let name =
            files.pattern.file_name().map_or_else(String::new, |name| name.to_string_lossy().into_owned());
        let DVec3 { x, y, z } = self.origin;
        let command = command.replace(['\n', '\r'], " ");
        let until = duration_s + 1.0 / times_per_s;
        let pattern = toml::Value::String(name);
        format!(
            "# {command}\n#\n# {pulses} pulses of {channels} channels in {duration_s:.6} s; pulses without a \
             return are missing.\n# Not observable from the points; set these yourself: divergence, pulse \
             length, energy, range limits.\n\n# scene = \"scene.xml\"         # what is scanned; or vlscan \
             run --scene\n\n[platform]\nkind = \"static\"\n\n[scanner]\noptics = \"pattern\"\npattern = \
             {pattern}\n\n[settings]\nmax_duration_s = {until:?}\n\n[[leg]]\nposition_m = [{x:?}, {y:?}, \
             {z:?}]\n"
        )
    }
}

impl StillFigures {
    /// The figures as text, a line each.
    pub fn table(&self) -> String {
        format!(
            "pulses     {}\nchannels   {}\nduration   {:.6} s\ntimes      {:.1} per second\n",
            self.pulses, self.channels, self.duration_s, self.times_per_s
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str, origin: DVec3) -> std::result::Result<StillPattern, String> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("still.csv");
        std::fs::write(&path, text).unwrap();
        StillPattern::read(&path, origin, &mut Diagnostics::default()).map_err(|e| match e {
            Error::Input(problems) => problems.text(),
            other => other.to_string(),
        })
    }

    #[test]
    fn pulses_point_to_their_first_returns() {
        let text = "x,y,z,time,return_number,number_of_returns\n\
                    1,5,2,10.5,1,1\n2,2,3,10,2,2\n1,3,2,10,1,2\n0,2,2,11,1,1\n";
        let pattern = read(text, DVec3::new(1.0, 2.0, 2.0)).unwrap();
        let lines: Vec<String> = pattern.table().lines().map(str::to_owned).collect();
        assert_eq!(lines[0], "time_s,azimuth_deg,elevation_deg");
        assert_eq!(lines[1..], ["0.000000000,0.0,0.0", "0.500000000,0.0,0.0", "1.000000000,-90.0,0.0"]);
        let figures = pattern.figures();
        assert_eq!(
            (figures.pulses, figures.channels, figures.duration_s, figures.times_per_s),
            (3, 1, 1.0, 2.0)
        );
        let files = StillFiles::new(Path::new("a/still.toml"));
        let pipeline: toml::Table = pattern.pipeline(&files, "vlscan fit").parse().unwrap();
        assert_eq!(pipeline["scanner"]["pattern"].as_str(), Some("still.pattern.csv"));
        assert_eq!(pipeline["settings"]["max_duration_s"].as_float(), Some(1.5));
        assert_eq!(pipeline["leg"][0]["position_m"][1].as_float(), Some(2.0));
    }

    #[test]
    fn clouds_without_a_time_for_each_pulse_are_refused() {
        for (text, words) in [
            ("x,y,z\n1,2,3\n2,3,4\n", "no times"),
            ("x,y,z,time\n1,2,3,5\n2,3,4,5\n", "several pulses"),
            ("x,y,z,time\n1,2,3,5\n", "fewer than two times"),
            ("x,y,z,time\n0,0,0,5\n0,0,0,6\n", "fewer than two times"),
        ] {
            let said = read(text, DVec3::ZERO).map(|_| ()).unwrap_err();
            assert!(said.contains(words), "{text:?}: {said}");
        }
    }
}
