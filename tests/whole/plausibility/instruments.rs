//! Instruments and legs that contradict themselves.

use super::inputs::*;
use super::{Mistake, typed, written};
use crate::common::fixture;
use std::fs;

/// Instruments and legs whose values contradict each other or do nothing.
pub fn instruments() -> Vec<Mistake> {
    let made = |name, scanner: &str, settings: &str, leg: &str, answer| {
        written(name, "m.toml", own(scanner, settings, leg), "run m.toml -o a.xyz", answer)
    };
    let of_scanner = |name, scanner: &str, answer| made(name, scanner, SWATH, SPEED, answer);
    let and = |more: &str| format!("{ROTATING}, {more}");
    vec![
        of_scanner("a cone without its angle", "optics = \"conic\"", "never deflect the beam"),
        of_scanner("fibres without their angle", "optics = \"line\", fibres = 20", "never deflect the beam"),
        of_scanner(
            "a single fibre",
            "optics = \"line\", scan_angle_max_deg = 45",
            "line optics without `fibres` have a single fibre",
        ),
        of_scanner(
            "a negative limit",
            "optics = \"conic\", scan_angle_max_deg = -20",
            "`scan_angle_max_deg` must be a number of at least 0",
        ),
        of_scanner(
            "a cone of more than half a turn",
            "optics = \"conic\", scan_angle_max_deg = 200",
            "`scan_angle_max_deg` is 200; half angles of these optics are at most 180 degrees",
        ),
        of_scanner(
            "a mirror that swings by more than half a turn",
            "optics = \"oscillating\", scan_angle_max_deg = 200",
            "half angles of these optics are at most 180 degrees",
        ),
        of_scanner(
            "no limit of the frequency above a minimum",
            &and("scan_freq_min_hz = 5, scan_freq_max_hz = 0"),
            "`scan_freq_max_hz` is 0, which means no limit",
        ),
        of_scanner(
            "a negative limit of the head",
            &and("head_rate_max_deg_per_s = -60"),
            "`head_rate_max_deg_per_s` is below 0",
        ),
        of_scanner(
            "noise ten times the threshold",
            &and("max_returns = 4, range_max_m = 250, nep_w = 1e-8, received_energy_min_w = 1e-9"),
            "false points per pulse",
        ),
        of_scanner(
            "noise a third of the threshold",
            &and("max_returns = 4, range_max_m = 250, nep_w = 1e-9, received_energy_min_w = 3.3e-9"),
            "crosses the detection threshold",
        ),
        of_scanner(
            "mA/W for A/W",
            &and("responsivity_a_per_w = 800"),
            "800 mA/W are 0.8 A/W",
        ),
        of_scanner("a range walk in millimetres", &and("range_walk_m = 50"), "50 mm are 0.05 m"),
        of_scanner("a bandwidth in MHz", &and("bandwidth_hz = 200"), "200 MHz are 200000000 Hz"),
        of_scanner(
            "channels of one id",
            &and("channel = [{ id = \"a\" }, { id = \"a\" }]"),
            "`id` of \"a\" occurs twice",
        ),
        made(
            "a mirror that swings too far in a leg",
            "optics = \"oscillating\"",
            "scan_freq_hz = 20, scan_angle_deg = 200",
            SPEED,
            "`scan_angle_deg` of 200 degrees is more than 180",
        ),
        made(
            "a scan angle of 0",
            ROTATING,
            "scan_freq_hz = 20, scan_angle_deg = 0",
            SPEED,
            "`scan_angle_deg` of 0 counts as not given; the scanner's 45 degrees are used",
        ),
        made("a mirror that stands", ROTATING, "scan_angle_deg = 20", SPEED, "the mirror stands still"),
        made("a missing speed", ROTATING, SWATH, "active = true", "`speed_m_per_s` is missing; 70 m/s are used"),
        made(
            "a negative speed",
            ROTATING,
            &format!("{SWATH}, max_duration_s = 0.3"),
            "speed_m_per_s = -20",
            "is -20 m/s, which is no speed",
        ),
        made("a speed of 0", ROTATING, &format!("{SWATH}, max_duration_s = 0.3"), "speed_m_per_s = 0", "is no speed"),
        written(
            "an energy model that the physics has not",
            "m.toml",
            own(ROTATING, SWATH, SPEED) + "physics = { legacy_energy = true }\n",
            "run m.toml -o a.xyz",
            "has no effect with the correction radiometry",
        ),
        written(
            "a mirror that swings faster in the next leg",
            "s.xml",
            survey()
                .replace("template=\"strip\" active=\"false\"", "template=\"strip\" scanFreq_hz=\"20\""),
            "run s.xml -o a.xyz",
            "takes fewer pulses than in the leg before (",
        ),
        // The tree of the ground is built anew for each pulse: strips of 4 m have 600.
        Mistake {
            files: vec![
                (
                    "scene.xml",
                    fs::read_to_string(fixture("terrain/scene.xml")).unwrap().replacen(
                        "</part>",
                        "<dmotion id=\"m\" loop=\"0\"><motion type=\"translation\" vec=\"0;0;0.0001\"/></dmotion></part>",
                        1,
                    ).into_bytes(),
                ),
                ("survey.xml", survey().replace("y=\"-132\"", "y=\"-2\"").replace("y=\"132\"", "y=\"2\"").into_bytes()),
            ],
            ..typed("a part that moves at every pulse", "run survey.xml -o a.xyz", "moves at every pulse")
        },
        written(
            "an element that lost its bracket",
            "scene.xml",
            fs::read_to_string(fixture("terrain/scene.xml")).unwrap().replacen(
                "</part>",
                "filter type=\"scale\"><param type=\"double\" key=\"scale\" value=\"3\"/></part>",
                1,
            ),
            "run survey.xml -o a.xyz",
            "did an element lose its `<`?",
        ),
    ]
}
