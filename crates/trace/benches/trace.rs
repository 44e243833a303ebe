//! Rays per second of every tree over a wavy surface with blades upon it, by packet size, on one thread; then
//! those over the bare surface as triangles, as a height field and as a mosaic of a hundred, with the ratio
//! of the last two.
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
    let one = measure("field", &mosaic(side, 1), Builder::Bvh, &sets);
    let many = measure("mosaic", &mosaic(side, 10), Builder::Bvh, &sets);
    print!("{:<32}", "mosaic / field");
    for (many, one) in many.iter().zip(one) {
        print!("{:>14.2}", many / one);
    }
    println!();
}

/// Prints time and memory of a tree, and the rates of its rays, which it returns.
fn measure(name: &str, surface: &Geometry, builder: Builder, sets: &[Vec<RayGroup>]) -> Vec<f64> {
    let started = Instant::now();
    let tree = Tree::build(surface, &BuildOptions::of(builder));
    let built = started.elapsed().as_secs_f64();
    let fields: usize = surface.fields.iter().map(HeightField::memory).sum();
    let bytes = (tree.memory() + fields) as f64 / surface.triangle_count() as f64;
    print!("{name:<10}{built:>10.2}{bytes:>12.1}");
    let rates: Vec<f64> = sets.iter().map(|set| rays_per_s(surface, &tree, set)).collect();
    for rate in &rates {
        print!("{:>10.1} M/s", rate * 1e-6);
    }
    println!();
    rates
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

/// The waves as `parts` height fields along either axis, side by side.
fn mosaic(side: u32, parts: usize) -> Geometry {
    let cells = side as usize - 1;
    let ends: Vec<usize> = (0..=parts).map(|i| i * cells / parts).collect();
    let mut surface = Geometry::default();
    for rows in ends.windows(2) {
        for columns in ends.windows(2) {
            let first = surface.triangle_count();
            surface.fields.push(field([columns[0], rows[0]], [columns[1], rows[1]], first));
        }
    }
    surface
}

/// The waves as a height field, from one vertex to another by column and row.
fn field(from: [usize; 2], to: [usize; 2], first: usize) -> HeightField {
    let [columns, rows] = [0, 1].map(|axis| to[axis] - from[axis] + 1);
    let mut heights = Heights::single(columns * rows).expect("enough memory");
    for row in 0..rows {
        let y = (from[1] + row) as f64;
        let height_at = |column: usize| f64::from(height((from[0] + column) as f64, y) as f32);
        let numbers: Vec<f64> = (0..columns).map(height_at).collect();
        heights.set(row * columns, &numbers).expect("enough memory");
    }
    let grid = HeightGrid { first: from, ..HeightGrid::new(columns, rows) };
    HeightField::new(grid, heights, first).expect("few triangles")
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
