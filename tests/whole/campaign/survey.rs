//! Random surveys: platforms, legs and their settings.

use super::draw::Draw;
use super::instrument::{self, Instrument};
use super::scenery::{self, HALF_WIDTH};
use std::fmt::Write as _;
use std::path::Path;

/// Pulses of a leg, about.
const PULSES: f64 = 400.0;

/// Writes a survey and all its files into `folder`, as `survey.xml`.
pub fn write(draw: &mut Draw, folder: &Path) {
    scenery::write(draw, folder);
    let kind = draw.pick(&["static", "linearpath", "groundvehicle", "multicopter", "interpolated"]);
    let scanner = instrument::draw(draw, kind == "static");
    let legs: String = match kind {
        "interpolated" => recorded_legs(draw, &scanner, folder),
        _ => flown_legs(draw, &scanner, kind),
    };
    let survey = format!(
        "<survey name=\"campaign\" scene=\"scene.xml#s\" scanner=\"#s\" {}{}>{}{legs}</survey>",
        match kind {
            "interpolated" => "platform=\"interpolated\" basePlatform=\"#p\" rotationSpec=\"CANONICAL\"",
            _ => "platform=\"#p\"",
        },
        if draw.chance(0.2) { " legRandomOffset=\"true\" legRandomOffsetStdev=\"0.05\"" } else { "" },
        detection(draw),
    );
    let platform = platform(draw, kind);
    let text =
        format!("<?xml version=\"1.0\"?>\n<document>\n{}\n{platform}\n{survey}\n</document>\n", scanner.xml);
    std::fs::write(folder.join("survey.xml"), text).expect("a survey");
}

/// Settings of a survey that replace those of its scanner.
fn detection(draw: &mut Draw) -> String {
    let mut xml = String::new();
    if draw.chance(0.3) {
        let _ = write!(
            xml,
            "<FWFSettings binSize_ns=\"{}\" beamSampleQuality=\"{}\"/>",
            draw.pick(&[0.1, 0.25]),
            draw.between(1, 4)
        );
    }
    if draw.chance(0.3) {
        let _ = write!(
            xml,
            "<detectorSettings accuracy_m=\"{}\" distanceMeasurementError=\"1 + 0.01*t\"/>",
            draw.pick(&[0.0, 0.02])
        );
    }
    xml
}

fn platform(draw: &mut Draw, kind: &str) -> String {
    let kind = if kind == "interpolated" { "linearpath" } else { kind };
    let mut xml = format!("<platform id=\"p\" name=\"p\" type=\"{kind}\" drag=\"0.01\"");
    if kind == "multicopter" {
        xml.push_str(" engine_max_force=\"0.1\" base_pitch_deg=\"-5\"");
    }
    let _ = write!(
        xml,
        "><scannerMount x=\"{}\" y=\"{}\" z=\"{}\">",
        draw.number(-0.5, 0.5),
        draw.number(-0.5, 0.5),
        draw.number(0.0, 1.0)
    );
    // What flies looks down, mostly.
    if kind != "static" {
        let _ = write!(xml, "<rot axis=\"x\" angle_deg=\"{}\"/>", draw.pick(&["-90", "-80", "-45"]));
    }
    xml.push_str("</scannerMount>");
    for name in ["positionXNoise", "positionZNoise", "attitudeXNoise", "attitudeYNoise"] {
        if draw.chance(0.2) {
            let noise = match draw.below(3) {
                0 => "type=\"NORMAL\" mean=\"0\" stdev=\"0.001\"",
                1 => "type=\"UNIFORM\" min=\"-0.002\" max=\"0.003\"",
                _ => {
                    "type=\"NORMAL\" stdev=\"0.01\" clipEnabled=\"1\" clipMin=\"-0.005\" clipMax=\"0.005\" fixedLifespan=\"7\""
                }
            };
            let _ = write!(xml, "<{name} {noise}/>");
        }
    }
    xml.push_str("</platform>");
    xml
}

