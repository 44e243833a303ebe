//! Surfaces that mirror rays or let them pass.

use vlscan_base::corrections::Corrections;
use vlscan_survey::{MaterialDefinition, OpticsDefinition, WaterDefinition};

/// Refractive index of panes that state none: window glass.
pub const GLASS_INDEX: f64 = 1.5;
/// Thickness of the sheets of panes that state none, m.
pub const SHEET_THICKNESS: f64 = 0.004;

/// Mirror, pane or water that a surface is.
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
    /// Mirrors a part of the light; the rest enters the water below.
    Water(Water),
}

/// Water below its surface, for light of the scanner's wavelength.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Water {
    /// Refractive index in air, at least 1.
    pub index: f64,
    /// Group index in vacuum, at least 1: light is slower by that factor.
    pub group_index: f64,
    /// Diffuse attenuation K, 1/m.
    pub attenuation: f64,
    /// Attenuation c of a narrow beam, 1/m, at least K.
    pub beam_attenuation: f64,
    /// Volume scattering function at 180°, 1/(m·sr).
    pub backscatter: f64,
    /// Variances of the slopes of the surface along and across the wind; 0 for flat water.
    pub slopes: [f64; 2],
    /// Direction of the wind: x and y of a unit vector.
    pub wind: [f64; 2],
}

impl Water {
    /// Product of Secchi depth and K that is assumed (Poole and Atkins, 1929).
    pub const SECCHI_PRODUCT: f64 = 1.7;
    /// Attenuation of water that states none, 1/m: a clear lake.
    pub const ATTENUATION: f64 = 0.1;
    /// Backscatter of water that states none, 1/(m·sr): pure fresh water of 20 °C at 532 nm (Buiteveld et
    /// al., 1994).
    pub const BACKSCATTER: f64 = 1.895220e-4;
    /// Wind speed over water that states none, m/s.
    pub const WIND: f64 = 5.0;
    /// Group index of fresh water of 20 °C at 532 nm in vacuum, less its refractive index in air.
    pub const DISPERSION: f64 = 0.021919;

    /// The water of a definition.
    fn resolve(d: &WaterDefinition) -> Water {
        let index = d.index.unwrap_or(WaterDefinition::FRESH_INDEX);
        let by_secchi = d.secchi.map(|depth| Water::SECCHI_PRODUCT / depth);
        let attenuation = d.attenuation.or(by_secchi).unwrap_or(Water::ATTENUATION);
        let wind = d.wind.unwrap_or(Water::WIND);
        let direction = d.wind_direction.unwrap_or(0.0).to_radians();
        Water {
            index,
            group_index: d.group_index.unwrap_or(index + Water::DISPERSION),
            attenuation,
            beam_attenuation: d.beam_attenuation.unwrap_or(attenuation).max(attenuation),
            backscatter: d.backscatter.unwrap_or(Water::BACKSCATTER),
            slopes: wave_slopes(wind, d.wind_direction.is_some()),
            wind: [libm::sin(direction), libm::cos(direction)],
        }
    }
}

/// Variances of the slopes of a clean sea along and across a wind (Cox and Munk, 1954), or half of their sum
/// if its direction is unknown. Without wind the water is flat.
fn wave_slopes(wind: f64, has_direction: bool) -> [f64; 2] {
    match has_direction {
        _ if wind == 0.0 => [0.0; 2],
        true => [0.00316 * wind, 0.003 + 0.00192 * wind],
        false => [0.5 * (0.003 + 0.00512 * wind); 2],
    }
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
    if d.water.is_water() {
        return match (d.mirror.is_some(), d.is_pane(), d.retro.is_some()) {
            (true, ..) => Some("both a mirror and water"),
            (_, true, _) => Some("both a pane and water"),
            (.., true) => Some("both a retro-reflector and water"),
            _ if d.water.attenuation.is_some() && d.water.secchi.is_some() => {
                Some("water with both an attenuation and a Secchi depth")
            }
            _ => None,
        };
    }
    match (d.mirror.is_some(), d.is_pane(), d.retro.is_some()) {
        (true, true, _) => Some("both a mirror and a pane"),
        (true, _, true) => Some("both a mirror and a retro-reflector"),
        (_, true, true) => Some("both a pane and a retro-reflector"),
        _ => None,
    }
}

