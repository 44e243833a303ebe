//! The settings that a loaded scene depends on.

use super::builder::LoadOptions;
use super::model::Scene;
use std::path::PathBuf;
use vlscan_base::corrections::Corrections;
use vlscan_survey::{Loader, MaterialChoice, SceneRecipe, VoxelMode};

/// Settings that a scene was loaded with, as far as they can affect it.
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Conditions {
    /// Wavelength of the spectra, nm.
    pub wavelength_nm: f64,
    /// Whether the scene reads files of spectra, so that its reflectances depend on the wavelength.
    pub has_spectra: bool,
    /// Seed of random materials and positions.
    pub seed: u64,
    /// Whether the scene has random materials or positions.
    pub is_random: bool,
    /// See [`LoadOptions::rules`].
    pub rules: Corrections,
    /// The rules that change the scene.
    pub relevant_rules: Corrections,
    /// See [`LoadOptions::drop_polygons`].
    pub drop_polygons: bool,
}

impl Conditions {
    /// The conditions under which a scene is loaded, before anything of it is.
    pub fn of(recipe: &SceneRecipe, options: &LoadOptions) -> Conditions {
        let loaders = recipe
            .parts
            .iter()
            .flat_map(|p| std::iter::once(&p.loader).chain(p.swaps.iter().filter_map(|s| s.loader.as_ref())));
        Conditions {
            wavelength_nm: options.wavelength_nm,
            has_spectra: false,
            seed: options.seed,
            is_random: loaders.into_iter().any(is_random),
            rules: options.rules.and(Corrections::MATERIAL),
            relevant_rules: Corrections::NONE,
            drop_polygons: options.drop_polygons,
        }
    }

    /// Adds the conditions that the materials of an epoch depend on.
    pub fn add(&mut self, scene: &Scene) {
        self.relevant_rules = self.relevant_rules.or(scene.relevant_rules);
        let is_spectrum = |f: &PathBuf| f.parent().is_some_and(|p| p.ends_with("spectra"));
        self.has_spectra |= scene.sources.iter().any(is_spectrum);
    }

    /// Checks that a scene loaded with these options would be equal; otherwise the difference is the error.
    pub fn check(&self, options: &LoadOptions) -> std::result::Result<(), String> {
        if self.has_spectra && self.wavelength_nm != options.wavelength_nm {
            let (packed, asked) = (self.wavelength_nm, options.wavelength_nm);
            return Err(format!("its spectra are those at {packed} nm, the scanner's beam has {asked} nm"));
        }
        if self.is_random && self.seed != options.seed {
            let (packed, asked) = (self.seed, options.seed);
            return Err(format!("its random materials or places are those of seed {packed}, not of {asked}"));
        }
        if self.rules.and(self.relevant_rules) != options.rules.and(self.relevant_rules) {
            let (packed, asked) =
                (profile_of(self.rules), profile_of(options.rules.and(Corrections::MATERIAL)));
            return Err(format!(
                "its materials or leaf angle tables were read for {packed}, and this run has {asked}"
            ));
        }
        if self.drop_polygons != options.drop_polygons {
            return Err("faces with more than four corners are treated otherwise in it".to_owned());
        }
        Ok(())
    }
}

/// The option by which materials are read like that.
fn profile_of(rules: Corrections) -> &'static str {
    if rules == Corrections::NONE {
        "--physics helios"
    } else if rules == Corrections::MATERIAL {
        "--physics refined"
    } else {
        "other corrections (--correct)"
    }
}

fn is_random(loader: &Loader) -> bool {
    let varied = |m: &MaterialChoice| m.random_variants > 0;
    match loader {
        Loader::MeshFiles { .. } | Loader::Mesh(_) => false,
        Loader::GeoTiff { material, .. } => varied(material),
        Loader::Xyz(xyz) => varied(&xyz.material),
        Loader::DetailedVoxels(v) => {
            varied(&v.material) || (v.random_shift && matches!(v.mode, VoxelMode::Scaled(_)))
        }
    }
}
