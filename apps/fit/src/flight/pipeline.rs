//! Text of the pipeline file of a fitted flight.

use super::FlightFit;
use super::doubts::Doubt;
use super::mirror::Mirror;
use super::recording::Pulse;
use super::write::FlightFiles;
use std::fmt::Write as _;
use std::path::Path;
use vlscan_crs::{epsg, short_name, unit_problem};
use vlscan_geom::degrees;

/// Reflectance of the target that is assumed to be seen at [`ASSUMED_RANGE`] times the largest recorded
/// range.
const ASSUMED_REFLECTANCE: f64 = 0.1;
const ASSUMED_RANGE: f64 = 1.5;
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
        document.table("[trajectory]", [Row::path("path", &files.trajectory)]);
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
        match unit_problem(wkt) {
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
        rows.push(Row::new("pulse_freq_hz", format_args!("{:.0}", self.rate.mean)));
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
        let range = |pulse: &Pulse| self.solution.model.position(pulse.time).distance(pulse.position);
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
mod tests {
    use super::super::{
        Attitude, Channel, MirrorParameters, Model, Parameters, PulseRate, RangeScatter, Recording, Solution,
    };
    use super::*;
    use std::path::PathBuf;
    use vlscan_geom::{DVec3, radians};

    #[test]
    fn tables_follow_an_empty_line_and_comments_precede_their_key() {
        let mut document = Document::default();
        document.comment("made by a test");
        document.comment("");
        document.row(Row::text("crs", "EPSG:25832"));
        let rows = [
            Row::number("speed", 0.5),
            Row::new("is_fast", false).with_comment("not yet"),
            Row::new("list", list([1.0, 2.0].into_iter())),
        ];
        document.table("[platform]", rows);
        let expected = "# made by a test\n#\ncrs = \"EPSG:25832\"\n\n\
                        [platform]\nspeed = 0.500000\n# not yet\nis_fast = false\n\
                        list = [1.000000, 2.000000]\n";
        assert_eq!(document.0, expected);
    }

    #[test]
    fn strings_are_quoted_as_toml() {
        for text in ["plain", "a \"b\"", "c:\\d\n'e'"] {
            let read: toml::Table = format!("key = {}", quoted(text)).parse().unwrap();
            assert_eq!(read["key"].as_str(), Some(text));
        }
    }

    /// The pipeline file of a flight of 2000 pulses at 100 kHz, as text and as read.
    fn written(mirror: Mirror, change: impl Fn(&mut Parameters)) -> (String, toml::Table) {
        written_with(mirror, change, false)
    }

    const NOISE: f64 = 0.02;

    /// The pipeline file of a flight over surfaces of different roughness if `is_mixed`.
    fn written_with(
        mirror: Mirror,
        change: impl Fn(&mut Parameters),
        is_mixed: bool,
    ) -> (String, toml::Table) {
        let mut parameters = Parameters {
            position: DVec3::new(0.0, 0.0, 500.0),
            velocity: DVec3::new(0.0, 40.0, 0.0),
            roll: radians(1.0),
            pitch: radians(2.0),
            mirror: MirrorParameters { angle: radians(40.0), rate: 60.0, ..MirrorParameters::default() },
            channels: vec![Channel { phase: 1.0, ..Channel::default() }],
            ..Parameters::default()
        };
        change(&mut parameters);
        let deviations = parameters.filled(0.01);
        let model = Model { mirror, parameters };
        let attitude = Attitude::default();
        let pulse = |k: u32| {
            let time = 1e-5 * f64::from(k);
            let at = model.footprint(&attitude, 0, time, 0.0);
            Pulse {
                time,
                position: DVec3::new(at.x, at.y, 0.0),
                angle: at.angle,
                returns: 3,
                class: 2,
                last: None,
                file_channel: 0,
                channel: 0,
            }
        };
        let recording = Recording::new((0..2000).map(pulse).collect()).unwrap();
        let solution = Solution {
            model: model.clone(),
            deviations,
            times: vec![0.0],
            attitudes: vec![attitude],
            residual: 0.01,
            angle_residual: 1e-4,
        };
        let rate = PulseRate::of(&recording, &solution);
        let cloud = PathBuf::from("line.laz");
        let noise = RangeScatter { value: NOISE, deviation: 0.001, is_mixed };
        let fit = FlightFit { cloud, recording, solution, rate, noise: Some(noise), extend: 0.0 };
        let files = FlightFiles {
            pipeline: PathBuf::from("folder/fit.toml"),
            trajectory: PathBuf::from("folder/fit.trajectory.csv"),
            wander: (mirror == Mirror::Cone).then(|| PathBuf::from("folder/fit.wander.txt")),
            pulse_times: None,
            simulated: PathBuf::from("folder/fit.simulated.laz"),
        };
        let text = fit.pipeline(&files, "vlscan fit line.laz\n-o fit.toml");
        let read = text.parse().unwrap();
        (text, read)
    }

    #[test]
    fn a_cone_has_a_wander_and_a_tilt_of_its_axis() {
        let (text, read) = written(Mirror::Cone, |p| p.mirror.rate = -60.0);
        assert!(
            text.starts_with(
                "# vlscan fit line.laz -o fit.toml\n#\n# Estimated, with standard deviations:\n"
            )
        );
        for line in [
            "# Not observable from the points; set these yourself: divergence, pulse length, energy, range \
             limits.",
            "# looking down, and across the flight\nmount = ",
            "# with the roughness of the ground, which adds to it\naccuracy_m = 0.0200",
            "are in the mirror's wander.\n",
        ] {
            assert!(text.contains(line), "{line}: {text}");
        }
        let scanner = &read["scanner"];
        assert_eq!(scanner["optics"].as_str(), Some("conic"));
        assert_eq!(scanner["scan_wander"].as_str(), Some("fit.wander.txt"));
        assert_eq!(scanner["scan_reverse"].as_bool(), Some(true));
        assert_eq!(scanner["max_returns"].as_integer(), Some(3));
        let phase = scanner["scan_phase_deg"].as_float().unwrap();
        assert!((phase - (degrees(1.0) + 270.0)).abs() < 1e-4, "{phase}");
        let tilt = scanner["scan_axis_tilt_deg"].as_array().unwrap();
        assert_eq!((tilt[0].as_float(), tilt[1].as_float()), (Some(-1.0), Some(2.0)));
        assert_eq!(read["settings"]["scan_freq_hz"].as_float(), Some(60.0));
        assert_eq!(read["trajectory"]["path"].as_str(), Some("fit.trajectory.csv"));
        assert_eq!(read["output"][0]["path"].as_str(), Some("fit.simulated.laz"));
    }

    #[test]
    fn an_estimate_that_is_not_plausible_is_a_comment_with_the_reason() {
        let (text, read) = written_with(Mirror::Cone, |_| {}, true);
        assert!(read["scanner"].get("accuracy_m").is_none(), "{text}");
        assert!(text.contains("# left out: points without class 2"), "{text}");
        assert!(text.contains("\n# accuracy_m = 0.0200\n"), "{text}");
        let (text, read) = written(Mirror::Cone, |_| {});
        assert!(read["scanner"].get("accuracy_m").is_some() && !text.contains("left out"), "{text}");
    }

    #[test]
    fn channels_have_tables_and_the_tilt_is_in_the_mount() {
        let (text, read) = written(Mirror::Polygon, |p| {
            p.channels[0].yaw = 0.1;
            p.channels.push(Channel { phase: 2.0, yaw: -0.1, pitch: 0.0, sense: -1.0 });
        });
        let scanner = read["scanner"].as_table().unwrap();
        assert!(
            !scanner.contains_key("scan_axis_tilt_deg") && !scanner.contains_key("scan_phase_deg"),
            "{text}"
        );
        assert_eq!(scanner["scan_angle_max_deg"].as_float(), Some(20.0));
        let channels = scanner["channel"].as_array().unwrap();
        assert_eq!(channels.len(), 2);
        assert_eq!(channels[1]["id"].as_str(), Some("channel 2"));
        // Lines of the second channel go the other way.
        let is_reversed = channels.iter().map(|channel| channel.get("scan_reverse").is_some());
        assert_eq!(is_reversed.collect::<Vec<_>>(), [false, true]);
        assert_eq!(read["platform"]["mount"]["rotate_deg"].as_array().map(Vec::len), Some(4));
        assert!(text.contains("# forward or back, then about the vertical\nbeam_origin = "), "{text}");
        assert!(text.contains("#   yaw of channel 2: "), "{text}");
    }

    #[test]
    fn tilts_of_facets_follow_the_sense_of_the_mirror() {
        let tilts = |angle: f64| {
            let (_, read) = written(Mirror::Polygon, |p| {
                p.mirror.angle = angle;
                p.facet_tilts = [1.0, 2.0, 3.0].map(radians).to_vec();
            });
            let tilts = read["scanner"]["facet_tilts_deg"].as_array().unwrap();
            tilts.iter().map(|tilt| tilt.as_float().unwrap()).collect::<Vec<f64>>()
        };
        assert_eq!(tilts(-0.7), [-1.0, -3.0, -2.0]);
        // The written phase is a whole line later, so that the first line is of the last facet.
        assert_eq!(tilts(0.7), [-3.0, -1.0, -2.0]);
    }
}
