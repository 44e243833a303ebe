//! Surveys, legs, templates.

use super::*;
use vlscan_geom::{DVec3, radians};

const LEG: &str =
    "<leg><platformSettings x='1' y='2' z='3'/><scannerSettings scanFreq_hz='50' scanAngle_deg='20'/></leg>";

#[test]
fn a_small_survey() {
    let survey = clean("", LEG);
    assert_eq!((survey.name.as_str(), survey.seed, survey.legs.len()), ("survey.xml", None, 1));
    assert_eq!(survey.platform.mount.offset, DVec3::new(0.0, 0.0, 2.0));
    let leg = &survey.legs[0];
    assert_eq!((leg.number, &leg.strip, leg.platform.position), (0, &None, DVec3::new(1.0, 2.0, 3.0)));
    assert_eq!((leg.platform.speed, leg.platform.stop_and_turn, leg.platform.slowdown), (70.0, true, true));
    assert!(leg.scanner.active && leg.scanner.vertical_min.is_none() && leg.scanner.max_duration.is_none());
    assert_eq!((leg.scanner.scan_freq, leg.scanner.scan_angle), (50.0, radians(20.0)));
}

#[test]
fn settings_merge_by_value() {
    // spec input-formats §2.5: three layers, compared by value
    let templates = "<scannerSettings id='root' scanFreq_hz='80' headRotatePerSec_deg='10'/>
        <scannerSettings id='slow' template='root' pulseFreq_hz='300000' scanAngle_deg='30' verticalAngleMin_deg='-10'/>";
    let legs = "
        <leg><platformSettings/><scannerSettings scanFreq_hz='50'/></leg>
        <leg><platformSettings/><scannerSettings scanFreq_hz='50' pulseFreq_hz='0' beamDivergence_rad='0.003'/></leg>
        <leg><platformSettings/><scannerSettings template='slow'/></leg>
        <leg><platformSettings/><scannerSettings template='slow' scanFreq_hz='20' active='false'/></leg>";
    let (survey, warnings) = survey_of(templates, "platform='plane'", legs).unwrap();
    contains(
        &warnings.render(false),
        &[
            "`pulseFreq_hz` of 0 is a default and treated as not given; 100000 is used",
            "`beamDivergence_rad` of 0.003",
        ],
    );
    let s: Vec<_> = survey.legs.iter().map(|l| &l.scanner).collect();
    // without a template, the scanner's values replace values that are missing or equal to the hard-coded
    // default
    assert_eq!((s[0].pulse_freq, s[0].beam_divergence), (100_000, 0.0005));
    assert_eq!((s[1].pulse_freq, s[1].beam_divergence), (100_000, 0.0005));
    // with a template, its values do
    assert_eq!((s[2].pulse_freq, s[2].scan_freq, s[2].head_rate), (300_000, 80.0, radians(10.0)));
    assert_eq!(
        (s[2].scan_angle, s[2].vertical_min, s[2].vertical_max),
        (radians(30.0), Some(radians(-10.0)), None)
    );
    assert_eq!((s[3].scan_freq, s[3].active), (20.0, false));
    // 0 differs from the template's 300000, so it takes effect and would stop the clock
    let stopped =
        "<leg><platformSettings/><scannerSettings template='slow' pulseFreq_hz='0' active='false'/></leg>";
    contains(
        &refused(survey_of(templates, "platform='plane'", stopped)),
        &["the pulse frequency must be above 0"],
    );
}

