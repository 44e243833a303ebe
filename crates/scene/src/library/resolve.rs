//! Resolves one definition to a material: its reflectances, its angular law and its optics.

use super::Library;
use crate::material::{Material, Reflection};
use crate::optics;
use crate::reflectance_issues::{ReflectanceIssue, assumed};
use crate::reflectance_units::MAX_FRACTION;
use vlscan_base::corrections::Corrections;
use vlscan_base::diag::Diagnostics;
use vlscan_base::quantity::CLASSES;
use vlscan_survey::{MaterialDefinition, OpticsDefinition, UnusedOptics};

impl Library {
    /// The material of a definition. `is_last` is true for the last definition of its file.
    pub(super) fn resolve(
        &mut self,
        d: &MaterialDefinition,
        is_last: bool,
        diagnostics: &mut Diagnostics,
    ) -> Material {
        if let (Some(_), Some(spectrum)) = (d.reflectance, &d.spectrum) {
            let message = format!(
                "material \"{}\" has a reflectance, which is used, and a spectrum, {spectrum}",
                d.name
            );
            diagnostics.warn(d.place.clone(), message);
        }
        let stated = self.optics(d, diagnostics);
        warn_of_unused(d, stated, diagnostics);
        let spectrum = self.spectrum_of(d, diagnostics);
        let (reflectance, further) = self.reflectances(d, stated, spectrum.as_deref());
        if is_specular_only(d) {
            let message =
                format!("material \"{}\" has Ks but no Kd; it reflects by its specular share alone", d.name);
            diagnostics.warn(d.place.clone(), message);
        }
        let (has_kd, has_ks) = (d.kd != [0.0; 3], d.ks != [0.0; 3]);
        self.relevant_rules = self.relevant_rules.or(Corrections {
            specular_shares: has_kd && has_ks,
            reflectance_fraction: d.reflectance.is_none_or(|r| r > 1.0),
            specular_lobe: has_ks && d.roughness == 0.0,
            lambert_default: !has_kd && !has_ks,
            ..Corrections::NONE
        });
        let has_share = self.rules.specular_shares || is_last || spectrum.is_some();
        let opaque = stated.and_then(|stated| stated.opacity).unwrap_or(1.0);
        // The reference's physics keeps per cent.
        let is_per_cent =
            !self.rules.reflectance_fraction && (spectrum.is_some() || reflectance > MAX_FRACTION);
        let diffuse = if is_per_cent { reflectance / 100.0 } else { reflectance };
        Material {
            name: d.name.clone(),
            reflectance: (reflectance * opaque).max(0.0),
            further_reflectances: further.into_iter().map(|further| (further * opaque).max(0.0)).collect(),
            reflection: reflection(d, has_share, self.rules),
            classification: d.classification,
            is_ground: d.is_ground,
            element_size: d.element_size,
            leaf: d.leaf,
            optics: stated.map(|stated| optics::resolve(&stated, d.roughness, diffuse)),
        }
    }

    /// The mirror or pane that a definition states. Records values that cannot be.
    fn optics(&mut self, d: &MaterialDefinition, diagnostics: &mut Diagnostics) -> Option<OpticsDefinition> {
        if let Some(both) = optics::conflict(&d.optics) {
            let message = format!("material \"{}\" is {both}", d.name);
            diagnostics.error(d.place.clone(), message).help("give it the properties of one of them");
        }
        if let Some(wrong) = optics::out_of_bounds(&d.optics) {
            let message = format!("material \"{}\": {wrong}", d.name);
            diagnostics.error(d.place.clone(), message);
        }
        let has_meaning = d.unused_optics.as_ref().is_some_and(|optics| optics.meaning.is_some());
        self.relevant_rules.specular_lobe |= has_meaning;
        optics::stated(d, self.rules)
    }

    /// Reflectances of the definition's spectrum at the wavelengths, in per cent. `None` if the definition
    /// has a reflectance, or no spectrum that can be read. Records definitions that have neither.
    fn spectrum_of(&mut self, d: &MaterialDefinition, diagnostics: &mut Diagnostics) -> Option<Vec<f64>> {
        if d.reflectance.is_some() {
            return None;
        }
        let Some(name) = &d.spectrum else {
            // Readers of mesh files report materials without a line.
            if d.has_line() && !optics::is_diffuse_free(d, self.rules) {
                self.add_issue(ReflectanceIssue::Missing, d);
            }
            return None;
        };
        let found = self.spectra.reflectances(name, d.place.as_ref(), diagnostics);
        if found.is_none() {
            let assumed = assumed(self.rules);
            let message =
                format!("no spectrum \"{name}\" for material \"{}\"; it reflects {assumed}", d.name);
            diagnostics.warn(d.place.clone(), message).help(self.spectra.described());
        }
        found
    }

