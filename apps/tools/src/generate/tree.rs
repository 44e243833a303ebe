//! Trees and shrubs: trunk, branches and crowns of leaves.

use super::obj::ObjFile;
use super::random::{Random, Topic};
use super::solid::{frame, leaf, spray, tube};
use libm::{cos, sin};
use std::f64::consts::{PI, TAU};
use vlscan_base::error::Result;
use vlscan_geom::{DVec3, unit};

/// Plants of the forest.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Species {
    Spruce,
    Beech,
    Birch,
}

impl Species {
    pub(super) const ALL: [Species; 3] = [Species::Spruce, Species::Beech, Species::Birch];

    pub(super) fn name(self) -> &'static str {
        self.traits().name
    }

    fn traits(self) -> &'static Traits {
        &TRAITS[self as usize]
    }

    /// Height of the tree and radius of its crown, m.
    fn size(self, random: &mut Random) -> (f64, f64) {
        let (vigour, spread) = (random.bell(), random.bell());
        let Traits { height, radius, .. } = self.traits();
        (height[0] + height[1] * vigour, radius[0] + radius[1] * vigour + radius[2] * spread)
    }
}

/// Traits of a species.
struct Traits {
    name: &'static str,
    foliage: &'static str,
    bark: &'static str,
    /// One-sided leaf area per crown area.
    leaf_area_index: f64,
    /// Height of the tree, m: mean, and its change with vigour.
    height: [f64; 2],
    /// Radius of the crown, m: mean, and its changes with vigour and spread.
    radius: [f64; 3],
    /// Height of the crown's base, as a fraction of the tree's height.
    crown_base: f64,
    /// Height of the trunk's top, as a fraction of the tree's height.
    trunk_top: f64,
}

static TRAITS: [Traits; 3] = [
    Traits {
        name: "spruce",
        foliage: "spruce_needles",
        bark: "spruce_bark",
        leaf_area_index: 3.4,
        height: [21.0, 6.0],
        radius: [2.4, 0.5, 0.3],
        crown_base: 0.14,
        trunk_top: 0.98,
    },
    Traits {
        name: "beech",
        foliage: "beech_leaves",
        bark: "beech_bark",
        leaf_area_index: 3.0,
        height: [19.0, 5.0],
        radius: [3.4, 0.7, 0.6],
        crown_base: 0.33,
        trunk_top: 0.86,
    },
    Traits {
        name: "birch",
        foliage: "birch_leaves",
        bark: "birch_bark",
        leaf_area_index: 2.2,
        height: [16.0, 4.0],
        radius: [2.1, 0.4, 0.3],
        crown_base: 0.40,
        trunk_top: 0.86,
    },
];

/// Maximum area of a leaf, m²; meshes with few triangles would otherwise have implausibly large leaves.
const MAX_LEAF_AREA: f64 = 0.6;

/// A tree and its position.
pub(super) struct Tree {
    pub(super) species: Species,
    number: u64,
    foot: DVec3,
    height: f64,
    radius: f64,
}

impl Tree {
    pub(super) fn new(seed: u64, number: u64, species: Species, foot: DVec3) -> Tree {
        let mut random = Random::new(seed, Topic::Tree, 2 * number);
        let (height, radius) = species.size(&mut random);
        Tree { species, number, foot, height, radius }
    }

    pub(super) fn number(&self) -> u64 {
        self.number
    }

    /// Centre and half axes of an ellipsoid around the crown, m.
    pub(super) fn crown(&self) -> (DVec3, DVec3) {
        let (base, half) =
            (self.species.traits().crown_base, 0.5 * self.height * (1.0 - self.species.traits().crown_base));
        (self.foot + DVec3::Z * (base * self.height + half), DVec3::new(self.radius, self.radius, half))
    }

    /// Leaf area of the crown, m². Triangles are distributed in proportion to it, so that all leaves have
    /// about the same size.
    pub(super) fn leaf_area(&self) -> f64 {
        self.species.traits().leaf_area_index * PI * self.radius * self.radius
    }

