//! Scanners and channels.

use super::*;
use vlscan_geom::{DVec3, Rotation, radians};

/// Reads a scanner in a survey whose legs are inactive.
fn scanner_of(scanner: &str) -> vlscan_base::Result<(Scanner, Diagnostics)> {
    let legs = "<leg><platformSettings/><scannerSettings active='0'/></leg>";
    let text = document(scanner, "platform='plane'", legs).replace("scanner='mirror'", "scanner='mine'");
    let folder = Folder::new(&[("survey.xml", &text), ("a.obj", "")]);
    folder.read(&ReadOptions::default()).map(|(survey, warnings)| (survey.scanner, warnings))
}

fn fine(scanner: &str) -> Scanner {
    let (scanner, warnings) = scanner_of(scanner).unwrap_or_else(|e| panic!("{}", report(&e)));
    assert!(warnings.is_empty(), "{}", warnings.render(false));
    scanner
}

#[test]
fn defaults() {
    let scanner = fine("<scanner id='mine' optics='conic' scanAngleMax_deg='30' pulseFreqs_Hz='5, 10'/>");
    let d = &scanner.devices[0];
    assert_eq!((scanner.pulse_freqs.as_slice(), scanner.multi_channel), (&[5, 10][..], false));
    assert_eq!((d.beam.divergence, d.beam.pulse_length, d.beam.wavelength), (0.0003, 4.0, 1064.0));
    assert_eq!((d.detector.range_max, d.detector.threshold, d.detector.max_returns), (f64::MAX, 0.0001, 0));
    assert_eq!(
        (d.waveform.window, d.waveform.quality, d.head.axis, d.head.max_rate),
        (1.0, 3, DVec3::Z, 0.0)
    );
    assert!(!d.errors.any());
}

#[test]
fn the_closed_list_of_optics() {
    let with = |optics: &str| {
        let text = format!(
            "<scanner id='mine' optics='{optics}' pulseFreqs_Hz='5' scanAngleMax_deg='30' scanAngleEffectiveMax_deg='20'
             scanProduct='900' numFibers='63' rotorFreq1_Hz='-10' angle1_deg='18' refrIndex1='1.5' angle2_deg='0.0000001'
             angle3_deg='-4'/>"
        );
        let (mut scanner, warnings) = scanner_of(&text).unwrap_or_else(|e| panic!("{}", report(&e)));
        if optics != "risley" {
            contains(&warnings.render(false), &[&format!("`angle1_deg` has no effect with {optics} optics")]);
        }
        scanner.devices.remove(0).deflector
    };
    assert!(
        matches!(with("rotating"), Deflector::Polygon { effective_max, .. } if effective_max == radians(20.0))
    );
    assert!(matches!(with("oscillating"), Deflector::Oscillating { scan_product: 900.0 }));
    assert!(matches!(with("conic"), Deflector::Conic));
    assert!(matches!(with("line"), Deflector::Fibres { count: 63 }));
    let Deflector::Risley { prisms, air, incident } = with("risley") else { panic!("no prisms") };
    assert_eq!(
        (prisms.len(), prisms[0].index, prisms[1].angle, air, incident),
        (2, 1.5, radians(-4.0), 1.0, DVec3::Y)
    );
    let unknown = refused(scanner_of("<scanner id='mine' optics='rotatin' pulseFreqs_Hz='5'/>"));
    contains(
        &unknown,
        &[
            "`optics` must be rotating, oscillating, conic, line or risley, found `rotatin`",
            "did you mean `rotating`?",
        ],
    );
}