    /// The reflectances at the first wavelength and at the others: fractions, or per cent where the physics
    /// of the reference keeps it. `spectrum` is in per cent. Records values that are not fractions.
    fn reflectances(
        &mut self,
        d: &MaterialDefinition,
        stated: Option<OpticsDefinition>,
        spectrum: Option<&[f64]>,
    ) -> (f64, Vec<f64>) {
        let is_fraction = self.rules.reflectance_fraction;
        let per_unit = |per_cent: f64| if is_fraction { per_cent / 100.0 } else { per_cent };
        let reflectance = match d.reflectance {
            Some(per_cent) if is_fraction && per_cent > MAX_FRACTION => {
                self.add_issue(ReflectanceIssue::PerCent, d);
                per_cent / 100.0
            }
            Some(fraction) => fraction,
            None if stated.is_some_and(|stated| stated.is_clean()) && spectrum.is_none() => 0.0,
            None => per_unit(spectrum.map_or(50.0, |at| at[0])),
        };
        let further: Vec<f64> =
            spectrum.into_iter().flat_map(|at| &at[1..]).map(|at| per_unit(*at)).collect();
        // Spectra and the default of 50 are per cent, but fractions in the refined physics.
        if let Some(given) = d.reflectance.or((!is_fraction).then_some(reflectance)) {
            self.units.add(self.materials.len() as u32, &d.name, given, || d.place.clone());
        }
        if is_fraction && further.iter().chain([&reflectance]).any(|r| !(0.0..=1.0).contains(r)) {
            self.add_issue(ReflectanceIssue::NoFraction, d);
        }
        (reflectance, further)
    }

    /// Records an issue of a material that a file defines.
    fn add_issue(&mut self, issue: ReflectanceIssue, d: &MaterialDefinition) {
        if let Some(place) = &d.place {
            self.issues.add(issue, &d.name, place.clone());
        }
    }
}

/// Warns of optics that are not simulated, and of classes that LAS cannot hold.
fn warn_of_unused(d: &MaterialDefinition, stated: Option<OpticsDefinition>, diagnostics: &mut Diagnostics) {
    if let Some(UnusedOptics { properties, place, .. }) = &d.unused_optics
        && stated.is_none()
    {
        let message = format!(
            "material \"{}\" is opaque: transparency and mirror reflection are not simulated ({properties})",
            d.name
        );
        diagnostics.warn(place.clone().or(d.place.clone()), message).help(
            "delete its faces if beams should pass through them; `d 1` and `illum 2` in an MTL file, or \
             alphaMode OPAQUE in a glTF file, confirm that it is opaque",
        );
    }
    // Definitions with a line have been checked where they were read.
    if !d.has_line() && !CLASSES.contains(&d.classification) {
        let message = format!(
            "material \"{}\" has the class {}, which is written as 0 in LAS and LAZ: they have classes 0 to \
             255",
            d.name, d.classification
        );
        diagnostics.warn(d.place.clone(), message);
    }
}

fn is_specular_only(d: &MaterialDefinition) -> bool {
    d.kd == [0.0; 3] && d.ks != [0.0; 3]
}

/// The angular law; without `has_share` the specular share remains 0, as in the reference for most materials.
pub(super) fn reflection(d: &MaterialDefinition, has_share: bool, rules: Corrections) -> Reflection {
    if let Some(coefficient) = d.optics.retro {
        return Reflection::Retro { coefficient };
    }
    let (kd, ks): (f64, f64) = (d.kd.iter().sum(), d.ks.iter().sum());
    let (has_kd, has_ks) = (d.kd != [0.0; 3], d.ks != [0.0; 3]);
    let specularity = match (has_kd, has_ks) {
        (_, false) => 0.0,
        (false, true) => 1.0,
        (true, true) if has_share => ks / (ks + kd),
        (true, true) => 0.0,
    };
    if d.roughness > 0.0 || (has_ks && rules.specular_lobe) {
        return Reflection::Lobes { specularity, exponent: d.ns, roughness: d.roughness };
    }
    match (has_kd, has_ks) {
        (_, true) => Reflection::Phong { specularity, exponent: d.ns },
        (false, false) if !rules.lambert_default => Reflection::Uniform,
        _ => Reflection::Lambert,
    }
}