#[test]
fn platform_settings_inherit_all_but_the_yaw() {
    let templates = "<platformSettings id='cruise' z='900' movePerSec_m='60' onGround='1' yawAtDeparture_deg='45' smoothTurn='true'/>";
    let legs = format!(
        "<leg stripId='A'><platformSettings template='cruise' x='5'/><scannerSettings scanFreq_hz='50'/></leg>
         <leg stripId='NULL_STRIP_ID'><platformSettings yawAtDeparture_deg='30'/><scannerSettings scanFreq_hz='50'/></leg>{LEG}"
    );
    let (survey, warnings) = survey_of(templates, "platform='plane'", &legs).unwrap();
    contains(
        &warnings.render(false),
        &["`yawAtDeparture_deg` of this template has no effect", "`smoothTurn` has no effect"],
    );
    let p = &survey.legs[0].platform;
    assert_eq!((p.position, p.speed, p.on_ground), (DVec3::new(5.0, 0.0, 900.0), 60.0, true));
    assert_eq!((p.smooth_turn, p.stop_and_turn, p.yaw_at_departure), (true, false, None));
    assert_eq!(survey.legs[1].platform.yaw_at_departure, Some(radians(30.0)));
    assert_eq!((survey.legs[0].strip.as_deref(), survey.legs[1].strip.as_deref()), (Some("A"), None));
}

#[test]
fn a_leg_without_scanner_settings_has_open_vertical_angles() {
    // the reference computes an empty window for this scanner
    let scanner = "<scanner id='free' optics='rotating' pulseFreqs_Hz='1000' scanAngleMax_deg='60' scanAngleEffectiveMax_deg='50'/>";
    let text =
        document(scanner, "platform='plane'", "<leg><platformSettings/></leg>").replace("'mirror'", "'free'");
    let folder = Folder::new(&[("survey.xml", &text.replacen("'free'", "'mirror'", 1)), ("a.obj", "")]);
    let (survey, _) = folder.read(&ReadOptions::default()).unwrap_or_else(|e| panic!("{}", report(&e)));
    let settings = &survey.legs[0].scanner;
    assert_eq!((settings.pulse_freq, settings.vertical_min, settings.vertical_max), (1000, None, None));
    // the scan frequency is 0 nevertheless
    let error = survey_of("", "platform='plane'", "<leg><platformSettings/></leg>").unwrap_err();
    assert_eq!(error.exit_status(), 3);
}

#[test]
fn durations() {
    let legs = "
        <leg maxDuration_s='2'><platformSettings/><scannerSettings scanFreq_hz='50' maxDuration_s='5'/></leg>
        <leg><platformSettings/><scannerSettings scanFreq_hz='50'><maxDuration_s> 0.5 </maxDuration_s></scannerSettings></leg>
        <leg><platformSettings/><scannerSettings scanFreq_hz='50' maxDuration_s='0'/></leg>";
    let survey = clean("", legs);
    let durations: Vec<_> = survey.legs.iter().map(|l| l.scanner.max_duration).collect();
    assert_eq!(durations, [Some(2.0), Some(0.5), None]);
}

#[test]
fn resolutions_replace_frequency_and_head_speed() {
    // spec kinematics §6: f = 100 000, M = 60°: 0.2·100000/120 = 166.67 Hz is above the limit; 0.1° gives
    // 83.3 Hz
    let leg = |settings: &str| format!("<leg><platformSettings/><scannerSettings {settings}/></leg>");
    let settings =
        "verticalResolution_deg='0.1' horizontalResolution_deg='0.2' headRotateStop_deg='90' scanFreq_hz='7'";
    let (survey, warnings) = survey_of("", "platform='plane'", &leg(settings)).unwrap();
    contains(&warnings.render(false), &["`scanFreq_hz` has no effect beside `verticalResolution_deg`"]);
    let s = &survey.legs[0].scanner;
    assert!((s.scan_freq - 83.333333333).abs() < 1e-6 && (s.head_rate - radians(16.6666666667)).abs() < 1e-9);
    let only_one = refused(survey_of("", "platform='plane'", &leg("verticalResolution_deg='0.1'")));
    contains(&only_one, &["`verticalResolution_deg` is given without `horizontalResolution_deg`", "^^^"]);
    let limit = survey_of(
        "",
        "platform='plane'",
        &leg("verticalResolution_deg='0.2' horizontalResolution_deg='0.2'"),
    );
    assert_eq!(limit.unwrap_err().exit_status(), 3);
}

