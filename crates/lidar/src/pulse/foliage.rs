//! Voxels of foliage: whether they scatter a ray, and where (spec pulse-physics §2.5, §2.6).

use libm::log;
use std::f64::consts::TAU;
use vlscan_base::corrections::Corrections;
use vlscan_base::rng::Stream;
use vlscan_geom::DVec3;
use vlscan_scene::{LadTable, SPHERICAL_MEAN_COSINE, Scene, VoxelKind};
use vlscan_trace::{Cube, Tree};

/// Projection G of spherically distributed leaves.
const SPHERICAL_PROJECTION: f64 = 0.5;

/// Bits of the counters of draws by column of a footprint, and of the place of the columns: free paths are
/// fewer.
const COLUMNS: u32 = 1 << 31;
const SHIFT: u32 = 1 << 30;

/// Draws the free paths of a pulse: one per voxel of foliage that a subray enters, in the order of subrays.
#[derive(Clone, Copy, Debug)]
pub(super) struct FreePaths {
    pub stream: Stream,
    pub device: u32,
    pub pulse: u64,
    pub drawn: u32,
}

impl FreePaths {
    /// Draws a free path through foliage of extinction `sigma` (1/m), m: exponentially distributed, ∞ if the
    /// draw is 0.
    pub fn sample(&mut self, sigma: f64) -> f64 {
        let u = self.stream.uniform(self.device, self.pulse, self.drawn);
        self.drawn = self.drawn.wrapping_add(1);
        -log(u) / sigma
    }

    /// Optical depth at which the elements of foliage in a column of the footprint intercept light:
    /// exponentially distributed, one draw for each pulse and column.
    pub fn depth_of_column(&self, column: [i32; 2]) -> f64 {
        let [u, v] = column.map(|i| i as u32 & 0x7fff);
        -log(self.stream.uniform(self.device, self.pulse, COLUMNS | u << 15 | v))
    }

    /// Offset of the columns of a pulse: shares of their size, from 0 to 1.
    pub fn shift_of_columns(&self) -> [f64; 2] {
        [0, 1].map(|axis| self.stream.uniform(self.device, self.pulse, COLUMNS | SHIFT | axis))
    }
}

/// Effect of a voxel on a ray that enters it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum MediumEvent {
    /// The ray is scattered this many metres after its entry.
    Scatter(f64),
    /// The ray leaves the voxel this many metres from the start of its current segment.
    Exit(f64),
    /// The ray is lost: the voxel has no exit ahead.
    Lost,
}

/// Effect of primitive `i` on a ray from `from` along `direction` that enters it at `entry` metres.
pub(super) fn medium_event(
    scene: &Scene,
    corrections: &Corrections,
    i: u32,
    (from, direction): (DVec3, DVec3),
    entry: f64,
    paths: &mut FreePaths,
) -> MediumEvent {
    let Some((voxel, cube)) = scene.voxel_and_cube(i) else { return MediumEvent::Scatter(0.0) };
    if voxel.kind() == VoxelKind::Opaque {
        return MediumEvent::Scatter(0.0);
    }
    let exit = exit(&cube, from, direction);
    if exit.is_nan() || exit <= 0.0 {
        return MediumEvent::Lost;
    }
    if voxel.kind() == VoxelKind::Transparent {
        return MediumEvent::Exit(exit);
    }
    let sigma = extinction(voxel.density, leaf_angles(scene, i), corrections, direction);
    if sigma.is_nan() || sigma == 0.0 {
        return MediumEvent::Exit(exit);
    }
    let path = paths.sample(sigma);
    if path > exit - entry { MediumEvent::Exit(exit) } else { MediumEvent::Scatter(path) }
}

/// True if primitive `i` scatters rays within itself rather than at its surface.
pub(super) fn is_scattering(scene: &Scene, i: u32) -> bool {
    scene.voxel(i).is_some_and(|v| v.kind() == VoxelKind::Transmittive)
}

fn leaf_angles(scene: &Scene, i: u32) -> Option<&LadTable> {
    scene.parts[scene.part_of(i) as usize].lad.as_deref()
}

