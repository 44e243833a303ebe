//! Facts about the parts of a scene, for tables of labelled points.

use super::primitive::area_of_triangle;
use super::{InstanceSet, Material, PrimitiveFacts, Scene, Tiles};
use std::collections::{BTreeMap, HashMap};
use std::sync::Arc;
use vlscan_geom::{Aabb, DVec3};
use vlscan_trace::{Model, Placement};

/// Facts about one part.
#[derive(Clone, Debug, PartialEq)]
pub struct PartFacts {
    /// Box around its primitives, world frame, m; moving parts are in their initial pose. Empty for a part
    /// without primitives. In scenes with very many vertices of instances the boxes of these reach a little
    /// further.
    pub bounds: Aabb,
    /// Number of primitives, including the triangles of instances.
    pub primitives: u64,
    /// Indices in [`Scene::materials`]; the material of most primitives comes first.
    pub materials: Vec<u32>,
    /// The areas of each of its materials.
    pub areas: Vec<MaterialArea>,
}

/// The area of a material in a part.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct MaterialArea {
    /// Area of the triangles, one side of each, m².
    pub triangles: f64,
    /// One-sided plant area of the voxels that transmit light, m²: plant area density times volume. Opaque
    /// voxels have none: their size may stand for their density.
    pub plants: f64,
}

impl MaterialArea {
    /// One-sided leaf area if the material is `material`, m²: that of plants in voxels, and of triangles if
    /// they are leaves. `None` if it is unknown whether the material is leaves.
    pub fn leaves(&self, material: &Material) -> Option<f64> {
        match material.is_leaf() {
            Some(true) => Some(self.total()),
            Some(false) => Some(0.0),
            None => (self.plants > 0.0).then_some(self.plants),
        }
    }

    /// The area of both.
    pub fn total(&self) -> f64 {
        self.triangles + self.plants
    }

    fn add(&mut self, other: MaterialArea, factor: f64) {
        self.triangles += factor * other.triangles;
        self.plants += factor * other.plants;
    }
}

/// Share of a material in a part.
#[derive(Clone, Copy, Debug, Default)]
struct Share {
    primitives: u64,
    area: MaterialArea,
}

/// Shares by index of the material.
type Shares = BTreeMap<u32, Share>;

/// Vertices of instances that are placed one by one.
const MAX_PLACED_VERTICES: u64 = 1 << 30;

impl PartFacts {
    /// Facts about every part of a scene, in order. All tiles are loaded once; one that cannot be loaded is
    /// reported by [`Tiles::check`](crate::Tiles::check).
    pub fn of_scene(scene: &Scene) -> Vec<PartFacts> {
        PartFacts::placing(scene, MAX_PLACED_VERTICES)
    }

    /// Places up to `most` vertices of instances.
    fn placing(scene: &Scene, most: u64) -> Vec<PartFacts> {
        let facts = |(shares, bounds): (Shares, Aabb)| {
            let primitives = shares.values().map(|share| share.primitives).sum();
            let mut shares: Vec<(u32, Share)> = shares.into_iter().collect();
            shares.sort_by_key(|(_, share)| std::cmp::Reverse(share.primitives));
            let (materials, areas) =
                shares.into_iter().map(|(material, share)| (material, share.area)).unzip();
            PartFacts { bounds: bounds.translated(scene.shift), primitives, materials, areas }
        };
        let all = PartShares::of_scene(scene, most);
        all.shares.into_iter().zip(all.bounds).map(facts).collect()
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

    /// Its one-sided leaf area, m². `None` if it is unknown of all of its materials whether they are leaves.
    pub fn leaf_area(&self, scene: &Scene) -> Option<f64> {
        let of = |(&material, area): (&u32, &MaterialArea)| {
            scene.materials.get(material as usize).and_then(|material| area.leaves(material))
        };
        self.materials.iter().zip(&self.areas).filter_map(of).reduce(|sum, area| sum + area)
    }
}

/// The shares of the materials, and the box, scene frame, of each part.
struct PartShares {
    shares: Vec<Shares>,
    bounds: Vec<Aabb>,
}

impl PartShares {
    /// Shares in a scene with its tiles; places up to `most` vertices of instances.
    fn of_scene(scene: &Scene, most: u64) -> PartShares {
        let parts = scene.parts.len();
        let mut all = PartShares { shares: vec![Shares::new(); parts], bounds: vec![Aabb::EMPTY; parts] };
        scene.for_each_own_primitive(|facts| all.add_primitive(facts));
        if let Some(set) = &scene.instances {
            all.add_instances(set, most);
        }
        if let Some(tiles) = &scene.tiles {
            all.add_tiles(tiles, most);
        }
        all
    }

