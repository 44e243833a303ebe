//! Every attribute of surveys, scanners and platforms, with every kind of value: each has an effect, is
//! rejected, or is warned of by its name.

use super::*;

/// Contents of a survey, without the places in its file.
fn model(survey: &Survey) -> String {
    let legs: Vec<Leg> = survey.legs.iter().map(|leg| Leg { place: None, ..leg.clone() }).collect();
    let parts: Vec<_> =
        survey.scene.parts.iter().map(|part| PartRecipe { place: None, ..part.clone() }).collect();
    format!("{:?}\n{:?}\n{legs:?}\n{:?}\n{parts:?}", survey.scanner, survey.platform, survey.leg_offset)
}

/// Reads a document: its model and its warnings, or `None` if it was rejected.
pub(super) fn read(text: &str) -> Option<(String, String)> {
    let folder = Folder::new(&[("survey.xml", text), ("a.obj", ""), ("way.txt", "")]);
    let (survey, warnings) = folder.read(&ReadOptions::default()).ok()?;
    Some((model(&survey), warnings.render(false)))
}

/// Values that are out of range, no numbers, or in another unit.
const HOSTILE: [&str; 8] = ["", "1,5", "NaN", "inf", "1e300", "-1e300", "-1", "99999999999"];

/// An element within a document, with attributes and values that have an effect.
struct Case {
    /// The document, with `HERE` where the attribute stands.
    text: String,
    attributes: &'static [(&'static str, &'static str)],
}

const SCANNER: &[(&str, &str)] = &[
    ("accuracy_m", "0.02"),
    ("averagePower_w", "3"),
    ("beamDivergence_rad", "0.0007"),
    ("beamDivergenceY_rad", "0.0007"),
    ("beamProfile", "top_hat"),
    ("beamQualityFactor", "1.5"),
    ("opticalEfficiency", "0.5"),
    ("receiverDiameter_m", "0.2"),
    ("atmosphericVisibility_km", "10"),
    ("exitAperture_m", "0.02"),
    ("maxNOR", "5"),
    ("pulseLength_ns", "5"),
    ("pulseFwhm_ns", "5"),
    ("pulseEnergy_uJ", "3"),
    ("rangeMin_m", "2"),
    ("rangeMax_m", "200"),
    ("receivedEnergyMin_W", "0.001"),
    ("wavelength_nm", "905"),
    ("headRotatePerSecMax_deg", "30"),
    ("nep_W", "1e-9"),
    ("bandwidth_Hz", "1e8"),
    ("saturation_W", "0.1"),
    ("rangeWalk_m", "0.01"),
    ("digitiserClock", "true"),
    ("detector", "centroid"),
    ("scanFreqMin_Hz", "1"),
    ("scanFreqMax_Hz", "70"),
    ("scanAngleMax_deg", "25"),
    ("scanAngleEffectiveMax_deg", "20"),
    ("facetTilts_deg", "1;-1"),
    ("scanReverse", "true"),
    ("scanPhase_deg", "30"),
    ("scanAxisTilt_deg", "1;-1"),
    ("scanProduct", "900"),
    ("scanAngleAlongMax_deg", "10"),
    ("numFibers", "63"),
    ("rotorFreq1_Hz", "-10"),
    ("angle1_deg", "18"),
    ("refrIndex1", "1.6"),
    ("rotorFreq3_Hz", "10"),
    ("angle3_deg", "3"),
    ("refrIndex3", "1.6"),
    ("refrIndex_air", "1.1"),
];

const LEG: &[(&str, &str)] = &[
    ("active", "false"),
    ("pulseFreq_hz", "300000"),
    ("scanFreq_hz", "40"),
    ("scanAngle_deg", "11"),
    ("verticalAngleMin_deg", "-11"),
    ("verticalAngleMax_deg", "11"),
    ("headRotatePerSec_deg", "7"),
    ("headRotateStart_deg", "-3"),
    ("headRotateStop_deg", "3"),
    ("beamDivergence_rad", "0.0008"),
    ("trajectoryTimeInterval_s", "0.5"),
    ("maxDuration_s", "9"),
    ("opticsWarmupPhase_s", "0.1"),
];