#[test]
fn scan_frequencies_of_active_legs_are_limited() {
    let leg = |freq: &str, active: bool| {
        format!("<leg><platformSettings/><scannerSettings scanFreq_hz='{freq}' active='{active}'/></leg>")
    };
    for (freq, active, status) in
        [("4.9", true, 3), ("121", true, 3), ("121", false, 0), ("0", false, 0), ("5", true, 0)]
    {
        let result = survey_of("", "platform='plane'", &leg(freq, active));
        assert_eq!(result.as_ref().err().map_or(0, Error::exit_status), status, "{freq} {active}");
        if let Err(e) = result {
            contains(&report(&e), &["the scanner allows 5 to 120 Hz", "survey.xml:7:", "^^^"]);
        }
    }
    // with another problem in the file, both are shown and the exit status is that of invalid input
    let both = survey_of("", "platform='plane' seed='x'", &leg("121", true)).unwrap_err();
    assert_eq!(both.exit_status(), 2);
}

#[test]
fn endless_legs_are_refused() {
    let leg = |settings: &str| {
        format!("<leg><platformSettings/><scannerSettings scanFreq_hz='50' {settings}/></leg>")
    };
    let on_tripod = |settings: &str| survey_of("", "platform='tripod'", &leg(settings));
    contains(&refused(on_tripod("")), &["leg 0 would never end", "maxDuration_s"]);
    assert!(on_tripod("maxDuration_s='1'").is_ok());
    assert!(on_tripod("headRotatePerSec_deg='10' headRotateStop_deg='90'").is_ok());
    let on_plane = |settings: &str| survey_of("", "platform='plane'", &leg(settings));
    contains(&refused(on_plane("headRotateStop_deg='90'")), &["does not reach its stop angle"]);
    contains(
        &refused(on_plane("headRotatePerSec_deg='10' headRotateStart_deg='90' headRotateStop_deg='10'")),
        &["`headRotateStop_deg` must be at least the start angle 90"],
    );
    assert!(on_plane("headRotatePerSec_deg='-10' headRotateStart_deg='90' headRotateStop_deg='10'").is_ok());
}

#[test]
fn windows_wider_than_the_mirror_are_refused() {
    let leg = |v: &str| format!("<leg><platformSettings/><scannerSettings scanFreq_hz='50' {v}/></leg>");
    assert!(
        survey_of("", "platform='plane'", &leg("verticalAngleMin_deg='-50' verticalAngleMax_deg='50'"))
            .is_ok()
    );
    let wide =
        survey_of("", "platform='plane'", &leg("verticalAngleMin_deg='-55' verticalAngleMax_deg='50'"));
    contains(&refused(wide), &["wider than the scanner's field of view", "100 degrees"]);
}

#[test]
fn templates_that_rest_on_themselves() {
    let templates = "<scannerSettings id='a' template='b'/><scannerSettings id='b' template='a'/>";
    let leg = "<leg><platformSettings/><scannerSettings template='a' scanFreq_hz='50'/></leg>";
    contains(&refused(survey_of(templates, "platform='plane'", leg)), &["refers to itself", "template='a'"]);
    let missing =
        refused(survey_of("", "platform='plane'", "<leg><platformSettings template='cruse'/></leg>"));
    contains(&missing, &["no <platformSettings> with the id `cruse`", "no <platformSettings> at all"]);
}

#[test]
fn long_chains_of_templates_are_no_recursion() {
    let mut templates = String::from("<scannerSettings id='t0' scanFreq_hz='50'/>");
    for i in 1..5_000 {
        templates += &format!("<scannerSettings id='t{i}' template='t{}'/>", i - 1);
    }
    let survey = clean(&templates, "<leg><platformSettings/><scannerSettings template='t4999'/></leg>");
    assert_eq!(survey.legs[0].scanner.scan_freq, 50.0);
}

