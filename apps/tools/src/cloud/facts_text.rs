//! Facts about a cloud as lines of text and as JSON.

use super::classes::{class_name, class_name_in_old_formats};
use super::facts::CloudSummary;
use super::facts_part::{Span, WEEK_S};
use serde_json::{Value, json};
use std::fmt::Write as _;
use vlscan_base::quantity::{fixed, number};
use vlscan_crs as crs;
use vlscan_formats::{Attribute, FileFacts};

/// Maximum number of flight lines and of files that are listed as text; JSON has all.
const MAX_LISTED: usize = 40;

/// Maximum number of channels that are listed with their points as text.
const MAX_LISTED_CHANNELS: usize = 8;

/// Seconds from the epoch of GPS, 6 January 1980, that adjusted standard GPS time leaves out.
const ADJUSTMENT_S: f64 = 1e9;
/// Days from 1 January 1970 to the epoch of GPS.
const GPS_EPOCH_DAYS: f64 = 3657.0;
const DAY_S: f64 = 86_400.0;
/// Seconds from 1 January 1970 to the beginnings of 1990 and of 2040, between which recordings are likely.
const LIKELY: std::ops::Range<f64> = 631_152_000.0..2_208_988_800.0;

/// A way to count seconds.
pub(super) struct TimeScale {
    name: &'static str,
    /// Seconds from 1 January 1970 to its 0.
    epoch_s: f64,
}

pub(super) const ADJUSTED: TimeScale =
    TimeScale { name: "adjusted standard GPS time", epoch_s: ADJUSTMENT_S + GPS_EPOCH_DAYS * DAY_S };
const GPS: TimeScale = TimeScale { name: "GPS seconds", epoch_s: GPS_EPOCH_DAYS * DAY_S };
const UNIX: TimeScale = TimeScale { name: "Unix time", epoch_s: 0.0 };

impl TimeScale {
    /// True if times are those of likely recordings.
    pub(super) fn is_likely(&self, span: Span) -> bool {
        [span.min, span.max].iter().all(|time| LIKELY.contains(&(time + self.epoch_s)))
    }

    fn dates(&self, span: Span) -> String {
        format!("{} to {}", date(span.min + self.epoch_s), date(span.max + self.epoch_s))
    }
}

/// The dates of times, for each scale by which they are likely: an addition to a message.
pub(super) fn likely_dates(span: Span) -> String {
    let likely = [ADJUSTED, GPS, UNIX].into_iter().filter(|scale| scale.is_likely(span));
    likely.map(|scale| format!("; as {} they are {}", scale.name, scale.dates(span))).collect()
}

impl CloudSummary {
    /// The facts as lines of text.
    pub fn text(&self) -> String {
        let mut out = String::new();
        let mut line = |name: &str, text: String| {
            let _ = writeln!(out, "{name:<15}{text}");
        };
        for (path, file) in self.files.iter().take(MAX_LISTED) {
            line(
                "file",
                format!("{}: {}", path.display(), file.as_ref().map_or_else(String::new, described)),
            );
        }
        if let Some(more) = self.files.len().checked_sub(MAX_LISTED).filter(|more| *more > 0) {
            line("", format!("and {more} more; --json lists all"));
        }
        line("points", self.points.to_string());
        if self.misses > 0 {
            line("misses", format!("{} pulses without a return", self.misses));
        }
        if let Some(b) = self.bounds {
            let axes = [("x", b.min.x, b.max.x), ("y", b.min.y, b.max.y), ("z", b.min.z, b.max.z)];
            for (name, low, high) in axes {
                line(name, format!("{} to {} m ({:.3} m)", fixed(low, 3), fixed(high, 3), high - low));
            }
        }
        line("coordinates", self.crs.as_deref().map_or_else(|| "no system named".to_owned(), crs::name));
        if let Some((area, side)) = self.area() {
            line("area", format!("{} m² in cells of {} m with points", number(area), number(side)));
            let density = |count: u64| number(count as f64 / area);
            let pulses = self.pulses().map(|pulses| format!(", {} pulses/m²", density(pulses)));
            line("density", format!("{} points/m²{}", density(self.points), pulses.unwrap_or_default()));
        }
        let spans = [("intensity", self.intensity, ""), ("scan angle", self.scan_angle, "°")];
        for (name, span, unit) in spans {
            let Some(Span { min, max }) = span else { continue };
            let mean = self.mean_intensity().filter(|_| name == "intensity");
            let mean = mean.map_or_else(String::new, |mean| format!(", {} on average", number(mean)));
            line(name, format!("{} to {}{unit}{mean}", number(min), number(max)));
        }
        if let Some(span) = self.time {
            line(
                "time",
                format!("{} to {} s{}", fixed(span.min, 6), fixed(span.max, 6), self.described_times(span)),
            );
        }
        if let Some((count, is_more)) = self.objects() {
            line("objects", format!("{count}{}", if is_more { " or more" } else { "" }));
        }
        if let Some(channels) = self.channels() {
            line("channels", channels);
        }
        if self.points > 0 {
            self.write_classes(&mut out);
            self.write_returns(&mut out);
            self.write_paths(&mut out);
            self.write_lines(&mut out);
        }
        out
    }