/// A property beyond its bounds.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("its {key} is {value}, expected {expected}")]
pub(super) struct OutOfBounds {
    /// Key in pipeline files and Python; those of MTL files begin with `vlscan_`.
    key: &'static str,
    value: f64,
    expected: String,
}

/// A property beyond its bounds, for a message: definitions that a program makes are not checked before.
pub(super) fn out_of_bounds(d: &OpticsDefinition) -> Option<OutOfBounds> {
    use vlscan_base::quantity::{
        MIRROR, PANE_ABSORPTION, PANE_INDEX, PANE_SHEETS, PANE_THICKNESS, REFLECTANCE, RETRO, SECCHI_DEPTH,
        WATER_ATTENUATION, WATER_BACKSCATTER, WIND_DIRECTION, WIND_SPEED, number,
    };
    let w = &d.water;
    let all = [
        ("mirror", d.mirror, MIRROR),
        ("pane_index", d.index, PANE_INDEX),
        ("pane_thickness_m", d.thickness, PANE_THICKNESS),
        ("pane_absorption", d.absorption, PANE_ABSORPTION),
        ("pane_sheets", d.sheets.map(f64::from), PANE_SHEETS),
        ("retro", d.retro, RETRO),
        ("opacity", d.opacity, REFLECTANCE),
        ("water_index", w.index, PANE_INDEX),
        ("water_group_index", w.group_index, PANE_INDEX),
        ("water_attenuation", w.attenuation, WATER_ATTENUATION),
        ("water_secchi_m", w.secchi, SECCHI_DEPTH),
        ("water_beam_attenuation", w.beam_attenuation, WATER_ATTENUATION),
        ("water_backscatter", w.backscatter, WATER_BACKSCATTER),
        ("water_wind_m_s", w.wind, WIND_SPEED),
        ("water_wind_deg", w.wind_direction, WIND_DIRECTION),
    ];
    for (key, value, bounds) in all {
        if let Some(value) = value.filter(|value| !bounds.contains(*value)) {
            return Some(OutOfBounds { key, value, expected: bounds.expected.to_owned() });
        }
    }
    let stated = w.attenuation.or(w.secchi.map(|depth| Water::SECCHI_PRODUCT / depth));
    let diffuse = stated.unwrap_or(Water::ATTENUATION);
    w.beam_attenuation.filter(|beam| *beam < diffuse).map(|value| OutOfBounds {
        key: "water_beam_attenuation",
        value,
        expected: format!(
            "a beam attenuation of at least the diffuse attenuation, {} per metre",
            number(diffuse)
        ),
    })
}