#[test]
fn unparsable_values_warn_and_name_what_is_used() {
    let legs = "<leg><platformSettings onGround='True' x=' 5'/><scannerSettings pulseFreq_hz='1e5' scanFreq_hz='50'/></leg>";
    let (survey, warnings) = survey_of("", "platform='plane'", legs).unwrap();
    let text = warnings.render(false);
    contains(
        &text,
        &["for `onGround`, found `True`; false is used", "found ` 5`; 0 is used", "found `1e5`; 0 is used"],
    );
    assert!(!survey.legs[0].platform.on_ground && survey.legs[0].scanner.pulse_freq == 100_000);
    assert!(warnings.items().iter().all(|d| d.severity == Severity::Warning));
    let folder = Folder::new(&[("survey.xml", &document("", "platform='plane'", legs)), ("a.obj", "")]);
    let strict = folder.read(&ReadOptions { strict: true, ..ReadOptions::default() });
    assert_eq!(strict.unwrap_err().exit_status(), 2);
}

#[test]
fn misspelt_names_are_reported_with_what_was_meant() {
    let legs = "<leg><platformSettings onground='true'/><scannerSettings scanFreq_Hz='50' scanFreq_hz='50'/><pause/></leg>";
    let (_, warnings) = survey_of("<scannerSetting id='x'/>", "platform='plane' sed='5'", legs).unwrap();
    contains(
        &warnings.render(false),
        &[
            "unknown attribute `onground` of <platformSettings>",
            "did you mean `onGround`?",
            "unknown attribute `scanFreq_Hz`",
            "did you mean `scanFreq_hz`?",
            "unknown element <pause> in <leg>",
            "unknown element <scannerSetting> in <document>",
            "did you mean `seed`?",
        ],
    );
}

#[test]
fn all_problems_of_all_files_come_at_once() {
    let survey = "<document><survey scene='s.xml#a' scanner='data/scanners_tls.xml#riegl_vz40' platform='p.xml#p' seed='?'>
        <leg/></survey></document>";
    let scene = "<document>\n<scene id='a'><part><filter type='objloader'><param type='string' key='filepath' value='no.obj'/></filter></part>
        <part><filter type='rotatee'/></part></scene></document>";
    let folder = Folder::new(&[("survey.xml", survey), ("s.xml", scene)]);
    let text = refused(
        folder.read(&ReadOptions { assets: vec![PathBuf::from("/nowhere")], ..ReadOptions::default() }),
    );
    contains(
        &text,
        &[
            "did you mean `riegl_vz400`?",
            "cannot find the file `p.xml`",
            "`?` is not a seed",
            "a <leg> needs <platformSettings>",
            "cannot find the file `no.obj`",
            "searched in: ., /nowhere, assets, ",
            "unknown filter type `rotatee`",
            "did you mean `rotate`?",
            "s.xml:2:89",
        ],
    );
}

#[test]
fn references() {
    let parts = format!("<document>{MIRROR}{SCENE}</document>");
    let survey = |scanner: &str, scene: &str| {
        format!(
            "<document>{PLATFORMS}{SCENE}<survey platform='#plane' scanner='{scanner}' scene='{scene}'>{LEG}</survey></document>"
        )
    };
    for (scanner, scene, fine) in [
        ("parts.xml#mirror", "scene", true),
        ("parts.xml", "#scene", true),
        ("parts.xml", "parts.xml", true),
        ("mirror", "scene", false),
        ("parts.xml#a#b", "scene", false),
        ("parts.xml#mirrors", "scene", false),
    ] {
        let folder =
            Folder::new(&[("survey.xml", &survey(scanner, scene)), ("parts.xml", &parts), ("a.obj", "")]);
        assert_eq!(folder.read(&ReadOptions::default()).is_ok(), fine, "{scanner} {scene}");
    }
}

#[test]
fn survey_attributes() {
    let attributes = "platform='plane' name='two lines' seed='7' numRuns='2' simSpeed='3' legRandomOffset='1' legRandomOffsetStdev='0.5'";
    let (survey, warnings) = survey_of("", attributes, LEG).unwrap();
    contains(&warnings.render(false), &["`numRuns` has no effect", "`simSpeed` has no effect"]);
    assert_eq!(
        (survey.name.as_str(), survey.seed, survey.leg_offset),
        ("two lines", Some(7), Some((0.0, 0.5)))
    );
    assert_eq!(survey_of("", "platform='plane' seed='AUTO'", LEG).unwrap().0.seed, None);
    contains(&refused(survey_of("", "platform='plane'", "")), &["the survey has no <leg>"]);
    contains(&refused(survey_of("", "", LEG)), &["<survey> needs the attribute `platform`"]);
}

