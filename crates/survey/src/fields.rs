//! Typed attributes of one element (spec input-formats §1.3).
//!
//! [`Fields::done`] reports all attributes that have not been read. Strict values must parse completely; otherwise
//! they are replaced by their default with a warning. Lenient values may have any text after the number.

use super::context::Context;
use super::xml::Element;
use super::{Formula, Mount};
use std::fmt::Display;
use vlscan_base::columns::has_decimal_comma;
use vlscan_base::diag::nearest;
use vlscan_base::quantity::{self, Bounds};
use vlscan_geom::{DVec3, Rotation, degrees, radians};

/// Maximum number of unknown elements in an element that are reported.
const MAX_UNKNOWN_CHILDREN: usize = 1000;

/// Elements of which an element may have several.
const REPEATED: [&str; 10] =
    ["channel", "dmotion", "filter", "leg", "motion", "param", "part", "rot", "source", "swap"];
/// The root, whose elements are told apart by their ids.
const ROOT: &str = "document";

/// The attributes of an element while they are read.
pub(super) struct Fields<'c> {
    pub element: &'c Element,
    context: &'c Context,
    known: Vec<&'static str>,
}

impl<'c> Fields<'c> {
    pub fn new(context: &'c Context, element: &'c Element) -> Fields<'c> {
        Fields { element, context, known: Vec::new() }
    }

    /// Marks attributes without effect as known.
    pub fn ignore(&mut self, names: &[&'static str]) {
        self.known.extend(names);
    }

    /// Warns about attributes that have not been read and about child elements other than `children`.
    pub fn done(self, children: &[&'static str]) {
        let tag = self.element.name();
        for name in self.element.attribute_names().filter(|n| !self.known.contains(n)) {
            let message = format!("unknown attribute `{name}` of <{tag}> is ignored");
            let help = meant(name, &self.known);
            self.context.warn_help(self.element.name_place(name), message, help);
        }
        self.report_repeated(children);
        let unknown = self.element.children().filter(|c| !children.contains(&c.name()));
        for child in unknown.take(MAX_UNKNOWN_CHILDREN) {
            let message = format!("unknown element <{}> in <{tag}> is ignored", child.name());
            self.context.warn_help(child.place(), message, meant(child.name(), children));
        }
    }

    /// The attributes that have been read or marked as known.
    pub fn known(&self) -> &[&'static str] {
        &self.known
    }

    /// Warns of second children of a kind of which the first one counts.
    fn report_repeated(&self, children: &[&'static str]) {
        if self.element.name() == ROOT {
            return;
        }
        for name in children.iter().filter(|name| !REPEATED.contains(name)) {
            for second in self.element.named(name).skip(1).take(MAX_UNKNOWN_CHILDREN) {
                let message = format!(
                    "a second <{name}> in <{}> is ignored; the first one counts",
                    self.element.name()
                );
                self.context.warn(second.place(), message);
            }
        }
    }

    pub fn text(&mut self, name: &'static str) -> Option<&'c str> {
        self.known.push(name);
        self.element.value(name)
    }

    /// The text of an attribute; a missing one is an error.
    pub fn required(&mut self, name: &'static str) -> Option<&'c str> {
        let text = self.text(name);
        if text.is_none() {
            let message = format!("<{}> needs the attribute `{name}`", self.element.name());
            self.context.error(self.element.place(), message);
        }
        text
    }

    pub fn has(&self, name: &str) -> bool {
        self.element.value(name).is_some()
    }

    /// Strict number within the bounds of all numbers.
    pub fn number(&mut self, name: &'static str, default: f64) -> f64 {
        self.within(name, default, &quantity::NUMBER)
    }

    /// Strict number within `bounds`.
    pub fn within(&mut self, name: &'static str, default: f64, bounds: &Bounds) -> f64 {
        let Some(text) = self.text(name) else { return default };
        match text.parse::<f64>() {
            Ok(value) if bounds.contains(value) => self.doubted(name, value, bounds),
            Ok(_) => {
                self.refuse(name, bounds.expected);
                default
            }
            Err(_) => self.replaced(name, "a number", default),
        }
    }

    /// `value`, with a warning if it is beyond what is usual.
    fn doubted(&self, name: &str, value: f64, bounds: &Bounds) -> f64 {
        if let Some((doubt, hint)) = bounds.doubt(value) {
            self.context.warn_help(self.element.value_place(name), format!("`{name}` {doubt}"), hint);
        }
        value
    }

    /// Warns of the value of an attribute; the message follows its name.
    pub fn warn(&self, name: &str, message: &str) {
        self.context.warn(self.element.value_place(name), format!("`{name}` {message}"));
    }

    /// Warns that attributes of the element have no effect, as `why` says, if they are written.
    pub fn without_effect(&mut self, names: &[&'static str], why: &str) {
        for name in names.iter().filter(|name| self.has(name)) {
            let message = format!("`{name}` has no effect {why}");
            self.context.warn(self.element.name_place(name), message);
        }
        self.ignore(names);
    }

    /// [`Fields::without_effect`] of those of `names` that have not been read.
    pub fn rest_without_effect(&mut self, names: &[&'static str], why: &str) {
        let rest: Vec<&'static str> =
            names.iter().copied().filter(|name| !self.known.contains(name)).collect();
        self.without_effect(&rest, why);
    }

    /// Strict number; NaN means "not set".
    pub fn optional_number(&mut self, name: &'static str, bounds: &Bounds) -> Option<f64> {
        let text = self.text(name)?;
        match text.parse::<f64>() {
            Ok(value) if bounds.contains(value) => Some(self.doubted(name, value, bounds)),
            Ok(value) if value.is_nan() => None,
            Ok(_) => {
                self.refuse(name, bounds.expected);
                None
            }
            Err(_) => {
                self.warn_replaced(name, "a number", "it counts as not given");
                None
            }
        }
    }

    /// Strict number above 0.
    pub fn positive(&mut self, name: &'static str, default: f64) -> f64 {
        self.within(name, default, &quantity::POSITIVE)
    }

    /// Strict number of at least 0.
    pub fn not_negative(&mut self, name: &'static str, default: f64) -> f64 {
        self.within(name, default, &quantity::NOT_NEGATIVE)
    }

    /// Strict number of degrees within `bounds` as radians; the default is in radians.
    pub fn angle(&mut self, name: &'static str, default: f64, bounds: &Bounds) -> f64 {
        let Some(text) = self.text(name) else { return default };
        match text.parse::<f64>() {
            Ok(value) if bounds.contains(value) => radians(self.doubted(name, value, bounds)),
            Ok(_) => {
                self.refuse(name, bounds.expected);
                default
            }
            Err(_) => {
                // return the default itself: settings are merged by comparing values
                self.replaced(name, "a number", degrees(default));
                default
            }
        }
    }

    /// Strict angle in degrees as radians; NaN means "not set".
    pub fn optional_angle(&mut self, name: &'static str) -> Option<f64> {
        self.optional_number(name, &quantity::ANGLE).map(radians)
    }

    /// Strict 32-bit integer.
    pub fn whole(&mut self, name: &'static str, default: i32) -> i32 {
        match self.text(name) {
            None => default,
            Some(text) => match text.parse::<i32>() {
                Ok(value) => value,
                Err(_) => self.replaced(name, "a whole number without decimals or exponent", default),
            },
        }
    }

    /// Strict integer within a range.
    pub fn whole_within(
        &mut self,
        name: &'static str,
        default: u32,
        range: std::ops::RangeInclusive<u32>,
    ) -> u32 {
        let value = i64::from(self.whole(name, i32::try_from(default).unwrap_or(i32::MAX)));
        match u32::try_from(value) {
            Ok(value) if range.contains(&value) || !self.has(name) => value,
            _ => {
                let (low, high) = (range.start(), range.end());
                match high {
                    &u32::MAX => self.refuse(name, &format!("a whole number of at least {low}")),
                    _ => self.refuse(name, &format!("a whole number from {low} to {high}")),
                }
                default
            }
        }
    }

    /// Strict boolean.
    pub fn flag(&mut self, name: &'static str, default: bool) -> bool {
        match self.text(name) {
            None => default,
            Some("true" | "1") => true,
            Some("false" | "0") => false,
            Some(_) => self.replaced(name, "true, false, 1 or 0", default),
        }
    }

    /// Lenient finite number.
    pub fn lenient_number(&mut self, name: &'static str, default: f64) -> f64 {
        let Some(text) = self.text(name) else { return default };
        if let Ok(value) = text.trim().parse::<f64>() {
            if quantity::NUMBER.contains(value) {
                return value;
            }
            self.refuse(name, quantity::NUMBER.expected);
            return default;
        }
        match numeric_beginning(text) {
            Some(value) => self.replaced(name, "a number", value),
            None => self.replaced(name, "a number", default),
        }
    }

    /// Lenient number of degrees as radians; the default is in degrees.
    pub fn lenient_angle(&mut self, name: &'static str, default_deg: f64) -> f64 {
        radians(self.lenient_number(name, default_deg))
    }

    /// Lenient integer of at least 0.
    pub fn lenient_count(&mut self, name: &'static str, default: u32) -> u32 {
        let Some(text) = self.text(name) else { return default };
        let text = text.trim();
        if let Ok(value) = text.parse::<u32>() {
            return value;
        }
        let digits = text.bytes().take_while(u8::is_ascii_digit).count();
        match text[..digits].parse::<u32>() {
            Ok(value) => self.replaced(name, "a whole number", value),
            Err(_) if text.starts_with('-') => {
                self.refuse(name, "a whole number of at least 0");
                default
            }
            Err(_) => self.replaced(name, "a whole number", default),
        }
    }

    /// Lenient boolean.
    pub fn lenient_flag(&mut self, name: &'static str, default: bool) -> bool {
        match self.text(name).map(str::trim) {
            None => default,
            Some("true" | "True" | "TRUE") => true,
            Some("false" | "False" | "FALSE") => false,
            Some(text) => match text.parse::<i64>() {
                Ok(number) => number != 0,
                Err(_) => self.replaced(name, "true or false", default),
            },
        }
    }

    /// A vector of the form `a;b;c`.
    pub fn vector(&mut self, name: &'static str) -> Option<DVec3> {
        let text = self.text(name)?;
        let vector = parse_vector(text);
        if vector.is_none() {
            self.refuse(name, "three numbers with semicolons, such as 0;0;1");
        }
        vector
    }

    /// A formula; a missing one is an error.
    pub fn formula(&mut self, name: &'static str) -> Option<Formula> {
        let text = self.required(name)?;
        match Formula::parse(text) {
            Ok(formula) => Some(formula),
            Err(e) => {
                self.context.error(self.element.value_part_place(name, &e.at), e.message);
                None
            }
        }
    }

    /// Attributes x, y, z; each 0 when missing.
    pub fn xyz(&mut self) -> DVec3 {
        DVec3::new(self.number("x", 0.0), self.number("y", 0.0), self.number("z", 0.0))
    }

    /// Records that the value is unusable.
    pub fn refuse(&self, name: &str, expected: &str) {
        let found = self.element.value(name).unwrap_or_default();
        let message = format!("`{name}` must be {expected}, found `{found}`");
        self.context.error(self.element.value_place(name), message);
    }

    fn replaced<T: Display>(&self, name: &str, expected: &str, used: T) -> T {
        self.warn_replaced(name, expected, &format!("{used} is used"));
        used
    }

    fn warn_replaced(&self, name: &str, expected: &str, used: &str) {
        let found = self.element.value(name).unwrap_or_default();
        let message = format!("expected {expected} for `{name}`, found `{found}`; {used}");
        let hint = if has_decimal_comma(found) { DECIMAL_POINT } else { "" };
        self.context.warn_help(self.element.value_place(name), message, hint);
    }
}

/// The hint for a number with a decimal comma.
const DECIMAL_POINT: &str = "numbers have a decimal point, not a comma";

/// The hint "did you mean …", or an empty text.
pub(super) fn meant(word: &str, known: &[&'static str]) -> String {
    nearest(word, known.iter().copied()).map_or(String::new(), |near| format!("did you mean `{near}`?"))
}

/// Parses three finite numbers separated by semicolons.
pub(super) fn parse_vector(text: &str) -> Option<DVec3> {
    let mut parts =
        text.split(';').map(|p| p.trim().parse::<f64>().ok().filter(|v| quantity::NUMBER.contains(*v)));
    let vector = DVec3::new(parts.next()??, parts.next()??, parts.next()??);
    parts.next().is_none().then_some(vector)
}

/// The longest prefix that is a finite number.
fn numeric_beginning(text: &str) -> Option<f64> {
    let text = text.trim_start();
    let end = text.bytes().take_while(|b| b.is_ascii_digit() || b"+-.eE".contains(b)).count().min(40);
    (1..=end).rev().find_map(|n| text[..n].parse::<f64>().ok().filter(|v| quantity::NUMBER.contains(*v)))
}

/// Offset and rotations of an element with `x`, `y`, `z`, `rotations` and `<rot>` children (spec input-formats §1.4,
/// §1.5).
pub(super) fn read_mount(context: &Context, element: &Element) -> Mount {
    let mut fields = Fields::new(context, element);
    let offset = fields.xyz();
    let local = fields.text("rotations").is_some_and(|text| is_local(context, element, text));
    fields.done(&["rot"]);
    Mount { offset, rotation: read_rotations(context, element, local) }
}

/// Whether rotations are about axes that turn with them, by the attribute `rotations` of an element.
pub(super) fn is_local(context: &Context, element: &Element, text: &str) -> bool {
    if !matches!(text, "local" | "global") {
        let message = format!("expected local or global for `rotations`, found `{text}`; global is used");
        context.warn_help(element.value_place("rotations"), message, meant(text, &["local", "global"]));
    }
    text == "local"
}

/// The composed `<rot>` children of an element: each about the fixed axes, or (`local`) about the axes as rotated by
/// the preceding ones.
pub(super) fn read_rotations(context: &Context, element: &Element, local: bool) -> Rotation {
    let (mut all, mut last) = (Rotation::IDENTITY, Rotation::IDENTITY);
    for rot in element.named("rot") {
        let Some(turn) = read_rotation(context, &rot, last) else { continue };
        all = if local { all.after(turn) } else { turn.after(all) };
        last = turn;
    }
    all
}

/// Reads a `<rot>`. With an axis named pitch, roll or yaw it is `before`, the rotation of the element before it, as in
/// the reference.
fn read_rotation(context: &Context, rot: &Element, before: Rotation) -> Option<Rotation> {
    let mut fields = Fields::new(context, rot);
    let (axis, angle) = (fields.required("axis"), fields.required("angle_deg"));
    let angle = angle.and_then(|text| {
        let angle = text.trim().parse::<f64>().ok().filter(|a| quantity::NUMBER.contains(*a));
        if angle.is_none() {
            fields.refuse("angle_deg", "a number of degrees");
        }
        angle
    });
    if let Some(name @ ("pitch" | "roll" | "yaw")) = axis {
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
    let about: Option<fn(f64) -> Rotation> = match axis {
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
