//! Beam and receiver of instruments, in XML and in pipeline files.

use super::*;

const PULSE: &str = "ns, power\n0, 0\n1, 5\n3, 0\n";

/// The scanner of a survey with these attributes and children of the scanner, and this content of the survey.
fn of_xml(attributes: &str, children: &str, survey: &str) -> vlscan_base::Result<(Scanner, Diagnostics)> {
    let scanner = format!(
        "<scanner id='mine' optics='conic' scanAngleMax_deg='30' pulseFreqs_Hz='5' {attributes}>{children}</scanner>"
    );
    let leg = format!("{survey}<leg><platformSettings/><scannerSettings active='0'/></leg>");
    let text = document(&scanner, "platform='plane'", &leg).replace("scanner='mirror'", "scanner='mine'");
    let folder =
        Folder::new(&[("survey.xml", &text), ("a.obj", ""), ("pulse.csv", PULSE), ("bad.csv", "0 1\n1\n")]);
    folder.read(&ReadOptions::default()).map(|(survey, warnings)| (survey.scanner, warnings))
}

/// The scanner of a pipeline with these keys in `[scanner]`; channels may follow them.
fn of_toml(keys: &str) -> vlscan_base::Result<(Scanner, Diagnostics)> {
    let text = format!(
        "scene = \"a.obj\"\nplatform = {{ kind = \"linear_path\" }}\n[[leg]]\nposition_m = [0, 0, 0]\nactive = false\n\
         [scanner]\noptics = \"conic\"\nscan_angle_max_deg = 30\npulse_freqs_hz = [5]\n{keys}"
    );
    let folder =
        Folder::new(&[("p.toml", &text), ("a.obj", ""), ("pulse.csv", PULSE), ("bad.csv", "0 1\n1\n")]);
    read_pipeline(&folder.path("p.toml")).map(|(survey, w)| (survey.scanner, w))
}

fn fine(scanner: vlscan_base::Result<(Scanner, Diagnostics)>) -> Vec<Device> {
    let (scanner, warnings) = scanner.unwrap_or_else(|e| panic!("{}", report(&e)));
    assert!(warnings.is_empty(), "{}", warnings.render(false));
    scanner.devices
}

/// The devices of a scanner that ships, named in a pipeline file, with these keys.
fn shipped(name: &str, keys: &str) -> vlscan_base::Result<(Scanner, Diagnostics)> {
    let text = format!(
        "scene = \"a.obj\"\n[[leg]]\nposition_m = [0, 0, 0]\nactive = false\n[platform]\ncatalogue = \"sr22\"\n\
         [scanner]\ncatalogue = \"{name}\"\n{keys}"
    );
    let folder = Folder::new(&[("p.toml", &text), ("a.obj", "")]);
    read_pipeline(&folder.path("p.toml")).map(|(survey, warnings)| (survey.scanner, warnings))
}

#[test]
fn data_sheets_count_in_pipelines_and_the_catalogue_of_the_reference_in_xml() {
    let found = |name: &str| {
        let (scanner, _) = find_scanner(name, &ReadOptions::default()).unwrap();
        scanner.devices[0].clone()
    };
    let swinging = "[settings]\nscan_freq_hz = 50\nscan_angle_deg = 20";
    let (als, of_xml) = (fine(shipped("leica_als50-ii", swinging))[0].clone(), found("leica_als50-ii"));
    assert_eq!((als.receiver.dead_time, of_xml.receiver.dead_time), (18.0, 0.0));
    assert!((width_of_pulse_length(als.beam.pulse_length) - 9.0).abs() < 1e-12);
    assert_eq!((of_xml.beam.pulse_length, of_xml.beam.stated_width), (10.0, Some(10.0)));
    let (vz400, of_xml) = (fine(shipped("riegl_vz400", ""))[0].clone(), found("riegl_vz400"));
    assert_eq!((vz400.beam.wavelength, of_xml.beam.wavelength), (1550.0, 1064.0));
    assert_eq!((vz400.beam.divergence, of_xml.beam.divergence), (0.00035, 0.0003));
    assert!(of_xml.stated.are_left() && !vz400.stated.are_left() && vz400.stated.is_built_in);
    // What the pipeline says counts.
    let own = fine(shipped("riegl_vz400", "wavelength_nm = 905\nbeam_divergence_rad = 0.001"))[0].beam;
    assert_eq!((own.wavelength, own.atmosphere_wavelength, own.divergence), (905.0, 905.0, 0.001));
    let avia = fine(shipped("livox-avia-non-repetitive", ""));
    assert!(avia.iter().all(|device| device.detector.accuracy == 0.02));
    assert_eq!(found("livox-avia-non-repetitive").detector.accuracy, 0.01);
    let puck = fine(shipped("data/scanners_tls.xml#vlp16", ""));
    assert!(puck.iter().all(|device| device.detector.range_min == 1.0));
    assert!((found("data/scanners_tls.xml#vlp16").detector.range_min - 0.09144).abs() < 1e-12);
}

