//! Property tests: every tree and every traversal reports the hits of the exact test of all primitives, bit
//! for bit.

use super::options::{Accounting, Axes};
use super::*;
use proptest::prelude::*;
use vlscan_geom::{DVec3, unit};

/// First hit, found by testing all primitives.
fn brute_force(g: &Geometry, origin: DVec3, d: DVec3) -> Option<Hit> {
    let triangles =
        (0..g.triangles.len()).filter_map(|i| Some((intersect::triangle(origin, d, g.triangle(i))?, i)));
    let cubes = g.cubes.iter().enumerate();
    let cubes = cubes.filter_map(|(i, &c)| Some((intersect::cube(origin, d, c)?, g.triangles.len() + i)));
    triangles
        .chain(cubes)
        .min_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)))
        .map(|(t, i)| Hit { t, primitive: i as u32 })
}

#[derive(Clone)]
struct Pulse {
    origin: DVec3,
    directions: Vec<DVec3>,
}

fn pulse(origin: DVec3, directions: &[DVec3]) -> Pulse {
    Pulse { origin, directions: directions.to_vec() }
}

fn group<'a>(pulses: impl Iterator<Item = &'a Pulse>, rays: usize) -> RayGroup {
    let mut group = RayGroup::new(rays);
    for p in pulses {
        group.push(p.origin, |x, y, z| {
            for (r, d) in p.directions.iter().enumerate() {
                (x[r], y[r], z[r]) = (d.x, d.y, d.z);
            }
        });
    }
    group
}

fn hit(hits: &Hits, at: usize) -> Option<Hit> {
    (hits.primitive[at] != Hits::MISS).then(|| Hit { t: hits.t[at], primitive: hits.primitive[at] })
}

fn trees(g: &Geometry) -> Vec<Tree> {
    let builders = [Builder::Median, Builder::Sah, Builder::AxisSah, Builder::Fsah, Builder::Bvh];
    let mut trees: Vec<Tree> = builders.map(|b| Tree::build(g, &BuildOptions::of(b))).into();
    let strict = BuildOptions {
        accounting: Accounting::Local,
        axes: Axes::TurnThenNext,
        ..BuildOptions::strict(Builder::Fsah)
    };
    trees.push(Tree::build(g, &strict));
    trees
}

/// Asserts that pulses alone and in groups, single rays and brute force agree in all trees.
fn assert_agreement(g: &Geometry, pulses: &[Pulse]) {
    let expected = expected_hits(g, pulses);
    let (mut hits, mut scratch) = (Hits::default(), TraceScratch::default());
    for (n, tree) in trees(g).iter().enumerate() {
        for (p, expected) in pulses.iter().zip(&expected) {
            tree.trace_group(g, &group(std::iter::once(p), p.directions.len()), &mut hits, &mut scratch);
            for (i, (d, expected)) in p.directions.iter().zip(expected).enumerate() {
                let o = p.origin;
                assert_eq!(hit(&hits, i), *expected, "tree {n}, ray {i} of a pulse from {o} to {d}");
                assert_eq!(tree.nearest_where(g, o, *d, |_| true), *expected, "tree {n}, single ray {i}");
            }
            for (d, expected) in p.directions.iter().zip(expected) {
                tree.trace_group(g, &group([pulse(p.origin, &[*d])].iter(), 1), &mut hits, &mut scratch);
                assert_eq!(hit(&hits, 0), *expected, "tree {n}, a pulse of one ray from {} to {d}", p.origin);
            }
        }
        assert_groups_agree(n, tree, g, pulses, &expected);
    }
}

fn expected_hits(g: &Geometry, pulses: &[Pulse]) -> Vec<Vec<Option<Hit>>> {
    let of_pulse = |p: &Pulse| p.directions.iter().map(|d| brute_force(g, p.origin, *d)).collect();
    pulses.iter().map(of_pulse).collect()
}

/// Asserts that groups agree with the expected hits on every instruction set.
fn assert_groups_agree(n: usize, tree: &Tree, g: &Geometry, pulses: &[Pulse], expected: &[Vec<Option<Hit>>]) {
    let (mut hits, mut scratch) = (Hits::default(), TraceScratch::default());
    for rays in [1, 2, 3, 4, 7, 19, 62] {
        let members = || pulses.iter().zip(expected).filter(|(p, _)| p.directions.len() == rays);
        let group = group(members().map(|(p, _)| p), rays);
        for level in simd::Level::available() {
            tree.trace_group_on(level, g, &group, &mut hits, &mut scratch);
            for (i, (p, expected)) in members().enumerate() {
                for (r, expected) in expected.iter().enumerate() {
                    let (o, d) = (p.origin, p.directions[r]);
                    let found = hit(&hits, i * group.stride() + r);
                    assert_eq!(found, *expected, "{level:?}, tree {n}, ray {r} of pulse {i} from {o} to {d}");
                }
            }
        }
    }
}

