//! The `<survey>` element (spec input-formats §2.2).

use super::checks::{check_legs, places_in};
use super::context::Context;
use super::device::{MULTI_CHANNEL_PULSE_LENGTH, change_detector, change_waveform_of};
use super::fields::{Fields, Reading, read_mount};
use super::instrument::read_scanner;
use super::keys::Key;
use super::legs::LegReader;
use super::platform_xml::{NOISE, read_platform, replace_noise};
use super::read::{chosen_scene, find_scene, is_geometry};
use super::receiver::change_receiver;
use super::scene_xml::read_scene_element;
use super::seed::parse_seed;
use super::trajectories::Trajectories;
use super::xml::Element;
use super::{
    Device, Mount, Platform, PlatformKind, PlatformNoise, PoseStream, Receiver, RotationSpec, Scanner, Survey,
};
use std::path::Path;
use vlscan_base::quantity::DEVIATION;

/// Reads the survey of a document and checks it.
pub(super) fn read_survey_document(
    context: &Context,
    root: &Element,
    trajectory: Option<PoseStream>,
) -> Option<Survey> {
    let (mut survey, legs) = read_survey_parts(context, root)?;
    match trajectory {
        Some(stream) => {
            survey.follow(stream);
            check_legs(context, &survey, &|_, _| None, false);
        }
        None if legs.is_empty() => {
            let element = root.child("survey")?;
            context.error_help(
                element.place(),
                "the survey has no <leg>",
                "a leg says where to scan from and how",
            );
        }
        None => check_legs(context, &survey, &places_in(&legs), false),
    }
    Some(survey)
}

/// Reads the survey of a document without the checks of the complete survey. The second value contains the
/// elements of the legs.
pub(super) fn read_survey_parts(context: &Context, root: &Element) -> Option<(Survey, Vec<Element>)> {
    let surveys: Vec<Element> = root.named("survey").collect();
    let Some(element) = surveys.first() else {
        let message = "the document holds no <survey>";
        match ["scene", "scanner", "platform"].into_iter().find(|kind| root.child(kind).is_some()) {
            Some(kind) => {
                let help = format!(
                    "it holds a <{kind}>; a survey is the file whose <survey> names scene, platform and \
                     scanner"
                );
                context.error_help(Some(root.place()), message, help);
            }
            None => context.error(root.place(), message),
        }
        return None;
    };
    if let Some(second) = surveys.get(1) {
        context.warn(second.place(), "only the first <survey> of a document is used");
    }
    let survey = read_survey_element(context, element)?;
    let legs = element.named("leg").collect();
    Some((survey, legs))
}

fn read_survey_element(context: &Context, element: &Element) -> Option<Survey> {
    let mut fields = Fields::new(context, element);
    let name = fields.text("name").unwrap_or_else(|| file_name(element.path()));
    let seed = read_seed(&mut fields);
    for name in ["platform", "scanner", "scene"] {
        fields.required(name);
    }
    for name in ["numRuns", "simSpeed"] {
        if fields.text(name).is_some_and(|text| text.trim().parse::<f64>() != Ok(1.0)) {
            fields.warn(name, "has no effect, as in HELIOS++");
        }
    }
    let leg_offset = read_leg_offset(&mut fields);
    fields.ignore(&["basePlatform", "rotationSpec", "id"]);
    let children = ["leg", "FWFSettings", "detectorSettings", "scannerMount"];
    fields.done(&[&children[..], &NOISE].concat());

    let scanner = context.asset("scanner", element, "scanner").and_then(|e| read_scanner(context, &e));
    let scanner = scanner.map(|mut scanner| {
        override_device_0(context, element, &mut scanner);
        scanner
    });
    let interpolated = element.value("platform") == Some("interpolated");
    let trajectories = interpolated.then(|| Trajectories::new(read_rotation_spec(context, element)));
    let mut reader = LegReader::new(context, scanner.as_ref(), trajectories);
    let mut legs: Vec<_> =
        element.named("leg").zip(0..).map(|(leg, number)| reader.read(&leg, number)).collect();
    let trajectories = reader.trajectories.take();
    let platform = match trajectories {
        Some(trajectories) => Some(interpolated_platform(context, element, trajectories)),
        None => ordinary_platform(context, element),
    };
    if let Some(platform) = &platform {
        for (leg, element) in legs.iter_mut().zip(element.named("leg")) {
            LegReader::use_other_platform(context, leg, &element, platform);
        }
    }
    // Other names are ids in the same document.
    let is_folder = |name: &str| name.contains(['/', '\\']) && context.is_folder(name, element.folder());
    let scene = match &context.scene {
        Some(other) => chosen_scene(context, other, find_scene),
        None if element.value("scene").is_some_and(|name| is_geometry(name) || is_folder(name)) => {
            let name = element.value("scene").unwrap_or_default();
            find_scene(context, name, element.folder(), Some(element.value_place("scene")))
        }
        None => context.asset("scene", element, "scene").and_then(|e| read_scene_element(context, &e)),
    };
    Some(Survey {
        name,
        path: element.path().to_path_buf(),
        seed,
        platform: platform?,
        scanner: scanner?,
        scene: scene?,
        legs,
        leg_offset,
        crs_wkt: None,
    })
}

fn file_name(path: &Path) -> String {
    path.file_name().map_or_else(|| "survey".to_owned(), |s| s.to_string_lossy().into_owned())
}