/// `<scannerSettings>` for a leg of `seconds`.
fn scanner_settings(draw: &mut Draw, scanner: &Instrument, seconds: f64) -> String {
    let freq = draw.pick(&scanner.pulse_freqs);
    let mut xml = format!(
        "<scannerSettings active=\"{}\" pulseFreq_hz=\"{freq}\" scanFreq_hz=\"{}\" scanAngle_deg=\"{}\" maxDuration_s=\"{seconds}\"",
        !draw.chance(0.1),
        draw.pick(&[10, 50, 100]),
        draw.pick(&[10, 20]),
    );
    if scanner.has_head {
        let rate = (360.0 / seconds).min(7200.0);
        let _ = write!(
            xml,
            " headRotatePerSec_deg=\"{rate:.3}\" headRotateStart_deg=\"{}\" headRotateStop_deg=\"360\"",
            draw.pick(&[0, 30, 90])
        );
    }
    if scanner.optics == "rotating" && draw.chance(0.4) {
        let _ = write!(
            xml,
            " verticalAngleMin_deg=\"{}\" verticalAngleMax_deg=\"18\"",
            draw.pick(&["-18", "-5"])
        );
    }
    if draw.chance(0.3) {
        let _ = write!(xml, " beamDivergence_rad=\"{}\"", draw.pick(&[0.0004, 0.002]));
    }
    if draw.chance(0.4) {
        let _ = write!(xml, " trajectoryTimeInterval_s=\"{}\"", draw.pick(&[0.01, 0.05]));
    }
    if draw.chance(0.1) {
        xml.push_str(" opticsWarmupPhase_s=\"0.01\"");
    }
    xml.push_str("/>");
    xml
}

fn flown_legs(draw: &mut Draw, scanner: &Instrument, kind: &str) -> String {
    let height = match kind {
        "static" | "groundvehicle" => draw.number(1.0, 3.0),
        _ => draw.number(10.0, 25.0),
    };
    let mut xml = String::new();
    for _ in 0..draw.between(if kind == "static" { 1 } else { 2 }, 4) {
        let across = |draw: &mut Draw| draw.number(-0.8 * HALF_WIDTH, 0.8 * HALF_WIDTH);
        let _ = write!(
            xml,
            "<leg{}><platformSettings x=\"{}\" y=\"{}\" z=\"{height}\" movePerSec_m=\"{}\" onGround=\"{}\"{}/>",
            if draw.chance(0.2) { " stripId=\"one\"" } else { "" },
            across(draw),
            across(draw),
            draw.number(5.0, 40.0),
            kind == "static" && draw.chance(0.3),
            match kind {
                "multicopter" =>
                    draw.pick(&[" stopAndTurn=\"true\"", " stopAndTurn=\"false\"", " smoothTurn=\"true\""]),
                _ => "",
            },
        );
        let seconds = PULSES / f64::from(scanner.pulse_freqs[0]) * draw.number(0.3, 1.5);
        xml.push_str(&scanner_settings(draw, scanner, (seconds * 1e4).round() / 1e4));
        xml.push_str("</leg>");
    }
    xml
}

/// Legs along a recorded trajectory, which is written into `folder`.
fn recorded_legs(draw: &mut Draw, scanner: &Instrument, folder: &Path) -> String {
    let seconds = PULSES / f64::from(scanner.pulse_freqs[0]);
    let poses = draw.between(3, 30);
    let mut text = "#HEADER: \"t\", \"roll\", \"pitch\", \"yaw\", \"x\", \"y\", \"z\"\n".to_owned();
    let start = draw.pick(&[0.0, 1000.0, 345_600.0]);
    for i in 0..poses {
        let fraction = i as f64 / (poses - 1) as f64;
        let _ = writeln!(
            text,
            "{:.6},{},{},{:.3},{:.3},{},{}",
            start + 2.0 * seconds * fraction,
            draw.number(-5.0, 5.0),
            draw.number(-5.0, 5.0),
            360.0 * fraction,
            HALF_WIDTH * (fraction - 0.5),
            draw.number(-10.0, 10.0),
            draw.number(10.0, 15.0)
        );
    }
    std::fs::write(folder.join("way.txt"), text).expect("a trajectory");
    let synchronised = draw.chance(0.4);
    let mut xml = String::new();
    for i in 0..draw.between(1, 2) {
        let from = start + seconds * i as f64;
        let _ = write!(
            xml,
            "<leg><platformSettings trajectory=\"way.txt\" tStart=\"{from:.6}\" tEnd=\"{:.6}\" teleportToStart=\"{}\" \
             syncGPSTime=\"{synchronised}\"/>",
            from + seconds * draw.number(0.4, 1.0),
            draw.chance(0.7),
        );
        xml.push_str(&scanner_settings(draw, scanner, seconds));
        xml.push_str("</leg>");
    }
    xml
}