/// A number that is often special: 0, a small integer, or arbitrary.
fn coordinate() -> impl Strategy<Value = f64> {
    prop_oneof![
        Just(0.0),
        (-4i32..=4).prop_map(f64::from),
        -4.0..4.0f64,
        (-8i32..=8).prop_map(|i| f64::from(i) * 0.125)
    ]
}

fn point() -> impl Strategy<Value = DVec3> {
    [coordinate(), coordinate(), coordinate()].prop_map(DVec3::from)
}

/// Triangles over few points, so that edges and corners are shared and some are degenerate, and some cubes.
fn geometry() -> impl Strategy<Value = Geometry> {
    (3usize..40).prop_flat_map(|points| {
        let corner = 0..points as u32;
        (
            prop::collection::vec(point(), points),
            prop::collection::vec([corner.clone(), corner.clone(), corner], 0..120),
            prop::collection::vec(
                (point(), 0.01..0.8f64).prop_map(|(centre, half)| Cube { centre, half }),
                0..40,
            ),
            0..4usize,
        )
            .prop_map(|(mut vertices, triangles, cubes, flat)| {
                if flat < 3 {
                    vertices.iter_mut().for_each(|v| v[flat] = 0.0);
                }
                Geometry { vertices, triangles, cubes, ..Geometry::default() }
            })
    })
}

/// Directions of one pulse: a cone around an axis.
fn cone(axis: DVec3, width: f64, rays: usize) -> Vec<DVec3> {
    let side = unit(axis.cross(if axis.x.abs() < axis.y.abs() { DVec3::X } else { DVec3::Y }));
    let up = axis.cross(side);
    (0..rays)
        .map(|i| {
            let (ring, angle) = ((i as f64 / rays as f64).sqrt() * width, 2.4 * i as f64);
            unit(axis + side * (ring * libm::cos(angle)) + up * (ring * libm::sin(angle)))
        })
        .collect()
}

/// Pulses aimed at a vertex, the middle of an edge, or anywhere.
fn pulses(g: &Geometry, aims: &[(DVec3, usize, u8, f64)]) -> Vec<Pulse> {
    aims.iter()
        .map(|&(from, which, kind, width)| {
            let origin = from * 3.0;
            let vertex = |i: usize| g.vertices[i % g.vertices.len()];
            let target = match kind % 3 {
                0 => vertex(which),
                1 => (vertex(which) + vertex(which + 1)) * 0.5,
                _ => from.yzx() * 0.5,
            };
            let aim = if kind & 4 == 0 { target - origin } else { DVec3::AXES[which % 3] };
            let aim = if aim == DVec3::ZERO { DVec3::X } else { aim };
            pulse(origin, &if kind & 8 == 0 { cone(unit(aim), width, 19) } else { vec![aim] })
        })
        .flat_map(|p| {
            // Adds neighbours of each pulse, so that packets form.
            let beside = |n: u32| {
                let step = DVec3::new(0.01, 0.02, -0.015) * f64::from(n);
                let directions = p.directions.iter().map(|d| unit(*d + step * 0.1)).collect();
                Pulse { origin: p.origin + step, directions }
            };
            [p.clone(), beside(1), beside(2), p.clone(), beside(7)]
        })
        .collect()
}

use glam::Vec3Swizzles;

