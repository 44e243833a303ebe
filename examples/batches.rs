//! Points as Arrow record batches while the run goes on: a density map of a flight that never is in memory as
//! a whole, and a Parquet file beside it.
//!
//!     cargo run --example batches

use std::collections::BTreeMap;
use vlscan::arrow_array::RecordBatch;
use vlscan::arrow_array::cast::AsArray;
use vlscan::arrow_array::types::Float64Type;
use vlscan::render::Render as _;
use vlscan::survey::{Mesh, ReadOptions, find_platform, find_scanner};
use vlscan::{Column, DVec3, Notice, Scan};

/// Side of a cell of the map, m.
const CELL: f64 = 10.0;

fn main() -> vlscan::Result<()> {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let file = folder.path().join("flight.parquet");
    let (scanner, _) = find_scanner("riegl_vux-1uav", &ReadOptions::default())?;
    let (platform, _) = find_platform("copter_linearpath", &ReadOptions::default())?;

    let corners = [[-60.0, -60.0], [60.0, -60.0], [60.0, 60.0], [-60.0, 60.0]];
    let corners = corners.map(|[x, y]| DVec3::new(x, y, 0.0));
    let field = Mesh::new(corners.into(), vec![[0, 1, 2], [0, 2, 3]], Vec::new(), Vec::new())?;

    let mut batches = Scan::new(field, scanner)
        .platform(platform)
        .path([DVec3::new(-20.0, 0.0, 40.0), DVec3::new(20.0, 0.0, 40.0)], 20.0)
        .configure(|settings| {
            (settings.pulse_freq, settings.scan_freq) = (50_000, 50.0);
            settings.scan_angle = 30f64.to_radians();
        })
        .observer(|notice| {
            if let Notice::Warnings(found) = notice {
                eprint!("{}", found.render(false));
            }
        })
        .outputs(|outputs| {
            outputs.cloud.columns = Some(vec![Column::X, Column::Y, Column::Z, Column::Intensity]);
        })
        .output(&file)?
        .batches(10_000)?;

    let mut map: BTreeMap<(i64, i64), u64> = BTreeMap::new();
    let (mut count, mut largest) = (0, 0);
    for batch in &mut batches {
        let batch = batch?;
        (count, largest) = (count + batch.num_rows() as u64, largest.max(batch.num_rows()));
        for (x, y) in column(&batch, "X").iter().zip(column(&batch, "Y")) {
            *map.entry(((x / CELL).floor() as i64, (y / CELL).floor() as i64)).or_default() += 1;
        }
    }

    let report = batches.report().expect("a run that has ended");
    let densest = map.values().max().expect("points");
    println!("{count} points in {} cells, up to {:.0} per m²", map.len(), *densest as f64 / (CELL * CELL));
    assert_eq!((count, largest), (report.summary.points, 10_000), "all points came, in batches of this size");
    assert!(map.contains_key(&(0, 0)) && map.contains_key(&(-1, 1)), "the field below the flight is covered");
    assert!(std::fs::metadata(&file).is_ok_and(|file| file.len() > 10_000), "the file is written, too");
    Ok(())
}

fn column<'b>(batch: &'b RecordBatch, name: &str) -> &'b [f64] {
    batch[name].as_primitive::<Float64Type>().values()
}
