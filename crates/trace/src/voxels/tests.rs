//! Grids have the hits of the stored cubes in their cells, bit for bit.

use super::*;
use crate::simd::Level;
use crate::{
    BuildOptions, Builder, Cube, Geometry, Hit, Hits, PrimitiveRef, RayGroup, TraceScratch, Tree, intersect,
};
use proptest::prelude::*;
use std::collections::BTreeSet;
use vlscan_geom::{DVec3, unit};

/// A scene of triangles, stored cubes and a grid after some of them.
#[derive(Clone, Debug)]
struct Case {
    counts: [u32; 3],
    /// In the order of their numbers.
    cells: Vec<[u32; 3]>,
    place: GridPlace,
    stored: Vec<Cube>,
    before: usize,
    triangles: Vec<[DVec3; 3]>,
}

impl Case {
    fn grid(&self) -> VoxelGrid {
        let mut cells = VoxelCells::new(self.counts);
        assert!(self.cells.iter().all(|cell| cells.push(*cell)));
        VoxelGrid::new(self.place, cells, self.before).unwrap()
    }

    fn with_grid(&self) -> Geometry {
        Geometry { cubes: self.stored.clone(), grids: vec![self.grid()], ..self.with_triangles() }
    }

    /// The same scene with all cubes stored.
    fn with_cubes(&self) -> Geometry {
        let own = self.cells.iter().map(|cell| self.place.cube(*cell));
        let (before, after) = self.stored.split_at(self.before);
        let cubes = before.iter().copied().chain(own).chain(after.iter().copied()).collect();
        Geometry { cubes, ..self.with_triangles() }
    }

    fn with_triangles(&self) -> Geometry {
        Geometry {
            vertices: self.triangles.iter().flatten().copied().collect(),
            triangles: (0..self.triangles.len() as u32).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect(),
            ..Geometry::default()
        }
    }

    /// A place in the scene by cells from the corner of the grid.
    fn at(&self, cells: [f64; 3]) -> DVec3 {
        let first = self.place.cube([0; 3]).centre;
        first + (DVec3::from(cells) - 0.5) * self.place.step()
    }
}

fn place() -> impl Strategy<Value = GridPlace> {
    let of = |corner: DVec3, spacing: f64| GridPlace::new(corner, spacing);
    prop_oneof![
        Just(of(DVec3::ZERO, 1.0)),
        Just(of(DVec3::new(-3.0, 0.3, 1.7), 0.25)),
        Just(of(DVec3::new(-1.1, 0.0, 0.0), 0.1)),
        Just(GridPlace {
            shift: DVec3::new(500_003.0, 5_400_001.5, 310.0),
            ..of(DVec3::new(500_000.2, 5_400_000.1, 300.3), 0.7)
        }),
        Just(of(DVec3::new(5.4e6, -4e5, 1e7), 0.3)),
        // Cubes of another size than their cells, scaled and moved.
        Just(GridPlace {
            half: 0.2,
            transform: Some((1.0, DVec3::new(0.3, -7.0, 2.0))),
            ..of(DVec3::ONE, 1.0)
        }),
        Just(GridPlace { half: 0.8, raise: 0.37, ..of(DVec3::ZERO, 1.0) }),
        Just(GridPlace { half: 0.15, transform: Some((0.3, DVec3::X)), ..of(DVec3::ONE, 1.0) }),
    ]
}

fn counts() -> impl Strategy<Value = [u32; 3]> {
    prop_oneof![
        3 => [1..6u32, 1..6u32, 1..6u32],
        3 => [1..40u32, 1..40u32, 1..40u32],
        1 => [1..3u32, 1..3u32, 1..700u32],
        1 => [1..300u32, 1..300u32, 1..3u32],
        1 => Just([1000, 1, 1000]),
        1 => Just([40_000, 50, 30]),
    ]
}

