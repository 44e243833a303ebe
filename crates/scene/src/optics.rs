//! Surfaces that mirror rays or let them pass.

use vlscan_base::corrections::Corrections;
use vlscan_survey::{MaterialDefinition, OpticsDefinition};

/// Refractive index of panes that state none: window glass.
pub const GLASS_INDEX: f64 = 1.5;
/// Thickness of the sheets of panes that state none, m.
pub const SHEET_THICKNESS: f64 = 0.004;

/// Mirror or pane that a surface is.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Optics {
    /// Behaviour of the light that meets the mirror or pane.
    pub kind: OpticsKind,
    /// Share of the light that meets the mirror or pane; the rest is reflected diffusely or absorbed.
    pub share: f64,
    /// Standard deviation of the slopes of the facets that mirror rays, rad; 0 for polished surfaces.
    pub roughness: f64,
}

/// Kind of an optical surface.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub enum OpticsKind {
    /// Mirrors a share of the light.
    Mirror {
        /// The share, 0 to 1, at any angle.
        reflectance: f64,
    },
    /// Mirrors and transmits light by the formulas of Fresnel.
    Pane {
        /// Refractive index, at least 1.
        index: f64,
        /// Thickness of each sheet, m.
        thickness: f64,
        /// Absorption within the sheets, 1/m.
        absorption: f64,
        /// Number of parallel sheets with air between them, 1 or 2.
        sheets: u32,
    },
}

/// The optical properties of a definition that have an effect under `rules`: those of picture formats only
/// have one in the refined physics, whose specular light leaves in the mirror direction.
pub(super) fn stated(d: &MaterialDefinition, rules: Corrections) -> Option<OpticsDefinition> {
    if d.optics.is_optical() {
        return Some(d.optics);
    }
    let meaning = d.unused_optics.as_ref().and_then(|optics| optics.meaning);
    meaning.filter(|_| rules.specular_lobe && d.optics.retro.is_none())
}

/// True if a definition reflects nothing diffusely unless it has a reflectance: clean mirrors and panes, and
/// retro-reflectors.
pub(super) fn is_diffuse_free(d: &MaterialDefinition, rules: Corrections) -> bool {
    d.optics.retro.is_some() || stated(d, rules).is_some_and(|stated| stated.is_clean())
}

/// Properties of a definition that contradict each other, for a message.
pub(super) fn conflict(d: &OpticsDefinition) -> Option<&'static str> {
    match (d.mirror.is_some(), d.is_pane(), d.retro.is_some()) {
        (true, true, _) => Some("both a mirror and a pane"),
        (true, _, true) => Some("both a mirror and a retro-reflector"),
        (_, true, true) => Some("both a pane and a retro-reflector"),
        _ => None,
    }
}

/// A property beyond its bounds, for a message: definitions that a program makes are not checked before.
pub(super) fn out_of_bounds(d: &OpticsDefinition) -> Option<&'static str> {
    use vlscan_base::quantity::{
        MIRROR, PANE_ABSORPTION, PANE_INDEX, PANE_SHEETS, PANE_THICKNESS, REFLECTANCE, RETRO,
    };
    [
        (d.mirror, MIRROR),
        (d.index, PANE_INDEX),
        (d.thickness, PANE_THICKNESS),
        (d.absorption, PANE_ABSORPTION),
        (d.sheets.map(f64::from), PANE_SHEETS),
        (d.retro, RETRO),
        (d.opacity, REFLECTANCE),
    ]
    .iter()
    .find(|(value, bounds)| value.is_some_and(|value| !bounds.contains(value)))
    .map(|(_, bounds)| bounds.expected)
}

/// The mirror or pane of a definition whose diffuse reflectance is the fraction `reflectance`.
pub(super) fn resolve(d: &OpticsDefinition, roughness: f64, reflectance: f64) -> Optics {
    let kind = match d.mirror {
        Some(reflectance) => OpticsKind::Mirror { reflectance },
        None => OpticsKind::Pane {
            index: d.index.unwrap_or(GLASS_INDEX),
            thickness: d.thickness.unwrap_or(SHEET_THICKNESS),
            absorption: d.absorption.unwrap_or(0.0),
            sheets: d.sheets.unwrap_or(1),
        },
    };
    let share = 1.0 - d.opacity.unwrap_or(reflectance);
    Optics { kind, share: share.clamp(0.0, 1.0), roughness }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn definitions_have_defaults_of_window_glass() {
        let pane = OpticsDefinition { sheets: Some(2), ..OpticsDefinition::default() };
        let kind = OpticsKind::Pane { index: 1.5, thickness: 0.004, absorption: 0.0, sheets: 2 };
        assert_eq!(resolve(&pane, 0.0, 0.1), Optics { kind, share: 0.9, roughness: 0.0 });
        let mirror = OpticsDefinition { mirror: Some(0.8), ..OpticsDefinition::default() };
        let kind = OpticsKind::Mirror { reflectance: 0.8 };
        assert_eq!(resolve(&mirror, 0.1, 0.0), Optics { kind, share: 1.0, roughness: 0.1 });
    }

    #[test]
    fn contradictions_and_values_beyond_their_bounds_are_named() {
        let none = OpticsDefinition::default();
        let both = OpticsDefinition { mirror: Some(0.9), index: Some(1.5), ..none };
        assert_eq!(conflict(&both), Some("both a mirror and a pane"));
        assert_eq!(conflict(&OpticsDefinition { mirror: Some(0.9), ..none }), None);
        for index in [0.0, -1.5, 0.99, f64::NAN, f64::INFINITY] {
            let pane = OpticsDefinition { index: Some(index), ..none };
            assert_eq!(out_of_bounds(&pane), Some("a refractive index from 1 to 5"), "{index}");
        }
        assert_eq!(out_of_bounds(&OpticsDefinition { index: Some(1.0), ..none }), None);
        assert!(out_of_bounds(&OpticsDefinition { sheets: Some(3), ..none }).is_some());
        assert!(out_of_bounds(&OpticsDefinition { mirror: Some(1.1), ..none }).is_some());
    }

    #[test]
    fn properties_of_picture_formats_have_an_effect_in_the_refined_physics_only() {
        let meaning = OpticsDefinition { index: Some(1.4), ..OpticsDefinition::default() };
        let unused = vlscan_survey::UnusedOptics {
            properties: "illum 4".to_owned(),
            place: None,
            meaning: Some(meaning),
        };
        let d = MaterialDefinition { unused_optics: Some(unused), ..MaterialDefinition::new("glass") };
        assert_eq!(stated(&d, Corrections::NONE), None);
        assert_eq!(stated(&d, Corrections::REFINED), Some(meaning));
        let explicit = OpticsDefinition { mirror: Some(1.0), ..OpticsDefinition::default() };
        let d = MaterialDefinition { optics: explicit, ..d };
        assert_eq!(stated(&d, Corrections::NONE), Some(explicit));
    }
}
