//! The loaded scene, which workers share.

use super::coincident::repeated_triangles;
use super::colours::Colours;
use super::grid_voxels::{GridSurfaces, GridVoxels};
use super::instance_set::InstanceSet;
use super::lad::LadTable;
use super::material::Material;
use super::surfaces::{Surface, SurfaceIds};
use super::tiles::Tiles;
use super::voxel::Voxel;
use std::ops::Range;
use std::path::PathBuf;
use std::sync::Arc;
use vlscan_base::corrections::Corrections;
use vlscan_base::store::vec_bytes;
use vlscan_geom::{Aabb, DVec3};
use vlscan_survey::{MotionSequence, MotionTiming};
use vlscan_trace::{BuildOptions, Builder, Cube, Geometry, HeightField, Hit, PrimitiveRef, Tree, VoxelGrid};

/// A loaded scene. Its frame is the world frame minus [`Scene::shift`], the centre of the box around all
/// primitives, so that large world coordinates lose no digits. Immutable once built.
#[derive(Clone, Debug, Default)]
pub struct Scene {
    /// World position of the local origin, m.
    pub shift: DVec3,
    /// Box around all primitives, local frame, m.
    pub bounds: Aabb,
    /// Primitives, local frame, m.
    pub geometry: Geometry,
    /// The index in `surfaces` of each stored primitive: of the triangles, then of the stored cubes.
    pub surface_ids: SurfaceIds,
    /// The index in `surfaces` of each height field.
    pub field_surfaces: Vec<u32>,
    /// Distinct (part, material) pairs.
    pub surfaces: Vec<Surface>,
    /// Parts in document order.
    pub parts: Vec<Part>,
    /// Materials of all parts.
    pub materials: Vec<Material>,
    /// Attributes of the stored cubes, parallel to `geometry.cubes`.
    pub voxels: Vec<Voxel>,
    /// Attributes and surfaces of the voxels of grids, parallel to `geometry.grids`.
    pub grid_voxels: Vec<GridVoxels>,
    /// Moving parts in document order; their primitives in the fields above are in the initial pose.
    pub moving_parts: Vec<MovingPart>,
    /// Instances of shared meshes, if any; their triangle indices continue after the primitives of
    /// `geometry`. Moving parts are never instances.
    pub instances: Option<InstanceSet>,
    /// Parts that are in memory only while rays need them, if any; their primitives are numbered after those
    /// of `geometry` and of instances.
    pub tiles: Option<Arc<Tiles>>,
    /// Colours of its surfaces, if they were requested; those of tiles are in the scenes of the tiles.
    pub colours: Option<Arc<Colours>>,
    /// Number of simulation steps between updates of the moving parts.
    pub dyn_step: u32,
    /// Time between updates, s; overrides all step counts.
    pub dyn_time_step: Option<f64>,
    /// Coordinate reference system that its files name, as WKT.
    pub crs: Option<String>,
    /// Rules that change its materials or leaf angle tables.
    pub relevant_rules: Corrections,
    /// Files that it was loaded from, except those named in its description.
    pub sources: Vec<PathBuf>,
    /// The tree of a packed scene.
    pub packed_tree: Option<PackedTree>,
    /// The sizes of a packed scene.
    pub packed_sizes: Option<Sizes>,
}

/// Result of [`Scene::sizes`], which reads all vertices and cubes.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Sizes {
    /// True if all primitives that are stored in the scene, those of moving parts in their initial pose, lie
    /// within its bounds: parts that were moved to the ground need not.
    pub are_within_bounds: bool,
    /// Edge of the largest cube, m; 0 without cubes.
    pub max_cube: f64,
}

/// A tree that was stored in a pack.
#[derive(Clone, Debug)]
pub struct PackedTree {
    /// The build strategy that the tree was built with.
    pub builder: Builder,
    /// The tree over all static primitives.
    pub tree: Arc<Tree>,
}

/// A part that moves during the survey, see [`MotionPlan`](super::MotionPlan).
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct MovingPart {
    /// Index in [`Scene::parts`].
    pub part: u32,
    /// Its vertices, which no other part uses.
    pub vertices: Range<usize>,
    /// Its triangles, as indices among the stored ones.
    pub triangles: Range<usize>,
    /// Its cubes, as indices among the stored ones.
    pub cubes: Range<usize>,
    /// The sequences of motions that it performs.
    pub motions: Vec<MotionSequence>,
    /// Update intervals of the pose and of the tree.
    pub timing: MotionTiming,
}

