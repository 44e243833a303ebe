//! Sends rays without an instrument through a mesh in memory, and counts how many per second.
//!
//!     cargo run --release --example cast [RAYS]

use std::f64::consts::TAU;
use std::time::Instant;
use vlscan::scene::LoadOptions;
use vlscan::survey::{Mesh, SceneRecipe};
use vlscan::trace::BuildOptions;
use vlscan::{DVec3, LoadedScene};

fn main() -> vlscan::Result<()> {
    let count = std::env::args().nth(1).and_then(|word| word.parse().ok()).unwrap_or(100_000_u32);

    let recipe = SceneRecipe::from(hills()?);
    let scene =
        LoadedScene::load(&recipe, &LoadOptions::default(), &BuildOptions::default(), false, &|_| ())?;

    // Downwards from a place above the middle, in a spiral that reaches 45 degrees.
    let origins = vec![DVec3::new(0.0, 0.0, 50.0); count as usize];
    let direction = |i: u32| {
        let (turn, out) = (f64::from(i) * TAU / 1000.0, f64::from(i) / f64::from(count));
        DVec3::new(out * turn.cos(), out * turn.sin(), -1.0)
    };
    let directions: Vec<DVec3> = (0..count).map(direction).collect();
    // The tree is built by the first rays.
    scene.cast(&origins[..1], &directions[..1], &|_| ())?;

    let start = Instant::now();
    let hits = scene.cast(&origins, &directions, &|_| ())?;
    let seconds = start.elapsed().as_secs_f64();

    let found = hits.iter().flatten();
    let mean = found.clone().map(|hit| hit.distance).sum::<f64>() / found.clone().count() as f64;
    println!("{} of {count} rays hit, on average after {mean:.2} m", found.clone().count());
    println!("{:.2} million rays per second", f64::from(count) / seconds / 1e6);
    assert!(hits.iter().all(Option::is_some), "every ray meets the hills");
    assert!(hits.iter().flatten().all(|hit| hit.normal.z > 0.0 && (45.0..90.0).contains(&hit.distance)));
    Ok(())
}

/// Hills of 200 m × 200 m, with two triangles per square metre.
fn hills() -> vlscan::Result<Mesh> {
    const SIDE: u32 = 201;
    let vertex = |i: u32| {
        let (x, y) = (f64::from(i % SIDE) - 100.0, f64::from(i / SIDE) - 100.0);
        DVec3::new(x, y, 2.0 * (x * 0.1).sin() * (y * 0.1).cos())
    };
    let cell = |i: u32| {
        let first = i / (SIDE - 1) * SIDE + i % (SIDE - 1);
        [[first, first + 1, first + SIDE], [first + 1, first + SIDE + 1, first + SIDE]]
    };
    let vertices = (0..SIDE * SIDE).map(vertex).collect();
    let triangles = (0..(SIDE - 1) * (SIDE - 1)).flat_map(cell).collect();
    Mesh::new(vertices, triangles, Vec::new(), Vec::new())
}