fn case() -> impl Strategy<Value = Case> {
    let order = prop::sample::select(vec![[0, 1, 2], [2, 1, 0], [1, 0, 2], [0, 2, 1], [1, 2, 0], [2, 0, 1]]);
    let coordinate = || -6..=6i32;
    let corner = || [coordinate(), coordinate(), coordinate()].prop_map(|c| DVec3::from(c.map(f64::from)));
    let cube = (corner(), 0.2..1.0f64).prop_map(|(centre, half)| Cube { centre, half });
    let triangle = [corner(), corner(), corner()];
    (
        (counts(), order, place()),
        (0..4usize, prop::collection::vec(any::<[u32; 3]>(), 1..200)),
        (prop::collection::vec(cube, 0..20), any::<prop::sample::Index>(), any::<bool>()),
        prop::collection::vec(triangle, 0..4),
    )
        .prop_map(
            |((counts, order, place), (density, draws), (mut stored, before, has_twins), mut triangles)| {
                let all = counts.map(u64::from).into_iter().product::<u64>();
                let cell = |n: u32| [n % counts[0], n / counts[0] % counts[1], n / counts[0] / counts[1]];
                let mut cells: Vec<[u32; 3]> = match density {
                    // Full, or three of four cells; else few, which may lie close together.
                    0 if all <= 6000 => (0..all as u32).map(cell).collect(),
                    1 if all <= 6000 => (0..all as u32)
                        .filter(|n| n.wrapping_mul(2_654_435_761) >> 30 != 3)
                        .map(cell)
                        .collect(),
                    2 => draws.iter().map(|c| [0, 1, 2].map(|axis| c[axis] % counts[axis].min(20))).collect(),
                    3 if all <= 1_000_000 => {
                        draws.iter().map(|c| [0, 1, 2].map(|axis| c[axis] % counts[axis])).collect()
                    }
                    _ => draws
                        .iter()
                        .map(|c| [0, 1, 2].map(|axis| counts[axis] - 1 - c[axis] % counts[axis].min(20)))
                        .collect(),
                };
                if cells.is_empty() {
                    cells.push([0; 3]);
                }
                let cells: BTreeSet<[u32; 3]> =
                    cells.iter().map(|cell| order.map(|axis| cell[axis])).collect();
                let in_scene = |cell: [u32; 3]| {
                    let mut to = [0; 3];
                    order.iter().zip(cell).for_each(|(axis, at)| to[*axis] = at);
                    to
                };
                let cells: Vec<[u32; 3]> = cells.into_iter().map(in_scene).collect();
                // Cubes of the grid once more: the lower number has the hit.
                if has_twins {
                    stored.extend(cells.iter().step_by(3).map(|cell| place.cube(*cell)));
                }
                let origin = place.cube([0; 3]).centre;
                triangles.iter_mut().flatten().for_each(|p| *p = origin + *p * place.step());
                stored.iter_mut().take(20).for_each(|c| {
                    if c.centre.abs().max_element() <= 6.0 {
                        c.centre = origin + c.centre * place.step()
                    }
                });
                let before = before.index(stored.len() + 1);
                Case { counts, cells, place, stored, before, triangles }
            },
        )
}

/// Pulses at cells: from outside and within, along planes and edges of the grid, at corners and centres.
fn pulses(case: &Case, draws: &[[f64; 8]], rays: usize) -> Vec<(DVec3, Vec<DVec3>)> {
    let occupied = |u: f64| {
        let cell = case.cells[(u * case.cells.len() as f64) as usize];
        cell.map(f64::from)
    };
    let of_draw = |(n, draw): (usize, &[f64; 8])| {
        let [u, v, s, t, w, a, b, step] = *draw;
        let (near, far) = (occupied(u), occupied(v));
        let middle = |cell: [f64; 3]| cell.map(|c| c + 0.5);
        let aside = |cell: [f64; 3], by: f64| {
            [cell[0] + by * (s - 0.5), cell[1] + by * (t - 0.5), cell[2] + by * (w - 0.5)]
        };
        let axis = (s * 3.0) as usize % 3;
        let sign = if t < 0.5 { -1.0 } else { 1.0 };
        let along = |mut cell: [f64; 3], by: f64| {
            cell[axis] += by * sign;
            cell
        };
        let (origin, target) = match n % 9 {
            0 => (aside(near, 60.0), far),
            1 => (middle(near), aside(near, 40.0)),
            // Along an edge of the grid, within a plane, and through the middles of cells.
            2 => (along(near, -5.0), along(near, 5.0)),
            3 => {
                let mut from = near;
                from[(axis + 1) % 3] += w;
                (along(from, -3.0), along(from, 5.0))
            }
            4 => (along(middle(near), -9.0), along(middle(near), 9.0)),
            5 => (middle(near), middle(far)),
            6 => (near, far),
            7 => (aside(middle(near), 1.0), aside(middle(far), 2.0)),
            _ => (aside(near, 3000.0), middle(far)),
        };
        let (origin, target) = (case.at(origin), case.at(target));
        let heading = target - origin;
        let heading = if heading == DVec3::ZERO { -DVec3::Z } else { unit(heading) };
        let width = 0.2 * a * b;
        (0..3).map(move |k| {
            let origin = origin + DVec3::splat(0.01 * step) * f64::from(k);
            let direction = |r: usize| match r {
                0 => heading,
                _ => {
                    let angle = r as f64 * 2.4;
                    let turn = DVec3::new(libm::cos(angle), libm::sin(angle), libm::cos(3.0 * angle));
                    unit(heading + turn * width)
                }
            };
            (origin, (0..rays).map(direction).collect())
        })
    };
    draws.iter().enumerate().flat_map(of_draw).collect()
}