const PLATFORM_SETTINGS: &[(&str, &str)] = &[
    ("x", "3"),
    ("y", "3"),
    ("z", "3"),
    ("onGround", "true"),
    ("movePerSec_m", "9"),
    ("stopAndTurn", "false"),
    ("smoothTurn", "true"),
    ("slowdownEnabled", "false"),
    ("yawAtDeparture_deg", "30"),
];

const PLATFORM: &[(&str, &str)] = &[
    ("drag", "0.5"),
    ("engine_max_force", "0.2"),
    ("speedup_magnitude", "3"),
    ("slowdown_magnitude", "3"),
    ("base_pitch_deg", "-4"),
    ("pitch_speed_deg", "80"),
    ("roll_speed_deg", "20"),
    ("yaw_speed_deg", "80"),
    ("pitch_offset_deg", "30"),
    ("roll_offset_deg", "20"),
];

const NOISE: &[(&str, &str)] = &[
    ("type", "UNIFORM"),
    ("mean", "0.5"),
    ("stdev", "0.5"),
    ("min", "-0.5"),
    ("max", "0.5"),
    ("clipEnabled", "true"),
    ("clipMin", "-0.5"),
    ("clipMax", "0.5"),
    ("fixedLifespan", "7"),
];

const FWF: &[(&str, &str)] = &[
    ("binSize_ns", "0.5"),
    ("winSize_ns", "0.7"),
    ("beamSampleQuality", "4"),
    ("maxFullwaveRange_ns", "100"),
    ("apertureDiameter_m", "0.2"),
];

const SURVEY: &[(&str, &str)] = &[
    ("numRuns", "2"),
    ("simSpeed", "2"),
    ("legRandomOffset", "true"),
    ("legRandomOffsetMean", "0.2"),
    ("legRandomOffsetStdev", "0.2"),
    ("basePlatform", "tripod"),
    ("rotationSpec", "CANONICAL"),
];

const MOTION: &[(&str, &str)] = &[
    ("vec", "1;2;3"),
    ("axis", "0;1;0"),
    ("angle", "7"),
    ("center", "1;1;1"),
    ("ortho", "0;1;0"),
    ("shift", "1;0;0"),
    ("glide", "2"),
    ("selfMode", "true"),
    ("autoCRS", "1"),
];

/// Optics as the smallest scanners that have them.
pub(super) const OPTICS: [&str; 5] = [
    "optics='rotating' scanAngleMax_deg='60' scanAngleEffectiveMax_deg='50'",
    "optics='oscillating' scanAngleMax_deg='60'",
    "optics='conic' scanAngleMax_deg='60'",
    "optics='line' scanAngleMax_deg='60'",
    "optics='risley' rotorFreq1_Hz='7' angle1_deg='17' refrIndex1='1.5' rotorFreq2_Hz='9' angle2_deg='11' refrIndex2='1.5'",
];

/// Optics, without those of their attributes that are tried.
fn without(optics: &str, name: &str) -> String {
    let words = optics.split(' ').filter(|word| word.split('=').next() != Some(name));
    words.collect::<Vec<_>>().join(" ")
}

pub(super) fn survey(scanner: &str, platform: &str, extra: &str, attributes: &str, content: &str) -> String {
    let assets = format!("{PLATFORMS}<platform id='mine' {platform}</platform>{SCENE}{extra}");
    format!(
        "<document>{assets}<scanner id='own' pulseFreqs_Hz='100000,300000' {scanner}</scanner>\n\
         <survey scene='scene' scanner='own' platform='mine' {attributes}>{content}</survey></document>"
    )
}

/// Two legs with these settings, whose scan is within the limits of every scanner above.
pub(super) fn legs(platform: &str, scanner: &str) -> String {
    let leg = |x: u32| {
        format!(
            "<leg><platformSettings x='{x}' {platform}/><scannerSettings scanFreq_hz='50' scanAngle_deg='10' \
             maxDuration_s='1' {scanner}/></leg>"
        )
    };
    leg(0) + &leg(50)
}