#[test]
fn channels_change_what_they_name() {
    let scanner = fine(
        "<scanner id='mine' optics='rotating' pulseFreqs_Hz='1000' wavelength_nm='905' scanAngleMax_deg='60' scanAngleEffectiveMax_deg='50'
            receivedEnergyMin_W='0.5' headRotatePerSecMax_deg='10' accuracy_m='0.1'>
           <beamOrigin x='1'><rot axis='y' angle_deg='10'/></beamOrigin>
           <FWFSettings winSize_ns='3'/><headError expr='THETA'/><rangeError expr='0.1'/>
           <channels>
             <channel/>
             <channel id='b' wavelength_nm='532' scanAngleMax_deg='45' scanAngleEffectiveMax_deg='40' beamDivergence_rad='0.001'>
               <beamOrigin z='2'/><FWFSettings binSize_ns='0.5'/></channel>
             <channel optics='line' numFibers='7'/>
           </channels></scanner>",
    );
    let [a, b, c] = &scanner.devices[..] else { panic!("three channels") };
    assert!(scanner.multi_channel);
    assert_eq!((a.id.as_str(), b.id.as_str(), c.id.as_str()), ("0", "b", "2"));
    // the emitter's pose is replaced completely
    assert_eq!(
        (a.beam_origin.offset, b.beam_origin),
        (DVec3::X, Mount { offset: DVec3::new(0.0, 0.0, 2.0), ..Mount::IDENTITY })
    );
    assert_eq!((b.beam.wavelength, b.beam.atmosphere_wavelength, b.beam.divergence), (532.0, 905.0, 0.001));
    // the angles of a channel are degrees and are used unchanged (trap 73)
    assert_eq!(b.scan_angle_max, radians(45.0));
    assert!(
        matches!(b.deflector, Deflector::Polygon { effective_max, .. } if effective_max == radians(40.0))
    );
    // a channel with other optics inherits no deflector settings (trap 74)
    assert!(matches!(c.deflector, Deflector::Fibres { count: 7 }) && c.scan_angle_max == 0.0);
    // thresholds and errors of the scanner apply to its channels (trap 75)
    assert_eq!((a.detector.threshold, a.errors.head.is_some(), c.errors.head.is_some()), (0.5, true, false));
    assert!(c.errors.range.is_some());
    // a channel's element resets the window; the pulse length assumed there is 4 ns
    assert_eq!((a.waveform.window, b.waveform.window, b.waveform.bin), (3.0, 1.0, 0.5));
}

#[test]
fn legs_have_mounts_of_their_own() {
    let legs = "<leg><platformSettings/><scannerSettings active='0'/></leg>
        <leg><scannerMount x='1'><rot axis='z' angle_deg='90'/></scannerMount><platformSettings/><scannerSettings active='0'/></leg>";
    let survey = clean("", legs);
    let turned = Mount { offset: DVec3::X, rotation: Rotation::about_z(radians(90.0)) };
    assert_eq!(survey.legs[0].platform.mount, None);
    assert_eq!(survey.legs[1].platform.mount, Some(turned));
}

#[test]
fn legs_can_name_other_platforms() {
    let others = "<platform id='tilted' type='linearpath'><scannerMount z='3'><rot axis='x' angle_deg='-90'/></scannerMount></platform>
        <platform id='light' type='multicopter' drag='0.1'/><platform id='heavy' type='multicopter' drag='0.2'/>
        <platform id='shaking' type='linearpath'><positionXNoise type='NORMAL' mean='0' stdev='1'/></platform>";
    let leg = |name: &str, child: &str| {
        format!("<leg platform='{name}'>{child}<platformSettings/><scannerSettings active='0'/></leg>")
    };
    let mount = |name: &str, child: &str| clean(others, &leg(name, child)).legs[0].platform.mount;
    let tilted = Mount { offset: DVec3::new(0.0, 0.0, 3.0), rotation: Rotation::about_x(radians(-90.0)) };
    assert_eq!(mount("tilted", ""), Some(tilted));
    // The leg's own mount goes before that of the platform.
    let own = Mount { offset: DVec3::X, rotation: Rotation::IDENTITY };
    let leg_of_both = leg("tilted", "<scannerMount x='1'/>");
    let (survey, warnings) =
        survey_of(others, "platform='plane'", &leg_of_both).unwrap_or_else(|e| panic!("{}", report(&e)));
    assert_eq!(survey.legs[0].platform.mount, Some(own));
    contains(&warnings.render(false), &["`platform` has no effect beside the <scannerMount> of the leg"]);
    let on =
        |platform: &str, name: &str| survey_of(others, &format!("platform='{platform}'"), &leg(name, ""));
    for (platform, name, message) in [
        ("plane", "tripod", "the platform `tripod` is of type static, that of the survey of type linearpath"),
        ("tripod", "light", "the platform `light` is of type multicopter, that of the survey of type static"),
        ("light", "heavy", "the platform `heavy` does not move as that of the survey"),
        ("plane", "none", "none"),
    ] {
        contains(&refused(on(platform, name)), &[message, "survey.xml:"]);
    }
    let (_, warnings) = on("plane", "shaking").unwrap_or_else(|e| panic!("{}", report(&e)));
    contains(&warnings.render(false), &["the noise of the platform `shaking` has no effect"]);
}