    /// Writes the tree with exactly `triangles` triangles (an even number).
    pub(super) fn write(&self, out: &mut ObjFile, seed: u64, triangles: u64) -> Result<()> {
        let mut random = Random::new(seed, Topic::Tree, 2 * self.number + 1);
        let wood = Wood::of(triangles);
        let pairs = (triangles - wood.triangles()) / 2;
        let area = (self.leaf_area() / (2 * pairs).max(1) as f64).min(MAX_LEAF_AREA);
        let trunk = self.trunk(&mut random, wood.segments);
        out.material(self.species.traits().bark);
        tube(out, &trunk, wood.sides)?;
        match self.species {
            Species::Spruce => self.spruce_crown(out, &mut random, &trunk, wood.branches, pairs, area),
            Species::Beech | Species::Birch => {
                self.broad_crown(out, &mut random, &trunk, wood.branches, pairs, area)
            }
        }
    }

    /// Axis of the trunk from a little below the ground to near the top, slightly curved, as points with
    /// radii.
    fn trunk(&self, random: &mut Random, segments: u64) -> Vec<(DVec3, f64)> {
        let (dx, dy) = random.heading();
        let sway = 0.03 * self.height * random.unit();
        let thick = 0.011 * self.height + 0.03;
        let top = self.species.traits().trunk_top;
        let point = |i: u64| {
            let t = i as f64 / segments as f64;
            let along = DVec3::new(dx, dy, 0.0) * (sway * t * t);
            let up = DVec3::Z * (-0.2 + (top * self.height + 0.2) * t);
            (self.foot + along + up, thick * (1.0 - 0.92 * t))
        };
        (0..=segments).map(point).collect()
    }

    fn spruce_crown(
        &self,
        out: &mut ObjFile,
        random: &mut Random,
        trunk: &[(DVec3, f64)],
        branches: u64,
        pairs: u64,
        area: f64,
    ) -> Result<()> {
        const PER_WHORL: f64 = 9.0;
        let base = self.species.traits().crown_base * self.height;
        let whorls = (0.9 * (self.height - base)).round().max(4.0);
        // Root and outward direction of the bough at crown level t (0 = lowest) and azimuth `turn`, as a
        // fraction of a turn.
        let bough = |t: f64, turn: f64| {
            let angle = TAU * turn;
            let root = on_axis(trunk, (base + t * (self.height - base)) / self.height);
            (root, DVec3::new(cos(angle), sin(angle), 0.0), self.radius * (1.0 - 0.97 * t) + 0.1)
        };
        for i in 0..branches {
            let t = (i as f64 + 0.5) / branches as f64;
            let (root, outward, reach) = bough(0.9 * t, random.unit());
            let tip = root + outward * (0.85 * reach) - DVec3::Z * (0.22 * reach);
            tube(out, &[(root, 0.035), (tip, 0.006)], 3)?;
        }
        out.material(self.species.traits().foliage);
        let mut left = pairs;
        while left > 0 {
            // Boughs get shorter upwards and so bear fewer needles: the density falls as 1 − t. The tip keeps
            // some nevertheless.
            let falling = 1.0 - (1.0 - random.unit()).sqrt();
            let level = (if random.unit() < 0.12 { 1.0 - 0.5 * falling } else { falling }) * whorls;
            let t = (level.floor() + 0.6 * random.unit()) / whorls;
            let turn = ((random.unit() * PER_WHORL).floor() + 0.3 * random.bell()) / PER_WHORL
                + 0.382 * level.floor();
            let (root, outward, reach) = bough(t, turn);
            let q = (0.06 + 0.94 * random.unit()).sqrt();
            let side = outward.cross(DVec3::Z) * (0.30 * reach * random.bell() * q);
            let sag = 0.10 * q + 0.16 * q * q;
            let place = root + outward * (reach * q) + side + DVec3::Z * (0.18 * random.bell() - sag * reach);
            let along = unit(outward + side * 0.8 + DVec3::Z * (0.25 * random.bell() - 0.2));
            let normal = unit(DVec3::Z + random.direction() * 0.5);
            if left >= 2 {
                spray(out, place, along, normal, area)?;
                left -= 2;
            } else {
                leaf(out, place, along, normal, area)?;
                left -= 1;
            }
        }
        Ok(())
    }