#[test]
fn scanners_that_ship_state_their_pulse_widths() {
    // 4 ns at half maximum, whatever the physics of a pipeline; in XML by the physics.
    let width = |beam: &Beam| width_of_pulse_length(beam.pulse_length);
    let beam = fine(shipped("riegl_lms-q780", ""))[0].beam;
    assert!((width(&beam) - 4.0).abs() < 1e-12 && beam.stated_width.is_none());
    assert_eq!(fine(shipped("riegl_lms-q780", "pulse_length_ns = 6"))[0].beam.pulse_length, 6.0);
    assert!((width(&fine(shipped("riegl_lms-q780", "pulse_fwhm_ns = 6"))[0].beam) - 6.0).abs() < 1e-12);
    let (scanner, _) = find_scanner("riegl_lms-q780", &ReadOptions::default()).unwrap();
    let beam = scanner.devices[0].beam;
    assert_eq!((beam.length(false), beam.stated_width), (4.0, Some(4.0)));
    assert!((width_of_pulse_length(beam.length(true)) - 4.0).abs() < 1e-12);
    // One's own files have no stated widths.
    assert_eq!(fine(of_xml("pulseLength_ns='4'", "", ""))[0].beam.stated_width, None);
}

#[test]
fn references_to_the_catalogue_skip_files_of_the_same_name() {
    let other =
        "<document><scanner id='vlp16' optics='conic' scanAngleMax_deg='30' pulseFreqs_Hz='5'/></document>";
    let folder = Folder::new(&[("data/scanners_tls.xml", other), ("vlp16", other)]);
    let options = ReadOptions { assets: vec![folder.path("")], ..ReadOptions::default() };
    for name in ["vlp16", "data/scanners_tls.xml#vlp16"] {
        let channels = |name: &str| find_scanner(name, &options).unwrap().0.devices.len();
        assert_eq!((channels(name), channels(&format!("catalogue:{name}"))), (1, 16), "{name}");
    }
}

#[test]
fn scanners_and_platforms_that_ship_have_ids() {
    for name in ["vlp16", "data/scanners_tls.xml#vlp16", "scanners_tls.xml#vlp16"] {
        assert_eq!(fine(shipped(name, "")).len(), 16, "{name}");
        assert_eq!(fine(shipped(&format!("catalogue:{name}"), "")).len(), 16, "{name}");
    }
    for (name, reported) in [
        ("catalogue:mine.xml#vlp16", "has no file `mine.xml`"),
        ("catalogue:data/scanners_als.xml#vlp16", "no <scanner> with the id `vlp16`"),
        ("catalogue:nosuch", "no scanner with the id `nosuch`"),
        ("catalogue:tripod", "`tripod` is a platform"),
        ("catalogue:", "no scanner with the id ``"),
    ] {
        let said = report(&shipped(name, "").unwrap_err());
        assert!(said.contains(reported), "{said}");
    }
    for (name, near) in
        [("VUX-1UAV", "`riegl_vux-1uav`"), ("data/scanners_als.xml#VUX-1UAV", "`riegl_vux-1uav`")]
    {
        let said = report(&shipped(name, "").unwrap_err());
        assert!(said.contains(&format!("did you mean {near}?")), "{said}");
    }
    assert!(report(&shipped("nosuch", "").unwrap_err()).contains("vlscan catalogue"));
    let Err(error) = find_platform("vehicel_linearpath", &ReadOptions::default()) else {
        panic!("a platform")
    };
    assert!(report(&error).contains("did you mean `vehicle_linearpath`?"));
}

#[test]
fn figures_can_state_their_sources() {
    let source = "<source figures='accuracy_m beamDivergence_rad' name='sheet of 2024'/>";
    let (scanner, warnings) = of_xml("", source, "").unwrap();
    assert!(warnings.is_empty());
    let figures = vec!["accuracy_m".to_owned(), "beamDivergence_rad".to_owned()];
    assert_eq!(scanner.sources, [FigureSource { figures, name: "sheet of 2024".to_owned() }]);
}