fn group(pulses: &[(DVec3, Vec<DVec3>)], rays: usize) -> RayGroup {
    let mut group = RayGroup::new(rays);
    for (origin, directions) in pulses {
        group.push(*origin, |x, y, z| {
            for (r, d) in directions.iter().enumerate() {
                (x[r], y[r], z[r]) = (d.x, d.y, d.z);
            }
        });
    }
    group
}

/// First hit, found by testing all primitives.
fn brute_force(g: &Geometry, origin: DVec3, d: DVec3) -> Option<Hit> {
    let triangles =
        (0..g.triangles.len()).filter_map(|i| Some((intersect::triangle(origin, d, g.triangle(i))?, i)));
    let cubes = g.cubes.iter().enumerate();
    let cubes = cubes.filter_map(|(i, &c)| Some((intersect::cube(origin, d, c)?, g.triangles.len() + i)));
    let nearest = triangles.chain(cubes).min_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    nearest.map(|(t, i)| Hit { t, primitive: i as u32 })
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(400))]

    #[test]
    fn grids_are_hit_as_cubes(
        case in case(),
        draws in prop::collection::vec(prop::array::uniform8(0.0..1.0f64), 1..24),
        rays in prop::sample::select(vec![1usize, 3, 7, 19, 40]),
        builder in prop::sample::select(vec![Builder::Bvh, Builder::Fsah, Builder::Sah, Builder::Median, Builder::AxisSah]),
    ) {
        let (own, flat) = (case.with_grid(), case.with_cubes());
        let options = BuildOptions { jobs: 1, ..BuildOptions::of(builder) };
        let (tree, flat_tree) = (Tree::build(&own, &options), Tree::build(&flat, &options));
        let pulses = pulses(&case, &draws, rays);
        let group = group(&pulses, rays);
        let (mut hits, mut expected) = (Hits::default(), Hits::default());
        let mut scratch = TraceScratch::default();
        flat_tree.trace_group(&flat, &group, &mut expected, &mut scratch);
        for (p, (origin, directions)) in pulses.iter().enumerate() {
            let at = p * group.stride();
            let found = (expected.primitive[at] != Hits::MISS).then(|| Hit { t: expected.t[at], primitive: expected.primitive[at] });
            prop_assert_eq!(found, brute_force(&flat, *origin, directions[0]));
        }
        for level in Level::available() {
            tree.trace_group_on(level, &own, &group, &mut hits, &mut scratch);
            for (p, pulse) in pulses.iter().enumerate() {
                for at in (0..rays).map(|r| p * group.stride() + r) {
                    let found = (hits.t[at].to_bits(), hits.primitive[at]);
                    let reference = (expected.t[at].to_bits(), expected.primitive[at]);
                    prop_assert_eq!(found, reference, "{:?}: {:?}", level, pulse);
                }
            }
        }
        for (origin, directions) in pulses.iter().step_by(2) {
            // Behind each hit for some times, as rays pass through foliage.
            let mut passed: Vec<u32> = Vec::new();
            for _ in 0..6 {
                let is_new = |i: u32| !passed.contains(&i);
                let found = tree.nearest_where(&own, *origin, directions[0], is_new);
                prop_assert_eq!(found, flat_tree.nearest_where(&flat, *origin, directions[0], is_new));
                let Some(hit) = found else { break };
                passed.push(hit.primitive);
            }
        }
    }

    #[test]
    fn every_cube_is_found_again(case in case()) {
        let (own, flat) = (case.with_grid(), case.with_cubes());
        let grid = &own.grids[0];
        prop_assert_eq!(own.len(), flat.len());
        prop_assert_eq!(own.bounds(), flat.bounds());
        prop_assert!(grid.cubes().eq(case.cells.iter().map(|cell| case.place.cube(*cell))));
        for index in 0..own.cube_count() {
            prop_assert_eq!(own.cube(index), flat.cube(index));
            match own.primitive(own.triangle_count() + index) {
                Some(PrimitiveRef::Cube(stored)) => prop_assert_eq!(own.index_of_stored_cube(stored), index),
                Some(PrimitiveRef::Grid { grid: 0, voxel }) => {
                    prop_assert_eq!(grid.cells().cell(voxel), case.cells[voxel]);
                }
                found => prop_assert!(false, "{:?}", found),
            }
        }
        prop_assert_eq!(own.cube(own.cube_count()), None);
        let (values, starts, along) = grid.cells().arrays();
        let again = VoxelCells::from_arrays(values, starts.to_vec(), along.to_vec()).unwrap();
        prop_assert!(again.iter().eq(case.cells.iter().copied()));
    }

    #[test]
    fn cells_in_no_order_are_refused(case in case(), from in any::<prop::sample::Index>(), to in any::<prop::sample::Index>()) {
        let mut cells = case.cells.clone();
        let (from, to) = (from.index(cells.len()), to.index(cells.len()));
        cells.swap(from, to);
        cells.push(case.cells[0]);
        let mut all = VoxelCells::new(case.counts);
        let taken = cells.iter().take_while(|cell| all.push(**cell)).count();
        prop_assert!(taken < cells.len(), "a cell occurs twice");
        prop_assert!(all.iter().eq(cells[..taken].iter().copied()));
        prop_assert!(!all.push(case.counts), "beyond the grid");
    }
}

