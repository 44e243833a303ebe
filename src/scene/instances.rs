//! Parts of the same mesh share it: when they are many or large, the mesh is kept once, as a model, and every part is an
//! instance of it.

use super::assembly::{Assembly, MAX_COORDINATE, MAX_ELEMENTS};
use super::ground;
use super::library::Names;
use super::{Surface, epoch, load};
use crate::error::{Error, Result};
use crate::geom::DVec3;
use crate::store::Store;
use crate::survey::{Loader, PartRecipe, SceneRecipe, Transform, UpAxis};
use crate::tree::{Geometry, Instances, Model, Placement};
use std::collections::HashMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// When parts share the mesh of a file that several of them name. The points are the same.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Sharing {
    /// When it saves much memory: what is stored in one piece is traced faster.
    #[default]
    Auto,
    /// Whenever a mesh can be shared, even by a single part.
    Always,
    /// Never: every part is stored.
    Never,
}

/// Bytes of OBJ text that need not be stored again from which on [`Sharing::Auto`] shares a file.
const MUCH: u64 = 64 << 20;

/// The instances of a scene.
#[derive(Clone, Debug, Default)]
pub struct InstanceSet {
    /// Meshes and places.
    pub instances: Arc<Instances>,
    /// The material of each triangle of each model.
    pub materials: Vec<Store<u32>>,
    /// The part that each instance is.
    pub parts: Vec<u32>,
}

impl InstanceSet {
    /// What triangle `i` belongs to and is made of; `None` for a primitive that is stored.
    pub fn surface(&self, i: u32) -> Option<Surface> {
        let (instance, triangle) = self.instances.locate(i)?;
        let model = self.instances.all[instance].model as usize;
        Some(Surface { part: self.parts[instance], material: self.materials[model][triangle] })
    }

    /// Bytes that it occupies.
    pub fn memory(&self) -> usize {
        self.instances.memory()
            + self.materials.iter().map(Store::memory).sum::<usize>()
            + self.parts.capacity() * size_of::<u32>()
    }
}

/// A mesh file as it is read.
type Key = (PathBuf, bool);

/// Models and instances as far as they are loaded.
#[derive(Default)]
pub(super) struct Stock {
    /// Files that are shared, with the number of the model once it is read.
    shared: HashMap<Key, Option<u32>>,
    /// Meshes in their own frames.
    pub models: Vec<Arc<Model>>,
    /// Materials of their triangles.
    pub materials: Vec<Vec<u32>>,
    /// Model, triangles stored before it, placement.
    pub places: Vec<(u32, u32, Placement)>,
    /// The part of each.
    pub parts: Vec<u32>,
}

impl Stock {
    /// Finds the files that are to be shared in an epoch.
    pub fn plan(&mut self, recipe: &SceneRecipe, epoch: u32, sharing: Sharing) {
        let mut users: HashMap<Key, u64> = HashMap::new();
        let parts = recipe.parts.iter().filter_map(|part| epoch::part_in_epoch(part, epoch));
        for key in parts.filter_map(|part| key_of(&part)) {
            *users.entry(key).or_default() += 1;
        }
        let wanted = |(path, _): &Key, users: u64| match sharing {
            Sharing::Never => false,
            Sharing::Always => true,
            Sharing::Auto => {
                let size = std::fs::metadata(path).map_or(0, |about| about.len());
                (users - 1).saturating_mul(size) >= MUCH
            }
        };
        self.shared = users.into_iter().filter(|(k, n)| wanted(k, *n)).map(|(k, _)| (k, None)).collect();
    }

    /// Bytes of the models.
    pub fn memory(&self) -> u64 {
        self.models.iter().map(|m| m.memory() as u64).sum::<u64>()
            + self.materials.iter().map(|m| 4 * m.len() as u64).sum::<u64>()
            + (self.places.len() * size_of::<(u32, u32, Placement)>()) as u64
    }

    /// The corners of all triangles of an instance, one after the other, in the world's frame.
    pub fn corners(&self, instance: usize) -> impl Iterator<Item = DVec3> {
        let (model, _, placement) = self.places[instance];
        let geometry = &self.models[model as usize].geometry;
        (0..geometry.triangles.len())
            .flat_map(move |i| geometry.triangle(i).map(|p| placement.place(p, DVec3::ZERO)))
    }
}

