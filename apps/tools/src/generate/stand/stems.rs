//! Stem diameters of tree models, from sections through their meshes.

use std::collections::HashMap;
use std::f64::consts::PI;
use vlscan_geom::DVec3;

/// Height above the foot at which stems are measured, m.
pub const BREAST_HEIGHT: f64 = 1.3;
/// Heights of trees between which the profile of a model can be looked up, m.
const TREE_HEIGHTS: [f64; 2] = [1.35, 250.0];
/// Number of sections of a profile.
const SECTIONS: usize = 192;
/// Diameters of stems of a model, m; smaller and larger sections are not those of a stem.
const DIAMETERS: std::ops::RangeInclusive<f64> = 1e-3..=100.0;

/// The stem diameters of a model by height.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct StemProfile {
    /// At [`section_height`]; `None` where no closed section of wood was found.
    diameters: Vec<Option<f64>>,
}

/// Height of a section as a fraction of the model's height: where breast height is in trees of certain
/// heights.
fn section_height(section: usize) -> f64 {
    let [low, high] = TREE_HEIGHTS;
    BREAST_HEIGHT / high * libm::pow(high / low, section as f64 / (SECTIONS - 1) as f64)
}

impl StemProfile {
    /// Measures the wood of a model: triangles, foot of the stem and height above it, all in m.
    pub fn of(wood: &[[DVec3; 3]], foot: DVec3, height: f64) -> StemProfile {
        let levels: Vec<f64> = (0..SECTIONS).map(|i| foot.z + height * section_height(i)).collect();
        let mut sections: Vec<Section> = levels.iter().map(|_| Section::default()).collect();
        for triangle in wood {
            let z = triangle.map(|p| p.z);
            let (low, high) = (z[0].min(z[1]).min(z[2]), z[0].max(z[1]).max(z[2]));
            let first = levels.partition_point(|level| *level <= low);
            let end = levels.partition_point(|level| *level <= high);
            for (section, level) in sections[first..end].iter_mut().zip(&levels[first..end]) {
                section.cut(triangle, *level);
            }
        }
        StemProfile { diameters: sections.iter().map(|section| section.stem(foot)).collect() }
    }

    /// Diameter of the model's stem at this fraction of its height, m, between two sections; `None` if it is
    /// not known.
    pub fn diameter(&self, fraction: f64) -> Option<f64> {
        let above = (0..self.diameters.len()).find(|&i| section_height(i) >= fraction)?.max(1);
        let (low, high) = (section_height(above - 1), section_height(above));
        let share = ((fraction - low) / (high - low)).clamp(0.0, 1.0);
        let (low, high) = ((*self.diameters.get(above - 1)?)?, (*self.diameters.get(above)?)?);
        Some(low + share * (high - low))
    }
}

/// A point of a section: the edge of the mesh that it is on, by the bits of its ends. Triangles that share an
/// edge have the same points, even if the file repeats its vertices.
type PointKey = [[u64; 3]; 2];

/// The lines in which the triangles of a mesh cross a level.
#[derive(Default)]
struct Section {
    number_of: HashMap<PointKey, usize>,
    points: Vec<[f64; 2]>,
    lines: Vec<[usize; 2]>,
}

impl Section {
    /// Adds the line of a triangle. Vertices at the level count as above it, so that all lines end at edges.
    fn cut(&mut self, triangle: &[DVec3; 3], level: f64) {
        let mut ends = [0; 2];
        let mut count = 0;
        for (a, b) in [(0, 1), (1, 2), (2, 0)] {
            let (a, b) = (triangle[a], triangle[b]);
            if (a.z >= level) != (b.z >= level) && count < 2 {
                ends[count] = self.point(a, b, level);
                count += 1;
            }
        }
        if count == 2 && ends[0] != ends[1] {
            self.lines.push(ends);
        }
    }