#[test]
fn every_setting_in_both_formats() {
    let xml = fine(of_xml(
        "pulseFwhm_ns='3' pulseEnergy_uJ='2' pulseShape='pulse.csv' beamProfile='top_hat' beamDivergenceY_rad='0.001'
         exitAperture_m='0.02' background_W='1e-9' responsivity_A_per_W='0.6' bandwidth_Hz='2e8' saturation_W='1e-5'
         rangeWalk_m='0.1' digitiserClock='true' detector='gaussian'",
        "<snr range_m='100' reflectance='0.2' value='20'/><maxRange range_m='600' reflectance='0.9' pulseFreq_Hz='1e5'/>",
        "",
    ));
    let toml = fine(of_toml(
        "pulse_fwhm_ns = 3\npulse_energy_uj = 2\npulse_shape = \"pulse.csv\"\nbeam_profile = \"top_hat\"\n\
         beam_divergence_y_rad = 0.001\nexit_aperture_m = 0.02\nbackground_w = 1e-9\nresponsivity_a_per_w = 0.6\n\
         bandwidth_hz = 2e8\nsaturation_w = 1e-5\nrange_walk_m = 0.1\ndigitiser_clock = true\ndetector = \"gaussian\"\n\
         snr = { range_m = 100, reflectance = 0.2, value = 20 }\n\
         max_range = { range_m = 600, reflectance = 0.9, pulse_freq_hz = 1e5 }\n",
    ));
    assert_eq!(xml[0].receiver, toml[0].receiver);
    assert_eq!(xml[0].beam, toml[0].beam);
    let target = ReferenceTarget { range: 600.0, reflectance: 0.9, pulse_freq: Some(1e5) };
    let expected = Receiver {
        pulse_shape: Some(std::sync::Arc::new(PulseSamples {
            times: vec![0.0, 1.0, 3.0],
            powers: vec![0.0, 1.0, 0.0],
        })),
        noise: Some(AmplifierNoise::Ratio {
            target: ReferenceTarget { range: 100.0, reflectance: 0.2, pulse_freq: None },
            value: 20.0,
        }),
        shot: Some(ShotNoise { background: 1e-9, responsivity: 0.6 }),
        bandwidth: Some(2e8),
        max_range: Some(target),
        saturation: Some(1e-5),
        range_walk: 0.1,
        digitiser_clock: true,
        ranging: Ranging::Gaussian,
        ..Receiver::default()
    };
    assert_eq!(xml[0].receiver, expected);
    let beam = xml[0].beam;
    assert_eq!((beam.pulse_energy, beam.profile), (Some(2.0 * 1e-6), BeamProfile::TopHat));
    assert_eq!((beam.divergence_y, beam.aperture), (Some(0.001), 0.02));
    assert!((beam.pulse_length - 3.0 / 0.484_954_4).abs() < 1e-5, "{}", beam.pulse_length);
}

#[test]
fn nothing_said_is_an_ideal_receiver() {
    for device in [&fine(of_xml("", "", ""))[0], &fine(of_toml(""))[0]] {
        assert_eq!(device.receiver, Receiver::default());
        assert_eq!(
            (device.beam.pulse_energy, device.beam.divergence_y, device.beam.aperture),
            (None, None, 0.0)
        );
        assert!(!device.detector.threshold_given);
    }
    assert!(fine(of_xml("receivedEnergyMin_W='0.0001'", "", ""))[0].detector.threshold_given);
    assert!(fine(of_toml("received_energy_min_w = 0.0001\n"))[0].detector.threshold_given);
}

#[test]
fn channels_change_what_they_name() {
    let xml = fine(of_xml(
        "nep_W='1e-9'",
        "<maxRange range_m='600' reflectance='0.9'/><channels><channel detector='centroid'/>\
         <channel receivedEnergyMin_W='1e-8' nep_W='2e-9'/></channels>",
        "",
    ));
    let toml = fine(of_toml(
        "nep_w = 1e-9\nmax_range = { range_m = 600, reflectance = 0.9 }\n[[scanner.channel]]\ndetector = \"centroid\"\n\
         [[scanner.channel]]\nreceived_energy_min_w = 1e-8\nnep_w = 2e-9\n",
    ));
    for devices in [xml, toml] {
        let [a, b] = &devices[..] else { panic!("two channels") };
        assert_eq!(
            (a.receiver.noise, a.receiver.ranging),
            (Some(AmplifierNoise::Power(1e-9)), Ranging::Centroid)
        );
        assert!(a.receiver.max_range.is_some() && b.receiver.max_range.is_none());
        assert_eq!((b.receiver.noise, b.detector.threshold), (Some(AmplifierNoise::Power(2e-9)), 1e-8));
    }
}