proptest! {
    #![proptest_config(ProptestConfig::with_cases(vlscan_base::machine::cases(80)))]

    #[test]
    fn all_trees_agree_with_brute_force(
        mut g in geometry(),
        aims in prop::collection::vec((point(), 0usize..64, 0u8..16, prop_oneof![Just(3e-4), Just(0.1), Just(1.5)]), 1..8),
        offset in prop_oneof![Just(0.0), Just(5.4e6), Just(1e12)],
        scale in prop_oneof![Just(1.0), Just(1e-3), Just(1e4)],
    ) {
        let mut pulses = pulses(&g, &aims);
        let place = |p: DVec3| p * scale + DVec3::new(offset, offset * 0.3, -offset * 0.01);
        g.vertices.iter_mut().for_each(|v| *v = place(*v));
        g.cubes.iter_mut().for_each(|c| *c = Cube { centre: place(c.centre), half: c.half * scale });
        pulses.iter_mut().for_each(|p| p.origin = place(p.origin));
        assert_agreement(&g, &pulses);
    }

    #[test]
    fn far_origins_and_odd_rays_agree(
        g in geometry(), from in point(), far in prop_oneof![Just(1e3), Just(1e7), Just(1e11), Just(1e14)],
        odd in prop_oneof![Just(DVec3::ZERO), Just(DVec3::NAN), Just(DVec3::INFINITY), Just(DVec3::X * -0.0), Just(DVec3::Y * 1e-200)],
    ) {
        let origin = (from + DVec3::splat(0.1)) * far;
        assert_agreement(&g, &[pulse(origin, &cone(unit(-from - DVec3::splat(0.1)), 1.0 / far, 7)), pulse(origin, &[odd, -origin])]);
        assert_agreement(&g, &[pulse(DVec3::NAN, &[DVec3::X])]);
    }

    /// From within a closed mesh every ray hits it; from outside an even number of times, so never "through"
    /// an edge.
    #[test]
    fn closed_meshes_do_not_leak(seed in 0u64..1000, rings in 3usize..9, sides in 3usize..12, offset in prop_oneof![Just(0.0), Just(4.7e6)]) {
        let centre = DVec3::new(offset, -offset, 0.1 * offset);
        let g = ball(centre, rings, sides, seed);
        let tree = Tree::build(&g, &BuildOptions::default());
        let origin = centre + DVec3::new(0.05, -0.03, 0.02);
        for (i, v) in g.vertices.iter().enumerate() {
            let next = g.vertices[(i + 1) % g.vertices.len()];
            for target in [*v, (*v + next) * 0.5, *v * 0.3 + next * 0.7] {
                let d = unit(target - origin);
                for d in [d, DVec3::new(d.x.next_up(), d.y, d.z), DVec3::new(d.x, d.y.next_down(), d.z)] {
                    prop_assert!(tree.nearest_where(&g, origin, d, |_| true).is_some(), "a leak towards {}", d);
                }
            }
        }
    }
}

/// Returns a closed, star-shaped, bumpy mesh.
fn ball(centre: DVec3, rings: usize, sides: usize, seed: u64) -> Geometry {
    let bumps = vlscan_base::rng::Stream::new(seed, vlscan_base::rng::Purpose::SceneMaking);
    let mut g = Geometry::default();
    let radius = |i: usize| 1.0 + 0.3 * bumps.uniform(0, i as u64, 0);
    g.vertices.push(centre + DVec3::Z * radius(0));
    for r in 1..=rings {
        for s in 0..sides {
            let (theta, phi) = (
                std::f64::consts::PI * r as f64 / (rings + 1) as f64,
                std::f64::consts::TAU * s as f64 / sides as f64,
            );
            let d = DVec3::new(
                libm::sin(theta) * libm::cos(phi),
                libm::sin(theta) * libm::sin(phi),
                libm::cos(theta),
            );
            g.vertices.push(centre + d * radius(r * 100 + s));
        }
    }
    g.vertices.push(centre - DVec3::Z * radius(1));
    let at = |r: usize, s: usize| (1 + (r - 1) * sides + s % sides) as u32;
    let last = g.vertices.len() as u32 - 1;
    for s in 0..sides {
        g.triangles.push([0, at(1, s), at(1, s + 1)]);
        g.triangles.push([last, at(rings, s + 1), at(rings, s)]);
        for r in 1..rings {
            g.triangles.push([at(r, s), at(r + 1, s), at(r + 1, s + 1)]);
            g.triangles.push([at(r, s), at(r + 1, s + 1), at(r, s + 1)]);
        }
    }
    g
}

