//! Building and tracing on a procedural forest of about a million triangles.
//!
//! `airborne`: 19 rays per pulse from 300 m above the ground, pulses 0.1 m apart along the line, lines 1 m apart.
//! `terrestrial`: 19 rays per pulse from one point 1.7 m above the ground, in all directions, in vertical lines.
//! `group` traces 512 pulses by one call, `pulse` one. Throughput counts rays; all of them lie in memory, not in the
//! cache, before the clock starts.

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use std::f64::consts::{FRAC_PI_2, TAU};
use std::hint::black_box;
use vlscan::geom::{DVec3, Rotation, unit};
use vlscan::rng::{Purpose, Stream};
use vlscan::tree::{BuildOptions, Builder, Geometry, Hits, RayBundle, RayGroup, Tree};

const BUILDERS: [Builder; 5] = [Builder::Bvh, Builder::Fsah, Builder::AxisSah, Builder::Sah, Builder::Median];

/// Rolling ground of 0.5 m cells over 200 m × 200 m, and trees of a trunk and a crown of leaves.
fn forest(trees: usize, leaves: usize) -> Geometry {
    let draw = Stream::new(1, Purpose::SceneMaking);
    let u = |tree: usize, n: u64, which: u32| draw.uniform(tree as u32, n, which);
    let ground = |x: f64, y: f64| 2.0 * libm::cos(0.05 * x) * libm::cos(0.07 * y);
    let mut g = Geometry::default();
    for i in 0..=400u32 {
        for j in 0..=400u32 {
            let (x, y) = (f64::from(i) * 0.5 - 100.0, f64::from(j) * 0.5 - 100.0);
            g.vertices.push(DVec3::new(x, y, ground(x, y)));
        }
    }
    for i in 0..400u32 {
        for j in 0..400u32 {
            let a = i * 401 + j;
            g.triangles.extend([[a, a + 401, a + 402], [a, a + 402, a + 1]]);
        }
    }
    for t in 0..trees {
        let (x, y) = (200.0 * u(t, 0, 0) - 100.0, 200.0 * u(t, 0, 1) - 100.0);
        let foot = DVec3::new(x, y, ground(x, y));
        let height = 8.0 + 14.0 * u(t, 0, 2);
        trunk(&mut g, foot, height * 0.9, 0.02 * height);
        let (crown, middle) = (height * 0.2, foot + DVec3::Z * height * 0.65);
        for l in 0..leaves as u64 {
            let d = unit(DVec3::new(u(t, l, 3) - 0.5, u(t, l, 4) - 0.5, u(t, l, 5) - 0.5));
            let at = middle + d * DVec3::new(crown, crown, 1.6 * crown) * u(t, l, 6).cbrt();
            let e = unit(DVec3::new(u(t, l, 7) - 0.5, u(t, l, 8) - 0.5, u(t, l, 9) - 0.5));
            let f = unit(e.cross(d + DVec3::splat(1e-3)));
            let size = 0.15 + 0.45 * u(t, l, 10);
            triangle(&mut g, [at, at + e * size, at + f * size]);
        }
    }
    g
}

fn trunk(g: &mut Geometry, foot: DVec3, height: f64, radius: f64) {
    let at = |s: u32, z: f64| {
        let a = TAU * f64::from(s) / 8.0;
        foot + DVec3::new(radius * libm::cos(a), radius * libm::sin(a), z)
    };
    for s in 0..8 {
        let corners = [at(s, -0.5), at(s + 1, -0.5), at(s + 1, height), at(s, height)];
        triangle(g, [corners[0], corners[1], corners[2]]);
        triangle(g, [corners[0], corners[2], corners[3]]);
    }
}

fn triangle(g: &mut Geometry, corners: [DVec3; 3]) {
    let n = g.vertices.len() as u32;
    g.vertices.extend(corners);
    g.triangles.push([n, n + 1, n + 2]);
}