#[test]
fn a_survey_changes_the_receiver_of_every_channel() {
    let devices = fine(of_xml(
        "pulseShape='pulse.csv'",
        "<channels><channel/><channel/></channels>",
        "<detectorSettings nep_W='3e-9' detector='centroid'/>",
    ));
    for device in &devices {
        let r = &device.receiver;
        assert_eq!((r.noise, r.ranging), (Some(AmplifierNoise::Power(3e-9)), Ranging::Centroid));
        assert!(r.pulse_shape.is_some());
    }
}

#[test]
fn settings_that_cannot_be_are_named_with_their_place() {
    let ratio = "<snr range_m='1' reflectance='0.2' value='9'/>";
    let far = "<maxRange range_m='1' reflectance='0.2'/>";
    let xml = [
        (
            "pulseFwhm_ns='3' pulseLength_ns='3'",
            "",
            "give either `pulseFwhm_ns` or `pulseLength_ns`, not both",
        ),
        ("pulseEnergy_uJ='0'", "", "`pulseEnergy_uJ` must be a number above 0"),
        ("beamProfile='round'", "", "`beamProfile` must be gaussian or top_hat"),
        ("exitAperture_m='-1'", "", "`exitAperture_m` must be a number of at least 0"),
        ("detector='best'", "", "`detector` must be peak, centroid, gaussian or photons"),
        ("background_W='1e-9' bandwidth_Hz='1e8'", "", "`background_W` needs `responsivity_A_per_W`"),
        ("nep_W='1e-9'", ratio, "give either `nep_W` or `snr`, not both"),
        ("receivedEnergyMin_W='1e-9'", far, "give either `receivedEnergyMin_W` or `maxRange`, not both"),
        (
            "",
            "<snr range_m='1' reflectance='20' value='9'/>",
            "`reflectance` must be a fraction above 0, at most 1",
        ),
        ("", "<snr range_m='1' reflectance='0.2'/>", "<snr> needs the attribute `value`"),
        ("", "<maxRange reflectance='0.2'/>", "<maxRange> needs the attribute `range_m`"),
        ("pulseShape='none.csv'", "", "cannot find the file `none.csv`"),
        ("pulseShape='bad.csv'", "", "expected two finite numbers"),
    ];
    for (attributes, children, message) in xml {
        contains(&refused(of_xml(attributes, children, "")), &[message, "^"]);
    }
    let toml = [
        ("pulse_fwhm_ns = 3\npulse_length_ns = 3\n", "either `pulse_fwhm_ns` or `pulse_length_ns`"),
        ("pulse_energy_uj = 0\n", "a number above 0"),
        ("beam_profile = \"round\"\n", "`beam_profile` must be gaussian or top_hat, found `round`"),
        ("detector = \"best\"\n", "`detector` must be peak, centroid, gaussian or photons, found `best`"),
        ("background_w = 1e-9\n", "`background_w` needs `responsivity_a_per_w`"),
        ("nep_w = 1e-9\nsnr = { range_m = 1, reflectance = 1, value = 1 }\n", "either `nep_w` or `snr`"),
        ("received_energy_min_w = 1\nmax_range = { range_m = 1, reflectance = 1 }\n", "or `max_range`"),
        ("max_range = { range_m = 1, reflectance = 20 }\n", "a fraction above 0, at most 1"),
        ("max_range = { range_m = 1 }\n", "the key `reflectance` is missing"),
        ("snr = { range_m = 1, reflectance = 1, value = 1, freq = 3 }\n", "unknown key `freq`"),
        ("pulse_shape = \"none.csv\"\n", "cannot find the file `none.csv`"),
        ("pulse_shape = \"bad.csv\"\n", "expected two finite numbers"),
    ];
    for (keys, message) in toml {
        contains(&refused(of_toml(keys)), &[message, "^"]);
    }
}

