//! The sets of rays that are traced.

use std::f64::consts::{FRAC_PI_2, TAU};
use vlscan::base::rng::{Purpose, Stream};
use vlscan::geom::{DVec3, Rotation};
use vlscan::trace::{Geometry, RayGroup};

const BATCH_PULSES: usize = 512;

/// Height of the aircraft above the lowest vertex, m.
const HEIGHT: f64 = 300.0;

pub struct RaySet {
    pub name: &'static str,
    pub batches: Vec<RayGroup>,
    pub rays: usize,
}

#[derive(Clone, Copy)]
struct Aim {
    origin: DVec3,
    attitude: Rotation,
}

impl RaySet {
    pub fn all(geometry: &Geometry) -> Vec<RaySet> {
        let bounds = geometry.bounds();
        let ground = bounds.min.z;
        let airborne = flight(ground, (60, 1.0), (900, 0.1));
        let mut shuffled = airborne.clone();
        shuffle(&mut shuffled);
        vec![
            RaySet::new("airborne", 3, &airborne),
            RaySet::new("terrestrial", 3, &turn(geometry)),
            RaySet::new("sparse", 3, &flight(ground, (100, 2.0), (50, 2.0))),
            RaySet::new("shuffled", 3, &shuffled[..40_000]),
            RaySet::new("seven rays", 2, &airborne),
            RaySet::new("single ray", 1, &flight(ground, (60, 1.0), (1800, 0.05))),
        ]
    }

    /// Creates a set with `rings` rings of subrays per pulse, 0.1 mrad apart: 1, 6 and 12 rays.
    fn new(name: &'static str, rings: i32, aims: &[Aim]) -> RaySet {
        let counts = [1, 6, 12];
        let template: Vec<Rotation> = (0..rings)
            .zip(counts)
            .flat_map(|(ring, count)| {
                (0..count).map(move |i| {
                    Rotation::about_y(TAU * f64::from(i) / f64::from(count))
                        .after(Rotation::about_x(f64::from(ring) * 1e-4))
                })
            })
            .collect();
        let batch = |aims: &[Aim]| {
            let mut group = RayGroup::new(template.len());
            for aim in aims {
                group.push(aim.origin, |x, y, z| {
                    for (i, s) in template.iter().enumerate() {
                        (x[i], y[i], z[i]) = aim.attitude.after(*s).forward().into();
                    }
                });
            }
            group
        };
        let batches: Vec<RayGroup> = aims.chunks(BATCH_PULSES).map(batch).collect();
        RaySet { name, rays: aims.len() * template.len(), batches }
    }
}

/// Parallel flight lines: `lines` is their number and distance, `side` the number of pulses to either side
/// and their distance.
fn flight(ground: f64, lines: (i32, f64), side: (i32, f64)) -> Vec<Aim> {
    let down = Rotation::about_x(-FRAC_PI_2);
    let line = |l: i32| {
        (-side.0..=side.0).map(move |i| {
            let along = f64::from(l - lines.0 / 2) + f64::from(i) / f64::from(2 * side.0);
            let angle = libm::atan(f64::from(i) * side.1 / HEIGHT);
            Aim {
                origin: DVec3::new(0.0, along * lines.1, ground + HEIGHT),
                attitude: Rotation::about_y(angle).after(down),
            }
        })
    };
    (0..lines.0).flat_map(line).collect()
}

/// Vertical scan lines all around a point 1.7 m above the ground.
fn turn(geometry: &Geometry) -> Vec<Aim> {
    let place = DVec3::new(0.3, 0.2, 0.0);
    let beside = |v: &&DVec3| (**v - place).truncate().length() < 1.5;
    let ground = geometry.vertices.iter().filter(beside).fold(f64::INFINITY, |z, v| z.min(v.z));
    let ground = if ground.is_finite() { ground } else { geometry.bounds().min.z };
    let origin = DVec3::new(place.x, place.y, ground + 1.7);
    let line = |l: i32| {
        (-400..900).map(move |i| Aim {
            origin,
            attitude: Rotation::about_z(f64::from(l) * TAU / 100.0)
                .after(Rotation::about_x(f64::from(i) * 1e-3)),
        })
    };
    (0..100).flat_map(line).collect()
}

fn shuffle(aims: &mut [Aim]) {
    let draw = Stream::new(1, Purpose::SceneMaking);
    for i in (1..aims.len()).rev() {
        let j = draw.uniform(0, i as u64, 0) * (i + 1) as f64;
        aims.swap(i, j as usize);
    }
}