#[test]
fn survey_settings_reach_the_first_channel_only() {
    // spec input-formats §2.11: the element resets the window to a quarter of the pulse length
    let channels =
        "<scanner id='duo' optics='rotating' pulseFreqs_Hz='1000' pulseLength_ns='8' scanAngleMax_deg='60'
        scanAngleEffectiveMax_deg='50' accuracy_m='0.1'><FWFSettings winSize_ns='3' beamSampleQuality='2'/>
        <channels><channel/><channel accuracy_m='0.2'/></channels></scanner>";
    let overrides = "<FWFSettings binSize_ns='0.5'/><detectorSettings rangeMax_m='99' accuracy_m='0.3' distanceMeasurementError='1+0.1*t'/>";
    let both = |scanner: &str| {
        let text = document(channels, "platform='plane'", &format!("{overrides}{LEG}"));
        let text = text.replace("scanner='mirror'", &format!("scanner='{scanner}'"));
        let folder = Folder::new(&[("survey.xml", &text), ("a.obj", "")]);
        let (survey, _) = folder.read(&ReadOptions::default()).unwrap_or_else(|e| panic!("{}", report(&e)));
        survey.scanner.devices
    };
    let single = &both("mirror")[0];
    assert_eq!((single.waveform.bin, single.waveform.window, single.waveform.quality), (0.5, 1.5, 3));
    let duo = both("duo");
    assert_eq!((duo[0].waveform.bin, duo[0].waveform.window, duo[0].waveform.quality), (0.5, 1.0, 2));
    assert_eq!(
        (duo[1].waveform.bin, duo[1].waveform.window, duo[1].detector.range_max),
        (0.25, 3.0, f64::MAX)
    );
    // the noise of the first channel applies to every channel
    assert_eq!((duo[0].detector.accuracy, duo[1].detector.accuracy), (0.3, 0.3));
    assert!(duo[1].detector.distance_error.is_some());
}

#[test]
fn noise_of_the_survey_replaces_that_of_the_platform() {
    let platform = "<platform id='boat' type='linearpath'><positionXNoise stdev='2' fixedLifespan='0'/>
        <attitudeZNoise type='UNIFORM' min='-1' max='1' clipEnabled='true' clipMin='-0.5' clipMax='0.5'/></platform>";
    let noise = "<positionXNoise type='NORMAL' mean='1' stdev='3'/>";
    let (survey, _) = survey_of(platform, "platform='boat'", &format!("{noise}{LEG}")).unwrap();
    let n = &survey.platform.noise;
    assert_eq!(
        n.position[0],
        Some(Noise { kind: NoiseKind::Normal { mean: 1.0, stdev: 3.0 }, clip: None, lifespan: 1 })
    );
    let uniform =
        Noise { kind: NoiseKind::Uniform { min: -1.0, max: 1.0 }, clip: Some((-0.5, 0.5)), lifespan: 1 };
    assert_eq!((&n.attitude[2], &n.position[1]), (&Some(uniform), &None));
    let wrong = survey_of("", "platform='plane'", &format!("<positionXNoise stdev='-1'/>{LEG}"));
    contains(&refused(wrong), &["`stdev` must be a number of at least 0"]);
}

const FLIGHT: &str = "platform='interpolated' basePlatform='plane'";

fn flown(attributes: &str, legs: &str) -> vlscan_base::Result<(Survey, Diagnostics)> {
    let text = document("", attributes, legs);
    Folder::new(&[("survey.xml", &text), ("a.obj", ""), ("f.csv", ""), ("g.csv", "")])
        .read(&ReadOptions::default())
}

