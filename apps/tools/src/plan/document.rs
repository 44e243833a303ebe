//! The pipeline file of a plan.

use super::beams::QuarterTurns;
use super::lines::PlanLine;
use super::reach::Reach;
use std::fmt::Write as _;
use vlscan_geom::DVec3;

/// A waypoint: where a leg begins.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Waypoint {
    /// World position, m.
    pub position: DVec3,
    /// m/s.
    pub speed: Option<f64>,
    /// True if the scanner fires on the way to the next waypoint.
    pub active: bool,
    /// True if z is taken from the ground.
    pub on_ground: bool,
    /// Legs of one strip share their output.
    pub strip: Option<String>,
}

/// A mount that replaces that of the platform.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Turned {
    /// Position of the scanner on the platform, m.
    pub offset: DVec3,
    /// How the scanner is turned.
    pub turns: QuarterTurns,
}

/// Figures that a plan of a flight states for flat ground.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Promise {
    /// Mean over the area of the parallel lines, pulses/m².
    pub density: f64,
    /// Width of a strip, m.
    pub width: f64,
    /// Height of the flight above the ground, m.
    pub height: f64,
}

/// A planned survey.
#[derive(Clone, Debug, Default)]
pub struct PlannedSurvey {
    /// Figures of the plan, a line each.
    pub comments: Vec<String>,
    /// Warnings, which are comments in the plan, too.
    pub warnings: Vec<String>,
    /// Reference to the scene, if it is known.
    pub scene: Option<String>,
    /// System of the coordinates, if it is stated besides the scene's: an EPSG code or WKT.
    pub crs: Option<String>,
    /// Reference to the platform.
    pub platform: String,
    /// The mount of the scanner, if it is not the platform's.
    pub turned: Option<Turned>,
    /// Reference to the scanner.
    pub scanner: String,
    /// Keys of `[settings]`.
    pub settings: Vec<(&'static str, f64)>,
    /// Legs.
    pub waypoints: Vec<Waypoint>,
    /// Lines on which the scanner fires, once the ground is known.
    pub lines: Vec<PlanLine>,
    /// System of the coordinates as WKT, of the scene or as [`crs`](Self::crs) states it.
    pub wkt: Option<String>,
    /// Figures against which the flight is checked; `None` for other plans.
    pub promise: Option<Promise>,
    /// The ground that each device of its scanner measures.
    pub reaches: Vec<Reach>,
}

impl PlannedSurvey {
    /// Length of the way along all waypoints, m.
    pub fn length(&self) -> f64 {
        self.waypoints.windows(2).map(|pair| pair[0].position.distance(pair[1].position)).sum()
    }