/// Distance at which a ray leaves voxel `i`, m, and the voxel's extinction, 1/m; `None` if it holds no
/// leaves.
pub(super) fn leaf_extinction(
    scene: &Scene,
    corrections: &Corrections,
    i: u32,
    (from, direction): (DVec3, DVec3),
) -> Option<(f64, f64)> {
    let (voxel, cube) = scene.voxel_and_cube(i).filter(|(v, _)| v.kind() == VoxelKind::Transmittive)?;
    let sigma = extinction(voxel.density, leaf_angles(scene, i), corrections, direction);
    let exit = exit(&cube, from, direction);
    (sigma > 0.0 && exit > 0.0).then_some((exit, sigma))
}

/// Mean cosine of the incidence on the leaves of voxel `i`: by the leaf angle table of its part, otherwise
/// for leaves that face all directions alike.
pub(super) fn mean_cosine(scene: &Scene, corrections: &Corrections, i: u32, direction: DVec3) -> f64 {
    let table = leaf_angles(scene, i).filter(|_| corrections.leaf_table_law);
    table.map_or(SPHERICAL_MEAN_COSINE, |t| t.mean_cosine(direction))
}

/// Cross-section of the foliage of a voxel with a leaf angle table in the radar equation (spec pulse-physics
/// §3.5); `None` if the voxel reflects like a surface.
pub(super) fn cross_section(
    scene: &Scene,
    corrections: &Corrections,
    i: u32,
    direction: DVec3,
) -> Option<f64> {
    if corrections.leaf_table_law {
        return None;
    }
    let voxel = scene.voxel(i)?;
    let table = leaf_angles(scene, i)?;
    Some(voxel.density * table.g(direction) / TAU)
}

/// Extinction of foliage of density `density` along `direction`, 1/m.
fn extinction(density: f64, table: Option<&LadTable>, corrections: &Corrections, direction: DVec3) -> f64 {
    match table {
        Some(table) => density * table.g(direction) / TAU,
        None if corrections.spherical_leaves => density * SPHERICAL_PROJECTION,
        None => density,
    }
}

/// True if a ray that enters voxel `i` at `entry` metres runs through its interior or along a lower face; an
/// upper face belongs to the neighbour.
pub(super) fn is_within(scene: &Scene, i: u32, (from, direction): (DVec3, DVec3), entry: f64) -> bool {
    let Some(cube) = scene.geometry.cube_of(i) else { return true };
    let middle = from + direction * (0.5 * (entry + exit(&cube, from, direction)));
    middle.cmpge(cube.centre - cube.half).all() && middle.cmplt(cube.centre + cube.half).all()
}

/// Distance from `from` at which a ray leaves a cube, m.
fn exit(cube: &Cube, from: DVec3, direction: DVec3) -> f64 {
    let mut nearest = f64::INFINITY;
    for axis in 0..3 {
        let a = (cube.centre[axis] - cube.half - from[axis]) / direction[axis];
        let b = (cube.centre[axis] + cube.half - from[axis]) / direction[axis];
        let far = if a > b { a } else { b };
        if far < nearest {
            nearest = far;
        }
    }
    nearest
}

