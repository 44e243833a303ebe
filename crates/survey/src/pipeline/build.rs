//! Builds the survey from the keys of a pipeline file.

use super::super::checks::check_legs;
use super::super::context::{Context, ReadOptions};
use super::super::effects::Setting;
use super::super::platform_xml::{mount_of_other, read_platform};
use super::super::read::{chosen_scene, find_scene};
use super::super::survey_xml::read_survey_parts;
use super::super::{
    Leg, Mount, Platform, PlatformKind, PlatformNoise, PlatformSettings, PoseStream, Scanner,
    ScannerSettings, Survey, WaveformPlace,
};
use super::instrument::read_instrument;
use super::keys::{LegKeys, Movement, PlatformKeys, SettingsKeys, SurveyKeys};
use super::parts::read_parts;
use super::source::{Source, near};
use super::values::Values;
use toml::Spanned;
use vlscan_base::quantity;
use vlscan_geom::DVec3;

pub(super) fn read_survey(
    context: &Context,
    source: &Source,
    keys: &SurveyKeys,
    options: &ReadOptions,
) -> Option<Survey> {
    let values = Values { context, source };
    let base = match &keys.survey {
        Some(name) => Some(survey_file(context, source, name)?),
        None => None,
    };
    let scene = match (&keys.scene, &base) {
        _ if options.scene.is_some() => options.scene.as_ref().and_then(|scene| chosen_scene(context, scene)),
        (Some(name), _) if !keys.part.is_empty() => {
            values.refuse(name, "either `scene` or [[part]] tables");
            None
        }
        _ if !keys.part.is_empty() => Some(read_parts(&values, &keys.part)),
        (Some(name), _) => scene_of(context, source, name),
        (None, Some(base)) => Some(base.scene.clone()),
        (None, None) => {
            let place = source.place(0..0);
            context.error_help(
                place,
                "a pipeline needs the key `scene`, [[part]] tables or a `survey`",
                "scene = \"file.xml#id\"",
            );
            None
        }
    };
    let scanner = match &keys.scanner {
        Some(table) => read_instrument(&values, table, base.as_ref().map(|b| b.scanner.clone())),
        None if base.is_none() => {
            context.error_help(source.place(0..0), "a pipeline needs a [scanner] or a `survey`", "");
            None
        }
        None => base.as_ref().map(|b| b.scanner.clone()),
    };
    let platform = read_carrier(&values, keys.platform.as_ref(), base.as_ref().map(|b| b.platform.clone()));
    let (scene, mut scanner, platform) = (scene?, scanner?, platform?);
    change_detection(&values, &mut scanner, keys);
    let mut survey = base.unwrap_or_else(|| Survey {
        name: source.path().file_stem().map_or_else(String::new, |s| s.to_string_lossy().into_owned()),
        path: source.path().to_path_buf(),
        seed: None,
        platform: platform.clone(),
        scanner: scanner.clone(),
        scene: scene.clone(),
        legs: Vec::new(),
        leg_offset: None,
        crs_wkt: None,
    });
    (survey.scene, survey.scanner, survey.platform) = (scene, scanner, platform);
    if let Some(name) = &keys.name {
        survey.name.clone_from(name);
    }
    if options.is_traced && keys.leg.is_empty() && survey.legs.is_empty() {
        survey.legs = vec![survey.scanner.leg()];
    }
    build_legs(&values, &mut survey, keys, options.trajectory.clone());
    if !options.is_traced {
        let streamed = options.trajectory.is_some();
        check_legs(context, &survey, &|leg, setting| place_of(source, keys, leg, setting, streamed));
    }
    Some(survey)
}

/// Where a setting of a leg is written: in its own table, or in that of all legs.
fn place_of(
    source: &Source,
    keys: &SurveyKeys,
    leg: usize,
    setting: Setting,
    streamed: bool,
) -> Option<vlscan_base::diag::Place> {
    let own = keys.leg.get(leg).map(Spanned::get_ref).filter(|_| !streamed);
    let of_leg = own.and_then(|leg| match setting.toml {
        "position_m" => leg.position_m.as_ref().map(Spanned::span),
        "speed_m_per_s" => leg.speed_m_per_s.as_ref().map(Spanned::span),
        name => leg.settings.as_ref()?.span_of(name),
    });
    let span = of_leg.or_else(|| keys.settings.as_ref()?.get_ref().span_of(setting.toml))?;
    Some(source.place(span))
}

impl SettingsKeys {
    /// The range of the value of a key.
    fn span_of(&self, key: &str) -> Option<std::ops::Range<usize>> {
        let numbers = [
            ("scan_freq_hz", &self.scan_freq_hz),
            ("scan_angle_deg", &self.scan_angle_deg),
            ("vertical_angle_min_deg", &self.vertical_angle_min_deg),
            ("vertical_angle_max_deg", &self.vertical_angle_max_deg),
            ("head_rate_deg_per_s", &self.head_rate_deg_per_s),
            ("head_start_deg", &self.head_start_deg),
            ("head_stop_deg", &self.head_stop_deg),
            ("beam_divergence_rad", &self.beam_divergence_rad),
            ("max_duration_s", &self.max_duration_s),
        ];
        let number = numbers.into_iter().find(|(name, _)| *name == key);
        let frequency = || self.pulse_freq_hz.as_ref().filter(|_| key == "pulse_freq_hz").map(Spanned::span);
        number.and_then(|(_, value)| value.as_ref()).map(Spanned::span).or_else(frequency)
    }
}