fn cases() -> Vec<(Case, &'static str)> {
    let mut all = Vec::new();
    let mut add = |text: String, attributes: &'static [(&'static str, &'static str)], about: &'static str| {
        all.push((Case { text, attributes }, about));
    };
    let plane = "type='linearpath'>";
    let turning = format!("{} headRotatePerSecMax_deg='60'>", OPTICS[0]);
    for optics in OPTICS {
        // The head of the scanner itself is tried, too.
        add(survey(&format!("{optics} HERE>"), plane, "", "", &legs("", "")), SCANNER, optics);
        add(
            survey(&format!("{optics} headRotatePerSecMax_deg='60'>"), plane, "", "", &legs("", "HERE")),
            LEG,
            optics,
        );
    }
    for kind in ["static", "linearpath", "groundvehicle", "multicopter"] {
        let platform = format!("type='{kind}'>");
        add(survey(&turning, &platform, "", "", &legs("HERE", "")), PLATFORM_SETTINGS, kind);
        add(survey(&turning, &format!("type='{kind}' HERE>"), "", "", &legs("", "")), PLATFORM, kind);
    }
    for kind in ["", "type='UNIFORM'"] {
        let noise = format!("type='linearpath'><positionXNoise {kind} HERE/>");
        add(survey(&turning, &noise, "", "", &legs("", "")), NOISE, "noise");
    }
    let waveform = format!("{} headRotatePerSecMax_deg='60'><FWFSettings HERE/>", OPTICS[0]);
    add(survey(&waveform, plane, "", "", &legs("", "")), FWF, "FWFSettings");
    add(survey(&turning, plane, "", "HERE", &legs("", "")), SURVEY, "survey");
    for (kind, own) in [
        ("identity", ""),
        ("translation", "vec='1;0;0'"),
        ("rotation", "axis='0;0;1' angle='5'"),
        ("reflection", "ortho='1;0;0'"),
        ("glideplane", "ortho='0;0;1' shift='2;0;0'"),
        ("helical", "axis='0;0;1' angle='5' glide='1'"),
        ("rotsym", "axis='0;0;1' angle='5'"),
    ] {
        let motion = format!("<dmotion id='m' loop='0'><motion type='{kind}' {own} HERE/></dmotion>");
        let text = survey(&turning, plane, "", "", &legs("", ""));
        add(text.replace("</part>", &format!("{motion}</part>")), MOTION, kind);
    }
    all
}

/// Checks that the document of a case is read as it stands: all of its values would pass if it were rejected.
fn check_base(case: &Case, about: &str) {
    let folder =
        Folder::new(&[("survey.xml", &case.text.replace("HERE", "")), ("a.obj", ""), ("way.txt", "")]);
    if let Err(error) = folder.read(&ReadOptions::default()) {
        panic!("the document of {about} is refused by itself:\n{}\n{}", report(&error), case.text);
    }
}

/// The document of a case with an attribute in place of one that it may have already, in the first of the
/// elements where the attribute stands.
fn with(case: &Case, name: &str, value: Option<&str>) -> String {
    let at = case.text.find("HERE").unwrap();
    let (before, after) = (&case.text[..at], case.text[at + 4..].replace("HERE", ""));
    let start = before.rfind('<').unwrap();
    let tag = without(&before[start..], name);
    let attribute = value.map_or(String::new(), |value| format!("{name}='{value}'"));
    format!("{}{tag} {attribute}{after}", &before[..start])
}

