//! Sense, phase, tilt and wander of deflectors, in XML and in pipeline files.

use super::*;
use std::f64::consts::TAU;
use std::sync::Arc;
use vlscan_geom::radians;

const FILES: [(&str, &str); 4] = [
    ("a.obj", ""),
    ("w.txt", "s, deg\n0 0.5\n# later\n2.5; -1\n"),
    ("bad.txt", "0 1\n0 2\n"),
    ("none.txt", "# t\n"),
];

/// The device of a pipeline with these keys in `[scanner]`, and the warnings.
fn of_toml(keys: &str) -> vlscan_base::Result<(Device, Diagnostics)> {
    let text = format!(
        "scene = \"a.obj\"\n[[leg]]\nposition_m = [0, 0, 0]\nactive = false\n[platform]\nkind = \"linear_path\"\n\
         [scanner]\npulse_freqs_hz = [5]\n{keys}"
    );
    let mut files = vec![("p.toml", text.as_str())];
    files.extend(FILES);
    let folder = Folder::new(&files);
    read_pipeline(&folder.path("p.toml")).map(|(mut s, w)| (s.scanner.devices.remove(0), w))
}

/// The device of a survey with these attributes of its scanner, and the warnings.
fn of_xml(attributes: &str) -> vlscan_base::Result<(Device, Diagnostics)> {
    let scanner = format!("<scanner id='mine' pulseFreqs_Hz='5' {attributes}/>");
    let leg = "<leg><platformSettings/><scannerSettings active='0'/></leg>";
    let text = document(&scanner, "platform='plane'", leg).replace("scanner='mirror'", "scanner='mine'");
    let mut files = vec![("survey.xml", text.as_str())];
    files.extend(FILES);
    let folder = Folder::new(&files);
    let read = folder.read(&ReadOptions::default());
    read.map(|(mut s, w)| (s.scanner.devices.remove(0), w))
}

#[test]
fn every_key_in_both_formats() {
    let (toml, warnings) = of_toml(
        "optics = \"conic\"\nscan_angle_max_deg = 30\nscan_reverse = true\nscan_phase_deg = -30\nscan_axis_tilt_deg = [0.5, -1]\nscan_wander = \"w.txt\"\n",
    )
    .unwrap();
    let (xml, more) = of_xml(
        "optics='conic' scanAngleMax_deg='30' scanReverse='true' scanPhase_deg='330' scanAxisTilt_deg='0.5;-1' scanWander='w.txt'",
    )
    .unwrap();
    assert!(warnings.is_empty() && more.is_empty());
    assert_eq!(toml.scan_motion, xml.scan_motion);
    let table = AngleTable { times: vec![0.0, 2.5], degrees: vec![0.5, -1.0] };
    let expected = ScanMotion {
        is_reversed: true,
        phase: radians(330.0) % TAU,
        axis_tilt: [radians(0.5), radians(-1.0)],
        wander: Some(Wander::Table(Arc::new(table))),
        swing: Swing::default(),
    };
    assert_eq!(toml.scan_motion, expected);
    let sine =
        "optics = \"rotating\"\nscan_angle_max_deg = 5\nscan_wander = { amplitude_deg = 0.2, freq_hz = 3 }\n";
    let sine = of_toml(sine).unwrap().0.scan_motion.wander;
    assert_eq!(sine, Some(Wander::Sine { amplitude: radians(0.2), freq: 3.0, phase: 0.0 }));
    assert_eq!(of_toml("optics = \"conic\"\n").unwrap().0.scan_motion, ScanMotion::default());
}

#[test]
fn mirrors_swing_as_their_keys_say_in_both_formats() {
    let toml = |keys: &str| of_toml(&format!("optics = \"oscillating\"\nscan_angle_max_deg = 20\n{keys}"));
    let xml = |keys: &str| of_xml(&format!("optics='oscillating' scanAngleMax_deg='20' {keys}"));
    for (in_toml, in_xml, expected) in [
        ("", "", Swing::TurningPulses),
        ("mirror_motion = \"even\"\n", "mirrorMotion='even'", Swing::TurningPulses),
        ("mirror_motion = \"sine\"\n", "mirrorMotion='sine'", Swing::Sine),
        ("turning_part = 0.3\n", "turningPart='0.3'", Swing::TurningPart(0.3)),
    ] {
        for read in [toml(in_toml), xml(in_xml)] {
            let (device, warnings) = read.unwrap();
            assert!(warnings.is_empty(), "{}", warnings.text());
            assert_eq!(device.scan_motion.swing, expected);
        }
    }
}

#[test]
fn what_cannot_be_is_named_with_its_place() {
    for (keys, message) in [
        ("optics = \"conic\"\nturning_part = 0.3\n", "`turning_part` needs optics = \"oscillating\""),
        ("optics = \"oscillating\"\nturning_part = 1.5\n", "a share from 0 to 1"),
        (
            "optics = \"oscillating\"\nmirror_motion = \"sine\"\nturning_part = 0.3\n",
            "`turning_part` is not for a sine (`mirror_motion`)",
        ),
        ("optics = \"line\"\nscan_wander = \"w.txt\"\n", "`scan_wander` needs optics that turn or swing"),
        ("optics = \"conic\"\nscan_wander = \"bad.txt\"\n", "a time later than that of the line before"),
        ("optics = \"conic\"\nscan_wander = \"none.txt\"\n", "`none.txt` has no line of numbers"),
        ("optics = \"conic\"\nscan_wander = \"away.txt\"\n", "cannot find the file `away.txt`"),
        ("optics = \"conic\"\nscan_wander = { amplitude_deg = 1 }\n", "the key `freq_hz` is missing"),
        ("optics = \"conic\"\nscan_wander = { amplitude_deg = 1, freq_hz = 0 }\n", "a number above 0"),
        ("optics = \"conic\"\nscan_wander = 3\n", "expected a text in quotes"),
        ("optics = \"conic\"\nscan_axis_tilt_deg = [1]\n", "two angles between -90 and 90"),
        ("optics = \"conic\"\nscan_axis_tilt_deg = [1, 95]\n", "two angles between -90 and 90"),
        ("optics = \"conic\"\nscan_angle_max_deg = 30\nscan_reverse = 1\n", "expected"),
        ("optics = \"conic\"\nscan_phase_deg = \"up\"\n", "expected"),
    ] {
        contains(&refused(of_toml(keys)), &[message, "^"]);
    }
    contains(&refused(of_xml("optics='conic' scanAxisTilt_deg='1;2;3'")), &["two angles", "^"]);
    let (device, warnings) = of_xml("optics='line' scanWander='w.txt' scanReverse='1'").unwrap();
    contains(&warnings.render(false), &["`scanWander` has no effect with line optics"]);
    assert!(device.scan_motion.wander.is_none() && device.scan_motion.is_reversed);
}
