//! The scan pattern of a sensor that stood still while it recorded.
//!
//! A pulse points from the sensor to its first return. Pulses without a return are not in a recording, and so
//! not in the pattern.

use crate::limit::{DEFAULT_MEMORY, PointLimit};
use crate::rows::{Row, Rows, Within, point_bytes};
use libm::{atan2, hypot};
use serde::Serialize;
use std::any::Any;
use std::collections::BTreeSet;
use std::fmt::Write as _;
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use vlscan_base::diag::Diagnostics;
use vlscan_base::error::{Error, Result};
use vlscan_base::files::reads::refuse_input_of;
use vlscan_base::files::{FileGroup, FileWriter, Patched, refuse_unwritable};
use vlscan_formats::{
    Attribute, AttributeSet, FileFacts, LasFacts, NewPart, PointPart, PointRow, PointSink, PositionSteps,
    Selection, read_points,
};
use vlscan_geom::{DVec3, degrees};

/// Maximum number of pulses of a pattern.
const MAX_PULSES: usize = 1 << 24;
/// Distance from the sensor up to which a point has no direction, m.
const MIN_RANGE: f64 = 1e-3;
/// Extension of the pattern beside the pipeline file.
const PATTERN: &str = "pattern.csv";
/// Bytes of the table that are written together.
const WRITTEN_BYTES: usize = 1 << 16;

/// The scan pattern of a recording.
#[derive(Clone, Debug)]
pub struct StillPattern {
    /// World position of the sensor, m.
    origin: DVec3,
    /// First returns of pulses by time, then channel; no two of a channel have one time.
    pulses: Rows,
    channels: usize,
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

/// The values of a point that counts for a sensor at `origin`.
fn row_of(row: &PointRow, origin: DVec3) -> Option<Row> {
    let is_placed = row.position.is_finite() && (row.position - origin).length() > MIN_RANGE;
    (!row.is_miss && is_placed && row.time.is_finite()).then_some(Row {
        time: row.time,
        position: row.position,
        angle: 0.0,
        source: 0,
        number: row.return_number,
        returns: 0,
        class: 0,
        channel: row.channel,
    })
}

/// The points of a block that count.
struct PatternPart {
    origin: DVec3,
    rows: Vec<Row>,
}

impl PointPart for PatternPart {
    fn add(&mut self, row: &PointRow) {
        self.rows.extend(row_of(row, self.origin));
    }

    fn takes_names(&self) -> bool {
        true
    }

    fn clear(&mut self) {
        self.rows.clear();
    }
}

/// Takes the points of a recording.
struct Points {
    origin: DVec3,
    attributes: AttributeSet,
    steps: Option<PositionSteps>,
    rows: Rows,
    max_memory: u64,
    /// True if there are more points than the memory allows.
    is_too_large: bool,
}

impl Points {
    fn limit(&self) -> PointLimit {
        PointLimit::new(Some(self.max_memory), point_bytes(self.steps.as_ref()))
    }

    fn keep(&mut self, rows: &[Row]) -> ControlFlow<()> {
        for row in rows {
            self.is_too_large |= self.limit().is_exceeded(self.rows.len() + 1);
            if self.is_too_large {
                return ControlFlow::Break(());
            }
            self.rows.push(row);
        }
        ControlFlow::Continue(())
    }
}

impl PointSink for Points {
    fn start(&mut self, attributes: AttributeSet) {
        self.attributes = attributes;
        self.rows = Rows::with_room(0, self.steps);
    }

    fn file(&mut self, facts: &FileFacts) {
        self.steps = facts.las.as_ref().map(LasFacts::steps);
    }

    fn parts(&self) -> Option<NewPart> {
        let origin = self.origin;
        Some(Box::new(move || -> Box<dyn PointPart> { Box::new(PatternPart { origin, rows: Vec::new() }) }))
    }

