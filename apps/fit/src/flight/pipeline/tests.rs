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
fn written_with(mirror: Mirror, change: impl Fn(&mut Parameters), is_mixed: bool) -> (String, toml::Table) {
    let fit = FlightFit {
        noise: Some(RangeScatter { value: NOISE, deviation: 0.001, is_mixed }),
        ..fitted(mirror, change)
    };
    text_of(&fit)
}

/// The text of the pipeline file of a fit, as text and as read.
fn text_of(fit: &FlightFit) -> (String, toml::Table) {
    let files = FlightFiles {
        pipeline: PathBuf::from("folder/fit.toml"),
        trajectory: PathBuf::from("folder/fit.trajectory.csv"),
        wander: (fit.solution.model.mirror == Mirror::Cone).then(|| PathBuf::from("folder/fit.wander.txt")),
        pulse_times: None,
        simulated: PathBuf::from("folder/fit.simulated.laz"),
    };
    let text = fit.pipeline(&files, "vlscan fit line.laz\n-o fit.toml");
    let read = text.parse().unwrap();
    (text, read)
}

/// A flight of 2000 pulses at 100 kHz.
fn fitted(mirror: Mirror, change: impl Fn(&mut Parameters)) -> FlightFit {
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
        Pulse { returns: 3, ..Pulse::on_ground(time, DVec3::new(at.x, at.y, 0.0), at.angle) }
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
    FlightFit { cloud, recording, solution, rate, noise: None, speed_by_pitch: 0.0, extend: 0.0 }
}

#[test]
fn a_cone_has_a_wander_and_a_tilt_of_its_axis() {
    let (text, read) = written(Mirror::Cone, |p| p.mirror.rate = -60.0);
    assert!(
        text.starts_with("# vlscan fit line.laz -o fit.toml\n#\n# Estimated, with standard deviations:\n")
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
fn a_flight_that_misses_its_points_has_no_live_key_that_depends_on_beams() {
    let mut fit = fitted(Mirror::Cone, |_| {});
    fit.noise = Some(RangeScatter { value: NOISE, deviation: 0.001, is_mixed: false });
    fit.solution.residual = 0.47;
    (fit.rate.lost, fit.rate.lost_deviation) = (0.002, 0.0001);
    let (text, read) = text_of(&fit);
    assert!(read["scanner"].get("accuracy_m").is_none(), "{text}");
    let reason = "the fitted flight misses its points by 0.47 m on the ground";
    assert!(text.contains(&format!("# left out: {reason}\n# accuracy_m = 0.0200\n")), "{text}");
    assert!(text.contains(&format!("# doubtful: {reason}\npulse_freq_hz = ")), "{text}");
    assert!(text.contains(&format!("# left out: {reason}\n# dropout_rate = 0.00200\n")), "{text}");
    fit.solution.residual = 0.01;
    assert!(!text_of(&fit).0.contains("misses its points"));
    fit.rate.coarse_step = Some(2.5e-6);
    let (text, _) = text_of(&fit);
    let reason = "# doubtful: GPS times have steps of 2.500 µs, too coarse for the intervals of pulses\n";
    assert!(text.contains(&format!("{reason}pulse_freq_hz = ")), "{text}");
}

#[test]
fn a_speed_that_the_points_do_not_show_is_uncertain_with_the_reason() {
    let mut fit = fitted(Mirror::Polygon, |_| {});
    let of_speed = |fit: &FlightFit| fit.figures()[0].deviation.unwrap();
    let (text, known) = (text_of(&fit).0, of_speed(&fit));
    assert!(text.contains("[trajectory]\npath = ") && known < 0.1, "{known} {text}");
    fit.speed_by_pitch = 1.2;
    let (text, _) = text_of(&fit);
    let comment = "[trajectory]\n# doubtful: the speed is known to 3 % only: over ground as flat as this";
    assert!(text.contains(comment) && (of_speed(&fit) / 1.2 - 1.0).abs() < 0.01, "{text}");
}

#[test]
fn recorded_scan_angles_that_are_narrower_than_those_of_a_polygon_mirror_are_a_comment() {
    let angles = |mirror: Mirror, degrees: f64| {
        let mut fit = fitted(mirror, |_| {});
        let turned = |pulse: Pulse| Pulse { angle: radians(degrees), ..pulse };
        fit.recording.pulses = fit.recording.pulses.iter().map(turned).collect();
        let (text, read) = text_of(&fit);
        assert!(read["settings"].get("scan_angle_deg").is_none(), "{text}");
        text.contains(&format!("\n# scan_angle_deg = {:.1}\n", degrees.abs()))
    };
    // The half angle of the mirror is 20 degrees.
    assert!(angles(Mirror::Polygon, -10.0));
    assert!(!angles(Mirror::Polygon, 19.0));
    assert!(!angles(Mirror::Cone, 10.0));
}

#[test]
fn channels_have_tables_and_the_tilt_is_in_the_mount() {
    let (text, read) = written(Mirror::Polygon, |p| {
        p.channels[0].yaw = 0.1;
        p.channels.push(Channel { phase: 2.0, yaw: -0.1, pitch: 0.0, sense: -1.0 });
    });
    let scanner = read["scanner"].as_table().unwrap();
    assert!(!scanner.contains_key("scan_axis_tilt_deg") && !scanner.contains_key("scan_phase_deg"), "{text}");
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
