//! Converts a cloud to the format that the name of the second file tells:
//! `cargo run -p vlscan-formats --example convert -- cloud.laz cloud.parquet`.

use std::error::Error;
use std::ops::ControlFlow;
use std::path::Path;
use vlscan_base::Result;
use vlscan_formats::{
    AttributeSet, CloudSettings, CloudWriter, PointFormat, PointRecord, PointRow, PointSink, read_points,
};
use vlscan_geom::Aabb;

/// Points that are written together.
const BLOCK_POINTS: usize = 4096;

/// The box around all points.
struct Bounds(Aabb);

impl PointSink for Bounds {
    fn start(&mut self, _: AttributeSet) {}

    fn point(&mut self, row: &PointRow, _: Option<&str>) -> Result<ControlFlow<()>> {
        self.0 = self.0.with(row.position);
        Ok(ControlFlow::Continue(()))
    }
}

/// Writes points as they are read.
struct Copy {
    settings: CloudSettings,
    writer: CloudWriter,
    block: Vec<PointRecord>,
}

impl Copy {
    fn flush(&mut self) -> Result<()> {
        self.writer.write(&self.block)?;
        self.block.clear();
        Ok(())
    }
}

impl PointSink for Copy {
    fn start(&mut self, _: AttributeSet) {}

    fn point(&mut self, row: &PointRow, _: Option<&str>) -> Result<ControlFlow<()>> {
        let mut record = PointRecord::from(row);
        record.position -= self.settings.origin;
        self.block.push(record);
        if self.block.len() == BLOCK_POINTS {
            self.flush()?;
        }
        Ok(ControlFlow::Continue(()))
    }
}

fn main() -> Result<(), Box<dyn Error>> {
    let mut paths = std::env::args().skip(1);
    let (Some(from), Some(to)) = (paths.next(), paths.next()) else {
        return Err("usage: convert FROM TO".into());
    };
    let format = PointFormat::of_file(Path::new(&to)).ok_or("the second name has no extension")??;
    // Records are relative to the centre of the cloud, so that formats with short numbers keep its digits.
    let mut bounds = Bounds(Aabb::EMPTY);
    let mut found = read_points(Path::new(&from), &mut bounds)?;
    let origin = if bounds.0.is_empty() { Default::default() } else { bounds.0.centre().round() };
    let bounds = bounds.0.translated(-origin);
    let settings = CloudSettings { origin, bounds, ..CloudSettings::default() };

    let writer = CloudWriter::create(Path::new(&to), false, format, &settings, &mut found)?;
    let mut copy = Copy { settings, writer, block: Vec::new() };
    read_points(Path::new(&from), &mut copy)?;
    copy.flush()?;
    let tally = copy.writer.finish()?;
    eprint!("{}", found.render(false));
    println!("{} points in {to}", tally.records);
    Ok(())
}