/// A part of the scene, identified by the object id of returns.
#[derive(Clone, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Part {
    /// Reported id, normally a number as text.
    pub id: String,
    /// Name of its first file without the extension.
    pub name: String,
    /// Leaf angle table of its voxels, if it has one; it changes the law for the strength of their returns
    /// (spec pulse-physics §3.5).
    pub lad: Option<Arc<LadTable>>,
}

impl Scene {
    /// The tree over all static primitives and all instances. A packed scene contains the tree of one
    /// builder.
    pub fn tree(&self, options: &BuildOptions) -> Arc<Tree> {
        let default = BuildOptions::of(options.builder);
        // The other settings apply to kd-trees.
        let is_default = options.builder == Builder::Bvh
            || *options == BuildOptions { jobs: options.jobs, delegate: options.delegate, ..default };
        if let Some(ready) = self.packed_tree.as_ref().filter(|r| is_default && r.builder == options.builder)
        {
            return ready.tree.clone();
        }
        let tree = self.tree_of_stored(options);
        Arc::new(match &self.instances {
            Some(set) => tree.with_instances(&set.instances, options),
            None => tree,
        })
    }

    /// The tree over the static primitives that are stored, without triangles that repeat an earlier one.
    pub(crate) fn tree_of_stored(&self, options: &BuildOptions) -> Tree {
        let surface = |i| {
            let surface = self.surface(i);
            (surface.part, surface.material)
        };
        let repeated = repeated_triangles(&self.geometry, surface);
        Tree::build_where(&self.geometry, options, |i| self.is_still(i) && !repeated.contains(&i))
    }

    /// Approximate memory of [`Scene::tree`], bytes, see [`Tree::estimate_build_memory`]; each model of
    /// instances has a tree.
    pub fn tree_forecast(&self, builder: Builder) -> u64 {
        let set = self.instances.as_ref().map_or(0, |p| {
            let models = p.instances.models.iter().map(|m| m.geometry.len() as u64).sum::<u64>();
            Tree::estimate_build_memory(models, builder)
                + Tree::estimate_build_memory(p.instances.all.len() as u64, Builder::Bvh)
        });
        match &self.packed_tree {
            Some(_) => 0,
            None => {
                let g = &self.geometry;
                let stored = g.triangles.len() + g.cubes.len() + g.grids.len();
                Tree::estimate_build_memory(stored as u64, builder).saturating_add(set)
            }
        }
    }

    /// Number of primitives, including the triangles of instances and the primitives of tiles.
    pub fn primitives(&self) -> usize {
        let in_tiles = self.tiles.as_ref().map_or(0, |tiles| tiles.primitives());
        self.numbers() - self.geometry.missing_before(self.geometry.triangle_count()) + in_tiles
    }

    /// Count of the numbers of primitives outside of tiles: one for each primitive, and for each missing
    /// triangle of a height field.
    pub fn numbers(&self) -> usize {
        self.geometry.len() + self.instances.as_ref().map_or(0, |p| p.instances.triangles() as usize)
    }

    /// The sizes of its primitives. A packed scene contains them, so that runs read only what their pulses
    /// meet.
    pub fn sizes(&self) -> Sizes {
        self.packed_sizes.unwrap_or_else(|| {
            let (b, g) = (self.bounds, &self.geometry);
            let within = |p: DVec3, half: f64| (p - half).cmpge(b.min).all() && (p + half).cmple(b.max).all();
            let fields = g.fields.iter().map(HeightField::bounds).filter(|of_field| !of_field.is_empty());
            let tiles = self.tiles.iter().flat_map(|tiles| tiles.facts());
            let in_tiles = tiles.clone().fold(0.0, |max, tile| f64::max(max, tile.max_cube));
            Sizes {
                are_within_bounds: g.vertices.iter().all(|v| within(*v, 0.0))
                    && fields.into_iter().all(|f| within(f.min, 0.0) && within(f.max, 0.0))
                    && g.grids
                        .iter()
                        .map(VoxelGrid::bounds)
                        .all(|of| within(of.min, 0.0) && within(of.max, 0.0))
                    && tiles.into_iter().all(|t| within(t.bounds.min, 0.0) && within(t.bounds.max, 0.0))
                    && g.cubes.iter().all(|c| within(c.centre, c.half)),
                max_cube: g
                    .cubes
                    .iter()
                    .map(|cube| cube.half)
                    .chain(g.grids.iter().map(|grid| grid.place().half))
                    .fold(in_tiles, |max, half| f64::max(max, half * 2.0)),
            }
        })
    }

