//! Pictures of scenes from above, on which areas are drawn. They are kept by the contents of the files that
//! they are drawn from.

use crate::beneath::Beneath;
use crate::processes::Process;
use crate::request::{Prepared, RequestError, check};
use crate::store::{StoreError, remove_folder};
use crate::view::VIEW;
use crate::worker::Workshop;
use serde::Serialize;
use serde_json::json;
use std::ffi::OsString;
use std::fs;
use std::path::{Path, PathBuf};

/// The folder of all pictures of scenes.
const MAPS: &str = "maps";

/// Pixels along the longer side.
const SIDE: u32 = 800;
/// Most pictures that are kept.
const MAX_KEPT: usize = 500;
/// The picture and its world file in their folder.
const PICTURE: &str = "map.png";
const FRAME: &str = "map.pgw";
/// Largest picture and world file, bytes.
const MAX_PICTURE: u64 = 32 << 20;
const MAX_FRAME: u64 = 4 << 10;

/// A picture of a scene from above.
#[derive(Clone, Debug)]
pub struct SceneMap {
    /// The folder of the picture, in which hostile files may have had other things drawn.
    folder: PathBuf,
    /// Coordinates of its pixels.
    pub frame: Frame,
}

/// Coordinates of the pixels of a picture.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Frame {
    /// Coordinates of the centre of the upper left pixel, m.
    pub corner: [f64; 2],
    /// Width and height of a pixel, m.
    pub pixel: f64,
}

impl SceneMap {
    /// The picture (PNG).
    ///
    /// # Errors
    /// Errors of files.
    pub fn picture(&self) -> std::io::Result<Vec<u8>> {
        Beneath::of(&self.folder)?.read(PICTURE, MAX_PICTURE)
    }

    /// The picture in a folder, if it is complete.
    fn of(folder: PathBuf) -> Option<SceneMap> {
        let files = Beneath::of(&folder).ok()?;
        files.file(PICTURE).ok()?;
        let text = files.read(FRAME, MAX_FRAME).ok()?;
        let frame = Frame::of(std::str::from_utf8(&text).ok()?)?;
        Some(SceneMap { folder, frame })
    }
}

impl Frame {
    /// The frame that a world file tells.
    fn of(text: &str) -> Option<Frame> {
        let numbers: Vec<f64> = text.lines().map(|line| line.trim().parse().ok()).collect::<Option<_>>()?;
        match numbers.as_slice() {
            [pixel, 0.0, 0.0, _, x, y] if numbers.iter().all(|number| number.is_finite()) => {
                Some(Frame { corner: [*x, *y], pixel: *pixel })
            }
            _ => None,
        }
    }

    /// Coordinates of a place in the picture, pixels from its upper left corner, rounded to what a pixel can
    /// tell.
    pub fn place(&self, x: f64, y: f64) -> [f64; 2] {
        let digits = (1.0 - self.pixel.log10().floor()).clamp(0.0, 6.0);
        let unit = 10f64.powi(digits as i32);
        let rounded = |value: f64| (value * unit).round() / unit;
        let [left, top] = self.corner;
        [rounded(left + (x - 0.5) * self.pixel), rounded(top - (y - 0.5) * self.pixel)]
    }
}

impl Workshop {
    /// The picture of a scene of an owner, if it has been drawn.
    ///
    /// # Errors
    /// [`RequestError`] for names that are none of the owner's.
    pub fn drawn_map(&self, owner: &str, scene: &str) -> Result<Option<SceneMap>, RequestError> {
        Ok(SceneMap::of(self.map_folder(owner, scene)?.0))
    }

    /// The picture of a scene of an owner, which is drawn if there is none; `None` if it cannot be drawn.
    ///
    /// # Errors
    /// [`RequestError`] for names that are none of the owner's.
    pub fn scene_map(&self, owner: &str, scene: &str) -> Result<Option<SceneMap>, RequestError> {
        let (folder, prepared) = self.map_folder(owner, scene)?;
        let known = SceneMap::of(folder.clone());
        if known.is_some() || prepared.uses.is_empty() {
            return Ok(known);
        }
        let words = ["scene".to_owned(), "map".to_owned(), format!("--out=../{VIEW}/{PICTURE}")];
        let assets = prepared.words.iter().filter(|word| word.starts_with("--assets=")).cloned();
        let words = words.into_iter().chain([format!("--side={SIDE}")]).chain(assets);
        let words = words.chain(["--".to_owned(), scene.to_owned()]).map(OsString::from);
        let drawn = self.draw(&prepared, &words.collect::<Vec<_>>(), None)?;
        let view = drawn.path().join(VIEW);
        if SceneMap::of(view.clone()).is_some() {
            let place = || {
                make_room(&self.store.root().join(MAPS))?;
                // What is there is damaged.
                remove_folder(&folder)?;
                fs::rename(&view, &folder)
            };
            place().map_err(StoreError::from)?;
        }
        Ok(SceneMap::of(folder))
    }

    /// The folder of the picture of a scene, and what it is drawn of. Owners share no pictures.
    fn map_folder(&self, owner: &str, scene: &str) -> Result<(PathBuf, Prepared), RequestError> {
        let inputs = json!({ "points": scene });
        let inputs = inputs.as_object().cloned().unwrap_or_default();
        let checked = check(Process::Preview, &inputs, owner, &self.store, &self.program)?;
        let folder = self.store.root().join(MAPS).join(format!("{owner}-{}", checked.fingerprint));
        Ok((folder, checked.prepared))
    }
}

/// Removes the oldest pictures when there are many.
fn make_room(all: &Path) -> std::io::Result<()> {
    fs::create_dir_all(all)?;
    let mut kept = Vec::new();
    for entry in fs::read_dir(all)? {
        let entry = entry?;
        // Another drawing may remove pictures, too.
        let Ok(about) = entry.metadata() else { continue };
        kept.push((about.modified()?, entry.path()));
    }
    kept.sort();
    let surplus = kept.len().saturating_sub(MAX_KEPT - 1);
    kept.into_iter().take(surplus).try_for_each(|(_, path)| remove_folder(&path))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn places_are_those_of_the_world_file() {
        let frame = Frame::of("0.25\n0\n0\n-0.25\n500000.125\n5400099.875\n").unwrap();
        assert_eq!(frame.place(0.0, 0.0), [500_000.0, 5_400_100.0]);
        assert_eq!(frame.place(400.0, 200.0), [500_100.0, 5_400_050.0]);
        assert_eq!(frame.place(1.0, 0.5), [500_000.25, 5_400_099.88]);
        for damaged in ["", "1\n2", "1\n0\n0\n-1\nx\n0", "1\n0\n0\n-1\nNaN\n0", "1\n0.5\n0\n-1\n0\n0"] {
            assert_eq!(Frame::of(damaged), None, "{damaged}");
        }
    }

    #[test]
    fn the_oldest_pictures_go() {
        let folder = tempfile::tempdir().unwrap();
        let all = folder.path().join("maps");
        make_room(&all).unwrap();
        for number in 0..MAX_KEPT + 3 {
            fs::create_dir(all.join(number.to_string())).unwrap();
        }
        make_room(&all).unwrap();
        assert_eq!(fs::read_dir(&all).unwrap().count(), MAX_KEPT - 1);
    }
}
