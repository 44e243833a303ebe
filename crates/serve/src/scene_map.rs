//! Pictures of scenes from above, on which areas are drawn. They are kept by the contents of the files that
//! they are drawn from.

use crate::beneath::Beneath;
use crate::job_folder;
use crate::processes::Process;
use crate::request::{RequestError, check};
use crate::store::StoreError;
use crate::worker::Workshop;
use serde::Serialize;
use serde_json::json;
use std::ffi::OsString;
use std::fs;
use std::path::{Path, PathBuf};

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
    /// The folder of the picture, which jobs can write.
    folder: PathBuf,
    /// Where it lies.
    pub frame: Frame,
}

/// Where the pixels of a picture lie.
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
        let text = Beneath::of(&folder).and_then(|folder| folder.read(FRAME, MAX_FRAME)).ok()?;
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
    /// The picture of a scene of an owner, which is drawn if there is none; `None` if it cannot be drawn.
    ///
    /// # Errors
    /// [`RequestError`] for names that are none of the owner's.
    pub fn scene_map(&self, owner: &str, scene: &str) -> Result<Option<SceneMap>, RequestError> {
        let inputs = json!({ "points": scene });
        let inputs = inputs.as_object().cloned().unwrap_or_default();
        let checked = check(Process::Preview, &inputs, owner, &self.store, &self.program)?;
        if checked.prepared.uses.is_empty() {
            return Ok(None);
        }
        let all = self.store.root().join("maps");
        let folder = all.join(&checked.fingerprint);
        let view = folder.join("view");
        if SceneMap::of(view.clone()).is_none() {
            make_room(&all).map_err(StoreError::from)?;
            job_folder::make(&self.store, &folder, &checked.prepared)?;
            let words = ["scene", "map", "--force"].map(OsString::from).into_iter();
            let options = [format!("--out=../view/{PICTURE}"), format!("--side={SIDE}")];
            let assets = checked.prepared.words.iter().filter(|word| word.starts_with("--assets="));
            let words = words.chain(options.map(OsString::from)).chain(assets.map(OsString::from));
            let words: Vec<OsString> = words.chain(["--".into(), scene.into()]).collect();
            self.draw(&folder, "in", &checked.prepared, &words)?;
            for part in ["in", "out"] {
                fs::remove_dir_all(folder.join(part)).map_err(StoreError::from)?;
            }
        }
        Ok(SceneMap::of(view))
    }
}

/// Removes the oldest pictures when there are many.
fn make_room(all: &Path) -> std::io::Result<()> {
    fs::create_dir_all(all)?;
    let mut kept = Vec::new();
    for entry in fs::read_dir(all)? {
        let entry = entry?;
        kept.push((entry.metadata()?.modified()?, entry.path()));
    }
    kept.sort();
    let surplus = kept.len().saturating_sub(MAX_KEPT - 1);
    kept.into_iter().take(surplus).try_for_each(|(_, path)| fs::remove_dir_all(path))
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
