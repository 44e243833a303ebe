//! Builds the survey from the keys of a pipeline file.

use super::super::checks::check_legs;
use super::super::context::ReadOptions;
use super::super::device::{change_detector, change_waveform, waveform_place};
use super::super::documents::named_asset;
use super::super::fields::Fields;
use super::super::instrument::read_instrument;
use super::super::keys::{
    DetectorKeys, InstrumentKeys, Key, LegKeys, PartKeys, PlatformKeys, SettingsKeys, SurveyKeys,
    WaveformKeys,
};
use super::super::platform_xml::{mount_of_other, read_platform};
use super::super::read::{chosen_scene, find_scene_on_soil};
use super::super::settings::ScannerLayer;
use super::super::survey_xml::read_survey_parts;
use super::super::{
    Leg, Mount, Platform, PlatformKind, PlatformNoise, PlatformSettings, Scanner, ScannerSettings,
    SceneRecipe, Survey,
};
use super::parts::{check_parts, read_parts};
use super::source::Source;
use vlscan_base::diag::Place;
use vlscan_geom::DVec3;

const K: SurveyKeys = SurveyKeys::KEYS;

/// Reads the survey of the keys at the top of a file, and whether the file has legs. Problems are recorded.
pub(super) fn read_survey(
    fields: &mut Fields,
    source: &Source,
    options: &ReadOptions,
) -> Option<(Survey, bool)> {
    let base = survey_file(fields);
    let name = fields.text(K.name);
    let scene = read_scene(fields, source, options, base.as_ref());
    let mut scanner = read_scanner(fields, base.as_ref());
    let platform = read_carrier(fields, base.as_ref().map(|b| b.platform.clone()));
    change_detection(fields, scanner.as_mut());
    let mut common = fields.child(K.settings, &SettingsKeys::TABLE);
    let mut legs: Vec<LegTables> =
        fields.children(K.leg, &LegKeys::TABLE).into_iter().map(LegTables::new).collect();
    let read = |(tables, number): (&mut LegTables, u32)| {
        read_leg(tables, scanner.as_ref(), platform.as_ref(), number)
    };
    let has_legs = !legs.is_empty();
    let own_legs: Vec<Leg> = legs.iter_mut().zip(0..).map(read).collect();
    let survey = match (scene, scanner, platform) {
        (Some(scene), Some(scanner), Some(platform)) => {
            let stem =
                || source.path().file_stem().map_or_else(String::new, |s| s.to_string_lossy().into_owned());
            let own = || Survey {
                name: stem(),
                path: source.path().to_path_buf(),
                seed: None,
                platform: platform.clone(),
                scanner: scanner.clone(),
                scene: scene.clone(),
                legs: Vec::new(),
                leg_offset: None,
                crs_wkt: None,
            };
            let mut survey = base.unwrap_or_else(own);
            (survey.scene, survey.scanner, survey.platform) = (scene, scanner, platform);
            survey.name = name.unwrap_or(survey.name);
            if has_legs {
                survey.legs = own_legs;
            }
            set_legs(fields, &mut survey, &mut legs, common.as_mut(), options);
            Some(survey)
        }
        // The settings have separate problems.
        _ => {
            let settings = legs.iter_mut().filter_map(|tables| tables.settings.as_mut());
            common.iter_mut().chain(settings).for_each(|table| ScannerLayer::DEFAULT.clone().change(table));
            None
        }
    };
    let settings = legs.into_iter().flat_map(|tables| [Some(tables.leg), tables.settings]);
    settings.flatten().chain(common).for_each(|table| table.done(&[]));
    Some((survey?, has_legs))
}

/// The `[[leg]]` table of a leg and the table of its settings.
struct LegTables<'c> {
    leg: Fields<'c>,
    settings: Option<Fields<'c>>,
}