fn survey_file(context: &Context, source: &Source, name: &Spanned<String>) -> Option<Survey> {
    let place = source.place(name.span());
    let root = context.referred_document(&near(source, name.get_ref()), source.folder(), Some(place))?;
    read_survey_parts(context, &root).map(|(survey, _)| survey)
}

fn scene_of(context: &Context, source: &Source, name: &Spanned<String>) -> Option<super::super::SceneRecipe> {
    find_scene(context, &near(source, name.get_ref()), source.folder(), Some(source.place(name.span())))
}

fn read_carrier(
    values: &Values,
    table: Option<&Spanned<PlatformKeys>>,
    inherited: Option<Platform>,
) -> Option<Platform> {
    let standing = || Platform {
        id: "platform".to_owned(),
        kind: PlatformKind::Static,
        mount: Mount::IDENTITY,
        noise: PlatformNoise::default(),
    };
    let Some(keys) = table.map(Spanned::get_ref) else { return Some(inherited.unwrap_or_else(standing)) };
    let mut platform = match &keys.catalogue {
        Some(name) => {
            let element = values.reference(name, "platform")?;
            read_platform(values.context, &element)?
        }
        None => inherited.unwrap_or_else(standing),
    };
    match keys.kind {
        Some(Movement::Static) => platform.kind = PlatformKind::Static,
        Some(Movement::LinearPath) => platform.kind = PlatformKind::LinearPath,
        None => {}
    }
    if let Some(mount) = &keys.mount {
        platform.mount = values.pose(mount);
    }
    Some(platform)
}

/// Applies `[waveform]` and `[detector]` to every device.
fn change_detection(values: &Values, scanner: &mut Scanner, keys: &SurveyKeys) {
    let waveform = keys.waveform.clone().unwrap_or_default();
    let detector = keys.detector.clone().unwrap_or_default();
    let distance_error = values.formula(&detector.distance_error);
    let span = waveform.window_ns.as_ref().or(waveform.bin_ns.as_ref()).map(Spanned::span);
    let place = span.map(|span| values.source.place(span));
    let waveform_place = place.map(|place| WaveformPlace { place, keys: ["bin_ns", "window_ns"] });
    for device in &mut scanner.devices {
        values.set(&mut device.waveform.bin, &waveform.bin_ns, &quantity::BIN_NS);
        values.set(&mut device.waveform.window, &waveform.window_ns, &quantity::BIN_NS);
        device.waveform_place = waveform_place.clone().or(device.waveform_place.take());
        values.not_negative(&mut device.waveform.max_range, &waveform.max_range_ns);
        if let Some(quality) = &waveform.quality {
            device.waveform.quality = *quality.get_ref();
            if !(1..=super::super::scanner_xml::MAX_QUALITY).contains(quality.get_ref()) {
                values.refuse(quality, "a whole number from 1 to 1000");
            }
        }
        values.set(&mut device.detector.accuracy, &detector.accuracy_m, &quantity::ACCURACY);
        values.set(&mut device.detector.range_min, &detector.range_min_m, &quantity::MIN_RANGE);
        values.set(&mut device.detector.range_max, &detector.range_max_m, &quantity::MAX_RANGE);
        let ranges = (device.detector.range_min, device.detector.range_max);
        values.in_order(ranges, [&detector.range_min_m, &detector.range_max_m]);
        if let Some(returns) = &detector.max_returns {
            device.detector.max_returns = *returns.get_ref();
        }
        if distance_error.is_some() {
            device.detector.distance_error.clone_from(&distance_error);
        }
    }
}

/// Sets the legs: a single leg that follows a stream, the `[[leg]]` tables, or the legs of the survey file.
fn build_legs(values: &Values, survey: &mut Survey, keys: &SurveyKeys, stream: Option<PoseStream>) {
    if !keys.leg.is_empty() {
        survey.legs =
            keys.leg.iter().zip(0..).map(|(leg, number)| read_leg(values, survey, leg, number)).collect();
    }
    let streamed = stream.is_some();
    if let Some(stream) = stream {
        survey.follow(stream);
    }
    if survey.legs.is_empty() {
        let message = "a pipeline needs a way to move: [trajectory], [[leg]] tables or a `survey`";
        values.context.error_help(
            values.source.place(0..0),
            message,
            "path = \"-\" in [trajectory] is standard input",
        );
    }
    let scanner = survey.scanner.clone();
    let common = keys.settings.as_ref();
    let own = |i: usize| (!streamed).then(|| keys.leg.get(i)?.get_ref().settings.clone()).flatten();
    for (i, leg) in survey.legs.iter_mut().enumerate() {
        if let Some(table) = common {
            leg.place.get_or_insert_with(|| values.source.place(table.span()));
        }
        let tables: Vec<SettingsKeys> =
            common.map(|t| t.get_ref().clone()).into_iter().chain(own(i)).collect();
        change_settings(values, &mut leg.scanner, &tables, &scanner);
    }
}