#[test]
fn every_attribute_has_an_effect_or_is_warned_of() {
    let (mut silent, mut refused, mut accepted) = (Vec::new(), Vec::new(), 0);
    for (case, about) in cases() {
        check_base(&case, about);
        for (name, value) in case.attributes {
            let (plain, given) = (read(&with(&case, name, None)), read(&with(&case, name, Some(value))));
            let Some((given, warnings)) = given else {
                refused.push(format!("{name}='{value}' of {about}"));
                continue;
            };
            accepted += 1;
            let has_effect = plain.is_none_or(|(plain, _)| plain != given);
            if !has_effect && !warnings.contains(&format!("`{name}`")) {
                silent.push(format!("{name}='{value}' of {about}"));
            }
        }
    }
    assert!(silent.is_empty(), "ignored without a word:\n{}", silent.join("\n"));
    assert!(refused.is_empty() && accepted > 400, "{accepted} accepted, refused:\n{}", refused.join("\n"));
}

/// Values that mean "not given" or are the default, by what they are written in.
fn means_nothing(name: &str, value: &str) -> bool {
    (name == "maxDuration_s" && value == "-1") || (name == "rangeMax_m" && value == "inf")
}

#[test]
fn values_out_of_range_are_refused_or_warned_of() {
    let (mut silent, mut refused, mut accepted) = (Vec::new(), 0, 0);
    for (case, about) in cases() {
        check_base(&case, about);
        for (name, typical) in case.attributes {
            if typical.parse::<f64>().is_err() {
                continue;
            }
            let plain = read(&with(&case, name, None));
            for value in HOSTILE.into_iter().filter(|value| !means_nothing(name, value)) {
                let Some((given, warnings)) = read(&with(&case, name, Some(value))) else {
                    refused += 1;
                    continue;
                };
                accepted += 1;
                let has_effect = plain.as_ref().is_none_or(|(plain, _)| *plain != given);
                let is_number = value.parse::<f64>().is_ok_and(f64::is_finite);
                if !(warnings.contains(&format!("`{name}`")) || has_effect && is_number) {
                    silent.push(format!("{name}='{value}' of {about}"));
                }
            }
        }
    }
    assert!(silent.is_empty(), "replaced without a word:\n{}", silent.join("\n"));
    assert!(refused > 1200 && accepted > 1200, "{accepted} accepted, {refused} refused");
}

#[test]
fn other_units_are_suspected() {
    let plane = "type='linearpath'>";
    let scanner = format!("{} headRotatePerSecMax_deg='60'", OPTICS[0]);
    let of_scanner =
        |attribute: &str| survey(&format!("{scanner} {attribute}>"), plane, "", "", &legs("", ""));
    let of_leg = |platform: &str, attribute: &str| {
        survey(&format!("{scanner}>"), plane, "", "", &legs(platform, attribute))
            .replace("scanAngle_deg='10' maxDuration_s='1' scanAngle_deg", "maxDuration_s='1' scanAngle_deg")
    };
    let risley = OPTICS[4].replace("rotorFreq1_Hz='7'", "rotorFreq1_Hz='7294'");
    for (text, hint) in [
        (of_scanner("beamDivergence_rad='0.5'"), "0.5 mrad are 0.0005 rad"),
        (of_scanner("pulseLength_ns='4e-9'"), "4e-9 s are 4 ns"),
        (of_scanner("accuracy_m='5'"), "5 mm are 0.005 m"),
        (of_scanner("receiverDiameter_m='50'"), "50 mm are 0.05 m"),
        (of_scanner("opticalEfficiency='99'"), "99 per cent are 0.99"),
        (of_leg("movePerSec_m='600'", ""), "600 km/h are 166.667 m/s"),
        (of_leg("", "scanAngle_deg='0.785'"), "0.785 rad would be 44.9772 degrees"),
        (of_leg("", "verticalAngleMin_deg='-0.5236'"), "-0.5236 rad would be -30.0001 degrees"),
        (
            of_leg("", "headRotateStop_deg='6.2832' headRotatePerSec_deg='5'"),
            "6.2832 rad would be 360.001 degrees",
        ),
        (of_leg("", "trajectoryTimeInterval_s='5000'"), "5000 ms are 5 s"),
        (survey(&format!("{risley}>"), plane, "", "", &legs("", "")), "7294 per minute are 121.567 Hz"),
    ] {
        let (_, warnings) = read(&text).unwrap_or_else(|| panic!("refused: {text}"));
        assert!(warnings.contains(hint), "{hint:?} is missing from\n{warnings}");
    }
    for (attribute, platform) in
        [("scanAngle_deg='1'", ""), ("headRotateStop_deg='0.5' headRotatePerSec_deg='5'", "")]
    {
        let (_, warnings) = read(&of_leg(platform, attribute)).unwrap();
        assert!(!warnings.contains("rad would be"), "{attribute}:\n{warnings}");
    }
}