    /// The channels with their points; `None` for a cloud of one.
    fn channels(&self) -> Option<String> {
        let count = self.by_channel.len();
        if count > MAX_LISTED_CHANNELS {
            let (first, last) = (self.by_channel.keys().next()?, self.by_channel.keys().next_back()?);
            let (least, most) = (self.by_channel.values().min()?, self.by_channel.values().max()?);
            return Some(format!("{count}, {first} to {last}, with {least} to {most} points each"));
        }
        let channels: Vec<String> =
            self.by_channel.iter().map(|(channel, points)| format!("{channel}: {points}")).collect();
        (count > 1).then(|| channels.join(", "))
    }

    /// Writes the table of classes.
    fn write_classes(&self, out: &mut String) {
        if !self.has(Attribute::Class) {
            return;
        }
        let _ = writeln!(out, "\nclasses         {:>12}  name", "points");
        for (class, points) in &self.by_class {
            let name = self.class_name(*class).unwrap_or(match *class < 64 || self.has_old_classes() {
                true => "reserved",
                false => "user-defined",
            });
            let _ = writeln!(out, "{class:>15} {points:>12}  {name}");
        }
    }

    /// Writes the table of returns.
    fn write_returns(&self, out: &mut String) {
        if !self.has(Attribute::ReturnNumber) {
            return;
        }
        let _ = writeln!(out, "\nreturns         {:>12}  {:>12}", "points", "pulses of so many");
        let numbers: std::collections::BTreeSet<u8> =
            self.by_return.keys().chain(self.pulses_by_returns.keys()).copied().collect();
        for of in numbers {
            let points = self.by_return.get(&of).copied().unwrap_or(0);
            let pulses = self.pulses_by_returns.get(&of).copied().unwrap_or(0);
            let _ = writeln!(out, "{of:>15} {points:>12}  {pulses:>12}");
        }
    }

    /// Writes the table of paths of the light.
    fn write_paths(&self, out: &mut String) {
        if !self.has(Attribute::Path) {
            return;
        }
        let _ = writeln!(out, "\npaths of light  {:>12}  name", "points");
        for (path, points) in &self.by_path {
            let _ = writeln!(out, "{path:>15} {points:>12}  {}", path_name(*path).unwrap_or("unknown"));
        }
    }

    /// Writes the table of flight lines or legs.
    fn write_lines(&self, out: &mut String) {
        if !self.has(Attribute::Leg) {
            return;
        }
        let heading = if self.lines_are_sources() { "flight lines" } else { "legs" };
        let _ = writeln!(out, "\n{heading:<15} {:>12}  time, s", "points");
        for (number, line) in self.lines.iter().take(MAX_LISTED) {
            let time =
                line.time.map_or_else(String::new, |t| format!("{} to {}", fixed(t.min, 3), fixed(t.max, 3)));
            let _ = writeln!(out, "{number:>15} {:>12}  {time}", line.points);
        }
        if let Some(more) = self.lines.len().checked_sub(MAX_LISTED).filter(|more| *more > 0) {
            let _ = writeln!(out, "{:>15} and {more} more; --json lists all", "");
        }
    }

