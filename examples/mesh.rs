//! Scans a mesh in memory from two stations, to a LAZ file.
//!
//!     cargo run --example mesh [FILE.laz]

use std::f64::consts::TAU;
use vlscan::survey::{MaterialDefinition, Mesh, ReadOptions, find_scanner};
use vlscan::{DVec3, Scan};

fn main() -> vlscan::Result<()> {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let out = std::env::args_os().nth(1).map_or_else(|| folder.path().join("box.laz"), Into::into);

    let (scanner, _) = find_scanner("vlp16", &ReadOptions::default())?;
    let report = Scan::new(box_on_floor()?, scanner)
        .station(DVec3::new(-6.0, 0.0, 1.5))
        .station(DVec3::new(6.0, 3.0, 1.5))
        // One turn of the head at each station, 10 turns per second.
        .configure(|settings| (settings.head_rate, settings.head_stop) = (10.0 * TAU, TAU))
        .seed(7)
        .outputs(|outputs| outputs.force = true)
        .output(&out)?
        .run()?;

    println!("{}: {} points of {} pulses", out.display(), report.summary.points, report.pulses);
    let bounds = report.summary.files[0].bounds;
    assert!(report.summary.points > report.pulses / 4, "most pulses below the horizon hit something");
    assert!(
        (bounds.max.z - 2.0).abs() < 0.1 && bounds.min.z.abs() < 0.1,
        "floor and top of the box: {bounds:?}"
    );
    assert!(bounds.size().x < 30.5 && bounds.size().y < 30.5, "no point is beyond the floor: {bounds:?}");
    Ok(())
}

/// A floor of 30 m × 30 m, and a box of 2 m × 2 m × 2 m in its middle.
fn box_on_floor() -> vlscan::Result<Mesh> {
    let corner = |i: u32, half: f64, low: f64, high: f64| {
        let side = |bit: u32| if i & bit == 0 { -half } else { half };
        DVec3::new(side(1), side(2), if i & 4 == 0 { low } else { high })
    };
    let floor = (0..4).map(|i| corner(i, 15.0, 0.0, 0.0));
    let vertices = floor.chain((0..8).map(|i| corner(i, 1.0, 0.0, 2.0))).collect();
    // Two triangles per face: the floor, the four walls, the top.
    let quads = [[0, 1, 3, 2], [4, 5, 9, 8], [5, 7, 11, 9], [7, 6, 10, 11], [6, 4, 8, 10], [8, 9, 11, 10]];
    let triangles = quads.iter().flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]).collect();
    let material = |name: &str, reflectance: f64, classification: i32| MaterialDefinition {
        reflectance: Some(reflectance),
        classification,
        ..MaterialDefinition::new(name)
    };
    let materials = vec![material("floor", 0.3, 2), material("box", 0.6, 6)];
    let material_of = (0..12).map(|triangle| u32::from(triangle >= 2)).collect();
    Mesh::new(vertices, triangles, materials, material_of)
}
