//! Moving parts (spec input-formats §3.7).

use super::context::Context;
use super::fields::{Fields, Reading, parse_vector};
use super::xml::Element;
use super::{Motion, MotionKind, MotionSequence, MotionTiming};
use std::collections::HashMap;
use vlscan_base::diag::nearest;
use vlscan_base::quantity;
use vlscan_geom::{DVec3, radians, unit};

/// Reads the `<dmotion>` children of a part; empty for a part at rest.
pub(super) fn read_motions(context: &Context, part: &Element) -> Vec<MotionSequence> {
    let elements: Vec<Element> = part.named("dmotion").collect();
    let mut ids = HashMap::new();
    for (i, element) in elements.iter().enumerate() {
        let Some(id) = element.value("id") else { continue };
        if ids.insert(id, i).is_some() {
            context.error(element.value_place("id"), format!("the motion `{id}` is described twice"));
        }
    }
    elements.iter().map(|e| read_sequence(context, e, &ids)).collect()
}

fn read_sequence(context: &Context, element: &Element, ids: &HashMap<&str, usize>) -> MotionSequence {
    let mut fields = Fields::new(context, element);
    let id = fields.required("id").unwrap_or_default();
    if !fields.has("loop") {
        fields.missing("loop");
    }
    fields.reading = Reading::Lenient;
    let loops = fields.count("loop", 0);
    let next = fields.text("next").filter(|n| !n.is_empty()).and_then(|next| {
        let index = ids.get(next.as_str()).copied();
        if index.is_none() {
            let mut known: Vec<&str> = ids.keys().copied().collect();
            known.sort_unstable();
            let help = nearest(&next, known).map_or(String::new(), |n| format!("did you mean `{n}`?"));
            context.warn_help(
                element.value_place("next"),
                format!("there is no motion `{next}` in this part, which stops after `{id}`"),
                help,
            );
        }
        index
    });
    fields.done(&["motion"]);
    if element.child("motion").is_none() {
        context.error(element.place(), "a <dmotion> needs at least one <motion>");
    }
    let motions = element.named("motion").filter_map(|m| read_motion(context, &m)).collect();
    MotionSequence { id, loops, next, motions }
}

/// Types of motions.
const TYPES: [&str; 7] =
    ["identity", "translation", "rotation", "reflection", "glideplane", "helical", "rotsym"];
/// Attributes of motions, of which each type has some.
const MOTION_ATTRIBUTES: [&str; 7] = ["vec", "axis", "angle", "center", "ortho", "shift", "glide"];

fn read_motion(context: &Context, element: &Element) -> Option<Motion> {
    let mut fields = Fields::new(context, element);
    if !fields.has("type") {
        fields.missing("type");
    }
    let kinds = TYPES.map(|name| (name, name));
    let kind = fields.choice("type", &kinds, None);
    fields.reading = Reading::Lenient;
    let about_self = fields.flag("selfMode", false);
    let auto_crs = fields.number("autoCRS", 0.0);
    let kind = kind.and_then(|kind| read_kind(&mut fields, element, kind));
    fields.rest_without_effect(
        &MOTION_ATTRIBUTES,
        &format!("in a motion of type {}", element.value("type").unwrap_or_default()),
    );
    fields.done(&[]);
    Some(Motion { kind: kind?, about_self, auto_crs })
}

fn read_kind(fields: &mut Fields, element: &Element, kind: &str) -> Option<MotionKind> {
    Some(match kind {
        "identity" => MotionKind::Identity,
        "translation" => MotionKind::Translation { by: required_vector(fields, "vec")? },
        "rotation" | "helical" if has_null_axis(element) => {
            let message = "the `axis` of this motion is 0 0 0, so that nothing moves";
            let help = "if rounding left nothing of the axis, write it with more digits";
            fields.context.warn_help(element.value_place("axis"), message, help);
            fields.ignore(&["axis", "angle", "center", "glide"]);
            MotionKind::Identity
        }
        "rotation" => {
            let (axis, angle) = axis_and_angle(fields);
            MotionKind::Rotation { centre: fields.vector("center"), axis: axis?, angle: angle? }
        }
        "reflection" => MotionKind::Reflection { normal: direction(fields, "ortho")? },
        "glideplane" => {
            let (normal, shift) = (direction(fields, "ortho"), required_vector(fields, "shift"));
            let (normal, shift) = (normal?, shift?);
            if normal.dot(shift).abs() > 1e-9 {
                fields.refuse("shift", "a vector in the mirror's plane (at right angles to `ortho`)");
                return None;
            }
            MotionKind::GlidePlane { normal, shift }
        }
        "helical" => {
            let (axis, angle) = axis_and_angle(fields);
            let glide = fields.required_number("glide");
            MotionKind::Helical { axis: axis?, angle: angle?, glide: glide? }
        }
        _ => {
            let (axis, angle) = axis_and_angle(fields);
            MotionKind::RotaryReflection { centre: fields.vector("center"), axis: axis?, angle: angle? }
        }
    })
}