#[test]
fn a_ray_beyond_single_precision_is_tested_with_all() {
    let mut cells = VoxelCells::new([3; 3]);
    assert!([[0, 0, 0], [1, 1, 1], [1, 1, 2]].into_iter().all(|cell| cells.push(cell)));
    let grid = VoxelGrid::new(GridPlace::new(DVec3::ZERO, 1.0), cells, 0).unwrap();
    let geometry = Geometry { grids: vec![grid], ..Geometry::default() };
    let tree = Tree::build(&geometry, &BuildOptions::default());
    let hit = tree.nearest_where(&geometry, DVec3::new(1.5, 1.5, 1e15), -DVec3::Z, |_| true);
    assert_eq!(hit, Some(Hit { t: 1e15 - 3.0, primitive: 2 }));
}

#[test]
fn grids_without_voxels_or_numbers_cannot_be_made() {
    let place = GridPlace::new(DVec3::ZERO, 1.0);
    assert!(VoxelGrid::new(place, VoxelCells::new([3; 3]), 0).is_none());
    let mut cells = VoxelCells::new([3; 3]);
    assert!(cells.push([0; 3]) && cells.push([2, 2, 2]));
    assert!(VoxelGrid::new(place, cells, u32::MAX as usize - 2).is_none());
    // Few voxels in a vast grid would need more rows than they are worth.
    let mut cells = VoxelCells::new([u32::MAX; 3]);
    assert!(cells.push([0; 3]) && !cells.push([1 << 28, 1 << 28, 4]));
    for broken in [
        (([3; 3], [0, 1, 1], 0), vec![0], vec![0]),
        (([3; 3], [0, 1, 2], 9), vec![0], vec![0]),
        (([3; 3], [0, 1, 2], 0), vec![0], vec![3]),
        (([3; 3], [0, 1, 2], 0), vec![0], vec![1, 1]),
        (([3; 3], [0, 1, 2], 0), vec![0, 5], vec![1]),
        (([3; 3], [0, 1, 2], 0), vec![1], vec![0, 1]),
        (([0; 3], [0, 1, 2], 0), vec![0], vec![0]),
        (([3; 3], [0, 1, 2], usize::MAX), vec![0], vec![0]),
    ] {
        assert!(VoxelCells::from_arrays(broken.0, broken.1, broken.2).is_none());
    }
}

#[test]
fn a_voxel_takes_few_bytes() {
    let side = 100;
    let bytes = |share: u64| {
        let mut cells = VoxelCells::new([side; 3]);
        let all = (0..side).flat_map(|x| (0..side).flat_map(move |y| (0..side).map(move |z| [x, y, z])));
        for (n, cell) in all.enumerate() {
            if (n as u64).wrapping_mul(0x9E37_79B9_7F4A_7C15) >> 32 < (share << 32) / 100 {
                assert!(cells.push(cell));
            }
        }
        let grid = VoxelGrid::new(GridPlace::new(DVec3::ZERO, 1.0), cells, 0).unwrap();
        grid.memory() as f64 / grid.len() as f64
    };
    assert!(bytes(100) < 2.2, "{}", bytes(100));
    assert!(bytes(10) < 3.2, "{}", bytes(10));
    assert!(bytes(2) < 6.5, "{}", bytes(2));
}
