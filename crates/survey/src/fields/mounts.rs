//! Poses of one frame within another, and rotations (spec input-formats §1.4, §1.5).

use super::Fields;
use crate::Mount;
use crate::context::Context;
use crate::keys::{AxisKeys, Key, PoseKeys};
use crate::xml::Element;
use vlscan_geom::{DVec3, Rotation, radians};

impl Fields<'_> {
    /// A position and attitude: a child element as [`read_mount`] reads it, or a table.
    pub fn pose(&mut self, key: Key) -> Option<Mount> {
        let mut child = self.child(key, &PoseKeys::TABLE)?;
        if let Some(element) = child.element() {
            return Some(read_mount(self.context, element));
        }
        let keys = PoseKeys::KEYS;
        let offset = child.vector(keys.offset_m).unwrap_or(DVec3::ZERO);
        let local = child.flag(keys.local, false);
        let rotation = child.rotations(keys.rotate_deg, local);
        child.done(&[]);
        Some(Mount { offset, rotation })
    }

    /// The composed rotations of a list of tables, each about one axis; about the axes as rotated by those
    /// before it, if they are `local`.
    pub fn rotations(&mut self, key: Key, local: bool) -> Rotation {
        let keys = AxisKeys::KEYS;
        type Axis = (Key, fn(f64) -> Rotation);
        let axes: [Axis; 3] =
            [(keys.x, Rotation::about_x), (keys.y, Rotation::about_y), (keys.z, Rotation::about_z)];
        let mut all = Rotation::IDENTITY;
        for mut turn in self.children(key, &AxisKeys::TABLE) {
            let given: Vec<_> = axes.iter().filter(|(key, _)| turn.has(*key)).collect();
            if let [(key, about)] = given[..] {
                let rotation = about(radians(turn.number(*key, 0.0)));
                all = if local { all.after(rotation) } else { rotation.after(all) };
            } else {
                let message = "expected one finite angle about one axis, such as { x = -90 }";
                self.context.error(turn.own_place(), message);
            }
            turn.ignore(AxisKeys::ALL);
            turn.done(&[]);
        }
        all
    }

    /// The composed `<rot>` children of a parameter.
    pub fn rotation(&mut self, key: &'static str) -> Option<Rotation> {
        let param = self.declared_param(key, &["rotation"])?;
        if let Some(text) = param.value("value") {
            let message = format!("`value` of a rotation is ignored: `{text}`");
            let help = "turns are children: <rot axis=\"z\" angle_deg=\"90\"/>";
            self.context.warn_help(param.value_place("value"), message, help);
        }
        let local = is_local(&mut Fields::new(self.context, &param));
        Some(read_rotations(self.context, &param, local))
    }
}

/// Offset and rotations of an element with `x`, `y`, `z`, `rotations` and `<rot>` children (spec
/// input-formats §1.4, §1.5).
pub(crate) fn read_mount(context: &Context, element: &Element) -> Mount {
    let mut fields = Fields::new(context, element);
    let offset = DVec3::from(["x", "y", "z"].map(|name| fields.number(name, 0.0)));
    let local = is_local(&mut fields);
    fields.done(&["rot"]);
    Mount { offset, rotation: read_rotations(context, element, local) }
}

/// True if rotations are about axes that turn with them, by the attribute `rotations` of an element.
fn is_local(fields: &mut Fields) -> bool {
    fields.choice("rotations", &[("local", true), ("global", false)], Some("global")).unwrap_or(false)
}

/// The composed `<rot>` children of an element: each about the fixed axes, or (`local`) about the axes as
/// rotated by the preceding ones.
fn read_rotations(context: &Context, element: &Element, local: bool) -> Rotation {
    let (mut all, mut last) = (Rotation::IDENTITY, Rotation::IDENTITY);
    for rot in element.named("rot") {
        let Some(turn) = read_rotation(context, &rot, last) else { continue };
        all = if local { all.after(turn) } else { turn.after(all) };
        last = turn;
    }
    all
}

/// Reads a `<rot>`. With an axis named pitch, roll or yaw it is `before`, the rotation of the element before
/// it, as in the reference.
fn read_rotation(context: &Context, rot: &Element, before: Rotation) -> Option<Rotation> {
    let mut fields = Fields::new(context, rot);
    let axis = fields.required("axis");
    let angle = fields.required_number("angle_deg");
    if let Some(name @ ("pitch" | "roll" | "yaw")) = axis.as_deref() {
        let (axis, sense) = match name {
            "pitch" => ("x", ""),
            "roll" => ("y", ""),
            _ => ("z", ", clockwise where `z` is counter-clockwise"),
        };
        let effect = if before == Rotation::IDENTITY {
            "it rotates nothing"
        } else {
            "it repeats the rotation before it"
        };
        let message = format!("the axis `{name}` is none of x, y and z; {effect}, as in HELIOS++");
        let help = format!("{name} is the rotation about {axis}{sense}: <rot axis=\"{axis}\" …>");
        context.warn_help(rot.value_place("axis"), message, help);
        fields.done(&[]);
        return angle.filter(|angle| *angle != 0.0).map(|_| before);
    }
    let about: Option<fn(f64) -> Rotation> = match axis.as_deref() {
        Some("x" | "X") => Some(Rotation::about_x),
        Some("y" | "Y") => Some(Rotation::about_y),
        Some("z" | "Z") => Some(Rotation::about_z),
        Some(_) => {
            fields.refuse("axis", "x, y or z");
            None
        }
        None => None,
    };
    fields.done(&[]);
    let (about, angle) = (about?, angle?);
    (angle != 0.0).then(|| about(radians(angle)))
}
