//! A cloud as COPC, for viewers that read the region and the detail they need in ranges of bytes.

use std::collections::HashMap;
use std::ops::ControlFlow;
use std::path::Path;
use vlscan_base::Observer;
use vlscan_base::diag::{Diagnostics, Place};
use vlscan_base::error::{Error, Result};
use vlscan_formats::{
    AttributeSet, CloudFormat, CloudSettings, CloudWriter, Column, ExtraDimensions, FileFacts, PointFormat,
    PointRecord, PointRow, PointSink, read_points,
};
use vlscan_geom::DVec3;

/// Points that are written together.
const BATCH_POINTS: usize = 4096;
/// Metres per unit of the coordinates: they reach 2147 km around the first point.
const SCALE: f64 = 1e-3;

/// Writes all points of a cloud to `out` as COPC: positions to the millimetre, intensity (`heliosAmplitude`
/// as it was read), returns, class, object (named objects by numbers in order of appearance), scan angle,
/// time, leg, device and colour. The cloud is read once, in bounded memory; so colours of other formats than
/// LAS have 8 bits if none of the first 4096 points has a greater component. Returns the number of points.
///
/// # Errors
/// The errors of [`read_points`] and [`CloudWriter`]; [`Error::Input`] for a cloud without points.
pub fn write_octree(cloud: &Path, out: &Path, replace: bool, observer: &Observer) -> Result<u64> {
    let mut copy = Copy {
        out,
        replace,
        crs: None,
        is_las: false,
        first: None,
        has_byte_colours: false,
        settings: CloudSettings::default(),
        writer: None,
        batch: Vec::with_capacity(BATCH_POINTS),
        objects: HashMap::new(),
        found: Diagnostics::default(),
    };
    let mut found = read_points(cloud, &mut copy)?;
    copy.flush()?;
    let Copy { writer, found: written, .. } = copy;
    found.extend(written);
    let Some(writer) = writer else {
        return Err(Error::input(format!("{} contains no points", cloud.display())));
    };
    let tally = writer.finish()?;
    if tally.left_out > 0 {
        let message = format!(
            "{} points without coordinates, or more than 2147 km from the first point, are left out",
            tally.left_out
        );
        found.warn(Some(Place::of_file(cloud)), message);
    }
    observer.warnings(found)?;
    Ok(tally.records)
}

/// Writes points while they are read. The file begins after the first batch, which shows the kind of the
/// colours; the origin of its coordinates is near the first point.
struct Copy<'a> {
    out: &'a Path,
    replace: bool,
    crs: Option<String>,
    /// True if the cloud is LAS, whose colours stay as they are.
    is_las: bool,
    /// Position of the first point that has one, m.
    first: Option<DVec3>,
    /// True if the first points have colours of 8 bits.
    has_byte_colours: bool,
    settings: CloudSettings,
    writer: Option<CloudWriter>,
    /// Points to be written next. Positions are those in the world before the file begins.
    batch: Vec<PointRecord>,
    objects: HashMap<String, i32>,
    found: Diagnostics,
}

impl Copy<'_> {
    /// Creates the file if a point has a position.
    fn begin(&mut self) -> Result<()> {
        let Some(first) = self.first else { return Ok(()) };
        self.settings.origin = first.round();
        self.settings.crs = self.crs.take();
        self.settings.las.scale = Some(SCALE);
        self.settings.las.extra = ExtraDimensions::Helios;
        let colours = self.batch.iter().filter_map(|point| point.stored.colour);
        if let Some(max) = colours.flatten().max() {
            self.settings.columns = Some(vec![Column::Red, Column::Green, Column::Blue]);
            self.has_byte_colours = !self.is_las && max <= u16::from(u8::MAX);
        }
        let format = PointFormat::Copc;
        let writer = CloudWriter::create(self.out, self.replace, format, &self.settings, &mut self.found)?;
        self.writer = Some(writer);
        for point in &mut self.batch {
            point.position -= self.settings.origin;
        }
        if self.has_byte_colours {
            self.batch.iter_mut().for_each(widen_colour);
        }
        Ok(())
    }

    /// Writes the batch. Points before the first one with a position are kept for the file.
    fn flush(&mut self) -> Result<()> {
        if self.writer.is_none() {
            self.begin()?;
        }
        let Some(writer) = &mut self.writer else { return Ok(()) };
        let written = writer.write(&self.batch);
        self.batch.clear();
        written
    }
}

/// Makes a colour of 8 bits one of 16. A greater one stays as it is.
fn widen_colour(point: &mut PointRecord) {
    let bytes = point.stored.colour.filter(|colour| colour.iter().all(|c| *c <= u16::from(u8::MAX)));
    if let Some(colour) = bytes {
        point.set_colour(colour.map(|component| component << 8));
    }
}

