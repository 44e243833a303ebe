//! Scenes for tests: files in a temporary folder and recipes for them.

use super::{LoadOptions, Scene, load};
use std::path::{Path, PathBuf};
use vlscan_base::corrections::Corrections;
use vlscan_base::diag::{Diagnostics, Place};
use vlscan_base::error::{Error, Result};
use vlscan_render::Render as _;
use vlscan_survey::{Loader, MeshReading, MotionTiming, PartRecipe, SceneRecipe, Transform};

/// The rules of the reference: no departures.
pub(super) const HELIOS: Corrections = Corrections::NONE;

pub(super) struct Fixture {
    folder: tempfile::TempDir,
    pub parts: Vec<PartRecipe>,
    /// Loaded with two threads.
    pub options: LoadOptions,
}

impl Fixture {
    pub fn new() -> Fixture {
        let options = LoadOptions { jobs: 2, ..LoadOptions::default() };
        Fixture { folder: tempfile::tempdir().unwrap(), parts: Vec::new(), options }
    }

    pub fn file(&self, name: &str, content: impl AsRef<[u8]>) -> PathBuf {
        let path = self.path().join(name);
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::fs::write(&path, content).unwrap();
        path
    }

    pub fn path(&self) -> &Path {
        self.folder.path()
    }

    /// Adds a part whose place is line 10 + its index in the scene's file.
    pub fn part(&mut self, loader: Loader) -> &mut PartRecipe {
        let number = self.parts.len() as u32;
        self.parts.push(PartRecipe {
            id: None,
            name: None,
            number,
            loader,
            changes: Default::default(),
            transform: Transform::IDENTITY,
            motions: Vec::new(),
            timing: MotionTiming { dyn_step: 1, tree_step: 1, dyn_time_step: None, tree_time_step: None },
            swaps: Vec::new(),
            place: Some(Place::in_line(Path::new("scene.xml"), 10 + number as usize, "<part>", 0..6)),
        });
        self.parts.last_mut().unwrap()
    }

    /// Writes an OBJ file and adds it as a part.
    pub fn obj(&mut self, name: &str, content: impl AsRef<[u8]>) -> &mut PartRecipe {
        let files = vec![self.file(name, content)];
        self.part(Loader::MeshFiles { files, reading: MeshReading::default() })
    }

    pub fn recipe(&self) -> SceneRecipe {
        SceneRecipe {
            id: "s".to_owned(),
            path: PathBuf::from("scene.xml"),
            parts: self.parts.clone(),
            dyn_step: 1,
            dyn_time_step: None,
            packed: None,
            asset_folders: vec![self.path().to_path_buf()],
        }
    }

    pub fn load(&self) -> Result<(Scene, Diagnostics)> {
        load(&self.recipe(), &self.options)
    }

    /// Loads the scene, which must not cause a warning.
    pub fn scene(&self) -> Scene {
        let (scene, diagnostics) = self.load().unwrap_or_else(|e| panic!("{}", report(&e)));
        assert!(diagnostics.items().is_empty(), "{}", diagnostics.text());
        scene
    }

    /// Loads the scene, which must fail, and returns the error as text.
    pub fn error(&self) -> String {
        report(&self.load().expect_err("the scene must not load"))
    }
}

/// The text of an error as shown to the user.
pub(super) fn report(e: &Error) -> String {
    match e {
        Error::Input(d) => d.render(false),
        other => other.to_string(),
    }
}
