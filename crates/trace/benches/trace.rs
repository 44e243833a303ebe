//! Rays per second of every tree over a wavy surface with blades upon it, by packet size, on one thread; then
//! those over the bare surface as triangles and as a height field.
//!
//! ```text
//! cargo bench -p vlscan-trace                    half a million triangles
//! cargo bench -p vlscan-trace -- 2000            a surface of 2000 × 2000 vertices
//! ```
//!
//! `cargo bench --bench kernel` of the workspace compares the tracer with Embree over forests
//! (docs/dev/kernel.md).

use std::hint::black_box;
use std::time::Instant;
use vlscan_trace::{
    BuildOptions, Builder, DVec3, Geometry, HeightField, HeightGrid, Heights, Hits, RayGroup, TraceScratch,
    Tree,
};

const BUILDERS: [Builder; 5] = [Builder::Bvh, Builder::Fsah, Builder::AxisSah, Builder::Sah, Builder::Median];
/// Groups of rays that are traced together.
const GROUPS: u32 = 512;
const ROUNDS: usize = 5;

fn main() {
    let side = std::env::args().skip(1).find_map(|word| word.parse().ok()).unwrap_or(440);
    let with_blades = surface(side, true);
    println!("{} triangles", with_blades.triangles.len());
    println!(
        "{:<10}{:>10}{:>12}{:>14}{:>14}{:>14}",
        "tree", "build s", "B/triangle", "1 ray", "7 rays", "19 rays"
    );
    let sets = [1, 7, 19].map(|rays| groups(f64::from(side), rays));
    for builder in BUILDERS {
        measure(builder.name(), &with_blades, builder, &sets);
    }
    println!("bare");
    measure("bvh", &surface(side, false), Builder::Bvh, &sets);
    measure("field", &field(side), Builder::Bvh, &sets);
}

/// Prints time and memory of a tree, and the rates of its rays.
fn measure(name: &str, surface: &Geometry, builder: Builder, sets: &[Vec<RayGroup>]) {
    let started = Instant::now();
    let tree = Tree::build(surface, &BuildOptions::of(builder));
    let built = started.elapsed().as_secs_f64();
    let fields: usize = surface.fields.iter().map(HeightField::memory).sum();
    let bytes = (tree.memory() + fields) as f64 / surface.triangle_count() as f64;
    print!("{name:<10}{built:>10.2}{bytes:>12.1}");
    for set in sets {
        print!("{:>10.1} M/s", rays_per_s(surface, &tree, set) * 1e-6);
    }
    println!();
}

/// The rate of the quickest of several rounds.
fn rays_per_s(surface: &Geometry, tree: &Tree, set: &[RayGroup]) -> f64 {
    let (mut hits, mut scratch) = (Hits::default(), TraceScratch::default());
    let rays: usize = set.iter().map(|groups| groups.len() * groups.rays()).sum();
    let round = |_| {
        let started = Instant::now();
        for groups in set {
            tree.trace_group(surface, groups, &mut hits, &mut scratch);
            black_box(&hits);
        }
        started.elapsed().as_secs_f64()
    };
    rays as f64 / (0..ROUNDS).map(round).fold(f64::INFINITY, f64::min)
}

fn height(x: f64, y: f64) -> f64 {
    (x * 0.07).sin() * (y * 0.05).cos() * 5.0
}

/// The waves as a height field.
fn field(side: u32) -> Geometry {
    let count = side as usize;
    let mut heights = Heights::single(count * count).expect("enough memory");
    for y in 0..count {
        let row: Vec<f64> = (0..count).map(|x| f64::from(height(x as f64, y as f64) as f32)).collect();
        heights.set(y * count, &row).expect("enough memory");
    }
    let field = HeightField::new(HeightGrid::new(count, count), heights, 0).expect("few triangles");
    Geometry { fields: vec![field], ..Geometry::default() }
}

/// Waves of 2 triangles per cell of 1 m, with an upright blade on every other cell or none.
fn surface(side: u32, with_blades: bool) -> Geometry {
    let at = |x: u32, y: u32, up: f64| {
        let (x, y) = (f64::from(x), f64::from(y));
        DVec3::new(x, y, height(x, y) + up)
    };
    let mut surface = Geometry {
        vertices: (0..side * side).map(|i| at(i % side, i / side, 0.0)).collect(),
        ..Geometry::default()
    };
    for (x, y) in (0..side - 1).flat_map(|y| (0..side - 1).map(move |x| (x, y))) {
        let first = y * side + x;
        surface.triangles.push([first, first + 1, first + side]);
        surface.triangles.push([first + 1, first + side + 1, first + side]);
        if with_blades && (x + y) % 2 == 0 {
            let tip = surface.vertices.len() as u32;
            surface.vertices.push(at(x, y, 0.3 + 0.01 * f64::from((x * 7 + y * 13) % 100)));
            surface.triangles.push([first, first + 1, tip]);
        }
    }
    surface
}

/// Narrow cones of rays from a line above the middle of the surface, swept from side to side, in batches.
fn groups(side: f64, rays: usize) -> Vec<RayGroup> {
    let batch = |number: u32| {
        let mut groups = RayGroup::new(rays);
        for i in (0..GROUPS).map(|i| f64::from(number * GROUPS + i)) {
            let origin = DVec3::new(0.5 * side, (i * 0.008) % side, 150.0);
            let angle = (i * 0.01).sin();
            groups.push(origin, |x, y, z| {
                for ray in 0..rays {
                    let aside = ray as f64 * 1e-5;
                    let direction = DVec3::new(angle.sin() + aside, aside, -angle.cos()).normalize();
                    (x[ray], y[ray], z[ray]) = direction.into();
                }
            });
        }
        groups
    };
    (0..100).map(batch).collect()
}