#[test]
fn interpolated_platforms() {
    let settings = "<scannerSettings scanFreq_hz='50'/></leg>";
    let legs = format!(
        "<scannerMount x='1'/><leg><platformSettings trajectory='f.csv' tIndex='1' xIndex='0' trajectory_separator=';' tStart='3' tEnd='9'/>{settings}
         <leg><platformSettings trajectory='g.csv' syncGPSTime='1' toRadians='false'/>{settings}
         <leg><platformSettings trajectory='f.csv' trajectory_seperator=',' teleportToStart='true'/>{settings}"
    );
    let (survey, warnings) = flown(FLIGHT, &legs).unwrap();
    let report = warnings.render(false);
    contains(
        &report,
        &[
            "time and roll are both column 1",
            "the legs differ in `toRadians`",
            "`trajectory_separator` has no effect: what an earlier leg says",
        ],
    );
    let PlatformKind::Interpolated(flight) = &survey.platform.kind else { panic!("not interpolated") };
    assert_eq!(
        (flight.files.len(), flight.degrees, flight.sync_gps_time, flight.position_only),
        (2, false, true, false)
    );
    assert_eq!(
        (flight.files[0].columns, flight.files[0].separator),
        (Some([1, 1, 2, 3, 0, 5, 6]), Some(';'))
    );
    assert_eq!((flight.files[1].columns, flight.files[1].separator), (None, None));
    assert_eq!(survey.platform.mount.offset, DVec3::new(1.0, 0.0, 0.0));
    let t = survey.legs[2].platform.trajectory.as_ref().unwrap();
    assert_eq!((t.file, t.start, t.end, t.teleport), (0, None, None, true));
    assert_eq!(survey.legs[0].platform.trajectory.as_ref().unwrap().start, Some(3.0));
}

#[test]
fn contradicting_trajectory_settings() {
    let leg = |settings: &str| {
        format!("<leg><platformSettings {settings}/><scannerSettings scanFreq_hz='50'/></leg>")
    };
    let status = |attributes: &str, legs: &str| flown(attributes, legs).unwrap_err().exit_status();
    assert_eq!(status("platform='interpolated' rotationSpec='NED'", &leg("trajectory='f.csv'")), 3);
    let domains = leg("trajectory='f.csv' interpolationDomain='position'")
        + &leg("trajectory='f.csv' interpolationDomain='position_and_attitude'");
    assert_eq!(status(FLIGHT, &domains), 3);
    assert_eq!(
        status(FLIGHT, &(leg("trajectory='f.csv' tIndex='1'") + &leg("trajectory='f.csv' tIndex='2'"))),
        3
    );
    assert_eq!(status(FLIGHT, &leg("x='1'")), 2);
    assert_eq!(status(FLIGHT, &leg("trajectory='h.csv'")), 2);
    assert!(
        flown(FLIGHT, &(leg("trajectory='f.csv' tIndex='1'") + &leg("trajectory='f.csv' tIndex='1'")))
            .is_ok()
    );
}

#[test]
fn legs_name_trajectories_in_memory() {
    let settings = "<scannerSettings scanFreq_hz='50'/></leg>";
    let legs = format!(
        "<leg><platformSettings trajectory='&lt;poses&gt;'/>{settings}
         <leg><platformSettings trajectory='f.csv'/>{settings}"
    );
    let text = document("", FLIGHT, &legs);
    let files = [("survey.xml", text.as_str()), ("a.obj", ""), ("f.csv", "")];
    let poses: std::sync::Arc<[u8]> = (*b"poses").into();
    let options =
        ReadOptions { named_trajectories: vec![("<poses>".to_owned(), poses)], ..ReadOptions::default() };
    let (survey, _) = Folder::new(&files).read(&options).unwrap_or_else(|e| panic!("{}", report(&e)));
    let PlatformKind::Interpolated(flight) = &survey.platform.kind else { panic!("not interpolated") };
    let [memory, file] = &flight.files[..] else { panic!("{} files", flight.files.len()) };
    assert_eq!(
        (memory.path.as_path(), memory.content.as_deref()),
        (Path::new("<poses>"), Some(&b"poses"[..]))
    );
    assert!(file.path.ends_with("f.csv") && file.content.is_none());
    let missing = Folder::new(&files).read(&ReadOptions::default());
    contains(&refused(missing), &["cannot find the file `<poses>`"]);
    // The name of a trajectory in memory, and the path of a file.
    let folder = Folder::new(&files[1..]);
    let name = folder.path("f.csv").display().to_string();
    folder.write("survey.xml", &text.replace("&lt;poses&gt;", &name));
    let named_trajectories = vec![(name, (*b"poses").into())];
    let (survey, _) = folder.read(&ReadOptions { named_trajectories, ..options }).unwrap();
    let PlatformKind::Interpolated(flight) = &survey.platform.kind else { panic!("not interpolated") };
    assert_eq!(flight.files.iter().map(|file| file.content.is_some()).collect::<Vec<_>>(), [true, false]);
}

