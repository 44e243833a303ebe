//! Fields have the hits of the mesh over their vertices, bit for bit.

use super::*;
use crate::intersect::triangle;
use crate::simd::Level;
use crate::{BuildOptions, Builder, Cube, Geometry, Hit, Hits, PrimitiveRef, RayGroup, TraceScratch, Tree};
use proptest::prelude::*;
use vlscan_geom::{Rotation, unit};

/// The mesh over the vertices of a field, and the numbers of its triangles in the field.
fn mesh(field: &HeightField) -> (Vec<DVec3>, Vec<[u32; 3]>, Vec<usize>) {
    let grid = field.grid();
    let number = |v: usize| field.heights().get(v);
    let vertices: Vec<DVec3> = (0..grid.columns * grid.rows)
        .map(|v| grid.vertex(v % grid.columns, v / grid.columns, number(v)))
        .collect();
    let (mut triangles, mut numbers) = (Vec::new(), Vec::new());
    for (cell, (row, column)) in
        (0..grid.rows.saturating_sub(1)).flat_map(|r| (0..grid.columns - 1).map(move |c| (r, c))).enumerate()
    {
        let a = row * grid.columns + column;
        let (b, c, d) = (a + grid.columns, a + grid.columns + 1, a + 1);
        for (k, corners) in [[a, b, d], [b, c, d]].into_iter().enumerate() {
            if !corners.iter().any(|&v| number(v).is_nan()) {
                triangles.push(corners.map(|v| v as u32));
                numbers.push(2 * cell + k);
            }
        }
    }
    (vertices, triangles, numbers)
}

/// A scene of stored triangles, a field after some of them, and cubes.
#[derive(Clone, Debug)]
struct Case {
    field: HeightField,
    stored: Vec<[DVec3; 3]>,
    before: usize,
    cubes: Vec<Cube>,
}

impl Case {
    fn with_field(&self) -> Geometry {
        let mut field = self.field.clone();
        field.number_from(self.before as u32);
        Geometry {
            vertices: self.stored.iter().flatten().copied().collect(),
            triangles: (0..self.stored.len() as u32).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect(),
            cubes: self.cubes.clone(),
            fields: vec![field],
            ..Geometry::default()
        }
    }

    /// The same scene with all triangles stored.
    fn with_mesh(&self) -> Geometry {
        let (mut vertices, mut triangles, _) = mesh(&self.field);
        let mut all = Vec::new();
        for (i, corners) in self.stored.iter().enumerate() {
            if i == self.before {
                all.append(&mut triangles);
            }
            all.push([0, 1, 2].map(|n| vertices.len() as u32 + n));
            vertices.extend(corners);
        }
        all.append(&mut triangles);
        Geometry { vertices, triangles: all, cubes: self.cubes.clone(), ..Geometry::default() }
    }
}

fn heights(kind: usize, numbers: Vec<f64>) -> Heights {
    let mut all = match kind {
        0 => Heights::short(-100, numbers.len()),
        _ => Heights::single(numbers.len()),
    }
    .unwrap();
    all.set(0, &numbers).unwrap();
    all
}

fn number() -> impl Strategy<Value = f64> {
    prop_oneof![
        4 => Just(0.0),
        8 => (-3..=3i32).prop_map(f64::from),
        4 => -3.0..3.0f64,
        1 => Just(40.0),
    ]
}

/// Rotations about upright and other axes, with scales of both signs.
fn similarity() -> impl Strategy<Value = Similarity> {
    let axis = prop_oneof![Just(DVec3::Z), Just(DVec3::X), Just(DVec3::new(0.3, -0.5, 1.0))];
    let angle = prop_oneof![Just(0.0), Just(std::f64::consts::FRAC_PI_2), -3.0..3.0f64];
    let scale = prop_oneof![Just(1.0), Just(2.0), Just(-0.7), 0.3..3.0f64];
    (axis, angle, scale).prop_map(|(axis, angle, scale)| Similarity {
        rotation: Rotation::about(axis, angle),
        scale,
        offset: DVec3::new(1.0, -2.0, 0.5),
    })
}