impl PointSink for Copy<'_> {
    fn start(&mut self, _: AttributeSet) {}

    fn file(&mut self, facts: &FileFacts) {
        self.is_las = facts.format == CloudFormat::Las;
    }

    fn crs(&mut self, wkt: &str) {
        self.crs = Some(wkt.to_owned());
    }

    fn point(&mut self, row: &PointRow, object: Option<&str>) -> Result<ControlFlow<()>> {
        if self.first.is_none() && row.position.is_finite() {
            self.first = Some(row.position);
        }
        let mut record = PointRecord::from(row);
        if let Some(colour) = row.colour {
            record.set_colour(colour);
        }
        if self.writer.is_some() {
            record.position -= self.settings.origin;
            if self.has_byte_colours {
                widen_colour(&mut record);
            }
        }
        if let Some(name) = object {
            let next = self.objects.len() as i32 + 1;
            record.object = match self.objects.get(name) {
                Some(number) => *number,
                None => *self.objects.entry(name.to_owned()).or_insert(next),
            };
        }
        self.batch.push(record);
        if self.batch.len() >= BATCH_POINTS && self.first.is_some() {
            self.flush()?;
        }
        Ok(ControlFlow::Continue(()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cloud::read_points as read_cloud;

    #[test]
    fn colours_are_in_the_octree_with_16_bits() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        let write = |name: &str, factor: u32| {
            let mut text = "x,y,z,red,green,blue\n".to_owned();
            for i in 0..9000 {
                let (x, y) = (f64::from(i % 100) * 0.5, f64::from(i / 100) * 0.5);
                text += &format!("{x},{y},1,{},{},{}\n", i % 256 * factor, 7 * factor, 255 * factor);
            }
            std::fs::write(at(name), text).unwrap();
        };
        write("bytes.csv", 1);
        write("shorts.csv", 257);
        for name in ["bytes", "shorts"] {
            let out = at(&format!("{name}.copc.laz"));
            let cloud = at(&format!("{name}.csv"));
            assert_eq!(write_octree(&cloud, &out, false, &Observer::default()).unwrap(), 9000);
            let (points, _) = read_cloud(&out).unwrap();
            assert!(points.has_colours(), "{name}");
            for i in 0..points.len() {
                let p = points.position(i) * 2.0;
                let number = p.x.round() as usize + 100 * p.y.round() as usize;
                assert_eq!(points.colour_of(i), [(number % 256) as u8, 7, 255], "{name} {number}");
            }
        }
        // The copy of a copy has the same colours.
        write_octree(&at("shorts.copc.laz"), &at("again.copc.laz"), false, &Observer::default()).unwrap();
        let (points, _) = read_cloud(&at("again.copc.laz")).unwrap();
        assert!((0..points.len()).all(|i| points.colour_of(i)[1..] == [7, 255]));
    }

    #[test]
    fn every_point_is_in_the_octree() {
        let folder = tempfile::tempdir().unwrap();
        let (cloud, out) = (folder.path().join("a.csv"), folder.path().join("a.copc.laz"));
        let mut text = "x,y,z,intensity,class,return_number,number_of_returns,object\n".to_owned();
        for i in 0..60_000 {
            let (x, y) = (500_000.0 + f64::from(i % 300) * 0.25, 5_400_000.0 + f64::from(i / 300) * 0.25);
            let tree = ["spruce", "beech"][i as usize % 2];
            text += &format!("{x},{y},{}.125,{i},{},{},2,{tree}\n", i % 40, i % 5, 1 + i % 2);
        }
        std::fs::write(&cloud, text).unwrap();
        assert_eq!(write_octree(&cloud, &out, false, &Observer::default()).unwrap(), 60_000);
        let (points, _) = read_cloud(&out).unwrap();
        let sorted = |mut all: Vec<[i64; 6]>| {
            all.sort_unstable();
            all
        };
        let found = sorted(
            (0..points.len())
                .map(|i| {
                    let p = points.position(i) * 1000.0;
                    let object = points.objects[usize::from(points.object.at(i))].parse::<i64>().unwrap();
                    let values = [points.intensity.at(i) as i64, i64::from(points.class.at(i)), object];
                    [
                        p.x.round() as i64,
                        p.y.round() as i64,
                        p.z.round() as i64,
                        values[0],
                        values[1],
                        values[2],
                    ]
                })
                .collect(),
        );
        let expected = sorted(
            (0..60_000)
                .map(|i| {
                    let (x, y) = (500_000_000 + i % 300 * 250, 5_400_000_000 + i / 300 * 250);
                    [x, y, i % 40 * 1000 + 125, i, i % 5, 1 + i % 2]
                })
                .collect(),
        );
        assert_eq!(found, expected);
        let empty = folder.path().join("b.csv");
        std::fs::write(&empty, "x,y,z\n").unwrap();
        let again = folder.path().join("b.copc.laz");
        assert!(write_octree(&empty, &again, false, &Observer::default()).is_err());
        assert!(!again.exists());
        assert!(write_octree(&cloud, &out, false, &Observer::default()).is_err(), "the file exists");
    }
}