/// A value of every key that not every physics makes use of, as TOML.
fn example(key: &str) -> &'static str {
    match key {
        "beam_profile" => "\"top_hat\"",
        "pulse_shape" => "\"pulse.csv\"",
        "max_range" => "{ range_m = 600, reflectance = 0.9 }",
        "snr" => "{ range_m = 100, reflectance = 0.2, value = 20 }",
        "range_noise" => "{ constant_m = 0.002 }",
        "overlap" => "{ field_of_view_rad = 0.002 }",
        "fmcw" => "{ bandwidth_hz = 1e9, chirp_s = 1e-5 }",
        "afterpulse" => "{ probability = 0.01, delay_ns = 10 }",
        "threshold_photons" | "pixels" => "8",
        "digitiser_clock" | "refraction_corrected" => "true",
        "detector" => "\"gaussian\"",
        "background_w" => "1e-9\nresponsivity_a_per_w = 0.6",
        _ => "0.002",
    }
}

#[test]
fn a_bandwidth_without_noise_is_warned_of() {
    for (keys, is_warned) in [
        ("", true),
        ("nep_w = 1e-9\n", false),
        ("responsivity_a_per_w = 0.6\n", false),
        ("[[scanner.channel]]\nnep_w = 1e-9\n", false),
    ] {
        let (_, warnings) = of_toml(&format!("bandwidth_hz = 1e8\n{keys}")).unwrap();
        let text = warnings.text();
        assert_eq!(text.contains("`bandwidth_hz` has no effect without noise"), is_warned, "{keys}: {text}");
    }
}

#[test]
fn field_of_view_and_corrected_points_are_read() {
    let expected = Receiver { field_of_view: Some(0.006), corrects_refraction: true, ..Receiver::default() };
    let keys = "receiver_fov_rad = 0.006\nrefraction_corrected = true\n";
    assert_eq!(fine(of_toml(keys))[0].receiver, expected);
    let attributes = "receiverFov_rad='0.006' refractionCorrected='true'";
    assert_eq!(of_xml(attributes, "", "").unwrap().0.devices[0].receiver, expected);
    for wrong in ["receiver_fov_rad = -1\n", "receiver_fov_rad = nan\n", "refraction_corrected = 2\n"] {
        assert!(of_toml(wrong).is_err(), "{wrong}");
    }
}

#[test]
fn overlaps_are_read_and_beams_without_one_have_no_text_of_it() {
    let expected = Overlap { field_of_view: 0.002, baseline: 0.1, focus: 0.02 };
    let table = "overlap = { field_of_view_rad = 0.002, baseline_m = 0.1, focus_m = 50 }\n";
    let child = "<overlap fieldOfView_rad='0.002' baseline_m='0.1' focus_m='50'/>";
    for found in [of_toml(table), of_xml("", child, "")] {
        let beam = found.unwrap().0.devices[0].beam;
        assert_eq!(beam.overlap, Some(expected));
        assert!(format!("{beam:?}").contains("overlap: Overlap { field_of_view: 0.002"), "{beam:?}");
    }
    let plain = fine(of_toml(""))[0].beam;
    assert!(plain.overlap.is_none() && !format!("{plain:?}").contains("overlap"), "{plain:?}");
    assert!(of_toml("overlap = { baseline_m = 0.1 }\n").is_err());
}

#[test]
fn keys_that_a_physics_passes_over_are_told_with_their_line() {
    let report_of = |scanner: &Scanner, refined: bool| {
        let mut found = Diagnostics::default();
        warn_of_unused_keys(&scanner.written, |_| refined, &mut found);
        found
    };
    let mut count = 0;
    let is_reported = |key: &&Key| {
        !matches!(key.used, KeyUse::Always | KeyUse::InLaterChannelsWith(_)) && !key.key.is_empty()
    };
    for key in INSTRUMENT_KEYS.iter().filter(is_reported) {
        let partner = match key.used {
            KeyUse::UnlessBeside { key, .. } => format!("{key} = {}\n", example(key)),
            _ => String::new(),
        };
        let text = format!("{partner}{} = {}\n", key.key, example(key.key));
        for (text, channel) in [(text.clone(), false), (format!("[[scanner.channel]]\n{text}"), true)] {
            let (scanner, _) = of_toml(&text).unwrap_or_else(|e| panic!("{text}: {}", report(&e)));
            let (helios, refined) = (report_of(&scanner, false), report_of(&scanner, true));
            let idle = if matches!(key.used, KeyUse::With(_)) { &helios } else { &refined };
            let reported = idle.items().iter().find(|item| item.message.contains(&format!("`{}`", key.key)));
            let reported = reported.unwrap_or_else(|| panic!("`{}` is passed over in silence", key.key));
            let line = 10 + text.lines().position(|line| line.starts_with(key.key)).unwrap();
            assert_eq!(reported.place.as_ref().map(|p| p.line), Some(line), "{text}");
            let other = if matches!(key.used, KeyUse::With(_)) { &refined } else { &helios };
            assert!(
                other.items().iter().all(|item| !item.message.contains(&format!("`{}`", key.key))),
                "{channel}: {}",
                other.render(false)
            );
            count += 1;
        }
    }
    assert!(count > 30, "{count}");
}