fn field() -> impl Strategy<Value = HeightField> {
    let steps = prop_oneof![
        Just(([1.0, 0.0], [0.0, -1.0])),
        Just(([0.5, 0.0], [0.0, 2.0])),
        Just(([-1.0, 0.0], [0.0, 1.0])),
        Just(([0.6, 0.8], [0.8, -0.6])),
        Just(([0.0, 1.0], [1.0, 0.0])),
        Just(([1.0, 0.0], [0.3, -1.0])),
    ];
    let moved = prop_oneof![
        Just((None, -0.0, DVec3::ZERO)),
        Just((None, -0.0, DVec3::new(500_010.0, 5_400_008.0, 1.0))),
        Just((Some(Similarity::translation(DVec3::new(0.25, -3.1, 2.0))), -0.0, DVec3::new(0.1, 0.2, 0.3))),
        Just((None, 1.7, DVec3::ZERO)),
        similarity().prop_map(|by| (Some(by), -0.0, DVec3::new(0.1, 0.2, 0.3))),
        similarity().prop_map(|by| (Some(by), 0.7, DVec3::ZERO)),
    ];
    let size = prop_oneof![(1..9usize, 1..9usize), (2..60usize, 2..24usize), (65..140usize, 2..5usize)];
    (size, steps, moved, 0.0..0.3f64, 0..2usize, any::<bool>()).prop_flat_map(
        |((columns, rows), (of_column, of_row), moved, holes, kind, has_holes)| {
            let drawn = prop::collection::vec((number(), 0.0..1.0f64), columns * rows);
            drawn.prop_map(move |drawn| {
                let is_hole = |draw: f64| has_holes && draw < holes;
                let numbers = drawn.iter().map(|(z, draw)| if is_hole(*draw) { f64::NAN } else { *z });
                let (transform, raise, shift) = moved;
                let far = if shift.x > 1e5 { [500_000.0, 5_400_000.0] } else { [-8.0, 3.0] };
                let grid = HeightGrid {
                    origin: far,
                    of_column,
                    of_row,
                    scale: 0.5,
                    offset: 0.25,
                    transform,
                    raise,
                    shift,
                    ..HeightGrid::new(columns, rows)
                };
                HeightField::new(grid, heights(kind, numbers.collect()), 0).unwrap()
            })
        },
    )
}

fn case() -> impl Strategy<Value = Case> {
    let coordinate = || -6..=6i32;
    let corner = [coordinate(), coordinate(), coordinate()].prop_map(|c| DVec3::from(c.map(f64::from)));
    let triangle = [corner.clone(), corner.clone(), corner.clone()];
    let cube = (corner, 0.2..1.0f64).prop_map(|(centre, half)| Cube { centre, half });
    let stored = prop::collection::vec(triangle, 0..30);
    (field(), stored, any::<prop::sample::Index>(), prop::collection::vec(cube, 0..4), any::<bool>())
        .prop_map(|(field, mut stored, before, cubes, has_twins)| {
            // Triangles of the field once more: the lower number has the hit.
            if has_twins {
                let (vertices, triangles, _) = mesh(&field);
                stored.extend(triangles.iter().step_by(3).map(|t| t.map(|v| vertices[v as usize])));
            }
            let before = before.index(stored.len() + 1);
            Case { field, stored, before, cubes }
        })
}