#[test]
fn channels_are_listed_by_their_elevations() {
    let with = |table: &str| {
        scanner_of(&format!(
            "<scanner id='mine' optics='rotating' pulseFreqs_Hz='1000' scanAngleMax_deg='1' scanAngleEffectiveMax_deg='1'
               headRotatePerSecMax_deg='3600'><channels elevations_deg='{table}'/></scanner>"
        ))
    };
    let elevations = |table: &str| -> Vec<f64> {
        let (scanner, _) = with(table).unwrap_or_else(|e| panic!("{}", report(&e)));
        assert!(scanner.multi_channel);
        let up = |d: &Device| (d.beam_origin.rotation.forward().z.asin().to_degrees() * 1e9).round() / 1e9;
        scanner.devices.iter().map(up).collect()
    };
    assert_eq!(elevations("-15; 1;0"), [-15.0, 1.0, 0.0]);
    assert_eq!(elevations("10;...;-5;4"), [10.0, 5.0, 0.0, -5.0]);
    for wrong in ["1;x", "91", "1;...;2;1", "1;...;2", "1;...;2;5000000000", "nan"] {
        contains(&refused(with(wrong)), &["`elevations_deg` must be up to 1024 angles"]);
    }
}

#[test]
fn channels_have_firing_offsets() {
    let with = |channels: &str| {
        scanner_of(&format!(
            "<scanner id='mine' optics='rotating' pulseFreqs_Hz='1000' scanAngleMax_deg='1' scanAngleEffectiveMax_deg='1'
               headRotatePerSecMax_deg='3600'>{channels}</scanner>"
        ))
    };
    let offsets = |channels: &str| -> Vec<f64> {
        let (scanner, _) = with(channels).unwrap_or_else(|e| panic!("{}", report(&e)));
        scanner.devices.iter().map(|d| (d.firing_offset * 1e12).round() * 1e-6).collect()
    };
    assert_eq!(offsets("<channels elevations_deg='1;2;3'/>"), [0.0; 3]);
    assert_eq!(offsets("<channels elevations_deg='1;2;3' firingOffsets_us='0;...;5;3'/>"), [0.0, 2.5, 5.0]);
    assert_eq!(offsets("<channels><channel/><channel firingOffset_us='2.304'/></channels>"), [0.0, 2.304]);
    for wrong in ["0;1", "0;1;-1", "0;1;2e6", "0;1;nan", "0;...;5;4", ""] {
        let channels = format!("<channels elevations_deg='1;2;3' firingOffsets_us='{wrong}'/>");
        contains(&refused(with(&channels)), &["`firingOffsets_us` must be 3 times in µs from 0 to 1000000"]);
    }
    let alone = "<channels firingOffsets_us='0;1'><channel/><channel/></channels>";
    contains(&refused(with(alone)), &["`firingOffsets_us` must be beside `elevations_deg`"]);
    let negative = "<channels><channel firingOffset_us='-1'/></channels>";
    contains(&refused(with(negative)), &["`firingOffset_us` must be a number from 0 to 1e6"]);
}

#[test]
fn wrong_instruments() {
    let base = |attributes: &str, children: &str| {
        refused(scanner_of(&format!(
            "<scanner id='mine' optics='conic' pulseFreqs_Hz='5' {attributes}>{children}</scanner>"
        )))
    };
    contains(&base("", "<headError expr='t'/>"), &["<headError> needs rotating optics"]);
    contains(
        &base("", "<rangeError expr='1+sine(THETA)'/>"),
        &["unknown name `sine`", "did you mean `sin`?", "^^^^"],
    );
    contains(&base("", "<rangeError/>"), &["<rangeError> needs the attribute `expr`"]);
    contains(&base("", "<channels/>"), &["<channels> needs at least one <channel>"]);
    contains(&base("wavelength_nm='0'", ""), &["`wavelength_nm` must be a whole number from 1 to 1000000"]);
    contains(&base("beamDivergence_rad='-1'", ""), &["`beamDivergence_rad` must be a number above 0"]);
    contains(
        &base("rangeMin_m='5' rangeMax_m='4'", ""),
        &["`rangeMax_m` must be at least `rangeMin_m`, 5, found `4`"],
    );
    contains(
        &base("scanFreqMin_Hz='100' scanFreqMax_Hz='10'", "<channels><channel/><channel/></channels>"),
        &["`scanFreqMax_Hz` must be at least `scanFreqMin_Hz`, 100, or 0 for no limit, found `10`"],
    );
    contains(
        &base("scanFreqMax_Hz='10'", "<channels><channel scanFreqMin_Hz='20'/></channels>"),
        &["`scanFreqMin_Hz` must be at most `scanFreqMax_Hz`, 10, found `20`"],
    );
    contains(
        &base("", "<beamOrigin><rot axis='w' angle_deg='1'/></beamOrigin>"),
        &["`axis` must be x, y or z"],
    );
    contains(
        &base("", "<beamOrigin><rot axis='x'/></beamOrigin>"),
        &["<rot> needs the attribute `angle_deg`"],
    );
    contains(&base("", "<FWFSettings binSize_ns='0'/>"), &["`binSize_ns` must be a number above 0"]);
    contains(
        &base("scanAngleAlongMax_deg='14'", ""),
        &["an elliptic cone (`scanAngleAlongMax_deg`) needs a `scanAngleMax_deg` above 0"],
    );
    let flat = "<channels><channel/><channel scanAngleMax_deg='0'/></channels>";
    let flat = base("scanAngleMax_deg='20' scanAngleAlongMax_deg='14'", flat);
    contains(&flat, &["an elliptic cone (`scanAngleAlongMax_deg`) needs a `scanAngleMax_deg` above 0"]);
    let rates = refused(scanner_of("<scanner id='mine' optics='conic' pulseFreqs_Hz='1e5'/>"));
    contains(&rates, &["`pulseFreqs_Hz` must be whole numbers above 0 separated by commas"]);
    let nothing = refused(scanner_of("<scanner id='mine'/>"));
    contains(&nothing, &["needs the attribute `optics`", "needs the attribute `pulseFreqs_Hz`"]);
}