#[test]
fn a_stream_replaces_platform_and_legs() {
    // on a tripod such a leg would never end; the first leg is inactive
    let legs = "<leg><platformSettings/><scannerSettings active='0' scanFreq_hz='5'/></leg>
        <leg><platformSettings x='4'/><scannerSettings scanFreq_hz='70'/></leg>";
    let folder = Folder::new(&[("survey.xml", &document("", "platform='tripod'", legs)), ("a.obj", "")]);
    assert!(folder.read(&ReadOptions::default()).is_err());
    let options = ReadOptions { trajectory: Some(PoseStream::at("-")), ..ReadOptions::default() };
    let (survey, _) = folder.read(&options).unwrap_or_else(|e| panic!("{}", report(&e)));
    assert!(matches!(&survey.platform.kind, PlatformKind::Stream(s) if s.path == Path::new("-")));
    assert_eq!((survey.legs.len(), survey.legs[0].scanner.scan_freq, survey.legs[0].number), (1, 70.0, 0));
}

#[test]
fn encodings_and_line_ends() {
    let text = document("", "platform='plane' name='Tübingen'", LEG).replace('\n', "\r\n");
    let latin: Vec<u8> = format!("<?xml version=\"1.0\" encoding=\"ISO-8859-1\"?>\r\n{text}")
        .chars()
        .map(|c| c as u8)
        .collect();
    let with_mark = format!("\u{feff}<?xml version=\"1.0\"?>\n{text}").into_bytes();
    let folder = Folder::new(&[("a.obj", "")]);
    for bytes in [text.clone().into_bytes(), latin.clone(), with_mark] {
        std::fs::write(folder.path("survey.xml"), bytes).unwrap();
        let (survey, _) = folder.read(&ReadOptions::default()).unwrap_or_else(|e| panic!("{}", report(&e)));
        assert_eq!(survey.name, "Tübingen");
    }
    let undeclared: Vec<u8> = text.chars().map(|c| c as u8).collect();
    std::fs::write(folder.path("survey.xml"), undeclared).unwrap();
    let (survey, warnings) =
        folder.read(&ReadOptions::default()).unwrap_or_else(|e| panic!("{}", report(&e)));
    assert_eq!(survey.name, "Tübingen");
    contains(&warnings.render(false), &["byte 0xfc is not UTF-8", "survey.xml:6:"]);
}

#[test]
fn a_document_in_memory_is_read_like_a_file() {
    let text = document("", "platform='plane' name='Tübingen'", LEG);
    let folder = Folder::new(&[("a.obj", "")]);
    let options = ReadOptions::default();
    let read = read_survey_text(&folder.path("survey.xml"), &text, &options);
    let (survey, _) = read.unwrap_or_else(|e| panic!("{}", report(&e)));
    assert_eq!((survey.name.as_str(), survey.legs.len()), ("Tübingen", 1));
    let Err(error) = read_survey_text(Path::new("<memory>"), "<document>", &options) else {
        panic!("a document without an end is read");
    };
    contains(&report(&error), &["<memory>"]);
}
