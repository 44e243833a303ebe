//! Counts the contents of a scene.

use super::{Scene, Surface};
use rayon::prelude::*;
use std::hash::{DefaultHasher, Hash, Hasher};
use vlscan_geom::{Aabb, DVec3};
use vlscan_trace::Geometry;

/// Maximum height of a sliver over its longest edge, relative to that edge.
const MAX_SLIVER_RATIO: f64 = 1e-6;

/// Numbers of primitives, instances and defects of a scene.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Inventory {
    /// Stored triangles, without the triangles of instances.
    pub triangles: u64,
    /// Triangles of all instances, each shared mesh counted once per instance.
    pub instanced_triangles: u64,
    /// Cubes: voxels and cubes of point clouds.
    pub cubes: u64,
    /// Number of instances.
    pub instances: u64,
    /// Meshes shared by instances.
    pub models: u64,
    /// Box around all primitives, world frame, m.
    pub bounds: Aabb,
    /// Number of primitives of each part.
    pub of_part: Vec<u64>,
    /// Number of primitives of each material.
    pub of_material: Vec<u64>,
    /// Triangles degenerate to a line, which rays can hardly hit; triangles of shared meshes are counted
    /// once.
    pub slivers: u64,
    /// Triangles with the same corners as another triangle of their mesh, or of their tile.
    pub duplicates: u64,
    /// Voxels with the position and size of another voxel, of their tile if they are in one.
    pub duplicate_cubes: u64,
    /// Instances with the placement of another instance of their mesh.
    pub duplicate_instances: u64,
}

impl Inventory {
    /// Defects of the primitives, a sentence each.
    pub fn faults(&self) -> Vec<String> {
        let faults = [
            (self.slivers, "triangles are almost lines; rays can hardly hit them"),
            (self.duplicates, "triangles have the same corners as another one"),
            (self.duplicate_cubes, "voxels have the same position and size as another one"),
            (self.duplicate_instances, "instances stand where another instance of the same mesh stands"),
        ];
        faults
            .into_iter()
            .filter(|fault| fault.0 > 0)
            .map(|(count, what)| format!("{count} {what}"))
            .collect()
    }

    /// Counts the contents of a scene by visiting every stored primitive. A tile that cannot be loaded is
    /// reported by [`Tiles::check`](crate::Tiles::check).
    pub fn of(scene: &Scene) -> Inventory {
        let fields = || scene.geometry.fields.iter().zip(&scene.field_surfaces);
        let in_fields = fields().map(|(field, _)| field.triangles() as u64).sum::<u64>();
        let mut all = Inventory {
            triangles: scene.geometry.triangles.len() as u64 + in_fields,
            cubes: scene.geometry.cube_count() as u64,
            bounds: scene.bounds.translated(scene.shift),
            of_part: vec![0; scene.parts.len()],
            of_material: vec![0; scene.materials.len()],
            ..Inventory::default()
        };
        let stored = scene.surface_ids.iter().map(|surface| (surface, 1));
        let grids = scene.geometry.grids.iter().zip(&scene.grid_voxels);
        let in_grids = grids.flat_map(|(grid, voxels)| voxels.surfaces.counts(grid.len()));
        let in_fields = fields().map(|(field, &s)| (s, field.triangles() as u64));
        for (surface, count) in stored.chain(in_fields).chain(in_grids) {
            let Surface { part, material } = scene.surfaces[surface as usize];
            all.of_part[part as usize] += count;
            all.of_material[material as usize] += count;
        }
        all.add_faults(&scene.geometry);
        let Geometry { cubes, grids, .. } = &scene.geometry;
        // The voxels of one grid have separate places.
        if !(grids.len() == 1 && cubes.is_empty()) {
            let cubes = scene.geometry.cubes_in(0..cubes.len(), 0..grids.len());
            all.duplicate_cubes =
                repeated(cubes.map(|c| bits(&[c.centre.x, c.centre.y, c.centre.z, c.half])).collect());
        }
        if let Some(tiles) = &scene.tiles {
            tiles.for_each(
                |_| true,
                |facts, tile| {
                    let of_tile = Inventory::of(&tile.scene);
                    all.triangles += of_tile.triangles;
                    all.cubes += of_tile.cubes;
                    all.slivers += of_tile.slivers;
                    all.duplicates += of_tile.duplicates;
                    all.duplicate_cubes += of_tile.duplicate_cubes;
                    all.of_part[facts.part as usize] += of_tile.primitives();
                    for (material, count) in facts.materials.iter().zip(of_tile.of_material) {
                        all.of_material[*material as usize] += count;
                    }
                },
            );
        }
        let Some(set) = &scene.instances else { return all };
        all.instanced_triangles = u64::from(set.instances.triangles());
        all.instances = set.instances.all.len() as u64;
        all.models = set.instances.models.len() as u64;
        let mut uses = vec![0u64; set.materials.len()];
        for (instance, &part) in set.instances.all.iter().zip(&set.parts) {
            uses[instance.model as usize] += 1;
            all.of_part[part as usize] += set.materials[instance.model as usize].len() as u64;
        }
        for (materials, uses) in set.materials.iter().zip(uses) {
            materials.iter().for_each(|&m| all.of_material[m as usize] += uses);
        }
        set.instances.models.iter().for_each(|m| all.add_faults(&m.geometry));
        let places = set.instances.all.iter().map(|i| {
            let (p, r) = (i.placement, i.placement.rotation);
            let (o, factors) = (p.offset, [p.widening, p.scale]);
            let map = [r.w, r.u.x, r.u.y, r.u.z, factors[0], factors[1], o.x, o.y, o.z, p.raise];
            (i.model, bits(&map))
        });
        all.duplicate_instances = repeated(places.collect());
        all
    }