#[test]
fn prisms_that_do_not_deflect_or_turn_are_warned_of() {
    let of = |attributes: &str| {
        let scanner = format!("optics='risley' {attributes}>");
        read(&survey(&scanner, "type='linearpath'>", "", "", &legs("", ""))).unwrap().1
    };
    contains(&of("rotorFreq1_Hz='7' rotorFreq2_Hz='9'"), &["the beam is never deflected", "livox_mid-70"]);
    contains(
        &of("rotorFreq1_Hz='7' angle1_deg='17' refrIndex1='1.5' rotorFreq2_Hz='9'"),
        &["`rotorFreq2_Hz` has no effect without `angle2_deg`"],
    );
    contains(
        &of("angle1_deg='17' refrIndex1='1.5'"),
        &["`angle1_deg` without `rotorFreq1_Hz`: this prism does not turn"],
    );
    contains(
        &of("rotorFreq1_Hz='7' angle1_deg='17' refrIndex1='1.5' rotorFreq2_Hz='7' angle2_deg='5'"),
        &["`angle2_deg` has no effect with `refrIndex2` as that of air, 1"],
    );
}

#[test]
fn limits_of_the_instrument_say_what_is_used() {
    let plane = "type='linearpath'>";
    let of = |scanner: &str, leg: &str| {
        let text = survey(scanner, plane, "", "", &legs("", leg));
        let text = if leg.contains("scanAngle_deg") { text.replace("scanAngle_deg='10' ", "") } else { text };
        let text = if leg.contains("scanFreq_hz") { text.replace("scanFreq_hz='50' ", "") } else { text };
        read(&text).unwrap_or_else(|| panic!("refused: {text}")).1
    };
    let rotating = format!("{} headRotatePerSecMax_deg='60'>", OPTICS[0]);
    contains(
        &of(&rotating, "headRotatePerSec_deg='90'"),
        &["`headRotatePerSec_deg` of 90 °/s", "turns by 60 °/s", "also in"],
    );
    contains(
        &of(&rotating, "scanAngle_deg='70'"),
        &["`scanAngle_deg` of 70 degrees is beyond the scanner's 60"],
    );
    contains(&of(&rotating, "scanAngle_deg='55'"), &["is beyond the 50 within which the scanner fires"]);
    contains(&of(&rotating, "scanAngle_deg='-5'"), &["is below 0 and ignored"]);
    contains(&of(&rotating, "verticalAngleMax_deg='30'"), &["is beyond the scan angle of 10 degrees"]);
    let fixed = format!("{}>", OPTICS[0]);
    contains(&of(&fixed, "headRotatePerSec_deg='9'"), &["has no effect: the scanner's head does not turn"]);
    let wrong_head = format!("{}><headError expr='THETA'/>", OPTICS[0]);
    contains(&of(&wrong_head, ""), &["has no effect because the head does not turn"]);
    let swinging = format!("{} scanProduct='400'>", OPTICS[1]);
    contains(&of(&swinging, "scanFreq_hz='50'"), &["the mirror swings with 40 Hz"]);
    contains(
        &of(&format!("{}>", OPTICS[4]), ""),
        &["its prisms turn by themselves", "its prisms deflect the beam"],
    );
}

