//! Values of keys: numbers within bounds, vectors, formulas, poses, references.

use super::super::context::Context;
use super::super::read::find_asset;
use super::super::xml::Element;
use super::super::{Formula, Mount};
use super::keys::{Key, PoseKeys};
use super::source::{Source, near};
use toml::Spanned;
use vlscan_base::quantity::{self, Bounds, number};
use vlscan_geom::{DVec3, Rotation, radians};

/// Context for reading the values of one file.
pub(super) struct Values<'c> {
    pub context: &'c Context,
    pub source: &'c Source,
}

impl Values<'_> {
    /// Sets `target` to the value of the key, if present; it must be within `bounds`.
    pub fn set(&self, target: &mut f64, key: &Key<f64>, bounds: &Bounds) {
        let Some(key) = key else { return };
        let value = *key.get_ref();
        if bounds.contains(value) {
            *target = value;
            self.doubt(key, value, bounds);
        } else {
            self.refuse(key, bounds.expected);
        }
    }

    /// Refuses a lower limit above the upper one, at the key that states one of them.
    pub fn in_order(&self, (least, most): (f64, f64), [lower, upper]: [&Key<f64>; 2]) {
        if least <= most {
            return;
        }
        if let Some(key) = upper {
            self.refuse(key, &format!("at least the lower limit, {}", number(least)));
        } else if let Some(key) = lower {
            self.refuse(key, &format!("at most the upper limit, {}", number(most)));
        }
    }

    /// Warns of a value beyond what is usual.
    pub fn doubt<T>(&self, key: &Spanned<T>, value: f64, bounds: &Bounds) {
        if let Some((doubt, hint)) = bounds.doubt(value) {
            self.context.warn_help(self.source.place(key.span()), format!("this {doubt}"), hint);
        }
    }

    pub fn positive(&self, target: &mut f64, key: &Key<f64>) {
        self.set(target, key, &quantity::POSITIVE);
    }

    pub fn not_negative(&self, target: &mut f64, key: &Key<f64>) {
        self.set(target, key, &quantity::NOT_NEGATIVE);
    }

    pub fn number(&self, target: &mut f64, key: &Key<f64>) {
        self.set(target, key, &quantity::NUMBER);
    }

    /// Sets `target` (radians) to the value of the key (degrees), if present; it must be within `bounds`.
    pub fn angle(&self, target: &mut f64, key: &Key<f64>, bounds: &Bounds) {
        if key.is_some() {
            let mut degrees = vlscan_geom::degrees(*target);
            self.set(&mut degrees, key, bounds);
            *target = radians(degrees);
        }
    }

    /// Three numbers.
    pub fn vector(&self, key: &Key<[f64; 3]>) -> Option<DVec3> {
        let key = key.as_ref()?;
        let vector = DVec3::from(*key.get_ref());
        if key.get_ref().iter().all(|&component| quantity::NUMBER.contains(component)) {
            return Some(vector);
        }
        self.refuse(key, "three finite numbers from -1e12 to 1e12");
        None
    }

    pub fn formula(&self, key: &Key<String>) -> Option<Formula> {
        let key = key.as_ref()?;
        match Formula::parse(key.get_ref()) {
            Ok(formula) => Some(formula),
            Err(e) => {
                self.context.error(self.source.part_of(key, &e.at), e.message);
                None
            }
        }
    }

    pub fn refuse<T>(&self, key: &Spanned<T>, expected: &str) {
        self.context.error(self.source.place(key.span()), format!("expected {expected}"));
    }

    /// The element of a scanner or a platform that a key refers to: by file and id, or by the id of one that ships.
    pub fn reference(&self, name: &Spanned<String>, kind: &str) -> Option<Element> {
        let text = near(self.source, name.get_ref());
        find_asset(self.context, kind, &text, self.source.folder(), Some(self.source.place(name.span())))
    }

    pub fn pose(&self, keys: &PoseKeys) -> Mount {
        let mut mount = Mount::IDENTITY;
        if let Some(offset) = self.vector(&keys.offset_m) {
            mount.offset = offset;
        }
        for turn in &keys.rotate_deg {
            let axes = turn.get_ref();
            let rotation = match (axes.x, axes.y, axes.z) {
                (Some(x), None, None) if quantity::NUMBER.contains(x) => Rotation::about_x(radians(x)),
                (None, Some(y), None) if quantity::NUMBER.contains(y) => Rotation::about_y(radians(y)),
                (None, None, Some(z)) if quantity::NUMBER.contains(z) => Rotation::about_z(radians(z)),
                _ => {
                    self.refuse(turn, "one finite angle about one axis, such as { x = -90 }");
                    continue;
                }
            };
            mount.rotation =
                if keys.local { mount.rotation.after(rotation) } else { rotation.after(mount.rotation) };
        }
        mount
    }
}
