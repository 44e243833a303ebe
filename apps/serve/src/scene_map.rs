//! Pictures of scenes from above, on which areas are drawn. They are kept by the contents of the files that
//! they are drawn from.

use crate::beneath::Beneath;
use crate::execution::bytes_in;
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
/// Most pictures of an owner that are kept, and their disk space, bytes.
const MAX_KEPT: usize = 100;
const MAX_SPACE: u64 = 64 << 20;
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
                make_room(&self.store.root().join(MAPS), owner, bytes_in(&view)?)?;
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

/// Removes the oldest pictures of an owner when there are many, to have room for one of so many bytes.
fn make_room(all: &Path, owner: &str, bytes: u64) -> std::io::Result<()> {
    fs::create_dir_all(all)?;
    let mut kept = Vec::new();
    for entry in fs::read_dir(all)? {
        let entry = entry?;
        let name = entry.file_name();
        // Names of owners have dashes, too; fingerprints have none.
        if name.to_str().and_then(|name| name.rsplit_once('-')).is_none_or(|(of, _)| of != owner) {
            continue;
        }
        // Another drawing may remove pictures, too.
        let Ok(about) = entry.metadata() else { continue };
        kept.push((about.modified()?, entry.path(), bytes_in(&entry.path()).unwrap_or(0)));
    }
    kept.sort();
    let (mut number, mut space) = (1, bytes);
    for (_, path, bytes) in kept.iter().rev() {
        number += 1;
        space = space.saturating_add(*bytes);
        if number > MAX_KEPT || space > MAX_SPACE {
            remove_folder(path)?;
        }
    }
    Ok(())
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
    fn the_oldest_pictures_of_an_owner_go() {
        let folder = tempfile::tempdir().unwrap();
        let all = folder.path().join("maps");
        make_room(&all, "anna", 0).unwrap();
        let add = |name: String, bytes: u64| {
            fs::create_dir(all.join(&name)).unwrap();
            fs::File::create(all.join(name).join(PICTURE)).unwrap().set_len(bytes).unwrap();
        };
        let count = |owner: &str| {
            let names =
                fs::read_dir(&all).unwrap().map(|entry| entry.unwrap().file_name().into_string().unwrap());
            names.filter(|name| name.rsplit_once('-').unwrap().0 == owner).count()
        };
        (0..MAX_KEPT + 3).for_each(|number| add(format!("anna-{number}"), 10));
        (0..3).for_each(|number| add(format!("an-anna-{number}"), MAX_SPACE));
        make_room(&all, "anna", 10).unwrap();
        assert_eq!((count("anna"), count("an-anna")), (MAX_KEPT - 1, 3), "owners have no part in others");
        make_room(&all, "anna", MAX_SPACE).unwrap();
        make_room(&all, "an-anna", 10).unwrap();
        assert_eq!((count("anna"), count("an-anna")), (0, 0));
    }
}
