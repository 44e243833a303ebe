//! Triangles that repeat an earlier one: the same corners, part and material. Rays never report them, because
//! the first of several equal hits counts. No tree can separate them, so a ray would test all. Trees are
//! built without them.

use rayon::prelude::*;
use std::collections::HashSet;
use std::hash::{DefaultHasher, Hash, Hasher};
use vlscan_geom::DVec3;
use vlscan_trace::Geometry;

/// Number of triangles of a scene that are checked first: a few duplicates cost less than a search among all.
const SAMPLE: usize = 4096;
/// Stride of the sample, prime to the number of triangles in nearly all scenes.
const STRIDE: usize = 2_654_435_761;

/// The numbers of the stored triangles that repeat an earlier one; `surface` returns part and material of a
/// number. Geometry with few of them may have none here.
pub(crate) fn repeated_triangles(g: &Geometry, surface: impl Fn(u32) -> (u32, u32) + Sync) -> HashSet<u32> {
    let count = g.triangles.len();
    let mut seen = HashSet::new();
    let sample = count.min(SAMPLE);
    let place = |i: usize| if sample == count { i } else { i.wrapping_mul(STRIDE) % count };
    // The same triangle may be drawn twice.
    let drawn: HashSet<usize> = (0..sample).map(place).collect();
    if drawn.into_iter().all(|index| seen.insert(hash(g, index))) {
        return HashSet::new();
    }
    let mut all: Vec<(u64, usize)> =
        (0..count).into_par_iter().map(|index| (hash(g, index), index)).collect();
    all.par_sort_unstable();
    let repeats = |group: &[(u64, usize)]| -> Vec<u32> {
        let mut first: HashSet<([u64; 9], u32, u32)> = HashSet::new();
        let number = |index: usize| g.number_of_triangle(index) as u32;
        let is_repeated = |index: &usize| {
            let (part, material) = surface(number(*index));
            !first.insert((bits(g.stored_triangle(*index)), part, material))
        };
        group.iter().map(|(_, index)| *index).filter(is_repeated).map(number).collect()
    };
    let groups: Vec<&[(u64, usize)]> =
        all.chunk_by(|a, b| a.0 == b.0).filter(|group| group.len() > 1).collect();
    groups.into_par_iter().flat_map_iter(repeats).collect()
}

fn hash(g: &Geometry, index: usize) -> u64 {
    let mut hasher = DefaultHasher::new();
    bits(g.stored_triangle(index)).hash(&mut hasher);
    hasher.finish()
}

/// The coordinates of corners in their order: a ray meets corners in another order at a distance that may
/// differ in its last digit.
fn bits(corners: [DVec3; 3]) -> [u64; 9] {
    let [a, b, c] = corners.map(|corner| corner.to_array().map(f64::to_bits));
    [a[0], a[1], a[2], b[0], b[1], b[2], c[0], c[1], c[2]]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fixture::Fixture;
    use vlscan_trace::{BuildOptions, Builder};

    #[test]
    fn repeated_triangles_are_left_out_of_trees_and_hits_are_the_same() {
        let mut f = Fixture::new();
        f.file("m.mtl", "newmtl a\nhelios_reflectance 0.1\nnewmtl b\nhelios_reflectance 0.2\n");
        let mut text =
            String::from("mtllib m.mtl\nv 0 0 0\nv 9 0 0\nv 0 9 0\nv 0 0 5\nv 9 0 5\nv 0 9 5\nusemtl a\n");
        // 3000 times the lower triangle, then the same of another material and in another order, and one
        // above.
        text += &"f 1 2 3\n".repeat(3000);
        text += &format!("usemtl b\n{}f 2 3 1\nf 4 5 6\n", "f 1 2 3\n".repeat(3000));
        f.obj("a.obj", &text);
        let scene = f.scene();
        let surface = |i| (scene.surface(i).part, scene.surface(i).material);
        let repeated = repeated_triangles(&scene.geometry, surface);
        assert_eq!(repeated.len(), 2 * 2999);
        assert!([0, 3000, 6000, 6001].iter().all(|number| !repeated.contains(number)));
        for builder in [Builder::Bvh, Builder::Fsah] {
            let options = BuildOptions::of(builder);
            let tree = scene.tree(&options);
            let whole = vlscan_trace::Tree::build(&scene.geometry, &options);
            assert!(tree.memory() < whole.memory() / 20, "{} of {}", tree.memory(), whole.memory());
            for i in 0..100 {
                let from = DVec3::new(f64::from(i % 10), f64::from(i / 10), -3.0) + scene.bounds.min;
                for way in [DVec3::Z, -DVec3::Z] {
                    let from = from + if way.z < 0.0 { DVec3::Z * 20.0 } else { DVec3::ZERO };
                    let [found, expected] =
                        [&*tree, &whole].map(|t| t.nearest_where(&scene.geometry, from, way, |_| true));
                    assert_eq!(found, expected, "{from} {way}");
                    // The second material is found behind a filter.
                    let is_b = |i: u32| scene.material_of(i).reflectance == 0.2;
                    let [found, expected] =
                        [&*tree, &whole].map(|t| t.nearest_where(&scene.geometry, from, way, is_b));
                    assert_eq!(found, expected, "{from} {way}");
                }
            }
        }
    }
}
