//! What the parts of a scene are and where: for tables beside labelled points.

use super::{Scene, TileFacts};
use std::collections::BTreeMap;
use vlscan_geom::Aabb;

/// Facts about one part.
#[derive(Clone, Debug, PartialEq)]
pub struct PartFacts {
    /// Box around its primitives, world frame, m; moving parts are in their initial pose. Empty for a part without primitives. In
    /// scenes with very many vertices of instances the boxes of these reach a little further.
    pub bounds: Aabb,
    /// Number of primitives, including the triangles of instances.
    pub primitives: u64,
    /// Indices in [`Scene::materials`], that of most primitives first.
    pub materials: Vec<u32>,
}

/// Vertices of instances that are placed one by one.
const MAX_PLACED_VERTICES: u64 = 1 << 30;

impl PartFacts {
    /// Facts about every part of a scene, in order. A tile that cannot be loaded is reported by
    /// [`Tiles::check`](crate::Tiles::check).
    pub fn of_scene(scene: &Scene) -> Vec<PartFacts> {
        PartFacts::placing(scene, MAX_PLACED_VERTICES)
    }

    /// Places up to `most` vertices of instances.
    fn placing(scene: &Scene, most: u64) -> Vec<PartFacts> {
        let facts = |(counts, bounds): (BTreeMap<u32, u64>, Aabb)| {
            let primitives = counts.values().sum();
            let mut counts: Vec<(u32, u64)> = counts.into_iter().collect();
            counts.sort_by_key(|&(_, count)| std::cmp::Reverse(count));
            let materials = counts.into_iter().map(|(material, _)| material).collect();
            PartFacts { bounds: bounds.translated(scene.shift), primitives, materials }
        };
        PartFacts::count(scene, most).into_iter().map(facts).collect()
    }

    /// The number of primitives of each material, and the box, scene frame, of each part.
    fn count(scene: &Scene, most: u64) -> Vec<(BTreeMap<u32, u64>, Aabb)> {
        let mut counts: Vec<BTreeMap<u32, u64>> = vec![BTreeMap::new(); scene.parts.len()];
        let mut bounds = vec![Aabb::EMPTY; scene.parts.len()];
        let (triangles, cubes) = (scene.geometry.triangles.len(), &scene.geometry.cubes);
        for (i, surface) in scene.surface_ids.iter().enumerate() {
            let surface = scene.surfaces[surface as usize];
            let part = surface.part as usize;
            *counts[part].entry(surface.material).or_default() += 1;
            bounds[part] = match i.checked_sub(triangles) {
                None => bounds[part].union(Aabb::around(scene.geometry.stored_triangle(i))),
                Some(cube) => bounds[part].union(cubes[cube].bounds()),
            };
        }
        for (field, &surface) in scene.geometry.fields.iter().zip(&scene.field_surfaces) {
            let surface = scene.surfaces[surface as usize];
            let part = surface.part as usize;
            *counts[part].entry(surface.material).or_default() += field.triangles() as u64;
            bounds[part] = bounds[part].union(field.bounds());
        }
        for (grid, voxels) in scene.geometry.grids.iter().zip(&scene.grid_voxels) {
            for (surface, count) in voxels.surfaces.counts(grid.len()) {
                let surface = scene.surfaces[surface as usize];
                let part = surface.part as usize;
                *counts[part].entry(surface.material).or_default() += count;
                // All voxels of a grid belong to one part.
                bounds[part] = bounds[part].union(grid.bounds());
            }
        }
        if let Some(set) = &scene.instances {
            let of_model = |materials: &[u32]| {
                let mut counts: BTreeMap<u32, u64> = BTreeMap::new();
                materials.iter().for_each(|&material| *counts.entry(material).or_default() += 1);
                counts
            };
            let of_models: Vec<BTreeMap<u32, u64>> = set.materials.iter().map(|of| of_model(of)).collect();
            let vertices = |i| set.instances.model(i).geometry.vertices.len() as u64;
            let is_exact = set.instances.all.iter().map(vertices).sum::<u64>() <= most;
            for (instance, &part) in set.instances.all.iter().zip(&set.parts) {
                let part = part as usize;
                bounds[part] = bounds[part].union(match is_exact {
                    true => set.instances.exact_bounds_of(instance),
                    false => set.instances.bounds_of(instance),
                });
                for (&material, count) in &of_models[instance.model as usize] {
                    *counts[part].entry(material).or_default() += count;
                }
            }
        }
        if let Some(tiles) = &scene.tiles {
            for tile in tiles.facts() {
                let part = tile.part as usize;
                bounds[part] = bounds[part].union(tile.bounds);
                if let [material] = tile.materials[..] {
                    *counts[part].entry(material).or_default() += tile.primitives();
                }
            }
            let has_several = |tile: &TileFacts| tile.materials.len() > 1;
            tiles.for_each(has_several, |facts, tile| {
                for (material, count) in PartFacts::count(&tile.scene, most).into_iter().flat_map(|of| of.0) {
                    let material = facts.materials[material as usize];
                    *counts[facts.part as usize].entry(material).or_default() += count;
                }
            });
        }
        counts.into_iter().zip(bounds).collect()
    }

    /// Point class of most of its primitives; 0 for a part without primitives.
    pub fn class(&self, scene: &Scene) -> i32 {
        let material = self.materials.first().and_then(|&material| scene.materials.get(material as usize));
        material.map_or(0, |material| material.classification)
    }

    /// Names of its materials.
    pub fn material_names<'a>(&self, scene: &'a Scene) -> Vec<&'a str> {
        let names = self.materials.iter().filter_map(|&material| scene.materials.get(material as usize));
        names.map(|material| material.name.as_str()).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Sharing;
    use crate::fixture::Fixture;
    use vlscan_geom::DVec3;

    const MESH: &str =
        "usemtl leaf\nv 0 0 0\nv 1 0 0\nv 0 1 2\nv 1 1 0\nf 1 2 3\nf 2 4 3\nusemtl bark\nf 1 2 4\n";

    #[test]
    fn facts_are_the_same_for_stored_parts_and_instances() {
        let mut f = Fixture::new();
        f.obj("oak.obj", MESH).transform.offset = DVec3::new(500_000.0, 5_000_000.0, 100.0);
        f.obj("oak.obj", MESH).transform.offset = DVec3::new(500_010.0, 5_000_000.0, 90.0);
        for sharing in [Sharing::Never, Sharing::Always] {
            f.options.sharing = sharing;
            let scene = f.load().unwrap().0;
            let facts = PartFacts::of_scene(&scene);
            assert_eq!(facts.iter().map(|f| f.primitives).collect::<Vec<_>>(), [3, 3]);
            assert_eq!(facts[1].bounds.min, DVec3::new(500_010.0, 5_000_000.0, 90.0));
            assert_eq!(facts[1].bounds.size(), DVec3::new(1.0, 1.0, 2.0));
            assert_eq!(scene.parts[1].name, "oak");
            assert_eq!(facts[1].material_names(&scene).len(), 2);
            // Without a visit to every vertex the box is around the outline of the mesh.
            let [near, exact] = [0, 6].map(|most| PartFacts::placing(&scene, most)[1].bounds);
            let reach = (near.min - exact.min).abs().max((near.max - exact.max).abs()).max_element();
            assert!(near.union(exact) == near && reach < 0.1, "{near:?} {exact:?}");
        }
    }
}