fn read_leg(values: &Values, survey: &Survey, table: &Spanned<LegKeys>, number: u32) -> Leg {
    let keys = table.get_ref();
    let place = values.source.place(table.span());
    let position = values.vector(&keys.position_m);
    if keys.position_m.is_none() {
        values.context.error(place.clone(), "a [[leg]] needs the key `position_m`");
    }
    let mut platform = PlatformSettings::at(position.unwrap_or(DVec3::ZERO));
    platform.on_ground = keys.on_ground;
    values.set(&mut platform.speed, &keys.speed_m_per_s, &quantity::SPEED);
    platform.mount = keys.mount.as_ref().map(|mount| values.pose(mount));
    if let Some(name) = &keys.platform {
        let other = values.reference(name, "platform").and_then(|e| read_platform(values.context, &e));
        let place = || values.source.place(name.span());
        let mount = other.and_then(|other| mount_of_other(values.context, &other, &survey.platform, place()));
        platform.mount = platform.mount.or(mount);
    }
    let own = survey.scanner.own_settings();
    let scanner = ScannerSettings { active: keys.active.unwrap_or(true), ..own };
    Leg { number, strip: keys.strip.clone(), platform, scanner, place: Some(place) }
}

/// Applies the settings tables in their order, then the resolutions.
fn change_settings(
    values: &Values,
    settings: &mut ScannerSettings,
    tables: &[SettingsKeys],
    scanner: &Scanner,
) {
    let (mut vertical, mut horizontal) = (0.0, 0.0);
    let mut place = None;
    for keys in tables {
        if let Some(freq) = &keys.pulse_freq_hz {
            settings.pulse_freq = *freq.get_ref();
            if settings.pulse_freq == 0 || settings.pulse_freq > i32::MAX as u32 {
                values.refuse(freq, "a whole number above 0");
            }
        }
        values.set(&mut settings.scan_freq, &keys.scan_freq_hz, &quantity::SCAN_FREQ);
        values.angle(&mut settings.scan_angle, &keys.scan_angle_deg, &quantity::HALF_ANGLE);
        for (target, key) in [
            (&mut settings.vertical_min, &keys.vertical_angle_min_deg),
            (&mut settings.vertical_max, &keys.vertical_angle_max_deg),
        ] {
            if key.is_some() {
                values.angle(target.get_or_insert(0.0), key, &quantity::ANGLE);
            }
        }
        values.angle(&mut settings.head_rate, &keys.head_rate_deg_per_s, &quantity::HEAD_RATE);
        values.angle(&mut settings.head_start, &keys.head_start_deg, &quantity::ANGLE);
        values.angle(&mut settings.head_stop, &keys.head_stop_deg, &quantity::ANGLE);
        values.set(&mut settings.beam_divergence, &keys.beam_divergence_rad, &quantity::DIVERGENCE);
        values.set(
            &mut settings.trajectory_interval,
            &keys.trajectory_interval_s,
            &quantity::SAMPLE_INTERVAL,
        );
        values.set(&mut settings.warmup, &keys.warmup_s, &quantity::WARMUP);
        if keys.max_duration_s.is_some() {
            values.positive(settings.max_duration.get_or_insert(0.0), &keys.max_duration_s);
        }
        values.angle(&mut vertical, &keys.vertical_resolution_deg, &quantity::ANGLE);
        values.angle(&mut horizontal, &keys.horizontal_resolution_deg, &quantity::ANGLE);
        let stop = keys.head_stop_deg.as_ref();
        if let Some(stop) =
            stop.filter(|_| (settings.head_stop - settings.head_start) * settings.head_rate < 0.0)
        {
            values.refuse(stop, "an angle to which the head turns at this speed");
        }
        let resolution = keys.vertical_resolution_deg.as_ref().or(keys.horizontal_resolution_deg.as_ref());
        place = resolution.map(|key| values.source.place(key.span())).or(place);
    }
    if let Some(place) = place {
        apply_resolution(values.context, place, settings, (vertical, horizontal), scanner);
    }
}

fn apply_resolution(
    context: &Context,
    place: vlscan_base::diag::Place,
    settings: &mut ScannerSettings,
    (vertical, horizontal): (f64, f64),
    scanner: &Scanner,
) {
    let device = &scanner.devices[0];
    let rotating = matches!(device.deflector, super::super::Deflector::Polygon { .. });
    if vertical <= 0.0 || horizontal <= 0.0 {
        context.error(place, "give both `vertical_resolution_deg` and `horizontal_resolution_deg`, above 0");
    } else if !rotating || device.scan_angle_max <= 0.0 {
        context.error(place, "resolutions need rotating optics with `scan_angle_max_deg`");
    } else {
        settings.scan_freq = f64::from(settings.pulse_freq) * vertical / (2.0 * device.scan_angle_max);
        settings.head_rate = horizontal * settings.scan_freq;
    }
}