    /// Part and material of primitive `i`. Panics if the index is out of range.
    #[inline]
    pub fn surface(&self, i: u32) -> Surface {
        let surface = self.primitive(i).and_then(|primitive| self.surface_of(primitive));
        surface.unwrap_or_else(|| panic!("primitive {i} of {}", self.primitives()))
    }

    /// The corners of primitive `i` if it is an existing triangle.
    #[inline]
    pub fn triangle(&self, i: u32) -> Option<[DVec3; 3]> {
        self.corners_of(self.primitive(i)?)
    }

    /// The first hit of a ray on the scene, with its tiles, among the primitives that `accept` accepts, each
    /// as a scene and its number there. `tree` is that of [`Scene::tree`]. A tile that cannot be loaded is
    /// reported by [`Tiles::check`].
    pub fn nearest_where(
        &self,
        tree: &Tree,
        origin: DVec3,
        direction: DVec3,
        accept: impl Fn(&Scene, u32) -> bool,
    ) -> Option<Hit> {
        let hit = tree.nearest_where(&self.geometry, origin, direction, |i| accept(self, i));
        match &self.tiles {
            Some(tiles) => tiles.nearest(self, (origin, direction), hit, accept),
            None => hit,
        }
    }

    /// The index of primitive `i` in the same scene without instances, height fields and tiles, where
    /// primitives are in the order of their parts, cubes last.
    #[inline]
    pub fn number_when_stored(&self, i: u32) -> u32 {
        match &self.tiles {
            Some(tiles) => tiles.number_when_stored(self, i, |i| self.number_without_tiles(i)),
            None => self.number_without_tiles(i),
        }
    }

    pub(crate) fn number_without_tiles(&self, i: u32) -> u32 {
        let Some(set) = &self.instances else { return i - self.missing_before(i) };
        let (number, before) = set.instances.number_when_stored(i, self.geometry.triangle_count());
        number - self.missing_before(before)
    }

    /// How many triangles of height fields before primitive `i` are missing.
    fn missing_before(&self, i: u32) -> u32 {
        self.geometry.missing_before(i as usize) as u32
    }

    /// The material of primitive `i`.
    pub fn material_of(&self, i: u32) -> &Material {
        &self.materials[self.surface(i).material as usize]
    }

    /// The part of primitive `i`.
    pub fn part_of(&self, i: u32) -> u32 {
        self.surface(i).part
    }

    /// The attributes of primitive `i` if it is a cube.
    pub fn voxel(&self, i: u32) -> Option<Voxel> {
        match self.primitive(i)? {
            PrimitiveRef::Cube(index) => self.voxels.get(index).copied(),
            PrimitiveRef::Grid { grid, voxel } => Some(self.grid_voxels[grid].get(voxel)),
            _ => None,
        }
    }

    /// The attributes of primitive `i` and the cube, if it is one.
    #[inline]
    pub fn voxel_and_cube(&self, i: u32) -> Option<(Voxel, Cube)> {
        self.voxel_of(self.primitive(i)?)
    }

    /// Converts a point from the local to the world frame.
    pub fn to_world(&self, p: DVec3) -> DVec3 {
        p + self.shift
    }

    /// Converts a point from the world to the local frame.
    pub fn to_local(&self, p: DVec3) -> DVec3 {
        p - self.shift
    }

    /// True if primitive `i` is static.
    pub fn is_still(&self, i: u32) -> bool {
        let moving = &self.moving_parts;
        moving.is_empty()
            || match self.geometry.primitive(i as usize) {
                Some(PrimitiveRef::Triangle(index)) => !moving.iter().any(|m| m.triangles.contains(&index)),
                Some(PrimitiveRef::Cube(index)) => !moving.iter().any(|m| m.cubes.contains(&index)),
                _ => true,
            }
    }

