//! A cloud as COPC, for viewers that read the region and the detail they need in ranges of bytes.

use std::collections::HashMap;
use std::ops::ControlFlow;
use std::path::Path;
use vlscan_base::Observer;
use vlscan_base::diag::{Diagnostics, Place};
use vlscan_base::error::{Error, Result};
use vlscan_base::files::FileGroup;
use vlscan_base::quantity::counted;
use vlscan_formats::{
    AttributeSet, CloudFormat, CloudSettings, CloudWriter, Column, ExtraDimensions, FileFacts, PointFormat,
    PointRecord, PointRow, PointSink, read_points,
};
use vlscan_geom::DVec3;

/// Points that are written together.
const BATCH_POINTS: usize = 4096;
/// Metres per unit of the coordinates.
const SCALE: f64 = 1e-3;
/// Distance from the origin along an axis that coordinates of 32 bits reach, m.
const REACH: f64 = i32::MAX as f64 * SCALE;

/// Writes all points of a cloud to `out` as COPC: positions to the millimetre, intensity (`heliosAmplitude`
/// as it was read), returns, class, object (named objects by numbers in order of appearance), scan angle,
/// time, leg, device and colour. The cloud is read once, in bounded memory. Colours of other formats than LAS
/// have 8 bits if no point has a greater component. Returns the number of points.
///
/// # Errors
/// The errors of [`read_points`] and [`CloudWriter`]; [`Error::Input`] for a cloud without points, or whose
/// points are too far apart.
pub fn write_octree(cloud: &Path, out: &Path, replace: bool, observer: &Observer) -> Result<u64> {
    let mut copy = Copy::new(out, replace);
    let mut found = read_points(cloud, &mut copy)?;
    copy.flush()?;
    let Copy { writer, found: written, .. } = copy;
    found.extend(written);
    let Some(writer) = writer else {
        return Err(Error::input(format!("{} contains no points", cloud.display())));
    };
    let mut group = FileGroup::default();
    let tally = writer.finish_in(&mut group)?;
    if tally.records == 0 {
        let message = format!(
            "the points of {} are too far apart for COPC: coordinates in millimetres reach 2147 km",
            cloud.display()
        );
        return Err(Error::input(message));
    }
    group.commit()?;
    if tally.left_out > 0 {
        let points = counted(tally.left_out, "point");
        let message =
            format!("left out: {points} without coordinates, or more than 2147 km from the first points");
        found.warn(Some(Place::of_file(cloud)), message);
    }
    observer.warnings(found)?;
    Ok(tally.records)
}

/// Writes points while they are read. The file begins after the first batch with a position, which
/// determines the origin of its coordinates.
struct Copy<'a> {
    out: &'a Path,
    replace: bool,
    /// True if a point has a position.
    has_position: bool,
    settings: CloudSettings,
    writer: Option<CloudWriter>,
    /// Points to be written next. Positions are those in the world before the file begins.
    batch: Vec<PointRecord>,
    objects: HashMap<String, i32>,
    found: Diagnostics,
}

