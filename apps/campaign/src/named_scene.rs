//! Scenes as commands name them: directly, or by a file that refers to one.

use std::path::{Path, PathBuf};
use vlscan_base::diag::Diagnostics;
use vlscan_base::error::Result;
use vlscan_lidar::pulse::{Corrections, PhysicsProfile};
use vlscan_options::{InputOptions, Options, holds_survey, read_survey};
use vlscan_scene::LoadOptions;
use vlscan_survey::{ReadOptions, SceneRecipe};

/// A scene as named on the command line: directly, or by a file that refers to it.
pub struct NamedScene<'a> {
    /// Scene, survey, pipeline or geometry file.
    pub name: &'a str,
    /// Folders in which files are looked up.
    pub assets: &'a [PathBuf],
}

/// Properties of the scan that the scene depends on.
pub struct Scanning {
    /// Wavelength of the first device, nm.
    pub wavelength_nm: f64,
    /// Wavelengths of other devices at which spectra are evaluated, too, nm.
    pub further_wavelengths_nm: Vec<f64>,
    /// The survey's seed.
    pub seed: Option<u64>,
    /// Corrections by which materials are read.
    pub corrections: Corrections,
}

impl NamedScene<'_> {
    /// Reads the scene's description and the properties of its scan.
    ///
    /// # Errors
    /// The errors of [`read_survey`] and of [`vlscan_survey::read_scene`].
    pub fn recipe(&self) -> Result<(SceneRecipe, Scanning, Diagnostics)> {
        let default = LoadOptions::default().wavelength_nm;
        let path = Path::new(self.name);
        if !holds_survey(path) {
            let reading = ReadOptions { assets: self.assets.to_vec(), ..ReadOptions::default() };
            let (scene, warnings) = vlscan_survey::read_scene(self.name, &reading)?;
            let corrections = PhysicsProfile::OF_PIPELINES.corrections();
            let further_wavelengths_nm = Vec::new();
            let scanning =
                Scanning { wavelength_nm: default, further_wavelengths_nm, seed: None, corrections };
            return Ok((scene, scanning, warnings));
        }
        let input = InputOptions { assets: self.assets.to_vec(), ..InputOptions::default() };
        let (survey, options, warnings) = read_survey(path, Options { input, ..Options::default() })?;
        let corrections = options.profile.corrections(Corrections::NONE)?;
        let LoadOptions { wavelength_nm, further_wavelengths_nm, .. } =
            LoadOptions { rules: corrections, ..LoadOptions::default() }.with_wavelengths_of(&survey.scanner);
        let scanning = Scanning { wavelength_nm, further_wavelengths_nm, seed: survey.seed, corrections };
        Ok((survey.scene, scanning, warnings))
    }
}