/// 19 subrays within 0.2 mrad around the forward axis: rings of 1, 6 and 12.
fn pulse(origin: DVec3, attitude: Rotation) -> RayBundle {
    let mut b = RayBundle { origin, ..RayBundle::default() };
    for (ring, count) in [(0, 1), (1, 6), (2, 12)] {
        for i in 0..count {
            let s = Rotation::about_y(TAU * f64::from(i) / f64::from(count))
                .after(Rotation::about_x(f64::from(ring) * 1e-4));
            let d = attitude.after(s).forward();
            b.x.push(d.x);
            b.y.push(d.y);
            b.z.push(d.z);
        }
    }
    b
}

fn airborne() -> Vec<RayBundle> {
    let across = |line: i32| {
        (-900..=900).map(move |i| {
            let angle = libm::atan(f64::from(i) * 0.1 / 300.0);
            let down = Rotation::about_x(-FRAC_PI_2);
            let origin = DVec3::new(0.0, f64::from(line) + f64::from(i) / 1800.0, 300.0);
            pulse(origin, Rotation::about_y(angle).after(down))
        })
    };
    (-40..40).flat_map(across).collect()
}

fn terrestrial() -> Vec<RayBundle> {
    let origin = DVec3::new(0.3, 0.2, 3.7);
    let line = |l: i32| {
        (-400..900).map(move |i| {
            let up = Rotation::about_x(f64::from(i) * 1e-3);
            pulse(origin, Rotation::about_z(f64::from(l) * TAU / 100.0).after(up))
        })
    };
    (0..100).flat_map(line).collect()
}

/// The pulses of a chunk, whose hits then stay in the cache as they do in a run.
fn chunks(pulses: &[RayBundle]) -> Vec<RayGroup> {
    let chunk = |pulses: &[RayBundle]| {
        let mut group = RayGroup::new(19);
        for p in pulses {
            group.push(p.origin, |x, y, z| {
                x.copy_from_slice(&p.x);
                y.copy_from_slice(&p.y);
                z.copy_from_slice(&p.z);
            });
        }
        group
    };
    pulses.chunks(512).map(chunk).collect()
}

fn builders(c: &mut Criterion, forest: &Geometry) {
    let mut group = c.benchmark_group("build");
    group.sample_size(10).throughput(Throughput::Elements(forest.len() as u64));
    for builder in BUILDERS {
        for jobs in [1, 2] {
            let options = BuildOptions { jobs, ..BuildOptions::of(builder) };
            let name = format!("{builder:?}/{jobs}").to_lowercase();
            group.bench_function(name, |b| b.iter(|| Tree::build(forest, &options)));
        }
    }
}

fn tracing(c: &mut Criterion, forest: &Geometry) {
    for (name, pulses) in [("airborne", airborne()), ("terrestrial", terrestrial())] {
        let mut group = c.benchmark_group(name);
        let rays: usize = pulses.iter().map(RayBundle::len).sum();
        let chunks = chunks(&pulses);
        group.sample_size(10).throughput(Throughput::Elements(rays as u64));
        for builder in BUILDERS {
            let tree = Tree::build(forest, &BuildOptions::of(builder));
            let bytes = tree.memory() as f64 / forest.len() as f64;
            println!("{builder:?}: {bytes:.0} bytes per triangle, {:?}", tree.statistics());
            let mut hits = Hits::default();
            group.bench_function(format!("{builder:?}/group").to_lowercase(), |b| {
                b.iter(|| {
                    for chunk in &chunks {
                        tree.trace_group(forest, chunk, &mut hits);
                        black_box(&hits);
                    }
                });
            });
            group.bench_function(format!("{builder:?}/pulse").to_lowercase(), |b| {
                b.iter(|| {
                    for p in &pulses {
                        tree.trace(forest, p, &mut hits);
                        black_box(&hits);
                    }
                });
            });
        }
    }
}

fn kernel(c: &mut Criterion) {
    let forest = forest(800, 830);
    println!("{} triangles", forest.len());
    builders(c, &forest);
    tracing(c, &forest);
}

criterion_group!(benches, kernel);
criterion_main!(benches);
