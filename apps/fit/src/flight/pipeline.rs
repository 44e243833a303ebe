//! Text of the pipeline file of a fitted flight.

use super::FlightFit;
use super::doubts::Doubt;
use super::mirror::Mirror;
use super::pulses::Pulse;
use super::write::FlightFiles;
use std::fmt::Write as _;
use std::path::Path;
use vlscan_crs::{epsg, height_problem, short_name, unit_problem};
use vlscan_geom::degrees;

/// Reflectance of the target that is assumed to be seen at [`ASSUMED_RANGE`] times the largest recorded
/// range.
const ASSUMED_REFLECTANCE: f64 = 0.1;
const ASSUMED_RANGE: f64 = 1.5;
/// Largest recorded scan angle, over that of the mirror, below which the file names it.
const RECORDED_ANGLES: f64 = 0.9;
/// Number of pulses by which the largest range is found.
const RANGE_PULSES: usize = 10_000;

/// A key of a TOML table.
struct Row {
    key: &'static str,
    /// Value as TOML.
    value: String,
    /// Comment on the line above.
    comment: Option<String>,
    /// True if the key is written as a comment, too.
    is_left_out: bool,
}

impl Row {
    fn new(key: &'static str, value: impl ToString) -> Row {
        Row { key, value: value.to_string(), comment: None, is_left_out: false }
    }

    /// Number with six decimals.
    fn number(key: &'static str, value: f64) -> Row {
        Row::new(key, format_args!("{value:.6}"))
    }

    fn text(key: &'static str, value: &str) -> Row {
        Row::new(key, quoted(value))
    }

    /// Name of a file in the folder of the pipeline file.
    fn path(key: &'static str, path: &Path) -> Row {
        Row::text(key, &path.file_name().unwrap_or_default().to_string_lossy())
    }

    fn with_comment(self, comment: impl Into<String>) -> Row {
        Row { comment: Some(comment.into()), ..self }
    }

    /// The row, or a comment with the reason why its value is not plausible.
    fn unless(self, doubt: Option<&Doubt>) -> Row {
        match doubt {
            Some(doubt) => {
                Row { is_left_out: true, ..self.with_comment(format!("left out: {}", doubt.reason)) }
            }
            None => self,
        }
    }
}

/// Text of a TOML document.
#[derive(Default)]
struct Document(String);

impl Document {
    fn line(&mut self, line: &str) {
        // Writing to a string does not fail.
        let _ = writeln!(self.0, "{line}");
    }

    fn comment(&mut self, comment: &str) {
        let line = if comment.is_empty() { "#".to_owned() } else { format!("# {comment}") };
        self.line(&line);
    }

    /// Adds a table after an empty line.
    fn table(&mut self, header: &str, rows: impl IntoIterator<Item = Row>) {
        self.line("");
        self.line(header);
        rows.into_iter().for_each(|row| self.row(row));
    }

    fn row(&mut self, row: Row) {
        if let Some(comment) = &row.comment {
            self.comment(comment);
        }
        let line = format!("{} = {}", row.key, row.value);
        if row.is_left_out { self.comment(&line) } else { self.line(&line) }
    }
}

impl FlightFit {
    /// Text of the pipeline file.
    pub(super) fn pipeline(&self, files: &FlightFiles, command: &str) -> String {
        let mut document = Document::default();
        self.add_head(&mut document, files, command);
        let comment = self.doubt_of_speed().map(|reason| format!("doubtful: {reason}"));
        document.table("[trajectory]", [Row { comment, ..Row::path("path", &files.trajectory) }]);
        document.table("[platform]", self.platform_rows());
        document.table("[scanner]", self.scanner_rows(files));
        let model = &self.solution.model;
        for number in (0..model.parameters.channels.len()).filter(|_| model.has_channels()) {
            document.table("[[scanner.channel]]", self.channel_rows(number));
        }
        document.table("[settings]", self.setting_rows(files));
        document.table("[[output]]", [Row::path("path", &files.simulated)]);
        document.0
    }

    /// Adds the comments at the beginning, and the keys outside of tables.
    fn add_head(&self, document: &mut Document, files: &FlightFiles, command: &str) {
        document.comment(&command.replace(['\n', '\r'], " "));
        document.comment("");
        document.comment("Estimated, with standard deviations:");
        for figure in self.figures() {
            document.comment(&format!("  {}: {}", figure.name, figure.text()));
        }
        document.comment("");
        if files.wander.is_some() {
            document.comment(
                "A turn of the platform and one of the mirror look alike to a cone: both are in the \
                 mirror's wander.",
            );
        }
        document.comment(
            "Not observable from the points; set these yourself: divergence, pulse length, energy, range \
             limits.",
        );
        document.line("");
        document.comment("scene = \"scene.xml\"         # what is scanned; or vlscan run --scene");
        let Some(wkt) = &self.recording.wkt else {
            document.comment("no crs: the cloud names none, and its coordinates are taken for metres");
            return;
        };
        match unit_problem(wkt).or_else(|| height_problem(wkt)) {
            None => {
                let crs = epsg(wkt).map_or_else(|| wkt.clone(), |(_, code)| format!("EPSG:{code}"));
                document.row(Row::text("crs", &crs));
            }
            // Readers convert lengths to metres.
            Some(problem) => {
                document.comment(&format!("no crs: that of the cloud is {}, but {problem}", short_name(wkt)));
            }
        }
    }