    /// The pipeline file (TOML). `command` is the command line that made it.
    pub fn text(&self, command: &str) -> String {
        let mut out = String::new();
        // Writing to a string does not fail.
        let mut line = |text: std::fmt::Arguments| {
            let _ = writeln!(out, "{text}");
        };
        line(format_args!("# {}", command.replace(['\n', '\r'], " ")));
        line(format_args!("#"));
        for comment in &self.comments {
            line(format_args!("# {comment}"));
        }
        for warning in &self.warnings {
            line(format_args!("# warning: {warning}"));
        }
        line(format_args!(""));
        match &self.scene {
            Some(scene) => line(format_args!("scene = {}", quoted(scene))),
            None => {
                line(format_args!("# scene = \"scene.xml\"         # what is scanned; or vlscan run --scene"))
            }
        }
        if let Some(crs) = &self.crs {
            line(format_args!("crs = {}", quoted(crs)));
        }
        line(format_args!("\n[platform]\ncatalogue = {}", quoted(&self.platform)));
        if let Some(Turned { offset, turns }) = &self.turned {
            let [x, y, z] = offset.to_array().map(setting);
            let steps: Vec<String> =
                turns.steps().map(|(axis, angle)| format!("{{ {axis} = {angle} }}")).collect();
            let rotation = match steps.is_empty() {
                true => String::new(),
                false => format!(", rotate_deg = [{}]", steps.join(", ")),
            };
            line(format_args!("mount = {{ offset_m = [{x}, {y}, {z}]{rotation} }}"));
        }
        line(format_args!("\n[scanner]\ncatalogue = {}", quoted(&self.scanner)));
        line(format_args!("\n[settings]"));
        for (key, value) in &self.settings {
            line(format_args!("{key} = {}", setting(*value)));
        }
        for waypoint in &self.waypoints {
            let [x, y, z] = waypoint.position.to_array().map(|v| number(v, 4));
            line(format_args!("\n[[leg]]\nposition_m = [{x}, {y}, {z}]"));
            if let Some(speed) = waypoint.speed {
                line(format_args!("speed_m_per_s = {}", setting(speed)));
            }
            if waypoint.on_ground {
                line(format_args!("on_ground = true"));
            }
            if !waypoint.active {
                line(format_args!("active = false"));
            }
            if let Some(strip) = &waypoint.strip {
                line(format_args!("strip = {}", quoted(strip)));
            }
        }
        out
    }
}

/// A number with at most this many decimals; whole numbers without a point, which suits keys of both types.
fn number(value: f64, decimals: usize) -> String {
    let text = format!("{value:.decimals$}");
    let short = if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.') } else { &text };
    if short == "-0" { "0".to_owned() } else { short.to_owned() }
}

/// A number with at most nine significant digits, however small it is.
fn setting(value: f64) -> String {
    let rounded: f64 = format!("{value:.8e}").parse().unwrap_or(value);
    // -0 is 0.
    (rounded + 0.0).to_string()
}

/// A TOML basic string.
fn quoted(text: &str) -> String {
    toml::Value::String(text.to_owned()).to_string()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn settings_keep_nine_digits() {
        for (value, text) in [
            (-0.0, "0"),
            (4e-7, "0.0000004"),
            (-1.234_567_891_2e-4, "-0.000123456789"),
            (80.25, "80.25"),
            (59.999_999_999_999_99, "60"),
            (2e6, "2000000"),
        ] {
            assert_eq!(setting(value), text);
        }
    }

    #[test]
    fn text_is_toml() {
        let document = PlannedSurvey {
            comments: vec!["two legs".to_owned()],
            scene: Some("a \"b\"\\c.xml".to_owned()),
            platform: "data/platforms.xml#sr22".to_owned(),
            scanner: "data/scanners_als.xml#x".to_owned(),
            turned: Some(Turned {
                offset: DVec3::new(0.0, 0.0, 0.2),
                turns: QuarterTurns([-90.0, 0.0, 180.0]),
            }),
            settings: vec![("pulse_freq_hz", 100_000.0), ("scan_freq_hz", 80.25)],
            waypoints: vec![
                Waypoint { position: DVec3::new(0.5, -1e-9, 100.0), active: true, ..Waypoint::default() },
                Waypoint { on_ground: true, ..Waypoint::default() },
            ],
            ..PlannedSurvey::default()
        };
        let text = document.text("vlscan plan\nrm -r /");
        let read: toml::Table = text.parse().unwrap();
        assert_eq!(read["scene"].as_str(), document.scene.as_deref());
        assert_eq!(read["settings"]["pulse_freq_hz"].as_integer(), Some(100_000));
        let turns = read["platform"]["mount"]["rotate_deg"].as_array().unwrap();
        assert_eq!((turns[0]["x"].as_integer(), turns[1]["z"].as_integer()), (Some(-90), Some(180)));
        let legs = read["leg"].as_array().unwrap();
        assert_eq!(legs[0]["position_m"].to_string(), "[0.5, 0, 100]");
        assert_eq!((legs[1]["on_ground"].as_bool(), legs[1]["active"].as_bool()), (Some(true), Some(false)));
    }
}