    fn add_part(&mut self, part: &mut (dyn PointPart + 'static)) -> Result<ControlFlow<()>> {
        let part: &mut dyn Any = part;
        let part = part.downcast_ref::<PatternPart>();
        Ok(part.map_or(ControlFlow::Continue(()), |part| self.keep(&part.rows)))
    }

    fn point(&mut self, row: &PointRow, _object: Option<&str>) -> Result<ControlFlow<()>> {
        let row = row_of(row, self.origin);
        Ok(self.keep(row.as_slice()))
    }

    fn selection(&self) -> Selection {
        use Attribute::{Channel, ReturnNumber, Time};
        let is_used = |attribute| matches!(attribute, Channel | ReturnNumber | Time);
        Selection::Attributes(AttributeSet::of(is_used))
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
    /// [`Error::Input`]: a file exists and `force` is not set, or is the recorded cloud, or has no folder.
    pub fn check(&self, cloud: &Path, force: bool) -> Result<()> {
        self.all().try_for_each(|path| {
            refuse_unwritable(path, force)?;
            refuse_input_of(path, [cloud])
        })
    }

    /// All files, the pipeline first.
    pub fn all(&self) -> impl Iterator<Item = &PathBuf> {
        [&self.pipeline, &self.pattern].into_iter()
    }
}

impl StillPattern {
    /// Reads the pattern of a sensor that stood at `origin`, m, while it recorded `cloud`. Points may take up
    /// to `max_memory`, bytes; 1 GiB by default.
    ///
    /// # Errors
    /// Files that cannot be read; [`Error::Input`] for clouds without times, with several pulses of one time,
    /// with too few or too many pulses, or whose points need more memory.
    pub fn read(
        cloud: &Path,
        origin: DVec3,
        max_memory: Option<u64>,
        found: &mut Diagnostics,
    ) -> Result<StillPattern> {
        let mut points = Points {
            origin,
            attributes: AttributeSet::default(),
            steps: None,
            rows: Rows::default(),
            max_memory: max_memory.unwrap_or(DEFAULT_MEMORY),
            is_too_large: false,
        };
        found.extend(read_points(cloud, &mut points)?);
        if points.is_too_large {
            return Err(points.limit().error(cloud));
        }
        let name = cloud.display();
        if !points.attributes.has(Attribute::Time) {
            return Err(Error::input(format!("{name} has no times of points, expected those of pulses")));
        }
        let pulses = first_returns(points.rows).map_err(|row| {
            let message =
                format!("{name}: several pulses of channel {} have the time {}", row.channel, row.time);
            let help = "record the time of each pulse, and the channels of sensors with several";
            Error::input_with_help(message, help)
        })?;
        let times = pulses.times.first().zip(pulses.times.last()).map(|(first, last)| last - first);
        if times.is_none_or(|duration| duration <= 0.0) {
            return Err(Error::input(format!("{name} has fewer than two times of pulses")));
        }
        if pulses.len() > MAX_PULSES {
            let message = format!("{name} has {} pulses, a pattern has at most {MAX_PULSES}", pulses.len());
            return Err(Error::input_with_help(message, "cut a part of the recording"));
        }
        let channels: BTreeSet<u16> = pulses.iter().map(|pulse| pulse.channel).collect();
        Ok(StillPattern { origin, pulses, channels: channels.len() })
    }

    /// Figures of the pattern.
    pub fn figures(&self) -> StillFigures {
        let times = &self.pulses.times;
        let duration_s = times[times.len() - 1] - times[0];
        let changes = times.windows(2).filter(|pair| pair[1] > pair[0]).count();
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
        let mut table = FileWriter::create(&files.pattern, force, Patched::Never)?;
        self.write_table(|text| table.append(text.as_bytes()))?;
        group.add(table);
        group.write(&files.pipeline, force, self.pipeline(files, command).as_bytes())?;
        group.commit()
    }

    /// Passes the table of directions to `write`, in parts.
    fn write_table(&self, mut write: impl FnMut(&str) -> Result<()>) -> Result<()> {
        let channel = if self.channels > 1 { "channel," } else { "" };
        let mut text = format!("time_s,{channel}azimuth_deg,elevation_deg\n");
        let start = self.pulses.times[0];
        for pulse in self.pulses.iter() {
            if text.len() >= WRITTEN_BYTES {
                write(&text)?;
                text.clear();
            }
            let DVec3 { x, y, z } = pulse.position - self.origin;
            let (azimuth, elevation) = (degrees(atan2(x, y)), degrees(atan2(z, hypot(x, y))));
            let channel = if self.channels > 1 { format!("{},", pulse.channel) } else { String::new() };
            // Writing to a string does not fail.
            let _ = writeln!(text, "{:.9},{channel}{azimuth:?},{elevation:?}", pulse.time - start);
        }
        write(&text)
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

/// The first return of each pulse, by time and channel.
///
/// # Errors
/// A return whose time and channel are those of another pulse.
fn first_returns(mut rows: Rows) -> std::result::Result<Rows, Row> {
    rows.sort_by_time(Within::ChannelsAndNumbers);
    let (mut kept, mut other) = (0, None);
    for i in 0..rows.len() {
        let row = rows.get(i);
        let first = (kept > 0).then(|| rows.get(kept - 1));
        let first = first.filter(|first| first.time == row.time && first.channel == row.channel);
        match first {
            Some(first) if first.number == row.number && first.position != row.position => {
                other.get_or_insert(row);
            }
            Some(_) => {}
            None => {
                rows.copy(i, kept);
                kept += 1;
            }
        }
    }
    rows.truncate(kept);
    other.map_or(Ok(rows), Err)
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
        read_file(&path, origin, None)
    }

    fn read_file(
        path: &Path,
        origin: DVec3,
        max_memory: Option<u64>,
    ) -> std::result::Result<StillPattern, String> {
        StillPattern::read(path, origin, max_memory, &mut Diagnostics::default()).map_err(|e| match e {
            Error::Input(problems) => problems.text(),
            other => other.to_string(),
        })
    }

    fn table(pattern: &StillPattern) -> String {
        let mut table = String::new();
        pattern
            .write_table(|text| {
                table.push_str(text);
                Ok(())
            })
            .unwrap();
        table
    }

    #[test]
    fn pulses_point_to_their_first_returns() {
        let text = "x,y,z,time,return_number,number_of_returns\n\
                    1,5,2,10.5,1,1\n2,2,3,10,2,2\n1,3,2,10,1,2\n0,2,2,11,1,1\n";
        let pattern = read(text, DVec3::new(1.0, 2.0, 2.0)).unwrap();
        let lines: Vec<String> = table(&pattern).lines().map(str::to_owned).collect();
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
    fn points_in_any_order_make_one_pattern_which_is_written_in_parts() {
        let row = |i: u32, number: u32| format!("{},5,{number},{},{number},2\n", i % 50, f64::from(i) / 8.0);
        let head = "x,y,z,time,return_number,number_of_returns\n";
        let rows: Vec<String> = (0..3000).flat_map(|i| [row(i, 1), row(i, 2)]).collect();
        let reversed: String = rows.iter().rev().cloned().collect();
        let [pattern, other] = [rows.concat(), reversed].map(|rows| {
            let pattern = read(&(head.to_owned() + &rows), DVec3::ZERO).unwrap();
            assert_eq!((pattern.pulses.len(), pattern.figures().times_per_s), (3000, 8.0));
            table(&pattern)
        });
        assert!(pattern == other && pattern.len() > WRITTEN_BYTES, "{} bytes", pattern.len());
        assert_eq!(pattern.lines().count(), 3001);
    }

    #[test]
    fn the_memory_of_points_can_be_limited() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("still.csv");
        let rows: String = (0..100).map(|i| format!("{i},5,1,{i}\n")).collect();
        std::fs::write(&path, "x,y,z,time\n".to_owned() + &rows).unwrap();
        let pattern = read_file(&path, DVec3::ZERO, Some(100 * point_bytes(None))).unwrap();
        assert_eq!(pattern.pulses.len(), 100);
        let said = read_file(&path, DVec3::ZERO, Some(99 * point_bytes(None))).unwrap_err();
        assert!(said.contains("--max-memory"), "{said}");
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