    /// Kind of the times, and the dates of adjusted standard GPS time.
    fn described_times(&self, span: Span) -> String {
        match self.has_adjusted_times() {
            Some(true) => {
                format!(" (adjusted standard GPS time: {}, without leap seconds)", ADJUSTED.dates(span))
            }
            Some(false) if span.max > WEEK_S => {
                format!(" (of the GPS week, continuing past its end at {WEEK_S} s)")
            }
            Some(false) => " (of the GPS week)".to_owned(),
            None if self.has_wrong_times() => {
                format!(" (not of the GPS week, as the header states{})", likely_dates(span))
            }
            None => String::new(),
        }
    }

    /// The name of a class in the formats of the files.
    fn class_name(&self, class: u8) -> Option<&'static str> {
        if self.has_old_classes() { class_name_in_old_formats(class) } else { class_name(class) }
    }

    /// The facts as a JSON object.
    pub fn json(&self) -> Value {
        let span = |span: Option<Span>| span.map(|span| json!({ "min": span.min, "max": span.max }));
        let file = |(path, file): &(std::path::PathBuf, Option<FileFacts>)| {
            let las = file.as_ref().and_then(|file| file.las.as_ref());
            json!({
                "path": path.display().to_string(),
                "format": file.as_ref().map(format_name),
                "las_version": las.map(|las| format!("{}.{}", las.version.0, las.version.1)),
                "point_format": las.map(|las| las.point_format),
                "scale": las.map(|las| las.scale.to_array()),
                "system": las.map(|las| las.system.clone()),
                "software": las.map(|las| las.software.clone()),
            })
        };
        let (area, pulses) = (self.area(), self.pulses());
        let density = |count: u64| area.map(|(area, _)| count as f64 / area);
        let kind =
            self.has_adjusted_times().map(|is| if is { "adjusted standard GPS time" } else { "GPS week" });
        let dates = self.time.filter(|_| self.has_adjusted_times() == Some(true));
        let line_key = if self.lines_are_sources() { "point_source_id" } else { "leg" };
        json!({
            "files": self.files.iter().map(file).collect::<Vec<_>>(),
            "points": self.points,
            "misses": self.misses,
            "left_out": self.skipped,
            "bounds_m": self.bounds.map(|b| json!({ "min": b.min.to_array(), "max": b.max.to_array() })),
            "crs": self.crs,
            "epsg": self.crs.as_deref().and_then(crs::epsg).map(|(_, code)| code),
            "area_m2": area.map(|(area, _)| area),
            "area_cell_m": area.map(|(_, side)| side),
            "density_per_m2": density(self.points),
            "pulses": pulses,
            "pulse_density_per_m2": pulses.and_then(density),
            "intensity": self.intensity.map(|s| {
                json!({ "min": s.min, "max": s.max, "mean": self.mean_intensity() })
            }),
            "scan_angle_deg": span(self.scan_angle),
            "time_s": span(self.time),
            "time_kind": kind,
            "dates": dates.map(|span| [span.min, span.max].map(|time| date(time + ADJUSTED.epoch_s))),
            "objects": self.objects().map(|(count, _)| count),
            "objects_are_all": self.objects().map(|(_, is_more)| !is_more),
            "channels": self.by_channel.iter()
                .map(|(channel, points)| json!({ "channel": channel, "points": points }))
                .collect::<Vec<_>>(),
            "classes": self.by_class.iter().map(|(class, points)| {
                json!({ "class": class, "name": self.class_name(*class), "points": points })
            }).collect::<Vec<_>>(),
            "paths": self.by_path.iter().map(|(path, points)| {
                json!({ "path": path, "name": path_name(*path), "points": points })
            }).collect::<Vec<_>>(),
            "returns": self.by_return.iter()
                .map(|(number, points)| json!({ "return": number, "points": points }))
                .collect::<Vec<_>>(),
            "pulses_by_returns": self.pulses_by_returns.iter().map(|(returns, pulses)| {
                json!({ "returns": returns, "pulses": pulses })
            }).collect::<Vec<_>>(),
            "flight_lines": self.lines.iter().map(|(number, line)| {
                json!({ line_key: number, "points": line.points, "time_s": span(line.time) })
            }).collect::<Vec<_>>(),
        })
    }
}

