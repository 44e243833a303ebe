//! Platforms (spec input-formats §7) and noise (spec input-formats §2.10).

use super::context::Context;
use super::fields::{Fields, Reading};
use super::keys::{Key, LegKeys};
use super::xml::Element;
use super::{Mount, Multicopter, Noise, NoiseKind, Platform, PlatformKind, PlatformNoise};
use vlscan_base::diag::Place;
use vlscan_base::quantity::{DEVIATION, NOT_NEGATIVE, NUMBER};
use vlscan_geom::radians;

/// Children of a platform that describe noise, in the order position x, y, z, attitude x, y, z.
pub(super) const NOISE: [&str; 6] = [
    "positionXNoise",
    "positionYNoise",
    "positionZNoise",
    "attitudeXNoise",
    "attitudeYNoise",
    "attitudeZNoise",
];

/// The other parameters of multicopters; a ground vehicle only has drag.
const MULTICOPTER: [&str; 9] = [
    "engine_max_force",
    "speedup_magnitude",
    "slowdown_magnitude",
    "base_pitch_deg",
    "pitch_speed_deg",
    "roll_speed_deg",
    "yaw_speed_deg",
    "pitch_offset_deg",
    "roll_offset_deg",
];

pub(super) fn read_platform(context: &Context, element: &Element) -> Option<Platform> {
    let mut fields = Fields::new(context, element);
    let id = fields.text("id").unwrap_or_default();
    fields.ignore(&["name"]);
    let kind = read_kind(&mut fields);
    let mount = fields.pose(LegKeys::KEYS.mount).unwrap_or(Mount::IDENTITY);
    fields.done(&NOISE);
    let mut noise = PlatformNoise::default();
    replace_noise(context, element, &mut noise);
    Some(Platform { id, kind: kind?, mount, noise })
}

/// The mount of `other`, a platform that a leg names at `place` instead of `platform`, that of the survey.
pub(super) fn mount_of_other(
    context: &Context,
    other: &Platform,
    platform: &Platform,
    place: Place,
) -> Option<Mount> {
    if !other.kind.can_fly_for(&platform.kind) {
        let (id, theirs, kind) = (&other.id, other.kind.name(), platform.kind.name());
        let message = match theirs == kind {
            true => {
                format!("the platform `{id}` does not move as that of the survey: their parameters differ")
            }
            false => format!("the platform `{id}` is of type {theirs}, that of the survey of type {kind}"),
        };
        let help =
            "all legs of a survey use one kind of platform; give the leg its own mount, or its own survey";
        context.error_help(place, message, help);
        return None;
    }
    if other.noise != platform.noise {
        let message = format!("the noise of the platform `{}` has no effect in a single leg", other.id);
        context.warn_help(place, message, "the noise of the survey's platform applies to all legs");
    }
    Some(other.mount)
}

fn read_kind(fields: &mut Fields) -> Option<PlatformKind> {
    fields.reading = Reading::Lenient;
    // Every attribute is read for every kind: built-in platforms list more than they need.
    let drag = fields.number(Key::attribute("drag", &NOT_NEGATIVE), 1.0);
    let angle = |fields: &mut Fields, name, default| radians(fields.number(name, default));
    let multicopter = Multicopter {
        drag,
        engine_max_force: fields.number("engine_max_force", 0.1),
        speedup: fields.number("speedup_magnitude", 2.0),
        slowdown: fields.number("slowdown_magnitude", 2.0),
        base_pitch: angle(fields, "base_pitch_deg", -5.0),
        pitch_speed: angle(fields, "pitch_speed_deg", 85.94),
        roll_speed: angle(fields, "roll_speed_deg", 28.65),
        yaw_speed: angle(fields, "yaw_speed_deg", 85.94),
        pitch_offset: angle(fields, "pitch_offset_deg", 35.0),
        roll_offset: angle(fields, "roll_offset_deg", 25.0),
    };
    fields.ignore(&["slowdown_distance"]);
    if !fields.has("type") {
        fields.missing("type");
        return None;
    }
    let kinds = [
        PlatformKind::Static,
        PlatformKind::LinearPath,
        PlatformKind::GroundVehicle { drag },
        PlatformKind::Multicopter(multicopter),
    ];
    let kind = fields.choice("type", &kinds.map(|kind| (kind.name(), kind)), Some("static"));
    let why = kind.as_ref().map(|kind| format!("on a platform of type {}", kind.name()));
    match (&kind, why) {
        (Some(PlatformKind::Static | PlatformKind::LinearPath), Some(why)) => {
            fields.without_effect(&["drag"], &why);
            fields.without_effect(&MULTICOPTER, &why);
        }
        (Some(PlatformKind::GroundVehicle { .. }), Some(why)) => fields.without_effect(&MULTICOPTER, &why),
        _ => {}
    }
    Some(kind.unwrap_or(PlatformKind::Static))
}

/// Replaces the noise sources for which `element` has a child.
pub(super) fn replace_noise(context: &Context, element: &Element, noise: &mut PlatformNoise) {
    let sources = noise.position.iter_mut().chain(&mut noise.attitude);
    for (name, source) in NOISE.iter().zip(sources) {
        if let Some(child) = element.child(name) {
            *source = Some(read_noise(context, &child));
        }
    }
}

fn read_noise(context: &Context, element: &Element) -> Noise {
    let mut fields = Fields::new(context, element);
    let kinds = [("NORMAL", false), ("UNIFORM", true)];
    let uniform = fields.choice("type", &kinds, Some("NORMAL")).unwrap_or(false);
    fields.reading = Reading::Lenient;
    match uniform {
        true => fields.without_effect(&["mean", "stdev"], "with uniform noise, which has `min` and `max`"),
        false => fields.without_effect(&["min", "max"], "with normal noise, which has `mean` and `stdev`"),
    }
    // Values without effect are not limited.
    let stdev = Key::attribute("stdev", if uniform { &NUMBER } else { &DEVIATION });
    let (mean, stdev) = (fields.number("mean", 0.0), fields.number(stdev, 1.0));
    let (min, max) = (fields.number("min", 0.0), fields.number("max", 1.0));
    if uniform {
        fields.in_order((min, max), ["min", "max"], "");
    }
    let clipped = fields.flag("clipEnabled", false);
    if !clipped {
        fields.without_effect(&["clipMin", "clipMax"], "without `clipEnabled`");
    }
    let clip = (fields.number("clipMin", 0.0), fields.number("clipMax", 1.0));
    if clipped {
        fields.in_order(clip, ["clipMin", "clipMax"], "");
    }
    let lifespan = fields.count("fixedLifespan", 1);
    fields.done(&[]);
    let kind = if uniform { NoiseKind::Uniform { min, max } } else { NoiseKind::Normal { mean, stdev } };
    Noise { kind, clip: clipped.then_some(clip), lifespan }
}