    /// The share of a material in a part.
    fn share(&mut self, part: u32, material: u32) -> &mut Share {
        self.shares[part as usize].entry(material).or_default()
    }

    fn extend_bounds(&mut self, part: u32, by: Aabb) {
        let bounds = &mut self.bounds[part as usize];
        *bounds = bounds.union(by);
    }

    fn add_primitive(&mut self, facts: &PrimitiveFacts) {
        let share = self.share(facts.part, facts.material);
        share.primitives += 1;
        share.area.triangles += facts.triangle_area();
        share.area.plants += facts.plant_area();
        self.extend_bounds(facts.part, facts.bounds());
    }

    fn add_instances(&mut self, set: &InstanceSet, most: u64) {
        // By model and widening, which most instances have in common.
        let mut of_models: HashMap<(u32, u64), Shares> = HashMap::new();
        let vertices = |i| set.instances.model(i).geometry.vertices.len() as u64;
        let is_exact = set.instances.all.iter().map(vertices).sum::<u64>() <= most;
        for (instance, &part) in set.instances.all.iter().zip(&set.parts) {
            self.extend_bounds(
                part,
                match is_exact {
                    true => set.instances.exact_bounds_of(instance),
                    false => set.instances.bounds_of(instance),
                },
            );
            let Placement { scale, widening, .. } = instance.placement;
            let of_model = of_models.entry((instance.model, widening.to_bits())).or_insert_with(|| {
                let materials = &set.materials[instance.model as usize];
                shares_of_model(set.instances.model(instance), materials, widening)
            });
            for (&material, of_model) in &*of_model {
                let share = self.share(part, material);
                share.primitives += of_model.primitives;
                share.area.add(of_model.area, scale * scale);
            }
        }
    }

    fn add_tiles(&mut self, tiles: &Arc<Tiles>, most: u64) {
        tiles.facts().iter().for_each(|tile| self.extend_bounds(tile.part, tile.bounds));
        tiles.for_each(
            |_| true,
            |facts, tile| {
                for (material, of) in PartShares::of_scene(&tile.scene, most).shares.into_iter().flatten() {
                    let share = self.share(facts.part, facts.materials[material as usize]);
                    share.primitives += of.primitives;
                    share.area.add(of.area, 1.0);
                }
            },
        );
    }
}

/// The shares of the materials in a model that is stretched by `widening` along x and y.
fn shares_of_model(model: &Model, materials: &[u32], widening: f64) -> Shares {
    let widened = |p: DVec3| DVec3::new(p.x * widening, p.y * widening, p.z);
    let mut shares = Shares::new();
    for (i, &material) in materials.iter().enumerate() {
        let share = shares.entry(material).or_default();
        share.primitives += 1;
        share.area.triangles += area_of_triangle(model.geometry.stored_triangle(i).map(widened));
    }
    shares
}

/// The areas of all materials of a scene, summed over its parts.
pub fn material_areas(scene: &Scene, parts: &[PartFacts]) -> Vec<MaterialArea> {
    let mut areas = vec![MaterialArea::default(); scene.materials.len()];
    for facts in parts {
        for (&material, area) in facts.materials.iter().zip(&facts.areas) {
            areas[material as usize].add(*area, 1.0);
        }
    }
    areas
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Sharing;
    use crate::fixture::Fixture;
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
            assert_eq!(facts[1].material_names(&scene), ["leaf", "bark"]);
            // Two leaves, each half the product of two edges, and bark in the plane.
            let leaf = 0.5 * (DVec3::X.cross(DVec3::new(0.0, 1.0, 2.0)).length())
                + 0.5 * (DVec3::new(0.0, 1.0, 0.0).cross(DVec3::new(-1.0, 1.0, 2.0)).length());
            let of = |part: usize| facts[part].areas.iter().map(|area| area.triangles).collect::<Vec<_>>();
            for part in [0, 1] {
                assert!(
                    (of(part)[0] - leaf).abs() < 1e-9 && (of(part)[1] - 0.5).abs() < 1e-9,
                    "{:?}",
                    of(part)
                );
                assert_eq!(facts[part].leaf_area(&scene), Some(of(part)[0]));
            }
            let all = material_areas(&scene, &facts);
            assert!((all.iter().map(MaterialArea::total).sum::<f64>() - 2.0 * (leaf + 0.5)).abs() < 1e-9);
            // Without a visit to every vertex the box is around the outline of the mesh.
            let [near, exact] = [0, 6].map(|most| PartFacts::placing(&scene, most)[1].bounds);
            let reach = (near.min - exact.min).abs().max((near.max - exact.max).abs()).max_element();
            assert!(near.union(exact) == near && reach < 0.1, "{near:?} {exact:?}");
        }
    }
}