#[test]
fn trees_of_nothing_and_of_one_work() {
    let empty = Geometry::default();
    let one = Geometry {
        vertices: vec![DVec3::new(-1.0, -1.0, 0.0), DVec3::new(1.0, -1.0, 0.0), DVec3::new(0.0, 1.0, 0.0)],
        triangles: vec![[0, 1, 2]],
        ..Geometry::default()
    };
    let point =
        Geometry { vertices: vec![DVec3::ONE], triangles: vec![[0, 0, 0]; 40], ..Geometry::default() };
    let same = Geometry { triangles: vec![[0, 1, 2]; 1000], ..one.clone() };
    let broken = Geometry {
        vertices: vec![DVec3::NAN, DVec3::ONE, DVec3::ZERO, DVec3::INFINITY],
        triangles: vec![[0, 1, 2], [1, 2, 3]],
        cubes: vec![
            Cube { centre: DVec3::NAN, half: 1.0 },
            Cube { centre: DVec3::Z * 4.0, half: f64::INFINITY },
        ],
        ..Geometry::default()
    };
    for g in [empty, one, point, same, broken] {
        assert_agreement(
            &g,
            &[pulse(DVec3::Z * 5.0, &cone(-DVec3::Z, 0.3, 19)), pulse(DVec3::ZERO, &[DVec3::X])],
        );
    }
}

#[test]
fn a_filter_looks_behind_what_it_refuses() {
    let g = Geometry {
        cubes: (0..50).map(|i| Cube { centre: DVec3::Y * f64::from(5 + 3 * i), half: 1.0 }).collect(),
        ..Geometry::default()
    };
    for tree in trees(&g) {
        let hit = tree.nearest_where(&g, DVec3::ZERO, DVec3::Y, |p| p >= 7);
        assert_eq!(hit, Some(Hit { t: 25.0, primitive: 7 }));
        assert_eq!(tree.nearest_where(&g, DVec3::ZERO, DVec3::Y, |_| false), None);
    }
}

#[test]
fn the_tree_does_not_depend_on_threads() {
    let g = ball(DVec3::ZERO, 60, 80, 5);
    for builder in [Builder::Median, Builder::Sah, Builder::AxisSah, Builder::Fsah, Builder::Bvh] {
        let build = |jobs| Tree::build(&g, &BuildOptions { jobs, ..BuildOptions::of(builder) });
        let (one, many) = (build(1), build(4));
        assert_eq!(one.nodes, many.nodes);
        assert_eq!(one.statistics(), many.statistics());
        assert!(one.blocks.iter().zip(&many.blocks).all(|(a, b)| a.id == b.id));
        assert_eq!(one.blocks.len(), many.blocks.len());
    }
}

/// Neighbouring pulses with more rays than two registers hold, over triangles smaller than their footprint.
#[test]
fn wide_pulses_in_groups_agree() {
    let g = ball(DVec3::new(1000.0, -2000.0, 50.0), 40, 60, 9);
    let pulses: Vec<Pulse> = (0..40)
        .map(|i| {
            let origin = g.vertices[0] + DVec3::new(0.02 * f64::from(i), 3.0 - 0.1 * f64::from(i), 20.0);
            let axis = unit(g.vertices[30 * i as usize] - origin);
            pulse(origin, &cone(axis, 3e-3 * f64::from(i % 7), if i < 20 { 62 } else { 19 }))
        })
        .collect();
    assert_agreement(&g, &pulses);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(60))]

    /// Inputs of merging: pulses of few rays that start beside, before and behind each other, some of them
    /// within the mesh, some with a NaN neighbour.
    #[test]
    fn merged_pulses_agree(
        seed in 0u64..1000, rays in prop::sample::select(vec![1usize, 2, 3, 4, 7]), away in 0.0..5.0f64,
        step in prop_oneof![Just(0.0), Just(1e-4), Just(0.05), Just(0.3)],
        turn in prop_oneof![Just(0.0), Just(1e-5), Just(1e-3), Just(0.015)],
        offset in prop_oneof![Just(0.0), Just(5.4e6)], odd in prop::option::of(0usize..40),
    ) {
        let draw = vlscan_base::rng::Stream::new(seed, vlscan_base::rng::Purpose::SceneMaking);
        let centre = DVec3::new(offset, -offset, 0.1 * offset);
        let g = ball(centre, 12, 20, seed);
        let any = |i: u64, n: u32| {
            DVec3::new(draw.uniform(n, i, 0), draw.uniform(n, i, 1), draw.uniform(n, i, 2)) - DVec3::splat(0.5)
        };
        let ahead = unit(any(0, 1));
        let from = centre - ahead * away;
        let pulses: Vec<Pulse> = (0..40)
            .map(|i| {
                let axis = unit(ahead + any(i, 2) * turn);
                let mut pulse = pulse(from + any(i, 3) * step, &cone(axis, 2.0 * turn, rays));
                if odd == Some(i as usize) {
                    pulse.origin.y = f64::NAN;
                }
                pulse
            })
            .collect();
        let expected = expected_hits(&g, &pulses);
        for builder in [Builder::Fsah, Builder::Bvh] {
            let tree = Tree::build(&g, &BuildOptions::of(builder));
            assert_groups_agree(0, &tree, &g, &pulses, &expected);
        }
    }
}

