//! Platforms (spec input-formats §7) and noise (spec input-formats §2.10).

use super::context::Context;
use super::fields::{Fields, read_mount};
use super::xml::Element;
use super::{Mount, Multicopter, Noise, NoiseKind, Platform, PlatformKind, PlatformNoise};
use vlscan_base::diag::Place;

/// Children of a platform that describe noise, in the order position x, y, z, attitude x, y, z.
pub(super) const NOISE: [&str; 6] = [
    "positionXNoise",
    "positionYNoise",
    "positionZNoise",
    "attitudeXNoise",
    "attitudeYNoise",
    "attitudeZNoise",
];

/// Attributes of multicopters; a ground vehicle has the first one.
const MULTICOPTER: [&str; 10] = [
    "drag",
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
    let id = fields.text("id").unwrap_or_default().to_owned();
    fields.ignore(&["name"]);
    let kind = fields.required("type").map(str::to_ascii_lowercase);
    let kind = read_kind(&mut fields, kind.as_deref(), context);
    let mut children = NOISE.to_vec();
    children.push("scannerMount");
    fields.done(&children);
    let mount = element.child("scannerMount").map_or(Mount::IDENTITY, |m| read_mount(context, &m));
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
            "all legs of a survey move in one way; give the leg a mount of its own, or a survey of its own";
        context.error_help(place, message, help);
        return None;
    }
    if other.noise != platform.noise {
        let message = format!("the noise of the platform `{}` has no effect in a single leg", other.id);
        context.warn_help(place, message, "the noise of the survey's platform holds for all legs");
    }
    Some(other.mount)
}

fn read_kind(fields: &mut Fields, kind: Option<&str>, context: &Context) -> Option<PlatformKind> {
    // Every attribute is read for every kind: built-in platforms list more than they need.
    let drag = fields.lenient_number("drag", 1.0);
    let multicopter = Multicopter {
        drag,
        engine_max_force: fields.lenient_number("engine_max_force", 0.1),
        speedup: fields.lenient_number("speedup_magnitude", 2.0),
        slowdown: fields.lenient_number("slowdown_magnitude", 2.0),
        base_pitch: fields.lenient_angle("base_pitch_deg", -5.0),
        pitch_speed: fields.lenient_angle("pitch_speed_deg", 85.94),
        roll_speed: fields.lenient_angle("roll_speed_deg", 28.65),
        yaw_speed: fields.lenient_angle("yaw_speed_deg", 85.94),
        pitch_offset: fields.lenient_angle("pitch_offset_deg", 35.0),
        roll_offset: fields.lenient_angle("roll_offset_deg", 25.0),
    };
    fields.ignore(&["slowdown_distance"]);
    let drag_only = kind == Some("groundvehicle");
    if matches!(kind, Some("static" | "linearpath")) || drag_only {
        let names = if drag_only { &MULTICOPTER[1..] } else { &MULTICOPTER[..] };
        fields.without_effect(names, &format!("on a platform of type {}", kind.unwrap_or_default()));
    }
    Some(match kind? {
        "static" => PlatformKind::Static,
        "linearpath" => PlatformKind::LinearPath,
        "groundvehicle" => PlatformKind::GroundVehicle { drag },
        "multicopter" => PlatformKind::Multicopter(multicopter),
        other => {
            let message = format!("unknown platform type `{other}`; a static platform is used");
            let help = "the types are static, linearpath, groundvehicle and multicopter";
            context.warn_help(fields.element.value_place("type"), message, help);
            PlatformKind::Static
        }
    })
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
    let uniform = match fields.text("type") {
        Some("UNIFORM") => true,
        None | Some("NORMAL") => false,
        Some(other) => {
            let message = format!("unknown noise type `{other}`; NORMAL is used");
            context.warn_help(element.value_place("type"), message, "the types are NORMAL and UNIFORM");
            false
        }
    };
    match uniform {
        true => fields.without_effect(&["mean", "stdev"], "with uniform noise, which has `min` and `max`"),
        false => fields.without_effect(&["min", "max"], "with normal noise, which has `mean` and `stdev`"),
    }
    let (mean, stdev) = (fields.lenient_number("mean", 0.0), fields.lenient_number("stdev", 1.0));
    let (min, max) = (fields.lenient_number("min", 0.0), fields.lenient_number("max", 1.0));
    let clipped = fields.lenient_flag("clipEnabled", false);
    if !clipped {
        fields.without_effect(&["clipMin", "clipMax"], "without `clipEnabled`");
    }
    let clip = (fields.lenient_number("clipMin", 0.0), fields.lenient_number("clipMax", 1.0));
    let lifespan = fields.lenient_count("fixedLifespan", 1);
    if !uniform && stdev < 0.0 {
        fields.refuse("stdev", "a number of at least 0");
    }
    if uniform && min > max {
        fields.refuse(if fields.has("max") { "max" } else { "min" }, "such that min does not exceed max");
    }
    if clipped && clip.0 > clip.1 {
        let name = if fields.has("clipMax") { "clipMax" } else { "clipMin" };
        fields.refuse(name, "such that clipMin does not exceed clipMax");
    }
    fields.done(&[]);
    let kind = if uniform { NoiseKind::Uniform { min, max } } else { NoiseKind::Normal { mean, stdev } };
    Noise { kind, clip: clipped.then_some(clip), lifespan }
}