/// Pulses towards the field: from above, along it, within it, through its vertices and along its lines.
fn pulses(case: &Case, draws: &[[f64; 8]], rays: usize) -> Vec<(DVec3, Vec<DVec3>)> {
    let grid = case.field.grid();
    let at = |u: f64, v: f64, z: f64| {
        let (column, row) = (u * grid.columns as f64, v * grid.rows as f64);
        let [x, y] = grid.place(0, 0);
        let of = |axis: usize| column * grid.of_column[axis] + row * grid.of_row[axis];
        grid.moved(DVec3::new(x + of(0), y + of(1), z))
    };
    let vertex = |u: f64, v: f64| {
        let (column, row) = ((u * grid.columns as f64) as usize, (v * grid.rows as f64) as usize);
        let (column, row) = (column.min(grid.columns - 1), row.min(grid.rows - 1));
        let number = case.field.heights().get(row * grid.columns + column);
        grid.vertex(column, row, if number.is_nan() { 0.0 } else { number })
    };
    let of_draw = |(n, draw): (usize, &[f64; 8])| {
        let [u, v, s, t, w, a, b, step] = *draw;
        let (origin, target) = match n % 7 {
            0 => (at(u, v, 30.0), vertex(s, t)),
            1 => (at(u, v, 200.0), at(s, t, 0.0)),
            2 => (vertex(u, v) + DVec3::Z * 10.0, vertex(u, v)),
            3 => (vertex(u, v) + DVec3::Z * 0.01, vertex(s, t) + DVec3::Z * 0.01),
            // Along a line of the grid, at the height of whole numbers.
            4 => (vertex(u, v), vertex(s, v)),
            5 => (at(u, v, (4.0 * w).round() * 0.25), at(s, t, (4.0 * w).round() * 0.25)),
            _ => (at(u, v, -5.0), at(s, t, 5.0)),
        };
        let axis = target - origin;
        let axis = if axis == DVec3::ZERO { -DVec3::Z } else { unit(axis) };
        let width = 0.05 * a * b;
        (0..3).map(move |k| {
            let origin = origin + DVec3::splat(0.01 * step) * f64::from(k);
            let aside = |r: usize| match r {
                0 => axis,
                _ => {
                    let angle = r as f64 * 2.4;
                    unit(
                        axis + DVec3::new(libm::cos(angle), libm::sin(angle), libm::cos(3.0 * angle)) * width,
                    )
                }
            };
            (origin, (0..rays).map(aside).collect())
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

/// The first hit of a ray, by the exact test of every primitive.
fn nearest_of_all(geometry: &Geometry, origin: DVec3, direction: DVec3) -> Option<Hit> {
    let mut best: Option<Hit> = None;
    let mut add = |primitive: usize, t: Option<f64>| {
        let hit = t.map(|t| Hit { t, primitive: primitive as u32 });
        let order = |hit: &Hit| (hit.t, hit.primitive);
        if let Some(hit) = hit.filter(|hit| best.is_none_or(|best| order(hit) < order(&best))) {
            best = Some(hit);
        }
    };
    for field in &geometry.fields {
        field.test_all(origin, direction, |number, t| add(number as usize, Some(t)));
    }
    for index in 0..geometry.triangles.len() {
        add(geometry.number_of_triangle(index), triangle(origin, direction, geometry.stored_triangle(index)));
    }
    for (index, cube) in geometry.cubes.iter().enumerate() {
        add(geometry.triangle_count() + index, crate::intersect::cube(origin, direction, *cube));
    }
    best
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(300))]

    #[test]
    fn fields_are_hit_as_meshes(
        case in case(),
        draws in prop::collection::vec(prop::array::uniform8(0.0..1.0f64), 1..24),
        rays in prop::sample::select(vec![1usize, 3, 7, 19, 40]),
        builder in prop_oneof![Just(Builder::Bvh), Just(Builder::Fsah)],
    ) {
        let (own, flat) = (case.with_field(), case.with_mesh());
        let options = BuildOptions { jobs: 1, ..BuildOptions::of(builder) };
        let (tree, flat_tree) = (Tree::build(&own, &options), Tree::build(&flat, &options));
        let number = |id: u32| match id {
            Hits::MISS => Hits::MISS,
            id => id - own.missing_before(id as usize) as u32,
        };
        let pulses = pulses(&case, &draws, rays);
        let group = group(&pulses, rays);
        let (mut hits, mut expected) = (Hits::default(), Hits::default());
        let mut scratch = TraceScratch::default();
        flat_tree.trace_group(&flat, &group, &mut expected, &mut scratch);
        for level in Level::available() {
            tree.trace_group_on(level, &own, &group, &mut hits, &mut scratch);
            for (p, pulse) in pulses.iter().enumerate() {
                for at in (0..rays).map(|r| p * group.stride() + r) {
                    let found = (hits.t[at].to_bits(), number(hits.primitive[at]));
                    let reference = (expected.t[at].to_bits(), expected.primitive[at]);
                    prop_assert_eq!(found, reference, "{:?}: {:?}", level, pulse);
                }
            }
        }
        // Against all triangles, without a pyramid.
        for (p, (origin, directions)) in pulses.iter().enumerate().step_by(3) {
            let nearest = nearest_of_all(&own, *origin, directions[0]);
            let at = p * group.stride();
            let reference = nearest.map_or((f64::INFINITY, Hits::MISS), |hit| (hit.t, hit.primitive));
            prop_assert_eq!((hits.t[at], hits.primitive[at]), reference, "{:?}", (origin, directions[0]));
        }
        for (origin, directions) in pulses.iter().step_by(2) {
            let found = tree.nearest_where(&own, *origin, directions[0], |_| true);
            let reference = flat_tree.nearest_where(&flat, *origin, directions[0], |_| true);
            prop_assert_eq!(found.map(|h| Hit { primitive: number(h.primitive), ..h }), reference);
            let behind = reference.and_then(|first| {
                flat_tree.nearest_where(&flat, *origin, directions[0], |i| i != first.primitive)
            });
            if let Some(first) = found {
                let found = tree.nearest_where(&own, *origin, directions[0], |i| i != first.primitive);
                prop_assert_eq!(found.map(|h| Hit { primitive: number(h.primitive), ..h }), behind);
            }
        }
    }

    #[test]
    fn every_triangle_is_found_again(case in case(), u in -0.2..1.2f64, v in -0.2..1.2f64) {
        let (own, flat) = (case.with_field(), case.with_mesh());
        let field = &own.fields[0];
        prop_assert_eq!(field.triangles() + case.stored.len(), flat.triangles.len());
        let mut seen = 0;
        for number in 0..own.triangle_count() {
            prop_assert_eq!(own.missing_before(number), number - seen);
            let corners = own.triangle(number);
            match own.primitive(number) {
                Some(PrimitiveRef::Triangle(index)) => prop_assert_eq!(own.number_of_triangle(index), number),
                Some(PrimitiveRef::Field { field: 0, triangle }) => {
                    prop_assert_eq!(field.triangle(triangle), (!corners[0].is_nan()).then_some(corners));
                }
                found => prop_assert!(false, "{:?}", found),
            }
            if !corners.iter().any(|p| p.is_nan()) {
                prop_assert_eq!(corners, flat.triangle(seen));
                seen += 1;
            }
        }
        prop_assert_eq!(seen, flat.triangles.len());
        let (vertices, triangles, numbers) = mesh(field);
        let used = triangles.iter().flatten().map(|&v| vertices[v as usize]);
        prop_assert_eq!(field.bounds(), Aabb::around(used));
        prop_assert_eq!(own.bounds(), flat.bounds());
        // Every triangle above or below a place is near it.
        let bounds = Aabb::around(vertices.iter().filter(|v| !v.is_nan()).copied());
        let place = bounds.min + (bounds.max - bounds.min) * DVec3::new(u, v, 0.0);
        let near: Vec<usize> = field.triangles_near(place.x, place.y).collect();
        for (corners, number) in triangles.iter().zip(numbers) {
            let box_of = Aabb::around(corners.map(|v| vertices[v as usize]));
            let is_over = (box_of.min.x..=box_of.max.x).contains(&place.x) && (box_of.min.y..=box_of.max.y).contains(&place.y);
            prop_assert!(!is_over || near.contains(&number), "{number} near {place}");
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(60))]

    #[test]
    fn many_fields_are_hit_as_each_of_them(
        fields in prop::collection::vec(field(), 1..40),
        aimed in any::<prop::sample::Index>(),
        draws in prop::collection::vec(prop::array::uniform8(0.0..1.0f64), 1..6),
        rays in prop::sample::select(vec![1usize, 3, 19]),
        builder in prop_oneof![Just(Builder::Bvh), Just(Builder::Fsah)],
    ) {
        // Side by side, some of them over each other, with numbers in their order.
        let (mut fields, mut first) = (fields, 0);
        for (i, field) in fields.iter_mut().enumerate() {
            field.number_from(first);
            first += field.len() as u32;
            let shift = field.grid().shift - DVec3::new((i % 6) as f64, (i / 6) as f64, 0.0) * 9.0;
            field.shift(shift);
        }
        let field = fields[aimed.index(fields.len())].clone();
        let case = Case { field, stored: Vec::new(), before: 0, cubes: Vec::new() };
        let pulses = pulses(&case, &draws, rays);
        let geometry = Geometry { fields, ..Geometry::default() };
        let tree = Tree::build(&geometry, &BuildOptions { jobs: 1, ..BuildOptions::of(builder) });
        let group = group(&pulses, rays);
        let nearest = |pulse: &(DVec3, Vec<DVec3>), ray: usize| {
            nearest_of_all(&geometry, pulse.0, pulse.1[ray])
        };
        let expected: Vec<[Option<Hit>; 2]> =
            pulses.iter().map(|pulse| [0, rays - 1].map(|ray| nearest(pulse, ray))).collect();
        let (mut hits, mut scratch) = (Hits::default(), TraceScratch::default());
        for level in Level::available() {
            tree.trace_group_on(level, &geometry, &group, &mut hits, &mut scratch);
            for (p, expected) in expected.iter().enumerate() {
                for (ray, hit) in [0, rays - 1].into_iter().zip(expected) {
                    let at = p * group.stride() + ray;
                    let reference = hit.map_or((f64::INFINITY, Hits::MISS), |hit| (hit.t, hit.primitive));
                    prop_assert_eq!((hits.t[at], hits.primitive[at]), reference, "{:?}", level);
                }
            }
        }
        for ((origin, directions), expected) in pulses.iter().zip(&expected) {
            let found = tree.nearest_where(&geometry, *origin, directions[0], |_| true);
            prop_assert_eq!(found, expected[0]);
            if let Some(first) = found {
                // Behind the first hit, as rays pass through what is filtered out.
                let next = tree.nearest_where(&geometry, *origin, directions[0], |i| i != first.primitive);
                prop_assert!(next.is_none_or(|next| (next.t, next.primitive) > (first.t, first.primitive)));
            }
        }
    }
}

#[test]
fn a_ray_beyond_single_precision_is_tested_with_all() {
    let mut all = Heights::single(9).unwrap();
    all.set(0, &[1.0; 9]).unwrap();
    let field = HeightField::new(HeightGrid::new(3, 3), all, 0).unwrap();
    let geometry = Geometry { fields: vec![field], ..Geometry::default() };
    let tree = Tree::build(&geometry, &BuildOptions::default());
    let hit = tree.nearest_where(&geometry, DVec3::new(0.75, 0.5, 1e15), -DVec3::Z, |_| true);
    assert_eq!(hit, Some(Hit { t: 1e15 - 1.0, primitive: 1 }));
}

#[test]
fn fields_without_triangles_are_not_hit() {
    for (columns, rows) in [(1, 1), (1, 9), (9, 1), (3, 3)] {
        let field =
            HeightField::new(HeightGrid::new(columns, rows), Heights::single(columns * rows).unwrap(), 0)
                .unwrap();
        assert_eq!((field.triangles(), field.bounds().is_empty()), (0, true));
        let geometry = Geometry { fields: vec![field], ..Geometry::default() };
        let tree = Tree::build(&geometry, &BuildOptions::default());
        assert_eq!(tree.nearest_where(&geometry, DVec3::new(0.5, 0.5, 9.0), -DVec3::Z, |_| true), None);
    }
    assert!(HeightField::new(HeightGrid::new(2, 2), Heights::single(5).unwrap(), 0).is_none());
    assert!(
        HeightField::new(HeightGrid::new(2, 2), Heights::single(4).unwrap(), u32::MAX as usize - 2).is_none()
    );
}

#[test]
fn a_cell_takes_few_bytes() {
    let side = 1000;
    let bytes = |heights: Heights| {
        let field = HeightField::new(HeightGrid::new(side, side), heights, 0).unwrap();
        field.memory() as f64 / (side * side) as f64
    };
    let mut short = Heights::short(0, side * side).unwrap();
    let mut single = Heights::single(side * side).unwrap();
    for row in (1..side).step_by(2) {
        short.set(row * side, &vec![7.0; side]).unwrap();
        single.set(row * side, &vec![7.5; side]).unwrap();
    }
    // Half of the rows are missing, which is when all that a field can have is there.
    assert!(bytes(short) < 3.5);
    assert!(bytes(single) < 5.5);
}