impl<'a> Copy<'a> {
    fn new(out: &'a Path, replace: bool) -> Copy<'a> {
        let mut settings = CloudSettings::default();
        settings.las.scale = Some(SCALE);
        settings.las.extra = ExtraDimensions::Helios;
        Copy {
            out,
            replace,
            has_position: false,
            settings,
            writer: None,
            batch: Vec::with_capacity(BATCH_POINTS),
            objects: HashMap::new(),
            found: Diagnostics::default(),
        }
    }

    /// Creates the file if a point has a position.
    fn begin(&mut self) -> Result<()> {
        let Some(origin) = origin_of(&self.batch) else { return Ok(()) };
        self.settings.origin = origin;
        let format = PointFormat::Copc;
        let writer = CloudWriter::create(self.out, self.replace, format, &self.settings, &mut self.found)?;
        self.writer = Some(writer);
        for point in &mut self.batch {
            point.position -= self.settings.origin;
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

/// The origin of coordinates: the first position, unless it is a stray from which the median position is out
/// of reach. `None` without a position.
fn origin_of(points: &[PointRecord]) -> Option<DVec3> {
    let positions: Vec<DVec3> = points.iter().map(|p| p.position).filter(|p| p.is_finite()).collect();
    let first = *positions.first()?;
    let median = |axis: fn(&DVec3) -> f64| {
        let mut values: Vec<f64> = positions.iter().map(axis).collect();
        let middle = values.len() / 2;
        *values.select_nth_unstable_by(middle, f64::total_cmp).1
    };
    let median = DVec3::new(median(|p| p.x), median(|p| p.y), median(|p| p.z));
    let is_stray = (first - median).abs().max_element() > REACH;
    Some(if is_stray { median.round() } else { first.round() })
}

impl PointSink for Copy<'_> {
    fn start(&mut self, attributes: AttributeSet) {
        if attributes.has_colours() {
            self.settings.columns = Some(vec![Column::Red, Column::Green, Column::Blue]);
        }
    }

    fn file(&mut self, facts: &FileFacts) {
        // Colours of LAS stay as they are.
        self.settings.las.widen_colours = facts.format != CloudFormat::Las;
        self.settings.adjusted_times = facts.las.as_ref().is_some_and(|las| las.has_adjusted_times);
    }

    fn crs(&mut self, wkt: &str) {
        self.settings.crs = Some(wkt.to_owned());
    }

    fn point(&mut self, row: &PointRow, object: Option<&str>) -> Result<ControlFlow<()>> {
        self.has_position |= row.position.is_finite();
        let mut record = PointRecord::from(row);
        if let Some(colour) = row.colour {
            record.set_colour(colour);
        }
        if self.writer.is_some() {
            record.position -= self.settings.origin;
        }
        if let Some(name) = object {
            let next = self.objects.len() as i32 + 1;
            record.object = match self.objects.get(name) {
                Some(number) => *number,
                None => *self.objects.entry(name.to_owned()).or_insert(next),
            };
        }
        self.batch.push(record);
        if self.batch.len() >= BATCH_POINTS && self.has_position {
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
    fn all_points_decide_whether_colours_have_8_bits() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        // Night first, a lamp at the end.
        let mut text = "x,y,z,red,green,blue\n".to_owned();
        for i in 0..9000 {
            let red = if i < 8000 { 200 } else { 51_200 };
            text += &format!("{}.25,{},0,{red},0,7\n", i % 100, i / 100);
        }
        std::fs::write(at("dark.csv"), text).unwrap();
        write_octree(&at("dark.csv"), &at("dark.copc.laz"), false, &Observer::default()).unwrap();
        let (points, _) = read_cloud(&at("dark.copc.laz")).unwrap();
        assert_eq!(points.len(), 9000);
        for i in 0..points.len() {
            let p = points.position(i);
            let is_dark = p.y.round() < 80.0;
            assert_eq!(points.colour_of(i), [if is_dark { 0 } else { 200 }, 0, 0], "{p}");
        }
    }

    #[test]
    fn colours_may_begin_with_a_later_scan() {
        let folder = tempfile::tempdir().unwrap();
        let out = folder.path().join("scans.copc.laz");
        let mut copy = Copy::new(&out, false);
        copy.file(&FileFacts { format: CloudFormat::E57, las: None });
        copy.start(AttributeSet::default().with_colours(true));
        for i in 0..2 * BATCH_POINTS {
            let colour = (i > BATCH_POINTS).then_some([9, 8, 7]);
            let position = DVec3::new(i as f64, 0.0, 0.0);
            let flow = copy.point(&PointRow { position, colour, ..PointRow::default() }, None).unwrap();
            assert!(flow.is_continue());
        }
        copy.flush().unwrap();
        copy.writer.unwrap().finish().unwrap();
        let (points, _) = read_cloud(&out).unwrap();
        assert_eq!(points.len(), 2 * BATCH_POINTS);
        for i in 0..points.len() {
            let is_coloured = points.position(i).x.round() > BATCH_POINTS as f64;
            assert_eq!(points.colour_of(i), if is_coloured { [9, 8, 7] } else { [0; 3] });
        }
    }

    #[test]
    fn a_stray_at_the_beginning_does_not_become_the_origin() {
        let at = |x, y| PointRecord { position: DVec3::new(x, y, 100.0), ..PointRecord::default() };
        let cloud = [at(0.0, 0.0), at(500_000.0, 5_400_000.4), at(500_001.0, 5_400_001.0)];
        assert_eq!(origin_of(&cloud), Some(DVec3::new(500_000.0, 5_400_000.0, 100.0)));
        assert_eq!(origin_of(&cloud[1..]), Some(DVec3::new(500_000.0, 5_400_000.0, 100.0)));
        let near = [at(0.0, 0.0), at(500_000.0, 500_000.0), at(500_001.0, 500_001.0)];
        assert_eq!(origin_of(&near), Some(DVec3::new(0.0, 0.0, 100.0)));
        assert_eq!(origin_of(&[at(f64::NAN, 0.0)]), None);
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
        std::fs::write(&empty, "x,y,z\n0,0,0\n1e10,5e10,0\n5e10,1e10,0\n").unwrap();
        let error = write_octree(&empty, &again, false, &Observer::default()).unwrap_err().to_string();
        assert!(error.contains("too far apart") && !again.exists(), "{error}");
    }
}
