//! A loaded scene, over which sessions are opened: facts about it, points on its surfaces.

use super::load::{build_tree, check_raster_memory, load_scene};
use super::settings::{Settings, check_jobs};
use ::arrow_array::{Float64Array, Int32Array, RecordBatch};
use std::fmt;
use std::sync::{Arc, OnceLock};
use vlscan_base::diag::Notice;
use vlscan_base::error::{Error, Result};
use vlscan_base::files::{FileLog, Reads};
use vlscan_base::machine;
use vlscan_base::rng::{Purpose, Stream};
use vlscan_geom::{Aabb, DVec3};
use vlscan_scene::{Conditions, Fallback, GroundModel, LoadOptions, Scene, SceneFrame, Sharing};
use vlscan_survey::SceneRecipe;
use vlscan_trace::{BuildOptions, Tree};

/// A scene in memory, with its tree once the tree is needed. Clones share both, and so do all sessions over
/// it: a scene that many surveys measure is loaded once.
///
/// A scene with swapped parts has several epochs; this is the scene of one of them, the first unless a
/// session has advanced to a later one.
#[derive(Clone)]
pub struct LoadedScene {
    scene: Arc<Scene>,
    tree: Arc<OnceLock<Arc<Tree>>>,
    /// The settings that the scene depends on.
    pub(super) conditions: Conditions,
    sharing: Sharing,
    max_memory: Option<u64>,
    trees: BuildOptions,
    epoch: u32,
    epochs: u32,
    /// The frame of the first epoch's scene.
    frame: SceneFrame,
    reads: Arc<Reads>,
}

impl LoadedScene {
    /// Loads the scene of the first epoch. The tree is built, with the options `trees`, when it is needed
    /// first. Warnings are errors if it `is_strict`.
    ///
    /// # Errors
    /// [`Error::Input`] for scenes that are invalid or exceed the memory limit; [`Error::Io`].
    pub fn load(
        recipe: &SceneRecipe,
        options: &LoadOptions,
        trees: &BuildOptions,
        is_strict: bool,
        notify: &dyn Fn(Notice),
    ) -> Result<LoadedScene> {
        check_raster_memory(recipe, options, trees.builder, notify)?;
        LoadedScene::load_without_tree(recipe, options, trees, is_strict, notify)
    }

    /// Loads the scene of a survey as its settings ask for; see [`LoadedScene::load`].
    ///
    /// # Errors
    /// As for [`LoadedScene::load`].
    pub fn of(settings: &Settings, notify: &dyn Fn(Notice)) -> Result<LoadedScene> {
        settings.check()?;
        let Settings { survey, load, tree, strict, .. } = settings;
        LoadedScene::load(&survey.scene, load, tree, *strict, notify)
    }

    /// [`LoadedScene::load`] where no tree will be needed, whose memory then does not count.
    pub(super) fn load_without_tree(
        recipe: &SceneRecipe,
        options: &LoadOptions,
        trees: &BuildOptions,
        is_strict: bool,
        notify: &dyn Fn(Notice),
    ) -> Result<LoadedScene> {
        check_jobs(options, trees)?;
        machine::start_pool()?;
        let log = FileLog::default();
        let load = || -> Result<(u32, Scene)> {
            let epochs = vlscan_scene::count_epochs(recipe)?;
            Ok((epochs, load_scene(recipe, options, is_strict, (0, None), notify)?))
        };
        let (epochs, scene) = log.record(load)?;
        let (scene, reads) = (Arc::new(scene), Arc::new(log.reads()));
        let mut conditions = Conditions::of(recipe, options);
        conditions.add(&scene);
        let frame = SceneFrame::of(&scene);
        let LoadOptions { sharing, max_memory, .. } = *options;
        let (tree, trees) = (Arc::default(), trees.clone());
        Ok(LoadedScene {
            scene,
            tree,
            conditions,
            sharing,
            max_memory,
            trees,
            epoch: 0,
            epochs,
            frame,
            reads,
        })
    }

    /// True if a session with these settings can be opened over the scene: false if they request spectra at
    /// another wavelength, other random materials, or another kind of tree. The caller ensures that the
    /// settings describe this scene.
    pub fn suits(&self, settings: &Settings) -> bool {
        self.check(settings).is_ok()
    }