    fn platform_rows(&self) -> [Row; 2] {
        let p = &self.solution.model.parameters;
        // With channels, which have tilts of their own, the tilt of the scanner is in its mount.
        let tilt = match self.solution.model.has_channels() {
            true => format!(", {{ y = {:.6} }}, {{ x = {:.6} }}", degrees(p.roll), degrees(p.pitch)),
            false => String::new(),
        };
        let mount = format!("{{ offset_m = [0, 0, 0], rotate_deg = [{{ x = -90 }}, {{ z = -90 }}{tilt}] }}");
        [
            Row::text("kind", "linear_path"),
            Row::new("mount", mount).with_comment("looking down, and across the flight"),
        ]
    }

    fn scanner_rows(&self, files: &FlightFiles) -> Vec<Row> {
        let (model, p) = (&self.solution.model, &self.solution.model.parameters);
        let scan_angle = Row::number("scan_angle_max_deg", degrees(self.scan_angle()));
        let mut rows = vec![
            Row::text("id", "fitted"),
            Row::text("optics", model.mirror.optics()),
            Row { comment: self.doubt_of_sweeps(), ..scan_angle },
        ];
        if model.mirror == Mirror::EllipticCone {
            rows.push(Row::number("scan_angle_along_max_deg", degrees(p.mirror.angle_along.abs())));
        }
        rows.push(Row::number("scan_freq_max_hz", p.mirror.rate.abs().max(1.0)));
        if !model.has_channels() {
            rows.extend(self.motion_rows(0));
            // The attitudes of the trajectory are deviations from this tilt.
            let tilt = format!("[{:.6}, {:.6}]", -degrees(p.roll), degrees(p.pitch));
            rows.push(Row::new("scan_axis_tilt_deg", tilt));
        }
        rows.extend(files.wander.as_ref().map(|path| Row::path("scan_wander", path)));
        rows.push(Row::new("pulse_freqs_hz", format_args!("[{:.0}]", self.rate.mean)));
        let doubts = self.doubts();
        let doubt = |key: &str| doubts.iter().find(|doubt| doubt.key == key);
        rows.extend(self.noise.map(|noise| {
            Row::new("accuracy_m", format_args!("{:.4}", noise.value))
                .with_comment("with the roughness of the ground, which adds to it")
                .unless(doubt("accuracy_m"))
        }));
        let range = ASSUMED_RANGE * self.largest_range();
        let max_range = format!("{{ range_m = {range:.0}, reflectance = {ASSUMED_REFLECTANCE} }}");
        rows.push(Row::new("max_range", max_range).with_comment(format!(
            "assumed: a target of this reflectance is seen from {ASSUMED_RANGE} times the largest recorded \
             distance, so that no pulse is lost"
        )));
        let returns = self.recording.pulses.iter().map(|pulse| pulse.returns).max().unwrap_or(1);
        rows.push(Row::new("max_returns", returns));
        if self.has_dropouts() {
            let row = Row::new("dropout_rate", format_args!("{:.5}", self.rate.lost));
            let row = row.with_comment(
                "pulses without a point, between others; what reflects too little of a scene is not known",
            );
            rows.push(row.unless(doubt("dropout_rate")));
        }
        rows
    }

    fn channel_rows(&self, number: usize) -> Vec<Row> {
        let channel = &self.solution.model.parameters.channels[number];
        let (pitch, yaw) = (degrees(channel.pitch), degrees(channel.yaw));
        let origin = format!("{{ rotate_deg = [{{ z = {pitch:.6} }}, {{ y = {yaw:.6} }}] }}");
        let mut rows = vec![
            Row::text("id", &format!("channel {}", number + 1)),
            Row::new("beam_origin", origin).with_comment("forward or back, then about the vertical"),
        ];
        rows.extend(self.motion_rows(number));
        rows
    }

    fn setting_rows(&self, files: &FlightFiles) -> Vec<Row> {
        let model = &self.solution.model;
        let mut rows = vec![Row::number("scan_freq_hz", model.parameters.mirror.rate.abs())];
        if model.mirror.is_swinging() {
            rows.push(Row::number("scan_angle_deg", degrees(self.scan_angle())));
        }
        rows.extend(self.unrecorded_angles());
        let pulse_rate = Row::new("pulse_freq_hz", format_args!("{:.0}", self.rate.mean));
        rows.push(Row { comment: self.doubt_of_rate(), ..pulse_rate });
        if let Some(path) = &files.pulse_times {
            rows.push(Row::path("pulse_times", path).with_comment(
                "the rate changes with the place of the mirror, and from line to line; pulses elsewhere \
                 are not known",
            ));
        } else if let Some(doubt) = self.doubts().iter().find(|doubt| doubt.key == "pulse_times") {
            rows.push(Row::text("pulse_times", "").unless(Some(doubt)));
        } else if !self.rate.dither.is_empty() {
            let interval = |factor: &f64| 1e6 * factor / self.rate.mean;
            let intervals = list(self.rate.dither.iter().map(interval));
            rows.push(Row::new("pulse_intervals_us", intervals).with_comment("intervals that repeat"));
        }
        rows
    }