/// Name of a path of the light, as the column `Path` numbers it.
fn path_name(path: u8) -> Option<&'static str> {
    const NAMES: [&str; 9] = [
        "straight to the surface",
        "through panes",
        "over mirrors: ghosts",
        "surface of water",
        "column of water",
        "bottom of water",
        "fog, rain, snow or dust",
        "single drops or flakes",
        "straight back from mirrors or panes",
    ];
    NAMES.get(usize::from(path)).copied()
}

/// The name of a file's format: LAZ and COPC are distinguished from LAS.
fn format_name(file: &FileFacts) -> &'static str {
    match &file.las {
        Some(las) if las.is_copc => "COPC",
        Some(las) if las.is_compressed => "LAZ",
        _ => file.format.name(),
    }
}

fn described(file: &FileFacts) -> String {
    let name = format_name(file);
    let Some(las) = &file.las else { return name.to_owned() };
    let (major, minor) = las.version;
    let [x, y, z] = las.scale.to_array().map(number);
    let steps = if x == y && y == z { x } else { format!("{x}, {y}, {z}") };
    let mut text = format!("{name} {major}.{minor}, point format {}, steps of {steps}", las.point_format);
    let by: Vec<&str> =
        [&las.software, &las.system].into_iter().map(String::as_str).filter(|t| !t.is_empty()).collect();
    if !by.is_empty() {
        let _ = write!(text, ", by {}", by.join(", "));
    }
    text
}

/// The date and time of seconds since 1970, as ISO 8601 without a zone: leap seconds are not subtracted.
fn date(seconds: f64) -> String {
    let seconds = seconds.floor();
    let is_number = seconds.abs() < 1e13;
    let time = is_number.then(|| chrono::DateTime::from_timestamp(seconds as i64, 0)).flatten();
    time.map_or_else(|| "?".to_owned(), |time| time.format("%Y-%m-%dT%H:%M:%S").to_string())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn adjusted_times_have_dates() {
        let date = |adjusted_s: f64| date(adjusted_s + ADJUSTED.epoch_s);
        // 2011-09-14T01:46:40 is 10⁹ seconds after the epoch of GPS.
        assert_eq!(date(0.0), "2011-09-14T01:46:40");
        assert_eq!(date(-1e9), "1980-01-06T00:00:00");
        // 29 February 2020 is 14 664 days after that epoch.
        assert_eq!(date(14_664.0 * DAY_S - 1e9 + 3661.5), "2020-02-29T01:01:01");
        assert_eq!(date(f64::NAN), "?");
        assert_eq!(date(1e300), "?");
    }

    #[test]
    fn times_have_the_dates_of_likely_recordings() {
        let said = |seconds: f64| likely_dates(Span { min: seconds, max: seconds + 100.0 });
        let of = |name: &str, seconds: f64| said(seconds).contains(&format!("; as {name} they are"));
        let all =
            |seconds| ["adjusted standard GPS time", "GPS seconds", "Unix time"].map(|n| of(n, seconds));
        for (seconds, expected) in [
            (604_799.0, [true, false, false]),
            (3.1e8, [true, false, false]),
            (1.306e9, [false, true, true]),
            (1.7e9, [false, true, true]),
            (2.1e9, [false, false, true]),
            (1e12, [false; 3]),
        ] {
            assert_eq!(all(seconds), expected, "{seconds}: {}", said(seconds));
        }
        assert!(said(1.306e9).contains("as GPS seconds they are 2021-05-25T"), "{}", said(1.306e9));
    }
}
