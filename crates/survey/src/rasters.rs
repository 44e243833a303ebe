//! The files of terrain rasters by name: a file, a virtual raster, the tiles in a folder, or those of a
//! pattern.

use super::RasterFiles;
use super::assets::{Located, NoMatch};
use super::context::{Context, ReadOptions};
use super::vrt::read_virtual_raster;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use vlscan_base::diag::{Diagnostics, Place};
use vlscan_base::error::Result;
use vlscan_base::files::reads;
use vlscan_base::recognise::{Expected, first_bytes, foreign};

/// Endings of the rasters that the scene reads.
const TILE_ENDINGS: [&str; 4] = ["tif", "tiff", "asc", "grd"];
/// Ending of virtual rasters.
const VIRTUAL_ENDING: &str = "vrt";

/// Finds the files of a terrain raster: a raster, a virtual raster (.vrt), a folder of tiles, or a pattern
/// such as `dem/*.tif`. Tiles are sorted by name.
///
/// # Errors
/// The errors of [`crate::read_survey`].
pub fn find_raster(name: &str, options: &ReadOptions) -> Result<(RasterFiles, Diagnostics)> {
    let context = Context::new(options);
    let files = context.raster(name, Path::new(""), None);
    context.finish(files)
}

/// True if a path is a raster, by its extension or contents, or a folder, which may contain tiles.
pub fn names_raster(path: &Path) -> bool {
    has_ending(path, &TILE_ENDINGS) || is_virtual(path) || path.is_dir() || holds_raster(path)
}

/// True if a file contains a supported raster, under any name.
fn holds_raster(path: &Path) -> bool {
    first_bytes(path).is_some_and(|bytes| foreign(path, &bytes, &Expected::RASTER).is_none())
}

/// True if a name has the extension of a raster.
pub(super) fn is_raster(name: &str) -> bool {
    has_ending(Path::new(name), &TILE_ENDINGS) || is_virtual(Path::new(name))
}

fn is_virtual(path: &Path) -> bool {
    has_ending(path, &[VIRTUAL_ENDING])
}

fn has_ending(path: &Path, endings: &[&str]) -> bool {
    let own = path.extension().unwrap_or_default();
    endings.iter().any(|ending| own.eq_ignore_ascii_case(ending))
}

impl Context {
    /// The files of a raster by its name, which a file in `folder` states at `place`.
    pub fn raster(&self, name: &str, folder: &Path, place: Option<Place>) -> Option<RasterFiles> {
        if self.assets.file(name, folder).is_none() {
            if let Some(found) = self.assets.folder(name, folder) {
                return self.tiles_in(&found, place);
            }
            if has_wildcards(name) {
                let files = self.files_matching(name, &of_wildcards(name), folder, place)?;
                return Some(RasterFiles::Tiles(files));
            }
        }
        let file = self.file(name, folder, place)?;
        match is_virtual(&file) {
            true => read_virtual_raster(self, &file).map(|raster| RasterFiles::Virtual(Arc::new(raster))),
            false => Some(file.into()),
        }
    }

    /// True if a name refers to a raster, by its ending or its contents, or to a folder of tiles.
    pub fn is_terrain(&self, name: &str, folder: &Path) -> bool {
        let holds_one = || self.assets.file(name, folder).is_some_and(|file| holds_raster(&file.found));
        is_raster(name) || self.is_folder(name, folder) || holds_one()
    }

    /// True if a name refers to a folder, not to a file.
    pub fn is_folder(&self, name: &str, folder: &Path) -> bool {
        self.assets.folder(name, folder).is_some() && self.assets.file(name, folder).is_none()
    }

    /// True if a name, relative to the working directory, is a folder or a pattern of file names.
    pub fn are_tiles(&self, name: &str) -> bool {
        let matches = |name: &str| self.assets.matching(&of_wildcards(name), Path::new("")).is_ok();
        Path::new(name).is_dir() || has_wildcards(name) && matches(name)
    }