    /// Memory of the scene without its tree, bytes.
    pub fn memory(&self) -> usize {
        let names = self.materials.iter().map(|m| m.name.capacity()).sum::<usize>()
            + self.parts.iter().map(|p| p.id.capacity()).sum::<usize>();
        size_of::<Scene>()
            + names
            + self.instances.as_ref().map_or(0, InstanceSet::memory)
            + self.tiles.as_ref().map_or(0, |tiles| tiles.memory())
            + self.colours.as_ref().map_or(0, |colours| colours.memory())
            + vec_bytes(&self.geometry.vertices)
            + vec_bytes(&self.geometry.triangles)
            + vec_bytes(&self.geometry.cubes)
            + vec_bytes(&self.voxels)
            + self.geometry.grids.iter().map(VoxelGrid::memory).sum::<usize>()
            + self.grid_voxels.iter().map(GridVoxels::memory).sum::<usize>()
            + self.geometry.fields.iter().map(HeightField::memory).sum::<usize>()
            + self.surface_ids.memory()
            + self.surfaces.capacity() * size_of::<Surface>()
            + self.parts.capacity() * size_of::<Part>()
            + self.materials.capacity() * size_of::<Material>()
    }

    /// Height of the ground at (x, y), local frame, m: the lowest surface whose material is ground; for a
    /// cube its upper face (spec kinematics §2.7). `None` where there is no ground. Visits every primitive
    /// once.
    pub fn ground_height(&self, x: f64, y: f64) -> Option<f64> {
        self.lowest_ground(x, y).map(|(_, height)| height)
    }

    /// The height by which the lowest ground is found, and that of the ground.
    fn lowest_ground(&self, x: f64, y: f64) -> Option<(f64, f64)> {
        let is_ground_material: Vec<bool> = self.materials.iter().map(|m| m.is_ground).collect();
        let is_ground: Vec<bool> =
            self.surfaces.iter().map(|s| is_ground_material[s.material as usize]).collect();
        let ground = |i: usize| self.surface_ids.get(i).is_some_and(|s| is_ground[s as usize]);
        let count = self.geometry.triangles.len();
        // For each primitive, the height to compare and the height to return.
        let triangles = (0..count).filter(|&i| ground(i)).filter_map(|i| {
            let z = height_in_triangle(self.geometry.stored_triangle(i), x, y)?;
            Some((z, z))
        });
        let fields =
            self.geometry.fields.iter().zip(&self.field_surfaces).filter(|(_, s)| is_ground[**s as usize]);
        let in_fields = fields.flat_map(|(field, _)| {
            let near = field.triangles_near(x, y).filter_map(|i| field.triangle(i));
            near.filter_map(|corners| height_in_triangle(corners, x, y))
        });
        let g = &self.geometry;
        let first_cube = g.triangle_count();
        let is_ground_cube = |index: &usize| {
            let surface = g.primitive(first_cube + *index).and_then(|cube| self.surface_of(cube));
            surface.is_some_and(|surface| is_ground_material[surface.material as usize])
        };
        let cubes = g.cubes_in(0..g.cubes.len(), 0..g.grids.len()).enumerate().filter_map(|(index, c)| {
            let within = (c.centre.x - x).abs() <= c.half && (c.centre.y - y).abs() <= c.half;
            (within && is_ground_cube(&index)).then_some((c.centre.z - c.half, c.centre.z + c.half))
        });
        triangles
            .chain(in_fields.map(|z| (z, z)))
            .chain(self.instances_over(&is_ground_material, x, y).map(|z| (z, z)))
            .chain(cubes)
            .chain(self.ground_of_tiles(x, y))
            .reduce(|best, next| if next.0 < best.0 { next } else { best })
    }

    /// For each tile, the height of its lowest ground at (x, y) for comparison, and the height to return.
    fn ground_of_tiles(&self, x: f64, y: f64) -> Vec<(f64, f64)> {
        let Some(tiles) = &self.tiles else { return Vec::new() };
        let is_ground = |m: &u32| self.materials[*m as usize].is_ground;
        let below = tiles.facts().iter().enumerate().filter(|(_, tile)| {
            let b = &tile.bounds;
            let is_over = (b.min.x..=b.max.x).contains(&x) && (b.min.y..=b.max.y).contains(&y);
            is_over && tile.materials.iter().any(is_ground)
        });
        // One after the other, so that one tile has to be in memory at a time.
        below.filter_map(|(i, _)| tiles.read(|reader| reader.get(i)?.scene.lowest_ground(x, y))).collect()
    }
}