#[test]
fn second_elements_are_warned_of() {
    let text = survey(&format!("{}>", OPTICS[0]), "type='linearpath'>", "", "", &legs("", ""));
    let text = text.replacen("</leg>", "<platformSettings x='7'/></leg>", 1);
    contains(
        &read(&text).unwrap().1,
        &["a second <platformSettings> in <leg> is ignored; the first one is used"],
    );
    let again = survey(
        &format!("{}>", OPTICS[0]),
        "type='linearpath'>",
        "<platform id='tripod' type='static'/>",
        "",
        &legs("", ""),
    );
    contains(&read(&again).unwrap().1, &["a second <platform> has the id `tripod`; the first one is used"]);
    let twice = "type='linearpath'><scannerMount z='1'/><scannerMount z='2'/>";
    let text = survey(&format!("{}>", OPTICS[0]), twice, "", "", &legs("", ""));
    contains(&read(&text).unwrap().1, &["a second <scannerMount> in <platform>"]);
}

#[test]
fn two_quantities_from_one_column_are_warned_of() {
    let of = |attributes: &str| {
        let leg = format!(
            "<leg><platformSettings trajectory='way.txt' {attributes}/><scannerSettings scanFreq_hz='50'/></leg>"
        );
        let text = document("", "platform='interpolated' basePlatform='plane'", &leg);
        read(&text).unwrap_or_else(|| panic!("refused: {text}")).1
    };
    let names = |list: &str| {
        list.split(' ').map(|pair| pair.replacen('=', "='", 1) + "'").collect::<Vec<_>>().join(" ")
    };
    contains(
        &of(&names("tIndex=0 xIndex=1 yIndex=2 zIndex=3")),
        &["roll and x are both column 1", "interpolationDomain=\"position\""],
    );
    let position = names("xIndex=0 yIndex=1 zIndex=2 interpolationDomain=position");
    contains(&of(&position), &["time and x are both column 0", "name it with tIndex"]);
    let unread = names("tIndex=3 xIndex=0 yIndex=1 zIndex=2 rollIndex=2 interpolationDomain=position");
    contains(&of(&unread), &["`rollIndex` has no effect with interpolationDomain"]);
    let apart = names("tIndex=0 rollIndex=1 pitchIndex=2 yawIndex=3 xIndex=4 yIndex=5 zIndex=6");
    assert!(!of(&apart).contains("both column"));
}

#[test]
fn steps_of_time_that_are_not_whole_are_warned_of() {
    let of = |scene: &str, part: &str, motion: &str| {
        let text = document("", "platform='plane'", &legs("", ""));
        let text = text.replace("<scene id='scene'>", &format!("<scene id='scene' {scene}>"));
        let text = text.replace("<part>", &format!("<part {part}>"));
        read(&text.replace("</part>", &format!("{motion}</part>")))
            .unwrap_or_else(|| panic!("refused: {text}"))
            .1
    };
    let moving = "<dmotion id='m' loop='0'><motion type='translation' vec='1;0;0'/></dmotion>";
    for (scene, part, motion, complaint) in [
        (
            "dynTimeStep='0.1'",
            "dynTimeStep='0.25'",
            moving,
            "`dynTimeStep` of 0.25 s is 2.5 steps of 0.1 s; 2 count",
        ),
        ("dynTimeStep='0.1'", "dynTimeStep='0.04'", moving, "it happens once"),
        (
            "dynTimeStep='0.1'",
            "dynStep='2'",
            moving,
            "`dynStep` has no effect beside the `dynTimeStep` of the <scene>",
        ),
        ("dynTimeStep='0.1' dynStep='2'", "", moving, "`dynStep` has no effect beside `dynTimeStep`"),
        ("", "kdtDynTimeStep='2'", moving, "`kdtDynTimeStep` has no effect without a `dynTimeStep`"),
        ("", "dynStep='2'", "", "on a part that does not move"),
    ] {
        contains(&of(scene, part, motion), &[complaint]);
    }
    assert!(
        !of("dynTimeStep='0.25'", "dynTimeStep='0.5' kdtDynTimeStep='1'", moving).contains("DynTimeStep")
    );
}