#[test]
fn the_statistics_of_the_wide_tree_are_its_own() {
    let g = ball(DVec3::ZERO, 40, 60, 9);
    let tree = Tree::build(&g, &BuildOptions::default());
    let s = tree.statistics();
    assert_eq!((s.primitives, s.references), (g.len(), g.len()));
    assert!(s.max_leaf <= 16 && s.min_leaf >= 1 && s.leaves < g.len() / 12 && s.max_depth < 6, "{s:?}");
    assert!(tree.memory() < 80 * g.len());
    // A bumpy ball of radius 1 to 1.3 in its box.
    assert!((s.root_area / (6.0 * 2.4f64.powi(2)) - 1.0).abs() < 0.2, "{s:?}");
}

/// A scene 20 km wide at UTM coordinates has the same echoes as around the origin, to far below 0.1 mm. All
/// coordinates are multiples of 2⁻¹⁰ m, so that moving the scene rounds nothing.
#[test]
fn wide_scenes_at_utm_coordinates_are_exact() {
    let draw = vlscan_base::rng::Stream::new(4, vlscan_base::rng::Purpose::SceneMaking);
    let coarse = |x: f64| (x * 1024.0).round() / 1024.0;
    let cells = 200u32;
    let mut local = Geometry::default();
    for i in 0..=cells {
        for j in 0..=cells {
            let height = coarse(80.0 * draw.uniform(0, u64::from(i), j));
            let at = |c: u32| f64::from(c) * 100.0 - 10_000.0;
            local.vertices.push(DVec3::new(at(i), at(j), height));
        }
    }
    for i in 0..cells {
        for j in 0..cells {
            let a = i * (cells + 1) + j;
            let b = a + cells + 1;
            local.triangles.extend([[a, b, b + 1], [a, b + 1, a + 1]]);
        }
    }
    let shift = DVec3::new(498_765.0, 5_412_345.0, 120.0);
    let moved = Geometry { vertices: local.vertices.iter().map(|v| *v + shift).collect(), ..local.clone() };
    let pulses: Vec<Pulse> = (0..600)
        .map(|p| {
            let u = |n| draw.uniform(1, p / 4, n);
            let beside = (p % 4) as f64;
            let origin = DVec3::new(19_000.0 * u(0) - 9_500.0 + beside, 19_000.0 * u(1) - 9_500.0, 1500.0);
            let axis = DVec3::new(u(2) - 0.5, u(3) - 0.5 + 1e-3 * beside, -1.2);
            pulse(DVec3::from(origin.to_array().map(coarse)), &cone(unit(axis), 3e-4, 19))
        })
        .collect();
    let group = |shift: DVec3| {
        let moved: Vec<Pulse> = pulses.iter().map(|p| pulse(p.origin + shift, &p.directions)).collect();
        group(moved.iter(), 19)
    };
    let (options, mut scratch) = (BuildOptions::default(), TraceScratch::default());
    let (mut near, mut far) = (Hits::default(), Hits::default());
    Tree::build(&local, &options).trace_group(&local, &group(DVec3::ZERO), &mut near, &mut scratch);
    Tree::build(&moved, &options).trace_group(&moved, &group(shift), &mut far, &mut scratch);
    let stride = group(shift).stride();
    for (p, pulse) in pulses.iter().enumerate() {
        for (r, d) in pulse.directions.iter().enumerate() {
            let at = p * stride + r;
            assert_ne!(far.primitive[at], Hits::MISS);
            assert!((near.t[at] - far.t[at]).abs() < 1e-6, "{} against {}", near.t[at], far.t[at]);
            let truth = brute_force_one(&local, pulse.origin, *d, far.primitive[at]);
            assert!(truth.is_some_and(|t| (t - far.t[at]).abs() < 1e-6), "{truth:?}");
        }
    }
}

/// Distance of one triangle by its plane equation, relative to the origin of the ray.
fn brute_force_one(g: &Geometry, origin: DVec3, d: DVec3, i: u32) -> Option<f64> {
    let [a, b, c] = g.triangle(i as usize);
    let normal = (b - a).cross(c - a);
    let t = (a - origin).dot(normal) / d.dot(normal);
    t.is_finite().then_some(t)
}
