//! Traces groups of rays over a wavy surface, and the same rays one by one: the hits are equal.
//!
//!     cargo run --release -p vlscan-trace --example groups

use std::time::Instant;
use vlscan_trace::{BuildOptions, DVec3, Geometry, Hits, RayGroup, TraceScratch, Tree};

/// Vertices along a side of the surface.
const SIDE: u32 = 400;
/// Rays of a group, as the subrays of a laser beam.
const RAYS: usize = 19;

fn main() {
    let surface = surface();
    let started = Instant::now();
    let tree = Tree::build(&surface, &BuildOptions::default());
    println!("{} triangles, tree in {:.2?}", surface.triangles.len(), started.elapsed());

    let groups = groups();
    let (mut hits, mut scratch) = (Hits::default(), TraceScratch::default());
    let started = Instant::now();
    tree.trace_group(&surface, &groups, &mut hits, &mut scratch);
    println!("{} rays in groups of {RAYS}: {:.2?}", groups.len() * RAYS, started.elapsed());

    let started = Instant::now();
    let mut found = 0;
    for group in 0..groups.len() {
        for ray in 0..RAYS {
            let single =
                tree.nearest_where(&surface, groups.origin(group), groups.direction(group, ray), |_| true);
            let at = group * groups.stride() + ray;
            let in_group = (hits.primitive[at] != Hits::MISS).then(|| (hits.t[at], hits.primitive[at]));
            assert_eq!(single.map(|hit| (hit.t, hit.primitive)), in_group);
            found += usize::from(single.is_some());
        }
    }
    println!("one by one: {:.2?}; {found} of them hit, all alike", started.elapsed());
}

/// A surface of waves, 2 triangles per cell of 1 m.
fn surface() -> Geometry {
    let height = |x: u32, y: u32| (f64::from(x) * 0.07).sin() * (f64::from(y) * 0.05).cos() * 5.0;
    let vertex = |i: u32| {
        let (x, y) = (i % SIDE, i / SIDE);
        DVec3::new(f64::from(x), f64::from(y), height(x, y))
    };
    let cell = |i: u32| {
        let (x, y) = (i % (SIDE - 1), i / (SIDE - 1));
        let first = y * SIDE + x;
        [[first, first + 1, first + SIDE], [first + 1, first + SIDE + 1, first + SIDE]]
    };
    Geometry {
        vertices: (0..SIDE * SIDE).map(vertex).collect(),
        triangles: (0..(SIDE - 1) * (SIDE - 1)).flat_map(cell).collect(),
        ..Geometry::default()
    }
}

/// Narrow cones of rays from a line above the surface, swept from side to side.
fn groups() -> RayGroup {
    let mut groups = RayGroup::new(RAYS);
    for i in 0..50_000 {
        let origin = DVec3::new(200.0, f64::from(i) * 0.008, 150.0);
        let angle = (f64::from(i) * 0.01).sin();
        groups.push(origin, |x, y, z| {
            for ray in 0..RAYS {
                let aside = ray as f64 * 1e-5;
                let direction = DVec3::new(angle.sin() + aside, aside, -angle.cos()).normalize();
                (x[ray], y[ray], z[ray]) = (direction.x, direction.y, direction.z);
            }
        });
    }
    groups
}