    fn point(&mut self, a: DVec3, b: DVec3, level: f64) -> usize {
        let bits = |p: DVec3| (p + DVec3::ZERO).to_array().map(f64::to_bits);
        // The same arithmetic for both triangles of the edge.
        let (a, b) = if bits(a) <= bits(b) { (a, b) } else { (b, a) };
        *self.number_of.entry([bits(a), bits(b)]).or_insert_with(|| {
            let p = a + (b - a) * ((level - a.z) / (b.z - a.z));
            self.points.push([p.x, p.y]);
            self.points.len() - 1
        })
    }

    /// Diameter of the stem as a tape around it measures it: of the closed outlines around the foot the
    /// smallest, else the nearest to it.
    fn stem(&self, foot: DVec3) -> Option<f64> {
        let foot = [foot.x, foot.y];
        let hulls = self.outlines().into_iter().map(|points| hull(&points));
        let sized = hulls.map(|hull| (perimeter(&hull) / PI, distance(&hull, foot)));
        sized
            .filter(|(diameter, _)| DIAMETERS.contains(diameter))
            .min_by(|a, b| a.1.total_cmp(&b.1).then(a.0.total_cmp(&b.0)))
            .map(|(diameter, _)| diameter)
    }

    /// The points of the outlines that have no loose ends.
    fn outlines(&self) -> Vec<Vec<[f64; 2]>> {
        let mut parent: Vec<usize> = (0..self.points.len()).collect();
        let mut ends = vec![0u32; self.points.len()];
        fn root(parent: &mut [usize], mut i: usize) -> usize {
            while parent[i] != i {
                parent[i] = parent[parent[i]];
                i = parent[i];
            }
            i
        }
        for &[a, b] in &self.lines {
            ends[a] += 1;
            ends[b] += 1;
            let (a, b) = (root(&mut parent, a), root(&mut parent, b));
            parent[a.max(b)] = a.min(b);
        }
        let mut groups: Vec<(Vec<[f64; 2]>, bool)> = vec![(Vec::new(), true); self.points.len()];
        for i in 0..self.points.len() {
            let group = &mut groups[root(&mut parent, i)];
            group.0.push(self.points[i]);
            group.1 &= ends[i] >= 2;
        }
        let closed = groups.into_iter().filter(|(points, is_closed)| *is_closed && points.len() >= 3);
        closed.map(|(points, _)| points).collect()
    }
}

fn cross(o: [f64; 2], a: [f64; 2], b: [f64; 2]) -> f64 {
    (a[0] - o[0]) * (b[1] - o[1]) - (a[1] - o[1]) * (b[0] - o[0])
}

/// The convex hull of points, counter-clockwise (Andrew's monotone chain, 1979).
fn hull(points: &[[f64; 2]]) -> Vec<[f64; 2]> {
    let mut sorted = points.to_vec();
    sorted.sort_by(|a, b| a[0].total_cmp(&b[0]).then(a[1].total_cmp(&b[1])));
    let half = |points: &mut dyn Iterator<Item = [f64; 2]>| {
        let mut chain: Vec<[f64; 2]> = Vec::new();
        for p in points {
            while let [.., o, a] = chain[..]
                && cross(o, a, p) <= 0.0
            {
                chain.pop();
            }
            chain.push(p);
        }
        chain.pop();
        chain
    };
    let mut all = half(&mut sorted.iter().copied());
    all.extend(half(&mut sorted.iter().rev().copied()));
    all
}

/// The edges of a polygon.
fn edges(hull: &[[f64; 2]]) -> impl Iterator<Item = ([f64; 2], [f64; 2])> {
    hull.iter().copied().zip(hull.iter().copied().cycle().skip(1))
}

fn perimeter(hull: &[[f64; 2]]) -> f64 {
    edges(hull).map(|(a, b)| libm::hypot(b[0] - a[0], b[1] - a[1])).sum()
}