/// The mirror, pane or water of a definition whose diffuse reflectance is the fraction `reflectance`.
pub(super) fn resolve(d: &OpticsDefinition, roughness: f64, reflectance: f64) -> Optics {
    let kind = match d.mirror {
        Some(reflectance) => OpticsKind::Mirror { reflectance },
        None if d.water.is_water() => OpticsKind::Water(Water::resolve(&d.water)),
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
    fn water_has_the_defaults_of_a_clear_lake_in_a_breeze() {
        let of = |water: WaterDefinition| {
            let d = OpticsDefinition { water, ..OpticsDefinition::default() };
            let OpticsKind::Water(water) = resolve(&d, 0.0, 0.0).kind else { panic!("{d:?}") };
            water
        };
        let none = WaterDefinition::default();
        let water = of(WaterDefinition { index: Some(1.34), ..none });
        assert_eq!((water.attenuation, water.beam_attenuation), (0.1, 0.1));
        assert!((water.group_index - 1.361919).abs() < 1e-12 && water.slopes[0] == water.slopes[1]);
        assert!((water.slopes[0] + water.slopes[1] - 0.0286).abs() < 1e-15);
        let water = of(WaterDefinition { secchi: Some(3.4), wind: Some(0.0), ..none });
        assert_eq!((water.attenuation, water.slopes), (0.5, [0.0; 2]));
        assert!((water.index - 1.335035).abs() < 1e-12 && (water.group_index - 1.356954).abs() < 1e-12);
        let water = of(WaterDefinition { wind: Some(5.0), wind_direction: Some(90.0), ..none });
        assert!((water.slopes[0] - 0.0158).abs() < 1e-15 && (water.slopes[1] - 0.0126).abs() < 1e-15);
        assert!(water.wind[0] == 1.0 && water.wind[1].abs() < 1e-15);
    }

    /// Refractive index of water in air (Quan and Fry, 1995), by wavelength, temperature and salinity.
    fn index_in_air(nm: f64, celsius: f64, salinity: f64) -> f64 {
        1.31405 + (1.779e-4 - 1.05e-6 * celsius + 1.6e-8 * celsius * celsius) * salinity
            - 2.02e-6 * celsius * celsius
            + (15.868 + 0.01155 * salinity - 0.00423 * celsius) / nm
            - 4382.0 / (nm * nm)
            + 1.1455e6 / (nm * nm * nm)
    }

    /// Group index in vacuum, with the air of Ciddor (1996).
    fn group_index(nm: f64, celsius: f64, salinity: f64) -> f64 {
        let air = |nm: f64| {
            let square = (1e3 / nm).powi(2);
            1.0 + 1e-8 * (5_792_105.0 / (238.0185 - square) + 167_917.0 / (57.362 - square))
        };
        let index = |nm: f64| index_in_air(nm, celsius, salinity) * air(nm);
        index(nm) - nm * (index(nm + 1e-3) - index(nm - 1e-3)) / 2e-3
    }

    #[test]
    fn the_defaults_are_pure_water_of_20_degrees_at_532_nm() {
        for (celsius, salinity, index, group) in [
            (20.0, 0.0, 1.335035, 1.356954),
            (20.0, 35.0, 1.341510, 1.364191),
            (0.0, 35.0, 1.342988, 1.365829),
        ] {
            let found = (index_in_air(532.0, celsius, salinity), group_index(532.0, celsius, salinity));
            assert!((found.0 - index).abs() < 1e-6 && (found.1 - group).abs() < 1e-6, "{found:?}");
        }
        let fresh = Water::resolve(&WaterDefinition::default());
        assert!((fresh.index - 1.335035).abs() < 1e-6 && (fresh.group_index - 1.356954).abs() < 1e-6);
        // The group index of the sea by the same dispersion is within 1 mm per metre.
        let sea = Water::resolve(&WaterDefinition { index: Some(1.341510), ..WaterDefinition::default() });
        assert!((sea.group_index - 1.364191).abs() < 1e-3, "{}", sea.group_index);
    }

    #[test]
    fn the_default_backscatter_is_that_of_molecules() {
        // Buiteveld et al. (1994) at 532 nm and 20 °C; compressibility in 1e-10/Pa, depolarisation 0.051.
        let (nm, celsius, depolarisation) = (532.0f64, 20.0, 0.051);
        let index = 1.3247 + 3.3e3 / nm.powi(2) - 3.2e7 / nm.powi(4) - 2.5e-6 * celsius * celsius;
        let compressibility = (5.062271 - 0.03179 * celsius + 0.000407 * celsius * celsius) * 1e-10;
        let by_pressure = (-0.000156 * nm + 1.5989) * (1.61857 - 0.005785 * celsius) / 1.5014 * 1e-10;
        let density = 2.0 * std::f64::consts::PI.powi(2) * 1.38054e-23 * (273.0 + celsius)
            / (nm * 1e-9).powi(4)
            / compressibility;
        let cabannes = (6.0 + 6.0 * depolarisation) / (6.0 - 7.0 * depolarisation);
        let aside = density * index * index * by_pressure * by_pressure * cabannes;
        let back = aside * (1.0 + (1.0 - depolarisation) / (1.0 + depolarisation));
        assert!((back / 1.895220e-4 - 1.0).abs() < 1e-6, "{back:e}");
        assert!((back / Water::BACKSCATTER - 1.0).abs() < 1e-6);
        let salt = 1.0 + 0.3 * 35.0 / 37.0;
        assert!((back * salt / 2.433053e-4 - 1.0).abs() < 1e-6);
        let total =
            8.0 * std::f64::consts::PI / 3.0 * aside * (2.0 + depolarisation) / (1.0 + depolarisation);
        assert!((total / 1.628223e-3 - 1.0).abs() < 1e-6 && (total * salt / 2.090287e-3 - 1.0).abs() < 1e-6);
    }

    /// The message about a property beyond its bounds; empty if there is none.
    fn said(d: &OpticsDefinition) -> String {
        out_of_bounds(d).map_or(String::new(), |wrong| wrong.to_string())
    }

    #[test]
    fn impossible_water_is_named() {
        let of = |water: WaterDefinition| OpticsDefinition { water, ..OpticsDefinition::default() };
        let none = WaterDefinition::default();
        let expected = "a refractive index from 1 to 5";
        for wrong in [0.0, -1.3, 0.99, f64::NAN, f64::INFINITY] {
            let water = of(WaterDefinition { index: Some(wrong), ..none });
            assert_eq!(said(&water), format!("its water_index is {wrong}, expected {expected}"));
            let water = of(WaterDefinition { group_index: Some(wrong), ..none });
            assert_eq!(said(&water), format!("its water_group_index is {wrong}, expected {expected}"));
        }
        for wrong in [-0.1, f64::NAN, f64::INFINITY] {
            for water in [
                WaterDefinition { attenuation: Some(wrong), ..none },
                WaterDefinition { secchi: Some(wrong), ..none },
                WaterDefinition { beam_attenuation: Some(wrong), ..none },
                WaterDefinition { backscatter: Some(wrong), ..none },
                WaterDefinition { wind: Some(wrong), ..none },
                WaterDefinition { wind_direction: Some(1e3 + wrong), ..none },
            ] {
                assert!(out_of_bounds(&of(water)).is_some(), "{water:?}");
            }
        }
        let narrow = of(WaterDefinition { attenuation: Some(0.5), beam_attenuation: Some(0.4), ..none });
        let expected = "its water_beam_attenuation is 0.4, expected a beam attenuation of at least the diffuse \
                        attenuation, 0.5 per metre";
        assert_eq!(said(&narrow), expected);
        let both = of(WaterDefinition { attenuation: Some(0.5), secchi: Some(3.0), ..none });
        assert_eq!(conflict(&both), Some("water with both an attenuation and a Secchi depth"));
        let both = OpticsDefinition { mirror: Some(1.0), ..of(WaterDefinition { wind: Some(1.0), ..none }) };
        assert_eq!(conflict(&both), Some("both a mirror and water"));
    }

    #[test]
    fn contradictions_and_values_beyond_their_bounds_are_named() {
        let none = OpticsDefinition::default();
        let both = OpticsDefinition { mirror: Some(0.9), index: Some(1.5), ..none };
        assert_eq!(conflict(&both), Some("both a mirror and a pane"));
        assert_eq!(conflict(&OpticsDefinition { mirror: Some(0.9), ..none }), None);
        for index in [0.0, -1.5, 0.99, f64::NAN, f64::INFINITY] {
            let pane = OpticsDefinition { index: Some(index), ..none };
            let expected = format!("its pane_index is {index}, expected a refractive index from 1 to 5");
            assert_eq!(said(&pane), expected);
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