/// The voxels of foliage that contain or touch `point`: rays that start there never enter them. `size` is the
/// edge of the scene's largest cube.
pub(super) fn voxels_around(scene: &Scene, tree: &Tree, point: DVec3, size: f64) -> Vec<u32> {
    let contains = |i: u32| {
        scene.voxel_and_cube(i).is_some_and(|(voxel, cube)| {
            (point - cube.centre).abs().cmple(DVec3::splat(cube.half)).all()
                && voxel.kind() != VoxelKind::Opaque
        })
    };
    let before = point - DVec3::Y * (2.0 * size);
    let mut found = Vec::new();
    while let Some(hit) =
        tree.nearest_where(&scene.geometry, before, DVec3::Y, |i| contains(i) && !found.contains(&i))
    {
        found.push(hit.primitive);
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pulse::testkit::{foliage, tree};
    use vlscan_base::rng::Purpose;
    use vlscan_geom::unit;

    fn paths() -> FreePaths {
        FreePaths { stream: Stream::new(1, Purpose::FreePath), device: 0, pulse: 1, drawn: 0 }
    }

    #[test]
    fn a_ray_leaves_a_cube_where_the_slabs_end() {
        // spec pulse-physics §2.8 (a), with a cube instead of the box
        let cube = Cube { centre: DVec3::new(0.0, 10.0, 0.0), half: 1.0 };
        assert_eq!(exit(&cube, DVec3::ZERO, DVec3::Y), 11.0);
        assert_eq!(exit(&cube, DVec3::new(0.0, 10.0, 0.0), DVec3::Y), 1.0, "from within");
        assert_eq!(exit(&cube, DVec3::new(0.0, 20.0, 0.0), DVec3::Y), -9.0, "behind");
        let diagonal = unit(DVec3::ONE);
        let from = DVec3::new(-1.0, 9.0, -1.0);
        assert!((exit(&cube, from, diagonal) - 12f64.sqrt()).abs() < 1e-12);
    }

    #[test]
    fn extinctions_of_the_worked_example() {
        // spec pulse-physics §2.8 (c), (g)
        let none = Corrections::NONE;
        let table = LadTable::new([(DVec3::Z, 2.4), (DVec3::X, 3.4), (-DVec3::Z, 2.4)]);
        let tilted = extinction(1.0, table.as_ref(), &none, DVec3::new(0.6, 0.0, 0.8));
        assert!((tilted - 0.447172157).abs() < 1e-9);
        assert!((extinction(1.0, table.as_ref(), &none, DVec3::Y) - 0.541126807).abs() < 1e-9);
        assert_eq!(extinction(1.0, None, &none, DVec3::Y), 1.0);
        let spherical = Corrections { spherical_leaves: true, ..none };
        assert_eq!(extinction(1.0, None, &spherical, DVec3::Y), 0.5);
    }

    #[test]
    fn free_paths_are_exponential() {
        let mut p = paths();
        let n = 20_000;
        let beyond = (0..n).filter(|_| p.sample(1.0) > 1.0).count() as f64 / f64::from(n);
        assert!((beyond - 0.367879441).abs() < 0.012, "{beyond}");
        assert_eq!(p.drawn, n as u32);
    }

    #[test]
    fn only_foliage_draws() {
        use VoxelKind::*;
        let scene = foliage(
            &[
                (10.0, 1.0, Opaque),
                (20.0, 1.0, Transparent),
                (30.0, 0.0, Transmittive),
                (40.0, f64::NAN, Transmittive),
            ],
            None,
        );
        let mut p = paths();
        let mut at = |i: u32, entry| {
            medium_event(&scene, &Corrections::NONE, i, (-scene.shift, DVec3::Y), entry, &mut p)
        };
        assert_eq!(at(0, 10.0), MediumEvent::Scatter(0.0));
        assert!(matches!(at(1, 20.0), MediumEvent::Exit(x) if (x - 21.0).abs() < 1e-12));
        assert!(matches!(at(2, 30.0), MediumEvent::Exit(_)));
        assert!(matches!(at(3, 40.0), MediumEvent::Exit(_)));
        assert_eq!(p.drawn, 0);
        let behind = (DVec3::Y * 500.0, DVec3::Y);
        assert_eq!(medium_event(&scene, &Corrections::NONE, 1, behind, 1.0, &mut p), MediumEvent::Lost);
    }

    #[test]
    fn the_voxel_around_a_point_is_found() {
        let scene = foliage(&[(10.0, 1.0, VoxelKind::Transmittive), (11.0, 1.0, VoxelKind::Opaque)], None);
        let find = |y: f64| voxels_around(&scene, &tree(&scene), DVec3::Y * y - scene.shift, 1.0);
        assert_eq!(find(10.5), [0]);
        assert!(find(11.5).is_empty(), "opaque ones are left alone");
        assert!(find(9.5).is_empty());
    }
}