impl<'c> LegTables<'c> {
    fn new(mut leg: Fields<'c>) -> LegTables<'c> {
        let settings = leg.child(LegKeys::KEYS.settings, &SettingsKeys::TABLE);
        LegTables { leg, settings }
    }

    /// Place of a setting of the leg.
    fn place(&self, key: Key) -> Option<Place> {
        let settings = || self.settings.as_ref()?.place_if_written(key);
        self.leg.place_if_written(key).or_else(settings)
    }
}

fn survey_file(fields: &mut Fields) -> Option<Survey> {
    let name = fields.near_name(K.survey)?;
    let context = fields.context;
    let root = context.referred_document(&name, fields.folder(), Some(fields.place(K.survey)))?;
    read_survey_parts(context, &root).map(|(survey, _)| survey)
}

fn read_scene(
    fields: &mut Fields,
    source: &Source,
    options: &ReadOptions,
    base: Option<&Survey>,
) -> Option<SceneRecipe> {
    let parts = fields.children(K.part, &PartKeys::TABLE);
    let (context, name) = (fields.context, fields.near_scene(K.scene));
    match (&options.scene, name, base) {
        (Some(scene), ..) => {
            check_parts(parts);
            chosen_scene(context, scene, find_scene_on_soil)
        }
        (None, Some(_), _) if !parts.is_empty() => {
            context.error(fields.place(K.scene), "give either `scene` or [[part]] tables, not both");
            None
        }
        (None, None, _) if !parts.is_empty() => Some(read_parts(fields, source, parts)),
        (None, Some(name), _) => {
            find_scene_on_soil(context, &name, fields.folder(), Some(fields.place(K.scene)))
        }
        (None, None, Some(base)) => Some(base.scene.clone()),
        (None, None, None) => {
            if !fields.has(K.survey) && !fields.has(K.scene) {
                let message = "a pipeline needs the key `scene`, [[part]] tables or a `survey`";
                context.error_help(fields.own_place(), message, "scene = \"file.xml#id\"");
            }
            None
        }
    }
}

fn read_scanner(fields: &mut Fields, base: Option<&Survey>) -> Option<Scanner> {
    let inherited = base.map(|base| base.scanner.clone());
    let Some(mut table) = fields.child(K.scanner, &InstrumentKeys::TABLE) else {
        if !fields.has(K.survey) && !fields.has(K.scanner) {
            let message = "a pipeline needs a [scanner] or a `survey`";
            fields.context.error_help(fields.own_place(), message, "");
        }
        return inherited;
    };
    if inherited.is_none() && fields.has(K.survey) {
        return None;
    }
    let scanner = read_instrument(&mut table, inherited);
    if scanner.is_none() {
        table.ignore(InstrumentKeys::ALL);
    }
    table.done(&[]);
    scanner
}

fn read_carrier(fields: &mut Fields, inherited: Option<Platform>) -> Option<Platform> {
    let keys = PlatformKeys::KEYS;
    let standing = || Platform {
        id: "platform".to_owned(),
        kind: PlatformKind::Static,
        mount: Mount::IDENTITY,
        noise: PlatformNoise::default(),
    };
    let Some(mut table) = fields.child(K.platform, &PlatformKeys::TABLE) else {
        return Some(inherited.unwrap_or_else(standing));
    };
    let platform = match table.has(keys.catalogue) {
        true => named_asset(&mut table, keys.catalogue, "platform")
            .and_then(|element| read_platform(table.context, &element)),
        false => Some(inherited.unwrap_or_else(standing)),
    };
    let kinds = [("static", PlatformKind::Static), ("linear_path", PlatformKind::LinearPath)];
    let (kind, mount) = (table.choice(keys.kind, &kinds, None), table.pose(keys.mount));
    table.done(&[]);
    let mut platform = platform?;
    platform.kind = kind.unwrap_or(platform.kind);
    platform.mount = mount.unwrap_or(platform.mount);
    Some(platform)
}

/// Applies `[waveform]` and `[detector]` to every device.
fn change_detection(fields: &mut Fields, scanner: Option<&mut Scanner>) {
    let waveform = fields.child(K.waveform, &WaveformKeys::TABLE);
    let detector = fields.child(K.detector, &DetectorKeys::TABLE);
    let mut nothing = [];
    let devices = scanner.map_or(&mut nothing[..], |scanner| &mut scanner.devices);
    if let Some(mut table) = waveform {
        let place = waveform_place(&table);
        for device in &mut *devices {
            change_waveform(&mut table, &mut device.waveform);
            device.waveform_place = place.clone().or(device.waveform_place.take());
        }
        table.ignore(WaveformKeys::ALL);
        table.done(&[]);
    }
    if let Some(mut table) = detector {
        for device in devices {
            change_detector(&mut table, device);
            let detector = &mut device.detector;
            detector.max_returns = table.count(DetectorKeys::KEYS.max_returns, detector.max_returns);
        }
        table.ignore(DetectorKeys::ALL);
        table.done(&[]);
    }
}

fn read_leg(
    tables: &mut LegTables,
    scanner: Option<&Scanner>,
    platform: Option<&Platform>,
    number: u32,
) -> Leg {
    let (keys, table) = (LegKeys::KEYS, &mut tables.leg);
    if !table.has(keys.position_m) {
        table.context.error(table.own_place(), "a [[leg]] needs the key `position_m`");
    }
    let mut settings = PlatformSettings::at(table.vector(keys.position_m).unwrap_or(DVec3::ZERO));
    settings.on_ground = table.flag(keys.on_ground, false);
    settings.has_speed = table.has(keys.speed_m_per_s);
    table.set(keys.speed_m_per_s, &mut settings.speed);
    settings.mount = table.pose(keys.mount);
    if table.has(keys.platform) && table.has_table(keys.mount) {
        table.warn_of_effect(keys.platform, "beside `mount`");
    }
    let other = named_asset(table, keys.platform, "platform").and_then(|e| read_platform(table.context, &e));
    if let Some((other, platform)) = other.zip(platform) {
        let mount = mount_of_other(table.context, &other, platform, table.place(keys.platform));
        settings.mount = settings.mount.or(mount);
    }
    let own = scanner.map_or_else(|| ScannerLayer::DEFAULT.resolved(), Scanner::own_settings);
    let scanner = ScannerSettings { active: table.flag(keys.active, true), ..own };
    let strip = table.text(keys.strip);
    Leg { number, strip, platform: settings, scanner, place: Some(table.own_place()) }
}

/// Completes the legs: those of the file or of its survey, or a single one that follows a stream, with the
/// settings of all legs and of each. Then checks the survey.
fn set_legs(
    fields: &Fields,
    survey: &mut Survey,
    tables: &mut [LegTables],
    mut common: Option<&mut Fields>,
    options: &ReadOptions,
) {
    let context = fields.context;
    if options.is_traced && survey.legs.is_empty() {
        survey.legs = vec![survey.scanner.leg()];
    }
    let tables = match &options.trajectory {
        Some(stream) => {
            survey.follow(stream.clone());
            // The settings of legs are checked anyway.
            let own = tables.iter_mut().filter_map(|tables| tables.settings.as_mut());
            own.for_each(|own| ScannerLayer::DEFAULT.clone().change(own));
            &mut []
        }
        None => tables,
    };
    if survey.legs.is_empty() {
        common.iter_mut().for_each(|common| ScannerLayer::DEFAULT.clone().change(common));
        let message = "a pipeline needs [trajectory], [[leg]] tables or a `survey`";
        context.error_help(fields.own_place(), message, "path = \"-\" in [trajectory] is standard input");
    }
    let times = survey.scanner.pulse_times.clone();
    for (i, leg) in survey.legs.iter_mut().enumerate() {
        // Legs of an XML survey do not have the times of a pattern.
        leg.scanner.pulse_times = leg.scanner.pulse_times.take().or_else(|| times.clone());
        let mut layer = ScannerLayer::of_leg(&leg.scanner);
        if let Some(common) = common.as_deref_mut() {
            leg.place.get_or_insert_with(|| common.own_place());
            layer.change(common);
        }
        let mut own = tables.get_mut(i).and_then(|tables| tables.settings.as_mut());
        if let Some(own) = own.as_mut() {
            layer.change(own);
        }
        let keys = [SettingsKeys::KEYS.vertical_resolution_deg, SettingsKeys::KEYS.horizontal_resolution_deg];
        let said = |table: &&Fields| keys.iter().any(|key| table.has(*key));
        if let Some(table) = [own.as_deref(), common.as_deref()].into_iter().flatten().find(said) {
            layer.apply_resolution(table, &survey.scanner);
        }
        layer.report_zero_angle(context, &survey.scanner);
        leg.scanner = layer.resolved();
    }
    if !options.is_traced {
        let place = |leg: usize, key: Key| {
            let own = tables.get(leg).and_then(|tables| tables.place(key));
            own.or_else(|| common.as_ref()?.place_if_written(key))
        };
        check_legs(context, survey, &place, true);
    }
}