/// The survey of a pipeline file of one part with these keys, and its warnings.
fn pipeline(scanner: &str, settings: &str, part: &str) -> vlscan_base::Result<(Survey, Diagnostics)> {
    let text = format!(
        "[[part]]\nfile = 'a.obj'\n{part}\n[platform]\nkind = 'linear_path'\n[scanner]\n{scanner}\n[settings]\n{settings}\n\
         [[leg]]\nposition_m = [0, 0, 0]\n[[leg]]\nposition_m = [9, 0, 0]\n"
    );
    let folder = Folder::new(&[("p.toml", &text), ("a.obj", "")]);
    read_pipeline(&folder.path("p.toml"))
}

#[test]
fn pipeline_files_take_whole_numbers_and_durations_above_0_only() {
    let conic = "optics = 'conic'\npulse_freqs_hz = [1000]\n";
    assert!(pipeline(conic, "max_duration_s = 1", "material = [{ primitives = [0] }]").is_ok());
    for (scanner, settings, part, message) in [
        ("optics = 'conic'\npulse_freqs_hz = [1000.0]", "", "", "found the number 1000.0"),
        ("optics = 'conic'\npulse_freqs_hz = []", "", "", "`pulse_freqs_hz` must be whole numbers above 0"),
        (conic, "", "material = [{ primitives = [1.0] }]", "found the number 1.0"),
        (conic, "", "material = [{ primitives = [-1] }]", "`primitives` must be whole numbers of at least 0"),
        (conic, "max_duration_s = 1e-20", "", "`max_duration_s` must be a number above 0"),
        (conic, "max_duration_s = -1", "", "`max_duration_s` must be a number above 0"),
    ] {
        contains(&refused(pipeline(scanner, settings, part)), &[message]);
    }
}

#[test]
fn a_material_without_of_after_others_is_a_warning() {
    let conic = "optics = 'conic'\npulse_freqs_hz = [1000]\nscan_angle_max_deg = 20";
    let warnings = |materials: &str| {
        pipeline(conic, "max_duration_s = 1", &format!("material = [{materials}]")).unwrap().1.render(false)
    };
    let (glass, wall) = ("{ name = 'glass', pane_index = 1.5 }", "{ name = 'wall', reflectance = 0.4 }");
    let expected = "replaces all materials of the part, also those of the tables before it";
    contains(&warnings(&format!("{glass}, {wall}")), &[expected, "with `of`; `name` only names"]);
    let of_glass = "{ of = 'glass', pane_index = 1.5 }";
    for fine in
        [glass.to_owned(), format!("{wall}, {of_glass}"), format!("{of_glass}, {{ primitives = [0] }}")]
    {
        assert!(!warnings(&fine).contains("replaces all"), "{fine}");
    }
}

#[test]
fn a_usable_angle_and_an_ellipse_of_0_are_told_in_pipeline_files() {
    let ellipse = "optics = 'conic'\npulse_freqs_hz = [1000]\nscan_angle_along_max_deg = 0\n";
    contains(&refused(pipeline(ellipse, "", "")), &["an elliptic cone (`scan_angle_along_max_deg`) needs"]);
    let (survey, _) = pipeline(&format!("{ellipse}scan_angle_max_deg = 20"), "", "").unwrap();
    assert!(matches!(survey.scanner.devices[0].deflector, Deflector::EllipticConic { along_max: 0.0 }));
    let dark = "optics = 'rotating'\npulse_freqs_hz = [1000]\nscan_angle_max_deg = 20\nscan_angle_effective_max_deg = 0";
    let (_, warnings) = pipeline(dark, "", "").unwrap();
    contains(
        &warnings.render(false),
        &["rotating optics without `scan_angle_effective_max_deg` emit no pulse"],
    );
}