    /// As [`LoadedScene::suits`], with the difference.
    pub(super) fn check(&self, settings: &Settings) -> Result<()> {
        let BuildOptions { jobs, geometry_jobs, .. } = settings.tree;
        let differs = |what: &str| Err(Error::input(format!("the scene was loaded for another run: {what}")));
        match self.conditions.check(&settings.load) {
            Err(mismatch) => differs(&mismatch.to_string()),
            Ok(()) if self.sharing != settings.load.sharing => differs("it has other --instances"),
            Ok(()) if BuildOptions { jobs, geometry_jobs, ..self.trees.clone() } != settings.tree => {
                differs("it has another --tree")
            }
            Ok(()) if settings.load.colours && !self.has_colours() => differs("it has no colours"),
            Ok(()) if self.epoch > 0 => differs("it is the scene of a later epoch"),
            Ok(()) => Ok(()),
        }
    }

    /// True if the colours of its surfaces were loaded, if it has any.
    pub(super) fn has_colours(&self) -> bool {
        self.scene.colours.is_some()
    }

    /// Loads the scene of another epoch in the frame of the first one. This one is freed before, unless
    /// others hold it.
    pub(super) fn load_epoch(
        &mut self,
        epoch: u32,
        settings: &Settings,
        notify: &dyn Fn(Notice),
    ) -> Result<()> {
        (self.scene, self.tree) = Default::default();
        let later = (epoch, Some(self.frame));
        let Settings { survey, load, strict, .. } = settings;
        self.scene = Arc::new(load_scene(&survey.scene, load, *strict, later, notify)?);
        self.epoch = epoch;
        Ok(())
    }

    /// The tree over the scene, which is built now if it is not yet there.
    ///
    /// # Errors
    /// [`Error::Input`] when it would exceed the memory limit.
    pub fn tree(&self, notify: &dyn Fn(Notice)) -> Result<&Arc<Tree>> {
        if let Some(tree) = self.tree.get() {
            return Ok(tree);
        }
        let tree = self.build_tree(&self.trees, notify)?;
        Ok(self.tree.get_or_init(|| tree))
    }

    /// Builds another tree over the scene.
    ///
    /// # Errors
    /// As for [`LoadedScene::tree`].
    pub fn build_tree(&self, options: &BuildOptions, notify: &dyn Fn(Notice)) -> Result<Arc<Tree>> {
        build_tree(options, self.max_memory, &self.scene, notify)
    }

    /// Forgets the tree, which is built again when it is needed.
    pub(super) fn drop_tree(&mut self) {
        self.tree = Arc::default();
    }

    /// The scene itself: parts, materials, geometry in the scene frame.
    pub fn scene(&self) -> &Arc<Scene> {
        &self.scene
    }

    /// The ground of the scene; `fallback` applies where no material is ground.
    ///
    /// # Errors
    /// As for [`LoadedScene::tree`].
    pub fn ground(&self, fallback: Fallback, notify: &dyn Fn(Notice)) -> Result<GroundModel> {
        Ok(GroundModel::new(self.scene.clone(), self.tree(notify)?.clone(), fallback))
    }

    /// Number of epochs: a survey is flown once for every state of the scene's swapped parts.
    pub fn epochs(&self) -> u32 {
        self.epochs
    }

    /// The epoch that this is, from 0.
    pub fn epoch(&self) -> u32 {
        self.epoch
    }

    /// Files that were read when the scene was loaded.
    pub fn reads(&self) -> &Reads {
        &self.reads
    }
}

impl fmt::Debug for LoadedScene {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("LoadedScene")
            .field("epoch", &self.epoch)
            .field("epochs", &self.epochs)
            .finish_non_exhaustive()
    }
}

/// Facts about a loaded scene.
#[derive(Clone, Debug, PartialEq)]
pub struct SceneFacts {
    /// Box around all primitives, world frame, m.
    pub bounds: Aabb,
    /// Number of triangles and voxels, including instances.
    pub primitives: u64,
    /// Ids of the parts.
    pub parts: Vec<String>,
    /// Names, reflectances and classes of the materials.
    pub materials: Vec<(String, f64, i32)>,
    /// Memory of scene and tree, bytes.
    pub memory: u64,
}