#[test]
fn mirrors_that_never_fire_are_pointed_out() {
    let (_, warnings) =
        scanner_of("<scanner id='mine' optics='rotating' pulseFreqs_Hz='5' scanAngleMax_deg='30'/>").unwrap();
    contains(&warnings.render(false), &["rotating optics without `scanAngleEffectiveMax_deg` emit no pulse"]);
}

#[test]
fn rotation_groups() {
    // spec input-formats §1.5 and kinematics §0.4
    let mount = |attributes: &str| {
        let scanner = fine(&format!(
            "<scanner id='mine' optics='conic' scanAngleMax_deg='30' pulseFreqs_Hz='5'><beamOrigin {attributes}>
               <rot axis='Z' angle_deg='90'/><rot axis='x' angle_deg='0'/><rot axis='y' angle_deg='-30'/></beamOrigin></scanner>"
        ));
        scanner.devices[0].beam_origin.rotation.forward()
    };
    assert!((mount("") - DVec3::new(-0.8660254, 0.0, -0.5)).length() < 1e-6);
    assert!((mount("rotations='local'") - DVec3::new(-1.0, 0.0, 0.0)).length() < 1e-6);
}

/// The report of a pipeline with these lines at its end, after a leg.
fn refused_pipeline(lines: &str) -> String {
    let text = format!(
        "scene = \"a.obj\"\n[platform]\nkind = \"linear_path\"\n[[leg]]\nposition_m = [0, 0, 0]\nactive = false\n{lines}\n"
    );
    let folder = Folder::new(&[("p.toml", &text), ("a.obj", "")]);
    refused(read_pipeline(&folder.path("p.toml")))
}

#[test]
fn every_key_of_a_table_is_suggested_for_a_misspelt_one() {
    let catalogue = "[scanner]\ncatalogue = \"data/scanners_tls.xml#vlp16\"\n";
    let described = "[scanner]\noptics = \"conic\"\npulse_freqs_hz = [5]\nscan_angle_max_deg = 30\n";
    for (scanner, misspelt, meant) in [
        (catalogue, "pulse_freq", "pulse_freqs_hz"),
        (catalogue, "elevation_deg", "elevations_deg"),
        (catalogue, "corretions", "corrections"),
        (catalogue, "firin_times", "firing_times"),
        (catalogue, "threshol_photons", "threshold_photons"),
        (described, "cataloge", "catalogue"),
    ] {
        let report = refused_pipeline(&format!("{scanner}{misspelt} = 1"));
        contains(&report, &[&format!("unknown key `{misspelt}`"), &format!("did you mean `{meant}`?")]);
    }
}

#[test]
fn keys_of_another_table_name_it() {
    let scanner = "[scanner]\ncatalogue = \"data/scanners_tls.xml#vlp16\"\n";
    for (lines, help) in [
        (format!("{scanner}head_rate_deg_per_s = 3600"), "`head_rate_deg_per_s` is a key of [settings]"),
        (
            format!("{scanner}pulse_freq_hz = 5"),
            "`pulse_freq_hz` is a key of [settings]; did you mean `pulse_freqs_hz` here?",
        ),
        (format!("{scanner}[settings]\nspeed_m_per_s = 5"), "`speed_m_per_s` is a key of [[leg]]"),
        (format!("{scanner}[settings]\nrain_mm_h = 5"), "`rain_mm_h` is a key of `weather` of [settings]"),
        (format!("{scanner}probability = 0.1"), "`probability` is a key of `afterpulse` of [scanner]"),
        (
            format!("{scanner}scene = 'b.obj'"),
            "`scene` is a key of the file itself: write it above the first table",
        ),
    ] {
        contains(&refused_pipeline(&lines), &[help]);
    }
}