    fn broad_crown(
        &self,
        out: &mut ObjFile,
        random: &mut Random,
        trunk: &[(DVec3, f64)],
        branches: u64,
        pairs: u64,
        area: f64,
    ) -> Result<()> {
        let base = self.species.traits().crown_base * self.height;
        let half = 0.5 * (self.height - base);
        let middle = self.foot + DVec3::Z * (base + half);
        let shape = DVec3::new(self.radius, self.radius, half);
        let clusters: Vec<(DVec3, DVec3)> = (0..(pairs / 16).clamp(5, 36))
            .map(|_| {
                let d = random.direction();
                let size = DVec3::new(1.0, 1.0, 0.75) * (self.radius * random.between(0.32, 0.5));
                (middle + d * shape * random.between(0.45, 0.78), size)
            })
            .collect();
        for i in 0..branches {
            let (tip, _) = clusters[i as usize % clusters.len()];
            let t = ((tip.z - self.foot.z) / self.height - random.between(0.12, 0.25)).clamp(0.2, 0.84);
            tube(out, &[(on_axis(trunk, t), 0.05), (tip, 0.01)], 3)?;
        }
        out.material(self.species.traits().foliage);
        for _ in 0..pairs {
            let (centre, size) = clusters[(random.unit() * clusters.len() as f64) as usize];
            let d = random.direction();
            let place = centre + d * size * random.between(0.45, 1.0);
            leaf_around(out, random, place, d, area)?;
        }
        Ok(())
    }
}

/// Writes a low round bush of `pairs` leaves.
pub(super) fn shrub(out: &mut ObjFile, seed: u64, number: u64, foot: DVec3, pairs: u64) -> Result<()> {
    let mut random = Random::new(seed, Topic::Shrub, number);
    let radius = random.between(0.5, 1.1);
    let area = (2.5 * PI * radius * radius / (2 * pairs).max(1) as f64).min(0.5 * MAX_LEAF_AREA);
    let middle = foot + DVec3::Z * (0.6 * radius);
    for _ in 0..pairs {
        let d = random.direction();
        let place = middle + d * DVec3::new(1.0, 1.0, 0.7) * (radius * random.between(0.3, 1.0));
        leaf_around(out, &mut random, place, d, area)?;
    }
    Ok(())
}

/// Writes a leaf whose upper side faces roughly outwards and up.
pub(super) fn leaf_around(
    out: &mut ObjFile,
    random: &mut Random,
    place: DVec3,
    outward: DVec3,
    area: f64,
) -> Result<()> {
    let normal = unit(outward * 0.5 + DVec3::Z * 0.6 + random.direction() * 0.7);
    let (u, v) = frame(normal);
    let (c, s) = random.heading();
    leaf(out, place, u * c + v * s, normal, area)
}

/// Number of a tree's triangles that are wood: about a seventh.
struct Wood {
    sides: u64,
    segments: u64,
    branches: u64,
}

impl Wood {
    const BRANCH: u64 = 6;

    fn of(triangles: u64) -> Wood {
        let (sides, segments) = match triangles {
            0..40 => (3, 1),
            40..250 => (4, 2),
            250..1500 => (6, 4),
            _ => (8, 8),
        };
        let branches = (triangles * 7 / 100 / Wood::BRANCH).min(400);
        Wood { sides, segments, branches }
    }

    fn triangles(&self) -> u64 {
        2 * self.sides * self.segments + Wood::BRANCH * self.branches
    }
}

/// Minimum number of triangles of a tree.
pub(super) const MIN_TREE_TRIANGLES: u64 = 20;

/// The point of the trunk's axis at the fraction `t` of the tree's height.
fn on_axis(trunk: &[(DVec3, f64)], t: f64) -> DVec3 {
    let at = t.clamp(0.0, 1.0) * (trunk.len() - 1) as f64;
    let i = (at as usize).min(trunk.len() - 2);
    trunk[i].0 + (trunk[i + 1].0 - trunk[i].0) * (at - i as f64)
}

#[cfg(test)]
mod tests {
    use super::super::obj::SceneFolder;
    use super::*;

    #[test]
    fn a_tree_has_exactly_the_triangles_asked_for() {
        let folder = tempfile::tempdir().unwrap();
        let folder = SceneFolder::create(folder.path(), true).unwrap();
        for species in Species::ALL {
            for triangles in [MIN_TREE_TRIANGLES, 64, 150, 602, 5000] {
                let tree = Tree::new(1, 3, species, DVec3::new(1.0, 2.0, 0.5));
                let mut out = ObjFile::create(&folder, "t.obj", "m.mtl").unwrap();
                tree.write(&mut out, 1, triangles).unwrap();
                let mesh = out.finish().unwrap();
                assert_eq!(mesh.triangles, triangles, "{species:?}");
                let size = mesh.bounds.size();
                assert!(size.z > 5.0 && size.z < 35.0 && size.x < 16.0, "{species:?} {triangles}: {size}");
            }
        }
    }
}