impl LoadedScene {
    /// Facts about the scene.
    pub fn facts(&self) -> SceneFacts {
        let scene = self.scene();
        SceneFacts {
            bounds: scene.bounds.translated(scene.shift),
            primitives: scene.primitives() as u64,
            parts: scene.parts.iter().map(|part| part.id.clone()).collect(),
            materials: scene
                .materials
                .iter()
                .map(|material| (material.name.clone(), material.reflectance, material.classification))
                .collect(),
            memory: (scene.memory() + self.tree.get().map_or(0, |tree| tree.memory())) as u64,
        }
    }

    /// World height of the ground at (x, y), m: the lowest surface whose material is ground; `None` where
    /// there is none.
    pub fn ground_height(&self, x: f64, y: f64) -> Option<f64> {
        let scene = self.scene();
        let shift = scene.shift;
        scene.ground_height(x - shift.x, y - shift.y).map(|z| z + shift.z)
    }

    /// About `count` points on the surfaces of the scene, in proportion to their areas and the same in every
    /// call, with the columns X, Y, Z (m, world frame), Classification and ObjectId (index of the part).
    ///
    /// # Errors
    /// [`Error::Input`] for a scene that is not loaded whole; [`Error::Internal`] if no table can be made of
    /// them.
    pub fn sample(&self, count: usize) -> Result<RecordBatch> {
        let scene = self.scene();
        if scene.tiles.is_some() {
            return Err(Error::input(
                "points on the surfaces need the scene in memory: leave out --scene-memory, also where it \
                 was packed",
            ));
        }
        let area = |i: u32| match scene.triangle(i) {
            Some([a, b, c]) => (b - a).cross(c - a).length() / 2.0,
            None => {
                let half = scene.geometry.cube_of(i).map_or(0.0, |cube| cube.half);
                24.0 * half * half
            }
        };
        let primitives = scene.numbers() as u32;
        let total: f64 = (0..primitives).map(area).sum();
        let per_area = if total > 0.0 { count as f64 / total } else { 0.0 };
        let stream = Stream::new(0, Purpose::Material);
        let (mut points, mut classes, mut parts) = (Vec::new(), Vec::new(), Vec::new());
        let mut due = 0.0;
        for i in 0..primitives {
            due += area(i) * per_area;
            let mut number = 0;
            while due >= 1.0 {
                due -= 1.0;
                let index = i - scene.geometry.missing_before(i as usize) as u32;
                let random = |component| stream.uniform(index, number, component);
                points.push(point_on(self, i, [random(0), random(1), random(2)]) + scene.shift);
                classes.push(scene.material_of(i).classification);
                parts.push(scene.part_of(i) as i32);
                number += 1;
            }
        }
        let axis = |axis: usize| Arc::new(points.iter().map(|p| p[axis]).collect::<Float64Array>());
        let columns: [(&str, Arc<dyn ::arrow_array::Array>); 5] = [
            ("X", axis(0)),
            ("Y", axis(1)),
            ("Z", axis(2)),
            ("Classification", Arc::new(Int32Array::from(classes))),
            ("ObjectId", Arc::new(Int32Array::from(parts))),
        ];
        RecordBatch::try_from_iter(columns).map_err(|e| Error::Internal(format!("Arrow: {e}")))
    }
}

/// A point on primitive `i`, scene frame; the random numbers are uniform from 0 to 1.
fn point_on(loaded: &LoadedScene, i: u32, [u, v, w]: [f64; 3]) -> DVec3 {
    let scene = loaded.scene();
    if let Some([a, b, c]) = scene.triangle(i) {
        let (u, v) = if u + v > 1.0 { (1.0 - u, 1.0 - v) } else { (u, v) };
        return a + (b - a) * u + (c - a) * v;
    }
    let Some(cube) = scene.geometry.cube_of(i) else { return DVec3::ZERO };
    let side = (w * 6.0) as usize % 6;
    let mut offset = DVec3::new(2.0 * u - 1.0, 2.0 * v - 1.0, 0.0);
    offset[2] = if side.is_multiple_of(2) { 1.0 } else { -1.0 };
    let turned = [offset, DVec3::new(offset.z, offset.x, offset.y), DVec3::new(offset.y, offset.z, offset.x)];
    cube.centre + turned[side / 2] * cube.half
}