#[test]
fn attributes_that_a_physics_passes_over_are_told_with_their_line() {
    let (scanner, _) = of_xml(
        "nep_W='1e-9'",
        "<maxRange range_m='600' reflectance='0.9'/>\n<channels><channel/>\n<channel saturation_W='1e-5'/></channels>",
        "\n<detectorSettings rangeWalk_m='0.1'/>",
    )
    .unwrap();
    let mut found = Diagnostics::default();
    warn_of_unused_keys(&scanner.written, |_| false, &mut found);
    let lines: Vec<_> = found
        .items()
        .iter()
        .map(|i| (i.message.split('`').nth(1).unwrap(), i.place.as_ref().unwrap().line))
        .collect();
    assert_eq!(
        lines,
        [("nep_W", 5), ("maxRange", 5), ("saturation_W", 7), ("rangeWalk_m", 10)],
        "{}",
        found.render(false)
    );
    // The built-in catalogue serves all physics.
    let (scanner, _) = find_scanner("riegl_vz400", &ReadOptions::default()).unwrap();
    assert!(scanner.written.is_empty());
}

#[test]
fn the_accuracy_of_a_later_channel_is_told_where_the_first_one_s_holds() {
    let channels =
        "accuracy_m = 0.1\n[[scanner.channel]]\naccuracy_m = 0.2\n[[scanner.channel]]\naccuracy_m = 0.3\n";
    let (scanner, _) = of_toml(channels).unwrap();
    let reported = |is_on: bool| {
        let mut found = Diagnostics::default();
        warn_of_unused_keys(&scanner.written, |_| is_on, &mut found);
        found.items().iter().map(|i| i.place.as_ref().unwrap().line).collect::<Vec<_>>()
    };
    assert_eq!((reported(false), reported(true)), (vec![14], vec![]));
    let channels = "<channels><channel accuracy_m='0.2'/><channel accuracy_m='0.3'/></channels>";
    let (scanner, _) = of_xml("", channels, "").unwrap();
    assert_eq!([0, 1].map(|i| scanner.devices[i].detector.accuracy), [0.2, 0.3]);
    let (scanner, _) = of_xml("", channels, "<detectorSettings accuracy_m='0.5'/>").unwrap();
    assert_eq!([0, 1].map(|i| scanner.devices[i].detector.accuracy), [0.5, 0.5]);
}

#[test]
fn noise_by_strength_photons_dead_time_and_steps() {
    let expected = Receiver {
        range_noise: Some(RangeNoise { constant: 0.005, shot: 0.02, amplifier: 0.0, footprint: 0.7 }),
        threshold_photons: Some(8),
        dropout_rate: 0.01,
        dead_time: 3.0,
        range_step: 0.001,
        ..Receiver::default()
    };
    let keys = "range_noise = { constant_m = 0.005, shot_m = 0.02, footprint = 0.7 }\nthreshold_photons = 8\ndropout_rate = 0.01\ndead_time_ns = 3\nrange_step_m = 0.001\n";
    assert_eq!(fine(of_toml(keys))[0].receiver, expected);
    let attributes = "thresholdPhotons='8' dropoutRate='0.01' deadTime_ns='3' rangeStep_m='0.001'";
    let (scanner, _) =
        of_xml(attributes, "<rangeNoise constant_m='0.005' shot_m='0.02' footprint='0.7'/>", "").unwrap();
    assert_eq!(scanner.devices[0].receiver, expected);
    // An accuracy that is stated later replaces it.
    let after = "range_noise = { constant_m = 0.005 }\n[detector]\naccuracy_m = 0.01\n";
    assert_eq!(fine(of_toml(after))[0].receiver.range_noise, None);
    for (keys, said) in [
        ("accuracy_m = 0.01\nrange_noise = { constant_m = 0.005 }\n", "`range_noise`"),
        ("range_noise = { constant_m = -1 }\n", "`constant_m`"),
        ("range_noise = { floor_m = 1 }\n", "unknown key `floor_m`"),
        ("threshold_photons = 0\n", "`threshold_photons`"),
        ("dead_time_ns = -1\n", "`dead_time_ns`"),
        ("range_step_m = -1\n", "`range_step_m`"),
    ] {
        let error = report(&of_toml(keys).unwrap_err());
        assert!(error.contains(said), "{said} is missing from\n{error}");
    }
}