/// Largest angle about a null axis that counts as no motion, degrees. The matrix of such a rotation is
/// cos(angle) times the identity: up to here the reference shrinks a part by less than 0.02 %.
const MAX_NULL_AXIS_ANGLE: f64 = 1.0;

/// True if the axis is the null vector and the angle small, as programs write a part that hardly turns and
/// round the axis to a few digits.
fn has_null_axis(element: &Element) -> bool {
    let angle = element.value("angle").and_then(|text| text.trim().parse::<f64>().ok());
    angle.is_some_and(|angle| angle.abs() <= MAX_NULL_AXIS_ANGLE)
        && element.value("axis").and_then(parse_vector) == Some([0.0; 3])
}

fn axis_and_angle(fields: &mut Fields) -> (Option<DVec3>, Option<f64>) {
    let axis = direction(fields, "axis");
    let angle = fields.required_number("angle").map(radians);
    (axis, angle)
}

fn required_vector(fields: &mut Fields, name: &'static str) -> Option<DVec3> {
    if !fields.has(name) {
        fields.missing(name);
    }
    fields.vector(name)
}

/// A vector normalised to unit length.
fn direction(fields: &mut Fields, name: &'static str) -> Option<DVec3> {
    let direction = unit(required_vector(fields, name)?);
    if !direction.is_finite() {
        fields.refuse(name, "a direction");
        return None;
    }
    Some(direction)
}

/// A number of steps, 1 if none is given; 0 is never.
pub(super) fn read_step(fields: &mut Fields, name: &'static str) -> u32 {
    let steps = fields.count(name, 1);
    if steps == 0 {
        fields.warn(name, "is 0: it never happens");
    }
    steps
}

/// Reads the timing attributes of a `<part>`.
pub(super) fn read_timing(fields: &mut Fields) -> MotionTiming {
    MotionTiming {
        dyn_step: read_step(fields, "dynStep"),
        tree_step: read_step(fields, "kdtDynStep"),
        dyn_time_step: positive_time(fields, "dynTimeStep"),
        tree_time_step: positive_time(fields, "kdtDynTimeStep"),
    }
}

/// Warns of a moving part that the document gives no time step, so that it moves at every pulse. `scene` is
/// its scene.
fn check_steps(context: &Context, part: &Element, scene: &Element) {
    if part.value(STEPS[0]).is_none() && scene.value(STEPS[0]).is_none() {
        context.warn_help(
            part.place(),
            "this part moves at every pulse: neither it nor its scene says how often",
            "give the <scene> a `dynTimeStep` in seconds, or `dynStep` in pulses; dynStep=\"1\" is every \
             pulse",
        );
    }
}

/// Attributes of a part's timing: in steps, and in seconds.
const STEPS: [&str; 2] = ["dynStep", "kdtDynStep"];
const TIMES: [&str; 2] = ["dynTimeStep", "kdtDynTimeStep"];

/// Warns of timing of a `<part>` that has no effect or is not a whole number of the steps in which it is
/// counted. `scene` is the `dynTimeStep` of the scene.
pub(super) fn check_timing(context: &Context, part: &Element, scene_element: &Element, scene: Option<f64>) {
    let unused = |names: &[&str], why: &str| {
        for name in names.iter().filter(|name| part.value(name).is_some()) {
            context.warn(part.name_place(name), format!("`{name}` has no effect {why}"));
        }
    };
    if part.child("dmotion").is_none() {
        return unused(&[STEPS, TIMES].concat(), "on a part that does not move");
    }
    let Some(scene) = scene else {
        check_steps(context, part, scene_element);
        return unused(&TIMES, "without a `dynTimeStep` of the <scene>");
    };
    unused(&STEPS, "beside the `dynTimeStep` of the <scene>");
    let mut step = scene;
    for name in TIMES {
        let written = part.value(name).and_then(|text| text.parse::<f64>().ok()).filter(|time| *time > 0.0);
        let Some(time) = written else { continue };
        if let Some(message) = rounded_steps(time / step, time, step) {
            context.warn(part.value_place(name), format!("`{name}` of {message}"));
        }
        step = time;
    }
}

/// Describes a time that is not a whole number of steps, of which `steps` is the number, and the time used
/// instead.
pub fn rounded_steps(steps: f64, time: f64, step: f64) -> Option<String> {
    let whole = steps.floor();
    let [time, found, step, counted] = [time, steps, step, whole].map(quantity::number);
    let counts = if whole == 0.0 { "it happens once".to_owned() } else { format!("{counted} count") };
    (whole != steps).then(|| format!("{time} s is {found} steps of {step} s; {counts}"))
}

/// A time step, s; `None` when it is missing.
pub(super) fn positive_time(fields: &mut Fields, name: &'static str) -> Option<f64> {
    let time = fields.optional(name)?;
    if time <= 0.0 {
        fields.refuse(name, "a number of seconds above 0");
        return None;
    }
    Some(time)
}