    /// Number of all primitives, including the triangles of instances.
    pub fn primitives(&self) -> u64 {
        self.triangles + self.instanced_triangles + self.cubes
    }

    /// Describes the likely coordinate system of the scene.
    pub fn coordinates(&self) -> &'static str {
        let (min, max) = (self.bounds.min, self.bounds.max);
        let within =
            |lo: [f64; 2], hi: [f64; 2]| min.x >= lo[0] && min.y >= lo[1] && max.x <= hi[0] && max.y <= hi[1];
        let size = self.bounds.size();
        if within([-180.0, -90.0], [180.0, 90.0]) && size.x < 1.0 && size.y < 1.0 && size.z > 10.0 * size.x {
            "perhaps degrees: the scene is flat sideways; vlscan takes metres"
        } else if within([100_000.0, 0.0], [900_000.0, 10_000_000.0]) && min.y > 10_000.0 {
            "projected, UTM or alike; name it with --crs"
        } else if min.abs().max(max.abs()).max_element() > 100_000.0 {
            "projected, far from the origin; name it with --crs"
        } else {
            "local"
        }
    }

    fn add_faults(&mut self, geometry: &Geometry) {
        let Geometry { triangles, fields, .. } = geometry;
        let numbers = |count: usize| (0..count).into_par_iter().with_min_len(4096);
        let stored = || numbers(triangles.len()).map(|i| geometry.stored_triangle(i));
        let in_fields =
            || fields.par_iter().flat_map(|field| numbers(field.len()).filter_map(|i| field.triangle(i)));
        self.slivers += stored().chain(in_fields()).filter(is_sliver).count() as u64;
        // The triangles of one field have separate places.
        let is_one_field = fields.len() == 1 && triangles.is_empty();
        if !is_one_field {
            self.duplicates += repeated(stored().chain(in_fields()).map(fingerprint).collect());
        }
    }
}

/// Number of elements that equal a previous one.
fn repeated<T: Ord + Send>(mut all: Vec<T>) -> u64 {
    all.par_sort_unstable();
    all.windows(2).filter(|w| w[0] == w[1]).count() as u64
}

/// Bit patterns for comparison; −0 becomes 0.
fn bits<const N: usize>(numbers: &[f64; N]) -> [u64; N] {
    numbers.map(|x| (x + 0.0).to_bits())
}

fn is_sliver([a, b, c]: &[DVec3; 3]) -> bool {
    let longest = (*b - *a).length_squared().max((*c - *b).length_squared()).max((*a - *c).length_squared());
    (*b - *a).cross(*c - *a).length() <= MAX_SLIVER_RATIO * longest
}

/// A hash that is equal for triangles with the same corners in any order; the probability of a collision is
/// 2⁻⁶⁴.
fn fingerprint(corners: [DVec3; 3]) -> u64 {
    let mut bits = corners.map(|p| (p + DVec3::ZERO).to_array().map(f64::to_bits));
    bits.sort_unstable();
    let mut hasher = DefaultHasher::new();
    bits.hash(&mut hasher);
    hasher.finish()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Sharing;
    use crate::fixture::Fixture;
    use vlscan_trace::Cube;

    const MESH: &str = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 1 1e-9 0\nf 1 2 3\nf 3 1 2\nf 1 2 4\nf 2 4 3\n";

    #[test]
    fn everything_is_counted_however_it_is_kept() {
        let mut f = Fixture::new();
        f.obj("a.obj", MESH).transform.offset = DVec3::new(500_000.0, 5_000_000.0, 0.0);
        f.obj("a.obj", MESH).transform.offset = DVec3::new(500_010.0, 5_000_000.0, 0.0);
        for (sharing, times) in [(Sharing::Never, 2), (Sharing::Always, 1)] {
            f.options.sharing = sharing;
            let all = Inventory::of(&f.load().unwrap().0);
            assert_eq!(
                (all.primitives(), &all.of_part[..], &all.of_material[..]),
                (8, &[4, 4][..], &[8][..])
            );
            assert_eq!((all.slivers, all.duplicates, all.duplicate_instances), (2 * times, times, 0));
            assert_eq!(all.bounds.size(), DVec3::new(11.0, 1.0, 0.0));
            assert!(all.coordinates().starts_with("projected, UTM"));
        }
    }

    #[test]
    fn duplicates_are_counted() {
        let mut f = Fixture::new();
        for x in [0.0, 5.0, 0.0] {
            f.obj("a.obj", MESH).transform.offset = DVec3::X * x;
        }
        f.options.sharing = Sharing::Always;
        assert_eq!(Inventory::of(&f.load().unwrap().0).duplicate_instances, 1);
        f.options.sharing = Sharing::Never;
        let mut scene = f.load().unwrap().0;
        assert_eq!(Inventory::of(&scene).duplicates, 3 + 3, "one in each, and the whole of one");
        let cube = Cube { centre: DVec3::ONE, half: 0.5 };
        scene.geometry.cubes = vec![cube, Cube { half: 0.25, ..cube }, cube];
        assert_eq!(Inventory::of(&scene).duplicate_cubes, 1);
    }
}
