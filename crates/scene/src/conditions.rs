//! The settings that a loaded scene depends on.

use super::builder::LoadOptions;
use super::model::Scene;
use std::path::PathBuf;
use vlscan_base::corrections::Corrections;
use vlscan_survey::{Loader, MaterialChoice, SceneRecipe, VoxelMode};

/// Settings of the loading that can affect a scene.
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Conditions {
    /// Wavelength of the spectra, nm.
    pub wavelength_nm: f64,
    /// See [`LoadOptions::further_wavelengths_nm`].
    pub further_wavelengths_nm: Vec<f64>,
    /// True if the scene reads files of spectra, so that its reflectances depend on the wavelength.
    pub has_spectra: bool,
    /// Seed of random materials and positions.
    pub seed: u64,
    /// True if the scene has random materials or positions.
    pub is_random: bool,
    /// See [`LoadOptions::rules`].
    pub rules: Corrections,
    /// The rules that change the scene.
    pub relevant_rules: Corrections,
    /// See [`LoadOptions::drop_polygons`].
    pub drop_polygons: bool,
}

/// Why a scene does not match other options.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum ConditionMismatch {
    /// Reflectances from spectra at another wavelength, nm.
    #[error("its spectra are those at {loaded} nm, the scanner's beam has {requested} nm")]
    #[allow(missing_docs, reason = "the variant says it")]
    Wavelength { loaded: f64, requested: f64 },
    /// Reflectances from spectra without the wavelengths of all channels.
    #[error("its spectra are not those at the wavelengths of all channels of the scanner")]
    Channels,
    /// Random materials or places of another seed.
    #[error("its random materials or places are those of seed {loaded}, not of {requested}")]
    #[allow(missing_docs, reason = "the variant says it")]
    Seed { loaded: u64, requested: u64 },
    /// Materials or leaf angle tables that were read by other rules, named by the options that choose these.
    #[error("its materials or leaf angle tables were read for {loaded}, but this run has {requested}")]
    #[allow(missing_docs, reason = "the variant says it")]
    Materials { loaded: &'static str, requested: &'static str },
    /// Faces with more than four corners that are skipped, or not.
    #[error("faces with more than four corners were treated differently when it was packed")]
    Polygons,
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
            further_wavelengths_nm: options.further_wavelengths_nm.clone(),
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

    /// Checks that a scene loaded with these options would be equal.
    ///
    /// # Errors
    /// The first difference.
    pub fn check(&self, options: &LoadOptions) -> Result<(), ConditionMismatch> {
        if self.has_spectra && self.wavelength_nm != options.wavelength_nm {
            let (loaded, requested) = (self.wavelength_nm, options.wavelength_nm);
            return Err(ConditionMismatch::Wavelength { loaded, requested });
        }
        if self.has_spectra && !self.further_wavelengths_nm.starts_with(&options.further_wavelengths_nm) {
            return Err(ConditionMismatch::Channels);
        }
        if self.is_random && self.seed != options.seed {
            let (loaded, requested) = (self.seed, options.seed);
            return Err(ConditionMismatch::Seed { loaded, requested });
        }
        if self.rules.and(self.relevant_rules) != options.rules.and(self.relevant_rules) {
            let requested = options.rules.and(Corrections::MATERIAL);
            let (loaded, requested) = (profile_of(self.rules), profile_of(requested));
            return Err(ConditionMismatch::Materials { loaded, requested });
        }
        if self.drop_polygons != options.drop_polygons {
            return Err(ConditionMismatch::Polygons);
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