fn read_seed(fields: &mut Fields) -> Option<u64> {
    let text = fields.text("seed").filter(|t| !t.eq_ignore_ascii_case("auto"))?;
    let seed = parse_seed(&text);
    if let Err(error) = &seed {
        fields.context.error(fields.place("seed"), error.to_string());
    }
    seed.ok()
}

fn read_leg_offset(fields: &mut Fields) -> Option<(f64, f64)> {
    fields.reading = Reading::Lenient;
    if !fields.flag("legRandomOffset", false) {
        let names = ["legRandomOffsetMean", "legRandomOffsetStdev"];
        fields.without_effect(&names, "without `legRandomOffset`");
        return None;
    }
    let stdev = Key::attribute("legRandomOffsetStdev", &DEVIATION);
    Some((fields.number("legRandomOffsetMean", 0.0), fields.number(stdev, 0.1)))
}

/// Applies the survey's waveform and detector settings, which affect the first device only. An accuracy of
/// the survey and the factor on the range noise apply to all devices (spec input-formats §2.11–2.12, trap
/// 17); without one, each has its own in refined physics.
fn override_device_0(context: &Context, survey: &Element, scanner: &mut Scanner) {
    let channels = if scanner.multi_channel { scanner.devices.len() } else { 1 };
    let device = &mut scanner.devices[0];
    let pulse_length =
        if scanner.multi_channel { MULTI_CHANNEL_PULSE_LENGTH } else { device.beam.pulse_length };
    let before = device.clone();
    change_waveform_of(&mut Fields::new(context, survey), device, pulse_length);
    if let Some(element) = survey.child("FWFSettings").filter(|_| device.waveform != before.waveform) {
        warn_of_first_channel(context, &element, channels);
    }
    let Some(element) = survey.child("detectorSettings") else { return share_detector(scanner, false) };
    let mut fields = Fields::new(context, &element);
    change_detector(&mut fields, device);
    let limits = |device: &Device| (device.detector.range_min, device.detector.range_max);
    if limits(device) != limits(&before) {
        warn_of_first_channel(context, &element, channels);
    }
    change_receiver(&mut fields, &mut device.receiver);
    let receiver = device.receiver.clone();
    scanner.written.extend(fields.written_keys(None));
    if receiver != before.receiver {
        set_receiver(scanner, &receiver);
    }
    share_detector(scanner, element.value("accuracy_m").is_some());
    fields.done(&[]);
}

/// Sets the factor on the range noise of all devices to that of the first one, and the accuracy, if the
/// survey states it.
fn share_detector(scanner: &mut Scanner, has_accuracy: bool) {
    let Some((first, others)) = scanner.devices.split_first_mut() else { return };
    for device in others {
        if has_accuracy {
            device.detector.accuracy = first.detector.accuracy;
        }
        device.detector.distance_error.clone_from(&first.detector.distance_error);
    }
}

/// Warns of an element of the survey that changes the first channel alone.
fn warn_of_first_channel(context: &Context, element: &Element, channels: usize) {
    if channels > 1 {
        let name = element.name();
        let message =
            format!("<{name}> of a survey reaches the first of the {channels} channels only, as in HELIOS++");
        context.warn_help(element.place(), message, "give the scanner the settings for all channels");
    }
}

/// Sets the receiver of all devices but for the pulse shape. HELIOS++ does not have these settings, so its
/// restriction to device 0 does not apply to them.
fn set_receiver(scanner: &mut Scanner, receiver: &Receiver) {
    for device in &mut scanner.devices {
        let pulse_shape = device.receiver.pulse_shape.take();
        device.receiver = Receiver { pulse_shape, ..receiver.clone() };
    }
}

fn ordinary_platform(context: &Context, survey: &Element) -> Option<Platform> {
    for name in ["basePlatform", "rotationSpec"] {
        if survey.value(name).is_some() {
            let message = format!("`{name}` has an effect only with platform=\"interpolated\"");
            context.warn(survey.name_place(name), message);
        }
    }
    if let Some(mount) = survey.child("scannerMount") {
        context.warn(
            mount.place(),
            "<scannerMount> of a survey has an effect only with platform=\"interpolated\"",
        );
    }
    let element = context.asset("platform", survey, "platform")?;
    let mut platform = read_platform(context, &element)?;
    replace_noise(context, survey, &mut platform.noise);
    Some(platform)
}

/// An interpolated platform takes mount and noise from the base platform; noise elements of the survey
/// replace its noise.
fn interpolated_platform(context: &Context, survey: &Element, trajectories: Trajectories) -> Platform {
    let base = context.asset("platform", survey, "basePlatform").and_then(|e| read_platform(context, &e));
    let (mut mount, mut noise) =
        base.map_or((Mount::IDENTITY, PlatformNoise::default()), |b| (b.mount, b.noise));
    if let Some(element) = survey.child("scannerMount") {
        mount = read_mount(context, &element);
    }
    replace_noise(context, survey, &mut noise);
    Platform {
        id: "interpolated".to_owned(),
        kind: PlatformKind::Interpolated(trajectories.finish()),
        mount,
        noise,
    }
}

/// The survey's `rotationSpec`.
fn read_rotation_spec(context: &Context, survey: &Element) -> RotationSpec {
    match survey.value("rotationSpec") {
        None | Some("ARINC 705") => RotationSpec::Arinc705,
        Some("CANONICAL") => RotationSpec::Canonical,
        Some(other) => {
            let message = format!("unknown rotation specification `{other}`");
            let help = "the specifications are `ARINC 705` and `CANONICAL`";
            context.limit(Some(survey.value_place("rotationSpec")), message, help);
            RotationSpec::Arinc705
        }
    }
}
