//! The facts about a survey and its scene that outputs depend on.

use serde::{Deserialize, Serialize};
use std::f64::consts::{PI, TAU};
use vlscan_geom::{Aabb, DVec3, LIGHT_SPEED};
use vlscan_scene::Scene;
use vlscan_survey::{Deflector, Leg, PlatformKind, Scanner, Survey};

/// All facts about the survey and the scene of the first epoch that outputs need: formats, headers and names
/// of files follow from it and from the request alone.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct OutputContext {
    /// Name of the survey, or of its file if it has none.
    pub survey: String,
    /// Legs in document order, inactive ones included.
    pub legs: Vec<OutputLeg>,
    /// Display name of the scanner.
    pub scanner: String,
    /// True if the platform stands still in each leg.
    pub stands: bool,
    /// Devices of the scanner in firing order.
    pub devices: Vec<OutputDevice>,
    /// Coordinate reference system as WKT, if the input names one.
    pub crs: Option<String>,
    /// World position of the scene frame's origin, m.
    pub shift: DVec3,
    /// Box around the scene, scene frame, m.
    pub bounds: Aabb,
    /// Ids of the scene's parts.
    pub parts: Vec<String>,
    /// The highest class of the scene's materials.
    pub highest_class: i32,
    /// Metres of range per nanosecond of the times of waveforms: of one way, or of the way there and back.
    pub metres_per_ns: f64,
    /// The time that times of records count from, s, along a trajectory in adjusted standard GPS time; 0
    /// where they are seconds of the week.
    pub time_origin: f64,
    /// True if the scene is available, from whose ground heights are measured; false if the facts come from
    /// shards.
    #[serde(skip)]
    pub has_ground: bool,
}

/// A leg.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct OutputLeg {
    /// Number in the survey, from 0.
    pub number: u32,
    /// True if the scanner fires.
    pub active: bool,
    /// Legs of the same strip share their files.
    pub strip: Option<String>,
    /// Duration of a revolution of the scanner's head, or of a mirror that sees all around, from 20 ms to 1
    /// s, in s.
    pub revolution_s: Option<f64>,
}

/// A device of the scanner.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct OutputDevice {
    /// Id in names of files.
    pub id: String,
    /// Width of the waveform's bins, ns.
    pub bin: f64,
    /// Row by elevation, from the lowest channel up.
    pub ring: u16,
}

impl OutputContext {
    /// Collects the facts from a survey and its first scene.
    pub fn new(survey: &Survey, scene: &Scene) -> OutputContext {
        let file = || survey.path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        let leg = |leg: &Leg| OutputLeg {
            number: leg.number,
            active: leg.scanner.active,
            strip: leg.strip.clone(),
            revolution_s: revolution(&survey.scanner, leg),
        };
        OutputContext {
            survey: if survey.name.is_empty() { file() } else { survey.name.clone() },
            legs: survey.legs.iter().map(leg).collect(),
            scanner: survey.scanner.name.clone(),
            stands: matches!(survey.platform.kind, PlatformKind::Static),
            devices: survey
                .scanner
                .devices
                .iter()
                .zip(survey.scanner.rings())
                .map(|(device, ring)| OutputDevice { id: device.id.clone(), bin: device.waveform.bin, ring })
                .collect(),
            crs: survey.crs_wkt.clone(),
            shift: scene.shift,
            bounds: scene.bounds,
            parts: scene.parts.iter().map(|part| part.id.clone()).collect(),
            highest_class: scene.materials.iter().map(|m| m.classification).max().unwrap_or(0),
            metres_per_ns: LIGHT_SPEED,
            time_origin: 0.0,
            has_ground: true,
        }
    }

    /// The facts where times of waveforms are those of the way there and back if `two_way` is set.
    pub fn with_times(self, two_way: bool) -> OutputContext {
        OutputContext { metres_per_ns: if two_way { LIGHT_SPEED * 0.5 } else { LIGHT_SPEED }, ..self }
    }
}

/// Duration of a revolution of a spinning scanner, by its first device, s: that of a mirror that sees all
/// around, or of the head. Revolutions of other lengths are not frames: lines of airborne scanners, scans of
/// terrestrial ones.
fn revolution(scanner: &Scanner, leg: &Leg) -> Option<f64> {
    let device = scanner.devices.first()?;
    let mirror = match device.deflector {
        Deflector::Polygon { effective_max, .. } if effective_max >= PI * (1.0 - 1e-9) => {
            leg.scanner.scan_freq
        }
        _ => 0.0,
    };
    let head = leg.scanner.head_rate.abs().min(device.head.max_rate.abs()) / TAU;
    let is_frame = |hz: &f64| (1.0 - 1e-9..=50.0 + 1e-9).contains(hz);
    [mirror, head].into_iter().find(is_frame).map(|hz| 1.0 / hz)
}

#[cfg(test)]
mod tests {
    use super::*;
    use vlscan_survey::{catalogue, testkit};

    #[test]
    fn frames_are_revolutions_of_spinning_scanners() {
        let (known, _) = catalogue().unwrap();
        let revolution = |id: &str, scan_freq: f64, head_rate: f64| {
            let (_, scanner) = known.scanners.iter().find(|(name, _)| name.ends_with(id)).unwrap();
            let settings = testkit::scanner_settings(1000);
            let mut leg = testkit::leg(0, settings);
            (leg.scanner.scan_freq, leg.scanner.head_rate) = (scan_freq, head_rate);
            super::revolution(scanner, &leg)
        };
        assert_eq!(revolution("#vlp16", 0.0, 10.0 * TAU), Some(0.1));
        assert_eq!(revolution("#hovermap", 10.0, 0.5 * TAU), Some(0.1));
        // Lines of an airborne scanner, and a terrestrial one.
        assert_eq!(revolution("#riegl_vux-1uav", 100.0, 0.0), None);
        assert_eq!(revolution("#riegl_vz400", 100.0, 0.17), None);
    }
}
