//! Reflection of surfaces (spec pulse-physics §3.2).

use super::optics::Optics;
use std::f64::consts::PI;
use std::fmt;
use vlscan_base::corrections::Corrections;

/// Name of the material of faces without one; no file can redefine it.
pub(super) const DEFAULT: &str = "default";

/// A material with its reflectance at the scanner's wavelength.
#[derive(Clone, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Material {
    /// Name; for materials of MTL files the name after `newmtl`.
    pub name: String,
    /// ρ as used in the energy computation: `helios_reflectance` verbatim, otherwise that of the spectrum,
    /// otherwise one half; spectra and the half are in per cent unless [`Corrections::reflectance_fraction`]
    /// is set.
    pub reflectance: f64,
    /// ρ at further wavelengths
    /// ([`LoadOptions::further_wavelengths_nm`](crate::LoadOptions::further_wavelengths_nm)); empty if it is
    /// the same at all.
    pub further_reflectances: Vec<f64>,
    /// Angular law of the reflection.
    pub reflection: Reflection,
    /// Point class of its returns.
    pub classification: i32,
    /// True if legs and parts may be placed on it.
    pub is_ground: bool,
    /// Size of the elements of foliage that intercept light as a whole, m; 0: leaves are much smaller than
    /// footprints.
    pub element_size: f64,
    /// True for leaves; `None` if the definition does not state it.
    pub leaf: Option<bool>,
    /// Mirror or pane that the surface is. Packs store it apart, so that those of opaque scenes keep their
    /// bytes.
    #[serde(skip)]
    pub optics: Option<Optics>,
}

impl fmt::Debug for Material {
    /// Checksums of scenes include this text, so opaque materials have no field `optics`.
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        // Checksums would miss a field that is not named.
        let Material {
            name,
            reflectance,
            further_reflectances,
            reflection,
            classification,
            is_ground,
            element_size,
            leaf,
            optics,
        } = self;
        let mut fields = f.debug_struct("Material");
        fields
            .field("name", name)
            .field("reflectance", reflectance)
            .field("further_reflectances", further_reflectances)
            .field("reflection", reflection)
            .field("classification", classification)
            .field("is_ground", is_ground)
            .field("element_size", element_size)
            .field("leaf", leaf);
        if let Some(optics) = optics {
            fields.field("optics", optics);
        }
        fields.finish()
    }
}

/// Angular law of the reflection back to the source: f(θ) = π·BRDF·cos θ.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub enum Reflection {
    /// ρ at any angle (neither Kd nor Ks).
    Uniform,
    /// ρ·cos θ (Kd only).
    Lambert,
    /// ρ·[(1−s) + s·|cos 2θ|^N / cos θ]·cos θ (Kd and Ks), the law of the reference.
    Phong {
        /// Specular share s, 0–1.
        specularity: f64,
        /// Exponent N.
        exponent: f64,
    },
    /// ρ·[(1−s)·(A + B·sin θ·tan θ) + s·(N+2)/2·max(0, cos 2θ)^N]·cos θ.
    ///
    /// The first term is the qualitative model of Oren and Nayar (1994) for light that returns to its source
    /// (both polar angles are θ, the azimuths are equal); without roughness it is Lambert's law. The second
    /// is the modified Phong lobe of Lafortune and Willems (1994), which reflects at most s·ρ: the mirror
    /// direction is 2θ away from the source, and beyond 45° the lobe does not return any light.
    Lobes {
        /// Specular share s, 0–1.
        specularity: f64,
        /// Exponent N.
        exponent: f64,
        /// Standard deviation σ of the slopes of the facets, rad: A = 1 − σ²/2/(σ² + 0.33), B = 0.45·σ²/(σ² +
        /// 0.09).
        roughness: f64,
    },
    /// π·R_A / cos θ, whatever ρ: a retro-reflecting sheet, whose intensity per illuminance E and area is
    /// R_A. The light that it receives is E·area·cos θ (CIE 17-24-103).
    Retro {
        /// Coefficient R_A, cd/(lx·m²).
        coefficient: f64,
    },
}

/// Minimum cosine of the incidence on a retro-reflector.
const MIN_RETRO_COSINE: f64 = 1e-3;

/// Words in the names of leaves, in lower case. The umlaut may be two characters.
const LEAF_WORDS: [&str; 10] =
    ["leaf", "leaves", "needle", "foliage", "laub", "blatt", "blätt", "bla\u{308}tt", "blaett", "nadel"];