/// The file of a part that may share it: one OBJ file, of a part that stays where it is.
fn key_of(part: &PartRecipe) -> Option<Key> {
    match &part.loader {
        _ if !part.motions.is_empty() => None,
        Loader::Obj { files, up } => match &files[..] {
            [file] => Some((file.clone(), *up == UpAxis::Y)),
            _ => None,
        },
        _ => None,
    }
}

/// Makes the next part an instance if its file is shared; `None` if it is to be stored. The instance has a number
/// unless its mesh is empty.
pub(super) fn place(scene: &mut Assembly, part: &PartRecipe) -> Result<Option<Option<usize>>> {
    let Some(key) = key_of(part) else { return Ok(None) };
    let model = match scene.stock.shared.get(&key) {
        None => return Ok(None),
        Some(Some(model)) => *model,
        Some(None) => {
            let model = read_model(scene, part, &key.0)?;
            scene.stock.shared.insert(key, Some(model));
            model
        }
    };
    let stock = &mut scene.stock;
    if stock.models[model as usize].geometry.triangles.is_empty() {
        return Ok(Some(None));
    }
    stock.places.push((model, scene.geometry.triangles.len() as u32, placement(&part.transform)));
    stock.parts.push(scene.parts.len() as u32);
    Ok(Some(Some(stock.places.len() - 1)))
}

fn placement(t: &Transform) -> Placement {
    Placement { rotation: t.rotation, scale: t.scale, offset: t.offset, ..Placement::IDENTITY }
}

/// Loads a file as if to store it and takes it out again.
fn read_model(scene: &mut Assembly, part: &PartRecipe, file: &Path) -> Result<u32> {
    let start = scene.end();
    let unmoved = PartRecipe { transform: Transform::IDENTITY, ..part.clone() };
    load::load_files(scene, &unmoved, &[file.to_path_buf()], &mut Names::default())?;
    let first = start.vertices.start as u32;
    let mut triangles = scene.geometry.triangles.split_off(start.triangles.start);
    triangles.iter_mut().for_each(|t| *t = t.map(|v| v - first));
    let vertices = scene.geometry.vertices.split_off(start.vertices.start);
    let surfaces = scene.triangle_surfaces.split_off(start.triangles.start);
    let materials = surfaces.iter().map(|&s| scene.surfaces[s as usize].material).collect();
    let model = Model::new(Geometry {
        vertices: vertices.into(),
        triangles: triangles.into(),
        ..Geometry::default()
    });
    scene.stock.models.push(Arc::new(model));
    scene.stock.materials.push(materials);
    Ok(scene.stock.models.len() as u32 - 1)
}

/// Numbers the instances on from the scene's own primitives, in a frame moved by `shift`; `None` when there are none.
pub(super) fn freeze(stock: Stock, own: usize) -> Result<Option<InstanceSet>> {
    if stock.places.is_empty() {
        return Ok(None);
    }
    let total = stock.places.iter().fold(own as u64, |sum, (model, ..)| {
        sum + stock.models[*model as usize].geometry.triangles.len() as u64
    });
    let Some(instances) = Instances::new(stock.models, stock.places, own) else {
        return Err(Error::input(format!(
            "the scene has {total} primitives with all its instances; at most {} can be numbered",
            MAX_ELEMENTS
        )));
    };
    Ok(Some(InstanceSet {
        instances: Arc::new(instances),
        materials: stock.materials.into_iter().map(Store::from).collect(),
        parts: stock.parts,
    }))
}

/// Whether an instance is certainly within [`MAX_COORDINATE`].
pub(super) fn is_near(stock: &Stock, instance: usize) -> bool {
    let (model, _, placement) = stock.places[instance];
    placement.magnitude(DVec3::ZERO, stock.models[model as usize].reach()) <= MAX_COORDINATE
}

/// The box around an instance in the world's frame, exactly.
pub(super) fn bounds(stock: &Stock, instance: usize) -> crate::geom::Aabb {
    let (model, _, placement) = stock.places[instance];
    ground::bounds_of_points(&stock.models[model as usize].geometry.vertices, |v| {
        placement.place(v, DVec3::ZERO)
    })
}