    /// Phase and sense of a channel's mirror, and the tilts of its facets.
    fn motion_rows(&self, number: usize) -> Vec<Row> {
        let model = &self.solution.model;
        let (p, channel) = (&model.parameters.mirror, &model.parameters.channels[number]);
        let phase = degrees(channel.phase);
        let angle = p.angle * channel.sense;
        let (phase, is_reversed) = match model.mirror {
            Mirror::EllipticCone => {
                // Of negative angles: turned by half a revolution, or the other way.
                let (across, phase) =
                    if p.angle_along < 0.0 { (-p.angle, phase + 180.0) } else { (p.angle, phase) };
                let is_mirrored = across < 0.0;
                (if is_mirrored { -phase } else { phase } - 90.0, (p.rate < 0.0) != is_mirrored)
            }
            // The phase of a cone counts from the right, turned by the mount.
            Mirror::Cone => (phase - 90.0, p.rate < 0.0),
            // The phase of a polygon mirror is 0 in the middle of a line.
            Mirror::Polygon if angle < 0.0 => (180.0 - phase, true),
            Mirror::Polygon => (phase - 180.0, false),
            Mirror::Oscillating | Mirror::Turning | Mirror::Sine if angle < 0.0 => (phase + 180.0, false),
            Mirror::Oscillating | Mirror::Turning | Mirror::Sine => (phase, false),
        };
        let mut rows = vec![Row::new("scan_phase_deg", format_args!("{:.5}", phase.rem_euclid(360.0)))];
        if is_reversed {
            rows.push(Row::new("scan_reverse", true));
        }
        match model.mirror {
            Mirror::Sine => rows.push(Row::text("mirror_motion", "sine")),
            Mirror::Turning => rows.push(Row::number("turning_part", p.turning.clamp(0.0, 1.0))),
            _ => {}
        }
        let tilts = &model.parameters.facet_tilts;
        if !tilts.is_empty() {
            // The first pulse is of facet 0, whatever its number here.
            let turns = ((phase.rem_euclid(360.0) - phase) / 360.0).round() as i64;
            let count = tilts.len() as i64;
            let of = |facet: i64| if is_reversed { turns - facet } else { facet - turns };
            // Tilts are positive towards the back, by the mount.
            let tilts = (0..count).map(|facet| -degrees(tilts[of(facet).rem_euclid(count) as usize]));
            rows.push(Row::new("facet_tilts_deg", list(tilts)));
        }
        rows
    }

    /// A comment with the largest recorded scan angle, if a polygon mirror fires well beyond it: a cloud does
    /// not show if the scanner fires no farther, or if a tile ends there.
    fn unrecorded_angles(&self) -> Option<Row> {
        let recorded = degrees(self.recording.pulses.angles().map(f64::abs).fold(0.0, f64::max));
        let is_narrower = recorded < RECORDED_ANGLES * degrees(self.scan_angle());
        let key = Row::new("scan_angle_deg", format_args!("{recorded:.1}"));
        let comment = "recorded scan angles, with the roll, reach this one; set it if the scanner fires no \
                       farther, otherwise pulses leave in all directions of the mirror";
        (self.solution.model.mirror == Mirror::Polygon && is_narrower)
            .then(|| Row { is_left_out: true, ..key.with_comment(comment) })
    }

    /// Largest scan angle of the written scanner, rad.
    fn scan_angle(&self) -> f64 {
        let angle = self.solution.model.parameters.mirror.angle.abs();
        match self.solution.model.mirror {
            Mirror::Polygon => 0.5 * angle,
            Mirror::Oscillating | Mirror::Turning | Mirror::Sine => self.half_angle(),
            Mirror::Cone | Mirror::EllipticCone => angle,
        }
    }

    /// Distance from the platform to the farthest points, m.
    fn largest_range(&self) -> f64 {
        let pulses = &self.recording.pulses;
        let step = pulses.len().div_ceil(RANGE_PULSES).max(1);
        let ranges = pulses.iter().step_by(step);
        let range = |pulse: Pulse| self.solution.model.position(pulse.time).distance(pulse.position);
        ranges.map(range).fold(0.0, f64::max)
    }
}

/// A list of numbers with six decimals.
fn list(values: impl Iterator<Item = f64>) -> String {
    let values: Vec<String> = values.map(|value| format!("{value:.6}")).collect();
    format!("[{}]", values.join(", "))
}

/// A string of TOML.
fn quoted(text: &str) -> String {
    toml::Value::String(text.to_owned()).to_string()
}

#[cfg(test)]
mod tests;