/// Words in the names of wood and bare crowns that may contain a leaf word: `Laubbaum_Stamm`.
const WOOD_WORDS: [&str; 13] = [
    "bark", "trunk", "stamm", "rinde", "borke", "holz", "branch", "twig", "zweig", "leafless", "leaf-off",
    "laublos", "blattlos",
];
/// The same, but only as words by themselves: names of trees and others contain them (`dogwood_leaf`).
const WHOLE_WOOD_WORDS: [&str; 4] = ["wood", "woods", "stem", "stems"];

/// Mean of cos θ over uniformly distributed leaf normals, weighted by projected area: 1/3 over 1/2.
pub const SPHERICAL_MEAN_COSINE: f64 = 2.0 / 3.0;

impl Material {
    /// A material without a definition: reflectance one half, uniform or Lambertian according to the rules.
    pub fn unnamed(name: &str, rules: Corrections) -> Material {
        Material {
            name: name.to_owned(),
            reflectance: if rules.reflectance_fraction { 0.5 } else { 50.0 },
            further_reflectances: Vec::new(),
            reflection: if rules.lambert_default { Reflection::Lambert } else { Reflection::Uniform },
            classification: 0,
            is_ground: false,
            element_size: 0.0,
            leaf: None,
            optics: None,
        }
    }

    /// True if triangles of this material are leaves: by its definition, else by an English or German word in
    /// its name. `None` if neither shows it.
    pub fn is_leaf(&self) -> Option<bool> {
        self.leaf.or_else(|| has_leaf_word(&self.name).then_some(true))
    }

    /// ρ at a wavelength by its number: 0 for the first, from 1 for the further ones.
    pub fn reflectance_at(&self, wavelength: usize) -> f64 {
        let further = wavelength.checked_sub(1).and_then(|further| self.further_reflectances.get(further));
        further.copied().unwrap_or(self.reflectance)
    }

    /// Reflectance factor f(θ) for the cosine of the incidence angle, `0 ≤ cos θ ≤ 1`, at a wavelength by its
    /// number.
    pub fn factor(&self, wavelength: usize, cosine: f64) -> f64 {
        let reflectance = self.reflectance_at(wavelength);
        match self.reflection {
            Reflection::Uniform => reflectance,
            Reflection::Lambert => reflectance * cosine,
            Reflection::Phong { specularity: s, exponent } => {
                let lobe = libm::pow((2.0 * cosine * cosine - 1.0).abs(), exponent);
                // cos θ cancels, so the result is finite at grazing incidence.
                reflectance * ((1.0 - s) * cosine + s * lobe)
            }
            Reflection::Lobes { specularity: s, exponent, roughness } => {
                let (a, b) = oren_nayar(roughness);
                let square = cosine * cosine;
                let diffuse = a * cosine + b * (1.0 - square);
                let off_mirror = 2.0 * square - 1.0;
                let lobe = if s > 0.0 && off_mirror > 0.0 {
                    (0.5 * exponent + 1.0) * libm::pow(off_mirror, exponent) * cosine
                } else {
                    0.0
                };
                reflectance * ((1.0 - s) * diffuse + s * lobe)
            }
            Reflection::Retro { coefficient } => PI * coefficient / cosine.max(MIN_RETRO_COSINE),
        }
    }

    /// Mean reflectance factor of the leaves that a ray hits in foliage, weighted by their projection, at a
    /// wavelength by its number; `mean_cosine` is the mean of cos θ over them.
    ///
    /// Exact for Lambert's law with any leaf angles, and for all laws with uniformly distributed leaf
    /// normals, where the density of cos θ is 2 cos θ. For other angles, other laws are scaled like
    /// Lambert's.
    pub fn leaf_factor(&self, wavelength: usize, mean_cosine: f64) -> f64 {
        let reflectance = self.reflectance_at(wavelength);
        let relative = mean_cosine / SPHERICAL_MEAN_COSINE;
        match self.reflection {
            Reflection::Uniform => reflectance,
            Reflection::Lambert => reflectance * mean_cosine,
            Reflection::Phong { .. } | Reflection::Retro { .. } => self.factor(wavelength, mean_cosine),
            Reflection::Lobes { specularity: s, exponent, roughness } => {
                let (a, b) = oren_nayar(roughness);
                let diffuse = a * SPHERICAL_MEAN_COSINE + b * 0.5;
                let lobe = if s > 0.0 { mean_lobe(exponent) } else { 0.0 };
                reflectance * ((1.0 - s) * diffuse + s * lobe) * relative
            }
        }
    }
}

/// True if a name is that of leaves, by an English or German word in it.
pub(super) fn has_leaf_word(name: &str) -> bool {
    let name = name.to_lowercase();
    let has = |words: &[&str]| words.iter().any(|word| name.contains(word));
    let is_whole = |word: &str| WHOLE_WOOD_WORDS.contains(&word);
    let is_wood = has(&WOOD_WORDS) || name.split(|c: char| !c.is_alphanumeric()).any(is_whole);
    has(&LEAF_WORDS) && !is_wood
}