#[test]
fn chirps_and_pixels_are_read() {
    let keys = "fmcw = { bandwidth_hz = 1e9, chirp_s = 1e-5, sample_rate_hz = 1e9, quadrature = true, false_alarm = 1e-6 }\n";
    let expected = Fmcw {
        bandwidth: 1e9,
        chirp: 1e-5,
        sample_rate: Some(1e9),
        has_quadrature: true,
        false_alarm: Some(1e-6),
    };
    assert_eq!(fine(of_toml(keys))[0].receiver.fmcw, Some(expected));
    let photons = "detector = \"photons\"\nthreshold_photons = 1\n";
    let keys = format!(
        "{photons}pixels = 4\nphoton_jitter_ns = 0.3\ndark_counts_hz = 1e5\nafterpulse = {{ probability = 0.02, delay_ns = 10 }}\n"
    );
    let expected = PixelSettings { count: 4, jitter: 0.3, dark_counts: 1e5, afterpulse: Some((0.02, 10.0)) };
    assert_eq!(fine(of_toml(&keys))[0].receiver.pixels, expected);
    assert!(!format!("{:?}", Receiver::default()).contains("pixels"));
    let chirps = "fmcw = { bandwidth_hz = 1e9, chirp_s = 1e-5 }\n";
    for (keys, said) in [
        (format!("{photons}{chirps}"), "give either `fmcw` or `threshold_photons`"),
        (format!("pulse_fwhm_ns = 3\n{chirps}"), "give either `fmcw` or `pulse_fwhm_ns`"),
        ("fmcw = { bandwidth_hz = 1e9 }\n".to_owned(), "`chirp_s`"),
        ("fmcw = { bandwidth_hz = nan, chirp_s = 1e-5 }\n".to_owned(), "`bandwidth_hz`"),
        ("fmcw = { bandwidth_hz = 1e9, chirp_s = -1 }\n".to_owned(), "`chirp_s`"),
        ("fmcw = { bandwidth_hz = 1e9, chirp_s = 1e-5, false_alarm = 0 }\n".to_owned(), "`false_alarm`"),
        (format!("{photons}pixels = 0\n"), "`pixels` must be a whole number from 1 to 4096"),
        (format!("{photons}pixels = 2.5\n"), "pixels"),
        (format!("{photons}photon_jitter_ns = -1\n"), "`photon_jitter_ns`"),
        (format!("{photons}dark_counts_hz = nan\n"), "`dark_counts_hz`"),
        (format!("{photons}afterpulse = {{ probability = 1, delay_ns = 9 }}\n"), "`probability`"),
        (format!("{photons}afterpulse = {{ probability = 0.1, delay_ns = 0 }}\n"), "`delay_ns`"),
    ] {
        let error = report(&of_toml(&keys).unwrap_err());
        assert!(error.contains(said), "{said} is missing from\n{error}");
    }
    let (_, warnings) = of_toml("pixels = 4\n").unwrap();
    contains(&warnings.render(false), &["`pixels` has no effect without `detector` \"photons\""]);
}

#[test]
fn receivers_that_count_photons() {
    let expected = Receiver {
        ranging: Ranging::Photons,
        threshold_photons: Some(1),
        dead_time: 3.0,
        ..Receiver::default()
    };
    let keys = "detector = \"photons\"\nthreshold_photons = 1\ndead_time_ns = 3\n";
    assert_eq!(fine(of_toml(keys))[0].receiver, expected);
    let attributes = "detector='photons' thresholdPhotons='1' deadTime_ns='3'";
    assert_eq!(fine(of_xml(attributes, "", ""))[0].receiver, expected);
    let error = report(&of_toml("detector = \"photons\"\n").unwrap_err());
    assert!(error.contains("needs `threshold_photons`"), "{error}");
    let (_, warnings) = of_toml("detector = \"photons\"\nthreshold_photons = 1\nnep_w = 1e-9\n").unwrap();
    assert!(warnings.render(false).contains("no amplifier"), "{}", warnings.render(false));
}