#[test]
fn parts_beside_another_scene_are_checked() {
    let text = "[[part]]\nfile = 'none.obj'\nscale = 0\n[scanner]\noptics = 'conic'\npulse_freqs_hz = [5]\n\
                [[leg]]\nposition_m = [0, 0, 0]\nsettings = { max_duration_s = 1 }\n";
    let folder = Folder::new(&[("p.toml", text), ("a.obj", "")]);
    let read = |text: &str| {
        folder.write("p.toml", text);
        let source = Source::read(&folder.path("p.toml"))?;
        let scene = Some(SceneChoice::Named(folder.path("a.obj").to_string_lossy().into_owned()));
        let options = ReadOptions { scene, ..ReadOptions::default() };
        read_pipeline_survey(source.tables()?, &options).map(|(read, warnings)| (read.survey, warnings))
    };
    let report = refused(read(text));
    contains(&report, &["`scale` must be a number above 0"]);
    assert!(!report.contains("none.obj"), "{report}");
    contains(&refused(read(&text.replace("scale = 0", "scal = 1"))), &["unknown key `scal`"]);
    read(&text.replace("scale = 0", "")).unwrap();
}

#[test]
fn what_is_read_leniently_keeps_its_bounds_and_names() {
    let plane = "type='linearpath'>";
    let scanner = format!("{}>", OPTICS[0]);
    let noise = |attributes: &str| {
        let noise = format!("type='linearpath'><positionXNoise {attributes}/>");
        read(&survey(&scanner, &noise, "", "", &legs("", "")))
    };
    assert_eq!(noise("stdev='1e13'"), None);
    assert_eq!(noise("stdev='-1m'"), None);
    contains(&noise("type='UNIFORM' stdev='-1'").unwrap().1, &["`stdev` has no effect"]);
    let offset = |stdev: &str| {
        let attributes = format!("legRandomOffset='true' legRandomOffsetStdev='{stdev}'");
        read(&survey(&scanner, plane, "", &attributes, &legs("", "")))
    };
    contains(&offset("0.5m").unwrap().1, &["0.5 is used"]);
    assert_eq!((offset("-0.5m"), offset("1e13")), (None, None));
    let domain = |name: &str| {
        let way = format!("trajectory='way.txt' interpolationDomain='{name}'");
        let text = survey(&scanner, plane, "", "basePlatform='mine'", &legs(&way, ""));
        read(&text.replace("platform='mine'", "platform='interpolated'"))
    };
    assert!(domain("position").is_some());
    assert_eq!(domain("Position"), None);
    let figure = |range: &str| {
        let figure = format!("{}><maxRange range_m='{range}' reflectance='0.5'/>", OPTICS[0]);
        read(&survey(&figure, plane, "", "", &legs("", "")))
    };
    assert!(figure("100").is_some());
    assert_eq!(figure(" 100 "), None);
    let count = |count: &str| {
        let cloud =
            [("filepath", "way.txt"), ("separator", ","), ("voxelSize", "1"), ("estimateNormals", count)];
        let params = cloud.map(|(key, value)| format!("<param key='{key}' value='{value}'/>")).concat();
        let part = format!("<part><filter type='xyzloader'>{params}</filter></part></scene>");
        read(&survey(&scanner, plane, "", "", &legs("", "")).replace("</scene>", &part))
    };
    assert!(count("2").is_some());
    assert_eq!(count("2.0"), None);
}

#[test]
fn child_elements_of_the_name_of_an_attribute_are_warned_of() {
    let plane = "type='linearpath'>";
    let of = |children: &str| {
        let scanner = format!("{}>{children}", OPTICS[0]);
        survey(&scanner, plane, "", "", &legs("", ""))
    };
    contains(&read(&of("<pulseLength_ns/>")).unwrap().1, &["unknown element <pulseLength_ns>"]);
    let channels = read(&of("<channels><channel><optics/><name/></channel></channels>")).unwrap();
    contains(&channels.1, &["unknown element <optics>", "unknown element <name>"]);
    contains(&channels.0, &["Polygon"]);
    let attribute = read(&of("").replace("optics='rotating'", "optics='rotating' snr='5'")).unwrap();
    contains(&attribute.1, &["unknown attribute `snr`"]);
    let beam =
        |beam: &str| read(&of(&format!("<channels><channel><incidentBeam {beam}/></channel></channels>")));
    contains(&beam("y='1'").unwrap().1, &["`incidentBeam` has no effect with rotating optics"]);
    assert_eq!((beam("y='inf'"), beam("y='0'")), (None, None));
}