/// Coefficients A and B of Oren and Nayar's qualitative model for a roughness in rad.
fn oren_nayar(roughness: f64) -> (f64, f64) {
    let square = roughness * roughness;
    (1.0 - 0.5 * square / (square + 0.33), 0.45 * square / (square + 0.09))
}

/// Mean of the lobe (N+2)/2·cos^N(2θ)·cos θ over cos θ with the density 2 cos θ.
///
/// With u = cos 2θ it is (N+2)/4·∫₀¹ u^N·√((1+u)/2) du, and with v = u^(N+1) an integral of a smooth
/// function, evaluated by five-point Gauss-Legendre quadrature. For sharp lobes it tends to 1/4: specular
/// leaves scatter like a specular sphere.
fn mean_lobe(exponent: f64) -> f64 {
    const RULE: [(f64, f64); 5] = [
        (0.046910077030668, 0.118463442528095),
        (0.230765344947158, 0.239314335249683),
        (0.5, 0.284444444444444),
        (0.769234655052842, 0.239314335249683),
        (0.953089922969332, 0.118463442528095),
    ];
    let root = |v: f64| (0.5 + 0.5 * libm::pow(v, 1.0 / (exponent + 1.0))).sqrt();
    let mean: f64 = RULE.iter().map(|(v, weight)| weight * root(*v)).sum();
    0.25 * (exponent + 2.0) / (exponent + 1.0) * mean
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::FRAC_PI_2;

    fn with(reflection: Reflection) -> Material {
        Material { reflectance: 0.5, reflection, ..Material::unnamed("m", Corrections::NONE) }
    }

    fn lobes(specularity: f64, exponent: f64, degrees: f64) -> Material {
        with(Reflection::Lobes { specularity, exponent, roughness: degrees.to_radians() })
    }

    #[test]
    fn leaves_are_known_by_a_key_or_a_name() {
        let named = |name: &str| Material::unnamed(name, Corrections::NONE).is_leaf();
        for leaf in [
            "oak_leaves",
            "LEAF",
            "Fir needles",
            "foliage.001",
            "Laub",
            "Belaubung",
            "Blatt",
            "Blätter",
            "Bla\u{308}tter",
            "BLAETTER",
            "Nadeln",
            "cottonwood_leaf",
            "Dogwood leaves",
            "leaf_system",
        ] {
            assert_eq!(named(leaf), Some(true), "{leaf}");
        }
        for other in [
            "bark",
            "wall",
            "m_7",
            "Laubbaum_Stamm",
            "Nadelholz",
            "leafless crown",
            "Rinde",
            "Leaf_Stem",
            "leaf wood",
        ] {
            assert_eq!(named(other), None, "{other}");
        }
        let stated =
            |name: &str, leaf| Material { leaf: Some(leaf), ..Material::unnamed(name, Corrections::NONE) };
        assert_eq!(stated("m_7", true).is_leaf(), Some(true));
        assert_eq!(stated("leaves", false).is_leaf(), Some(false));
    }

    #[test]
    fn factors_of_the_worked_example() {
        // spec pulse-physics §3.6: ρ = 0.5 at 30° and 60°
        let (c30, c60) = (3f64.sqrt() / 2.0, 0.5);
        let phong = with(Reflection::Phong { specularity: 0.5, exponent: 10.0 });
        assert!((with(Reflection::Lambert).factor(0, c30) - 0.433012702).abs() < 1e-9);
        assert!((phong.factor(0, c30) - 0.216750492).abs() < 1e-9);
        assert!((phong.factor(0, c60) - 0.125244141).abs() < 1e-9);
        assert_eq!(with(Reflection::Uniform).factor(0, c60), 0.5);
    }

    #[test]
    fn retro_reflectors_have_the_factors_of_their_classes() {
        let at = |coefficient: f64, degrees: f64| {
            with(Reflection::Retro { coefficient }).factor(0, libm::cos(degrees.to_radians()))
        };
        for (coefficient, degrees, expected) in [
            (180.0, 0.0, 565.4867),
            (180.0, 5.0, 567.6467),
            (70.0, 0.0, 219.9115),
            (250.0, 0.0, 785.3982),
            (330.0, 0.0, 1036.7256),
        ] {
            let found = at(coefficient, degrees);
            assert!((found - expected).abs() < 1e-4, "{coefficient} at {degrees}°: {found}");
        }
        assert!(at(180.0, 90.0).is_finite());
    }

    #[test]
    fn the_text_of_opaque_materials_has_no_optics() {
        use crate::optics::{Optics, OpticsKind};
        let opaque = Material::unnamed("m", Corrections::NONE);
        assert!(!format!("{opaque:?}").contains("optics"));
        let optics = Optics { kind: OpticsKind::Mirror { reflectance: 1.0 }, share: 1.0, roughness: 0.0 };
        assert!(format!("{:?}", Material { optics: Some(optics), ..opaque }).contains("Mirror"));
    }

    #[test]
    fn a_lobe_is_brightest_when_faced_and_ends_at_45_degrees() {
        let glossy = lobes(0.5, 10.0, 0.0);
        // 0.5·(0.5 + 0.5·12/2)
        assert!((glossy.factor(0, 1.0) - 1.75).abs() < 1e-15);
        // cos 60° = 1/2 between mirror direction and source at 30°
        let c30 = 3f64.sqrt() / 2.0;
        assert!((glossy.factor(0, c30) - 0.5 * c30 * (0.5 + 3.0 / 1024.0)).abs() < 1e-15);
        for degrees in [45.1f64, 60.0, 80.0, 89.0] {
            let cosine = degrees.to_radians().cos();
            assert!(
                (glossy.factor(0, cosine) - 0.25 * cosine).abs() < 1e-15,
                "{degrees}°: the diffuse share alone"
            );
        }
        let matte = lobes(0.0, 10.0, 0.0);
        for cosine in [0.1, 0.5, 1.0] {
            assert_eq!(matte.factor(0, cosine), with(Reflection::Lambert).factor(0, cosine));
        }
    }

    /// Normalisation: light incident along the normal leaves with at most s·ρ, here exactly s·ρ.
    #[test]
    fn a_faced_lobe_sends_back_its_share_and_no_more() {
        for exponent in [0.0, 1.0, 10.0, 200.0] {
            // ∫ (n+2)/2π cos^n(α) cos α dω over the hemisphere, α from the normal; and f at normal incidence
            // is π·BRDF
            let peak = lobes(1.0, exponent, 0.0).factor(0, 1.0) / 0.5 / PI;
            let n = 200_000;
            let sum: f64 = (0..n)
                .map(|i| {
                    let alpha = (f64::from(i) + 0.5) / f64::from(n) * FRAC_PI_2;
                    alpha.cos().powf(exponent + 1.0) * alpha.sin()
                })
                .sum();
            let albedo = peak * sum * FRAC_PI_2 / f64::from(n) * 2.0 * PI;
            assert!((albedo - 1.0).abs() < 1e-6, "exponent {exponent}: {albedo}");
        }
    }

    #[test]
    fn rough_surfaces_look_flat() {
        // σ = 30°: A = 1 − σ²/2/(σ² + 0.33) = 0.7732, B = 0.45 σ²/(σ² + 0.09) = 0.3388; at 60° sin·tan = 1.5
        let rough = lobes(0.0, 10.0, 30.0);
        let s2 = (PI / 6.0).powi(2);
        let (a, b) = (1.0 - 0.5 * s2 / (s2 + 0.33), 0.45 * s2 / (s2 + 0.09));
        assert!((a - 0.7731).abs() < 5e-4 && (b - 0.3388).abs() < 5e-4, "{a} {b}");
        assert!((rough.factor(0, 1.0) - 0.5 * a).abs() < 1e-15);
        assert!((rough.factor(0, 0.5) - 0.5 * 0.5 * (a + 1.5 * b)).abs() < 1e-12);
        assert!(
            rough.factor(0, 0.2) > with(Reflection::Lambert).factor(0, 0.2),
            "brighter than Lambert towards the limb"
        );
    }

    #[test]
    fn leaves_reflect_as_the_mean_over_those_that_are_met() {
        for material in
            [lobes(0.0, 10.0, 0.0), lobes(0.0, 10.0, 35.0), lobes(0.4, 10.0, 20.0), lobes(1.0, 300.0, 0.0)]
        {
            let n = 100_000;
            let mean: f64 = (0..n)
                .map(|i| {
                    let cosine = (f64::from(i) + 0.5) / f64::from(n);
                    material.factor(0, cosine) * 2.0 * cosine / f64::from(n)
                })
                .sum();
            let found = material.leaf_factor(0, SPHERICAL_MEAN_COSINE);
            assert!((found / mean - 1.0).abs() < 2e-4, "{material:?}: {found} is not {mean}");
        }
        assert_eq!(with(Reflection::Lambert).leaf_factor(0, 0.9), 0.45);
        assert_eq!(with(Reflection::Uniform).leaf_factor(0, 0.9), 0.5);
    }
}
