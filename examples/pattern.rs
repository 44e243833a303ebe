//! An instrument with a scan pattern of one's own: a rose whose petals cover a cone, over flat ground.
//!
//!     cargo run --example pattern

use std::f64::consts::TAU;
use std::sync::Arc;
use vlscan::arrow_array::cast::AsArray;
use vlscan::arrow_array::types::Float64Type;
use vlscan::survey::{Deflector, Device, Mesh, ScanPattern, Scanner};
use vlscan::{DVec3, Scan};

/// A rose curve: the beam swings through the axis of a cone while the plane of the swing turns.
#[derive(Debug)]
struct Rose {
    /// Half opening angle of the cone, rad.
    half_angle: f64,
    /// Swings and turns per second.
    swings: f64,
    turns: f64,
}

impl ScanPattern for Rose {
    fn direction(&self, time: f64) -> DVec3 {
        let opening = self.half_angle * (TAU * self.swings * time).sin();
        let (sin, cos) = (TAU * self.turns * time).sin_cos();
        DVec3::new(opening.sin() * sin, opening.cos(), opening.sin() * cos)
    }
}

const HEIGHT: f64 = 10.0;
const HALF_ANGLE: f64 = 0.3;

fn main() -> vlscan::Result<()> {
    let rose = Rose { half_angle: HALF_ANGLE, swings: 50.0, turns: 3.0 };
    let scanner = Scanner::new("rose", 20_000, Device::new(Deflector::Custom(Arc::new(rose))));

    // A wall at 10 m, since the scanner looks along +y.
    let corners = [[-9.0, -9.0], [9.0, -9.0], [9.0, 9.0], [-9.0, 9.0]].map(|[x, z]| DVec3::new(x, HEIGHT, z));
    let wall = Mesh::new(corners.into(), vec![[0, 1, 2], [0, 2, 3]], Vec::new(), Vec::new())?;

    let batches = Scan::new(wall, scanner)
        .station(DVec3::ZERO)
        .configure(|settings| settings.max_duration = Some(0.5))
        .batches(4096)?;

    let (mut points, mut farthest) = (0, 0.0_f64);
    for batch in batches {
        let batch = batch?;
        let [x, z] = ["X", "Z"].map(|name| batch[name].as_primitive::<Float64Type>().values());
        points += batch.num_rows();
        farthest = x.iter().zip(z).map(|(x, z)| x.hypot(*z)).fold(farthest, f64::max);
    }

    println!("{points} points within {farthest:.2} m of the axis");
    assert!((9_900..=10_100).contains(&points), "one point per pulse of half a second: {points}");
    let edge = HEIGHT * HALF_ANGLE.tan();
    assert!((farthest / edge - 1.0).abs() < 0.02, "the petals reach {edge:.2} m: {farthest}");
    Ok(())
}