impl Scene {
    /// The box of all ground, local frame, m; instances and tiles with ground count with their whole box.
    /// `None` without ground.
    pub fn ground_bounds(&self) -> Option<Aabb> {
        let is_ground: Vec<bool> = self.materials.iter().map(|m| m.is_ground).collect();
        let surfaces: Vec<bool> = self.surfaces.iter().map(|s| is_ground[s.material as usize]).collect();
        let own = self.surface_ids.iter().enumerate().filter(|(_, s)| surfaces[*s as usize]);
        let g = &self.geometry;
        let own = own.map(|(i, _)| match i.checked_sub(g.triangles.len()) {
            None => Aabb::around(g.stored_triangle(i)),
            Some(cube) => g.cubes[cube].bounds(),
        });
        let fields = g.fields.iter().zip(&self.field_surfaces).filter(|(_, s)| surfaces[**s as usize]);
        let own = own.chain(fields.map(|(field, _)| field.bounds()));
        let grids = g.grids.iter().zip(&self.grid_voxels).map(|(grid, voxels)| {
            let is_ground = |i: usize| voxels.surfaces.get(i).is_some_and(|s| surfaces[s as usize]);
            match &voxels.surfaces {
                GridSurfaces::InTurn(all) if all.iter().all(|s| surfaces[*s as usize]) => grid.bounds(),
                GridSurfaces::InTurn(all) if !all.iter().any(|s| surfaces[*s as usize]) => Aabb::EMPTY,
                _ => {
                    let own = grid.cubes().enumerate().filter(|(i, _)| is_ground(*i));
                    own.fold(Aabb::EMPTY, |all, (_, cube)| all.union(cube.bounds()))
                }
            }
        });
        let own = own.chain(grids.filter(|bounds| !bounds.is_empty()));
        let instances = self.instances.iter().flat_map(|set| {
            let has_ground: Vec<bool> =
                set.materials.iter().map(|of| of.iter().any(|&m| is_ground[m as usize])).collect();
            let all = set.instances.all.iter().filter(move |i| has_ground[i.model as usize]);
            all.map(|i| set.instances.exact_bounds_of(i))
        });
        let tiles = self.tiles.iter().flat_map(|tiles| tiles.facts());
        let tiles = tiles.filter(|tile| tile.materials.iter().any(|&m| is_ground[m as usize]));
        own.chain(instances).chain(tiles.map(|tile| tile.bounds)).reduce(Aabb::union)
    }

    /// Heights over (x, y) of the triangles of instances whose material is one of `included`.
    fn instances_over(&self, included: &[bool], x: f64, y: f64) -> impl Iterator<Item = f64> {
        self.instances.iter().flat_map(move |set| {
            let has_included: Vec<bool> =
                set.materials.iter().map(|of| of.iter().any(|&m| included[m as usize])).collect();
            let instances = &set.instances;
            let below =
                instances.all.iter().filter(move |i| has_included[i.model as usize]).filter(move |i| {
                    let b = instances.bounds_of(i);
                    (b.min.x..=b.max.x).contains(&x) && (b.min.y..=b.max.y).contains(&y)
                });
            below.flat_map(move |instance| {
                let materials = set.materials[instance.model as usize].iter().enumerate();
                materials
                    .filter(|(_, m)| included[**m as usize])
                    .filter_map(move |(k, _)| height_in_triangle(instances.corners(instance, k), x, y))
            })
        })
    }
}

/// Height of a triangle over (x, y); its edges belong to it, so that neighbours have no gap between them.
fn height_in_triangle(corners: [DVec3; 3], x: f64, y: f64) -> Option<f64> {
    let [a, b, c] = corners.map(|p| (p.x - x, p.y - y));
    // Swapping the two points only changes the sign, so neighbours agree on their common edge.
    let side = |p: (f64, f64), q: (f64, f64)| p.0 * q.1 - p.1 * q.0;
    let (wa, wb, wc) = (side(b, c), side(c, a), side(a, b));
    let inside = (wa >= 0.0 && wb >= 0.0 && wc >= 0.0) || (wa <= 0.0 && wb <= 0.0 && wc <= 0.0);
    let area = wa + wb + wc;
    (inside && area != 0.0).then(|| (wa * corners[0].z + wb * corners[1].z + wc * corners[2].z) / area)
}

#[cfg(test)]
mod tests;