/// Distance of a point to a convex polygon; 0 within it.
fn distance(hull: &[[f64; 2]], p: [f64; 2]) -> f64 {
    if edges(hull).all(|(a, b)| cross(a, b, p) >= 0.0) {
        return 0.0;
    }
    let to_edge = |(a, b): ([f64; 2], [f64; 2])| {
        let (along, offset) = ([b[0] - a[0], b[1] - a[1]], [p[0] - a[0], p[1] - a[1]]);
        let length = along[0] * along[0] + along[1] * along[1];
        let share = if length > 0.0 { (along[0] * offset[0] + along[1] * offset[1]) / length } else { 0.0 };
        let share = share.clamp(0.0, 1.0);
        libm::hypot(offset[0] - share * along[0], offset[1] - share * along[1])
    };
    edges(hull).map(to_edge).fold(f64::INFINITY, f64::min)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The side of a cone around an axis: radii at the bottom and the top, number of sides.
    fn cone(at: [f64; 2], z: [f64; 2], radii: [f64; 2], sides: usize) -> Vec<[DVec3; 3]> {
        let point = |side: usize, end: usize| {
            let angle = 2.0 * PI * (side % sides) as f64 / sides as f64;
            DVec3::new(at[0] + radii[end] * angle.cos(), at[1] + radii[end] * angle.sin(), z[end])
        };
        let quad = |i: usize| [[(i, 0), (i + 1, 0), (i + 1, 1)], [(i, 0), (i + 1, 1), (i, 1)]];
        (0..sides).flat_map(quad).map(|t| t.map(|(side, end)| point(side, end))).collect()
    }

    #[test]
    fn a_tapered_stem_has_the_diameter_of_its_height() {
        let stem = cone([0.3, -0.2], [-0.5, 20.0], [0.3, 0.0], 64);
        let profile = StemProfile::of(&stem, DVec3::ZERO, 20.0);
        for tree in [2.0, 5.0, 12.3, 20.0, 60.0] {
            let fraction = BREAST_HEIGHT / tree;
            let expected = 0.6 * (20.0 - 20.0 * fraction) / 20.5;
            let found = profile.diameter(fraction).unwrap();
            assert!((found / expected - 1.0).abs() < 2e-3, "{tree}: {found} {expected}");
        }
        assert_eq!(profile.diameter(1.2), None, "above the top");
        assert_eq!(StemProfile::default().diameter(0.1), None);
    }

    #[test]
    fn crowns_branches_and_leaves_are_no_stems() {
        // A crown around the stem down to the ground, a branch beside it, and a leaf at the axis.
        let mut wood = cone([0.0; 2], [0.0, 10.0], [3.0, 0.1], 24);
        wood.extend(cone([2.0, 0.0], [0.0, 10.0], [0.05, 0.05], 12));
        wood.push([DVec3::new(-0.01, 0.0, 0.0), DVec3::new(0.01, 0.0, 9.0), DVec3::new(0.0, 0.01, 9.0)]);
        let around = StemProfile::of(&wood, DVec3::ZERO, 10.0).diameter(0.13).unwrap();
        assert!(around > 4.0, "no stem within: {around}");
        wood.extend(cone([0.0; 2], [0.0, 10.0], [0.2, 0.2], 32));
        let stem = StemProfile::of(&wood, DVec3::ZERO, 10.0).diameter(0.13).unwrap();
        assert!((stem - 0.4).abs() < 0.002, "{stem}");
        // A stem that leans away from its foot is the nearest outline.
        let leaning = StemProfile::of(&cone([1.0, 0.0], [0.0, 10.0], [0.1, 0.1], 32), DVec3::ZERO, 10.0);
        assert!((leaning.diameter(0.13).unwrap() - 0.2).abs() < 0.002);
    }

    #[test]
    fn meshes_without_closed_sections_have_no_diameter() {
        let mut open = cone([0.0; 2], [0.0, 10.0], [0.2, 0.2], 8);
        open.truncate(10);
        assert_eq!(StemProfile::of(&open, DVec3::ZERO, 10.0).diameter(0.13), None);
        assert_eq!(StemProfile::of(&[], DVec3::ZERO, 10.0).diameter(0.13), None);
        let broken = vec![[DVec3::NAN; 3], [DVec3::ZERO; 3], [DVec3::splat(f64::INFINITY); 3]];
        assert_eq!(StemProfile::of(&broken, DVec3::ZERO, 10.0).diameter(0.13), None);
    }
}
