//! Moving parts (spec input-formats §3.7).

use super::context::Context;
use super::fields::{Fields, parse_vector};
use super::xml::Element;
use super::{Motion, MotionKind, MotionSequence, MotionTiming};
use crate::diag::nearest;
use crate::geom::{DVec3, radians, unit};
use crate::quantity;
use std::collections::HashMap;

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
    let id = fields.required("id").unwrap_or_default().to_owned();
    let loops = match fields.required("loop") {
        Some(_) => fields.lenient_count("loop", 0),
        None => 0,
    };
    let next = fields.text("next").filter(|n| !n.is_empty()).and_then(|next| {
        let index = ids.get(next).copied();
        if index.is_none() {
            let mut known: Vec<&str> = ids.keys().copied().collect();
            known.sort_unstable();
            let help = nearest(next, known).map_or(String::new(), |n| format!("did you mean `{n}`?"));
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

fn read_motion(context: &Context, element: &Element) -> Option<Motion> {
    let mut fields = Fields::new(context, element);
    let kind = fields.required("type").map(str::to_owned);
    let about_self = fields.lenient_flag("selfMode", false);
    let auto_crs = fields.lenient_number("autoCRS", 0.0);
    let kind = kind.and_then(|kind| read_kind(context, &mut fields, &kind));
    fields.ignore(&["vec", "axis", "angle", "center", "ortho", "shift", "glide"]);
    fields.done(&[]);
    Some(Motion { kind: kind?, about_self, auto_crs })
}

fn read_kind(context: &Context, fields: &mut Fields, kind: &str) -> Option<MotionKind> {
    Some(match kind {
        "identity" => MotionKind::Identity,
        "translation" => MotionKind::Translation { by: required_vector(fields, "vec")? },
        "rotation" if is_null_rotation(fields) => {
            let message = "a rotation by 0 about an `axis` without direction moves nothing";
            context.warn(fields.element.value_place("axis"), message);
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
            let glide = required_number(fields, "glide");
            MotionKind::Helical { axis: axis?, angle: angle?, glide: glide? }
        }
        "rotsym" => {
            let (axis, angle) = axis_and_angle(fields);
            MotionKind::RotaryReflection { centre: fields.vector("center"), axis: axis?, angle: angle? }
        }
        other => {
            let known =
                ["identity", "translation", "rotation", "reflection", "glideplane", "helical", "rotsym"];
            let help = match nearest(other, known) {
                Some(near) => format!("did you mean `{near}`?"),
                None => format!("the types are {}", known.join(", ")),
            };
            let place = fields.element.value_place("type");
            context.error_help(place, format!("unknown motion type `{other}`"), help);
            return None;
        }
    })
}

/// Whether the axis is the null vector and the angle 0, as programs write a part that stands still.
fn is_null_rotation(fields: &Fields) -> bool {
    let element = &fields.element;
    let angle = element.value("angle").and_then(|text| text.trim().parse::<f64>().ok());
    angle == Some(0.0) && element.value("axis").and_then(parse_vector) == Some(DVec3::ZERO)
}

fn axis_and_angle(fields: &mut Fields) -> (Option<DVec3>, Option<f64>) {
    let axis = direction(fields, "axis");
    let angle = required_number(fields, "angle").map(radians);
    (axis, angle)
}

/// A number without which the motion would be wrong: an unreadable value is an error.
fn required_number(fields: &mut Fields, name: &'static str) -> Option<f64> {
    let text = fields.required(name)?;
    let number = text.trim().parse::<f64>().ok().filter(|v| quantity::NUMBER.contains(*v));
    if number.is_none() {
        fields.refuse(name, "a number");
    }
    number
}

fn required_vector(fields: &mut Fields, name: &'static str) -> Option<DVec3> {
    fields.required(name)?;
    fields.vector(name)
}

/// A vector normalised to unit length.
fn direction(fields: &mut Fields, name: &'static str) -> Option<DVec3> {
    let vector = required_vector(fields, name)?;
    let direction = unit(vector);
    if !direction.is_finite() {
        fields.refuse(name, "a direction");
        return None;
    }
    Some(direction)
}

/// Reads the timing attributes of a `<part>`.
pub(super) fn read_timing(fields: &mut Fields) -> MotionTiming {
    MotionTiming {
        dyn_step: fields.whole_within("dynStep", 1, 0..=u32::MAX),
        tree_step: fields.whole_within("kdtDynStep", 1, 0..=u32::MAX),
        dyn_time_step: positive_time(fields, "dynTimeStep"),
        tree_time_step: positive_time(fields, "kdtDynTimeStep"),
    }
}

/// A time step, s; `None` when it is missing or NaN.
pub(super) fn positive_time(fields: &mut Fields, name: &'static str) -> Option<f64> {
    let time = fields.optional_number(name)?;
    if time <= 0.0 {
        fields.refuse(name, "a number of seconds above 0");
        return None;
    }
    Some(time)
}