#[test]
fn channels_are_listed_by_the_angles_of_their_beams() {
    let beams = |devices: &[Device]| -> Vec<[f64; 5]> {
        let of = |device: &Device| {
            let (d, o) = (device.beam_origin.rotation.forward(), device.beam_origin.offset);
            [d.z.asin().to_degrees(), d.x.atan2(d.y).to_degrees(), o.x, o.y, o.z]
        };
        devices.iter().map(of).collect()
    };
    let expected = [[10.0, 4.0, 0.0, 0.02, 0.0], [-10.0, -4.0, 0.0, 0.02, 0.0]];
    let are = |devices: &[Device]| {
        let found = beams(devices);
        assert_eq!(found.len(), 2);
        for (a, b) in found.iter().flatten().zip(expected.iter().flatten()) {
            assert!((a - b).abs() < 1e-9, "{found:?}");
        }
    };
    are(&fine(of_toml("elevations_deg = [10, -10]\nazimuths_deg = [4, -4]\norigin_radii_m = [0.02]\n")));
    let channels = "<channels elevations_deg='10;-10' azimuths_deg='4;-4' originRadii_m='0.02'/>";
    are(&fine(of_xml("", channels, "")));
    for (keys, said) in [
        ("azimuths_deg = [4, -4]\n", "needs `elevations_deg`"),
        ("elevations_deg = [10, -10]\nazimuths_deg = [4]\n", "2 angles in degrees"),
        ("elevations_deg = [10, -91]\n", "-90 to 90"),
        ("elevations_deg = []\n", "-90 to 90"),
        ("elevations_deg = [10, -10]\norigin_radii_m = [1, 2, 3]\n", "1 or 2 lengths"),
        ("elevations_deg = [10]\n[[scanner.channel]]\nid = \"a\"\n", "lists channels"),
        ("[[scanner.channel]]\nelevations_deg = [10]\n", "a channel has no `elevations_deg`"),
    ] {
        let error = report(&of_toml(keys).unwrap_err());
        assert!(error.contains(said), "{said} is missing from\n{error}");
    }
}

#[test]
fn listed_angles_replace_those_of_an_entry() {
    let found = |name: &str, keys: &str| -> Vec<[f64; 3]> {
        let (scanner, _) = shipped(name, keys).unwrap_or_else(|e| panic!("{}", report(&e)));
        let of = |device: &Device| {
            let (d, o) = (device.beam_origin.rotation.forward(), device.beam_origin.offset);
            [d.z.asin().to_degrees(), d.x.atan2(d.y).to_degrees(), o.y]
        };
        scanner.devices.iter().map(of).collect()
    };
    let listed = "elevations_deg = [-20, 0, 10]\nazimuths_deg = [1, 0, -2]\n";
    let plain = "elevations_deg = [-20, 0, 10]\n";
    let tilt = "beam_origin = { rotate_deg = [{ x = 5 }] }\n";
    for (name, keys, expected) in [
        // The first channel of the entry looks down by 15°.
        ("vlp16", listed.to_owned(), [[-20.0, 1.0, 0.0], [0.0, 0.0, 0.0], [10.0, -2.0, 0.0]]),
        // That of this one looks aside by 4.25°.
        ("ouster_os1-128", plain.to_owned(), [-20.0, 0.0, 10.0].map(|angle| [angle, 0.0, 0.015806])),
        (
            "ouster_os1-128",
            format!("{plain}origin_radii_m = [0.02]\n"),
            [-20.0, 0.0, 10.0].map(|angle| [angle, 0.0, 0.02]),
        ),
        ("vlp16", format!("{plain}{tilt}"), [-15.0, 5.0, 15.0].map(|angle| [angle, 0.0, 0.0])),
    ] {
        let found = found(name, &keys);
        assert_eq!(found.len(), 3, "{keys}");
        for (a, b) in found.iter().flatten().zip(expected.iter().flatten()) {
            assert!((a - b).abs() < 1e-9, "{name}, {keys}: {found:?}");
        }
    }
}