    fn tiles_in(&self, folder: &Path, place: Option<Place>) -> Option<RasterFiles> {
        let listed = reads::list(folder);
        let files: Vec<PathBuf> = match listed {
            Ok(all) => {
                all.into_iter().filter(|p| has_ending(p, &TILE_ENDINGS) && reads::is_file(p)).collect()
            }
            Err(e) => {
                self.error_help(place, format!("cannot read the folder {}: {e}", folder.display()), "");
                return None;
            }
        };
        if files.is_empty() {
            let message = format!("the folder {} holds no raster", folder.display());
            let survey = folder.join("survey.xml");
            let help = match survey.is_file() {
                true => format!("name {}", survey.display()),
                false => "names of rasters end in .tif, .tiff, .asc or .grd".to_owned(),
            };
            self.error_help(place, message, help);
            return None;
        }
        Some(RasterFiles::Tiles(files))
    }

    /// All files that match an expression, see [`super::assets::Assets::matching`]; none is an error that
    /// names the files as they are `written`.
    pub fn files_matching(
        &self,
        written: &str,
        expression: &str,
        folder: &Path,
        place: Option<Place>,
    ) -> Option<Vec<PathBuf>> {
        match self.assets.matching(expression, folder) {
            Ok(Located { found, respelled }) => {
                self.warn_of_spelling(written, respelled.as_deref(), place);
                Some(found)
            }
            Err(NoMatch::Expression(e)) => {
                let reason = e.lines().last().unwrap_or_default().trim().to_owned();
                let message = "the part after the last `/` is not a valid regular expression";
                self.error_help(place, message, reason);
                None
            }
            Err(NoMatch::Nothing) => {
                let help = self.assets.searched(written, folder);
                self.not_found(place, format!("no file matches `{written}`"), help);
                None
            }
        }
    }
}

fn has_wildcards(name: &str) -> bool {
    name.contains(['*', '?'])
}

/// The expression for a name in which `*` stands for any characters and `?` for one.
fn of_wildcards(name: &str) -> String {
    let (folder, name) =
        name.rsplit_once('/').map_or(("", name), |(folder, _)| name.split_at(folder.len() + 1));
    let mut expression = folder.to_owned();
    for c in name.chars() {
        match c {
            '*' => expression.push_str(".*"),
            '?' => expression.push('.'),
            c if c.is_alphanumeric() || c == '_' => expression.push(c),
            c => expression.extend(['\\', c]),
        }
    }
    expression
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn wildcards_stand_for_characters_of_the_last_name() {
        assert_eq!(of_wildcards("a.b/dem_?*.tif"), r"a.b/dem_..*\.tif");
        assert_eq!(of_wildcards("*(1)"), r".*\(1\)");
    }

    #[test]
    fn rasters_are_files_folders_and_patterns() {
        let folder = tempfile::tempdir().unwrap();
        for name in ["b.tif", "a.TIFF", "a.tfw", "c.txt", "d.asc"] {
            std::fs::write(folder.path().join(name), "").unwrap();
        }
        std::fs::create_dir(folder.path().join("empty")).unwrap();
        let at = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
        let names = |name: &str| {
            let (found, _) = find_raster(&at(name), &ReadOptions::default()).unwrap();
            let name = |path: &PathBuf| path.file_name().unwrap().to_str().unwrap().to_owned();
            found.all().iter().map(name).collect::<Vec<_>>()
        };
        assert_eq!(names(""), ["a.TIFF", "b.tif", "d.asc"]);
        assert_eq!(names("*.tif"), ["b.tif"]);
        assert_eq!(names("c.txt"), ["c.txt"]);
        for (name, expected) in
            [("empty", "holds no raster"), ("d*.tif", "no file matches"), ("e.tif", "cannot find")]
        {
            let error = find_raster(&at(name), &ReadOptions::default()).unwrap_err().to_string();
            assert!(error.contains(expected), "{error}");
        }
    }
}
