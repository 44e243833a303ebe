//! The facts about a survey and its scene that outputs depend on.

use crate::geom::{Aabb, DVec3};
use crate::scene::Scene;
use crate::survey::{Leg, Scanner, Survey};
use serde::{Deserialize, Serialize};
use std::f64::consts::TAU;

/// Everything that outputs need to know about the survey and the scene of the first epoch: formats, headers and names of
/// files follow from it and from the request alone.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct OutputContext {
    /// Name of the survey, or of its file if it has none.
    pub survey: String,
    /// Legs in document order, inactive ones included.
    pub legs: Vec<OutputLeg>,
    /// Display name of the scanner.
    pub scanner: String,
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
}

/// A leg.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct OutputLeg {
    /// Number in the survey, from 0.
    pub number: u32,
    /// Whether the scanner fires.
    pub active: bool,
    /// Legs of the same strip share their files.
    pub strip: Option<String>,
    /// Duration of a revolution of the scanner's head, s, if it turns at least once per second.
    pub revolution_s: Option<f64>,
}

/// A device of the scanner.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct OutputDevice {
    /// Id in names of files.
    pub id: String,
    /// Width of the waveform's bins, ns.
    pub bin: f64,
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
            devices: survey
                .scanner
                .devices
                .iter()
                .map(|device| OutputDevice { id: device.id.clone(), bin: device.waveform.bin })
                .collect(),
            crs: survey.crs_wkt.clone(),
            shift: scene.shift,
            bounds: scene.bounds,
            parts: scene.parts.iter().map(|part| part.id.clone()).collect(),
        }
    }
}

/// Duration of a revolution of the head of the first device, if it turns at least once per second.
fn revolution(scanner: &Scanner, leg: &Leg) -> Option<f64> {
    let limit = scanner.devices.first()?.head.max_rate.abs();
    let rate = leg.scanner.head_rate.abs().min(limit);
    (rate >= TAU * (1.0 - 1e-9)).then(|| TAU / rate)
}
