//! Points that are new or gone: far from all points of the other epoch, as measured by the spacing there.
//!
//! A point is new if its distance from the nearest point of the first cloud is more than twice the distance
//! of that point from its eighth neighbour, and gone if the same holds in reverse. Of points that are
//! scattered evenly over a surface one in 10¹³ lies so far from the others by chance (a Poisson process:
//! exp(−4 · 8)). Only cells where both clouds have points are compared.

use super::comparison::common_box;
use super::cut::{CellGrid, Cut};
use crate::cloud::Points;
use crate::kd_tree::KdTree;
use rayon::prelude::*;
use std::path::Path;
use vlscan_base::Observer;
use vlscan_base::diag::Diagnostics;
use vlscan_base::error::{Error, Result};
use vlscan_base::files::FileGroup;
use vlscan_formats::{CloudSettings, CloudWriter, PointFormat, PointRecord};
use vlscan_geom::{Aabb, radians};

/// Neighbour whose distance is the spacing of a place.
const NEIGHBOUR: usize = 8;
/// Minimum distance of a changed point, in spacings.
const SPACINGS: f64 = 2.0;
/// Classes of gone and of new points in files: two of those that LAS leaves to users.
const CLASSES: [u8; 2] = [65, 64];
/// Points that are written at a time.
const BATCH: usize = 1 << 16;

/// Indices of the points that changed.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ChangedPoints {
    /// Points of the first cloud that the second one lacks.
    pub gone: Vec<usize>,
    /// Points of the second cloud that the first one lacks.
    pub new: Vec<usize>,
}

/// The points of each cloud that the other one lacks, where both have points in cells of a side.
///
/// # Errors
/// [`Error::Input`] for clouds that do not overlap, and for cells that are too small.
pub fn changed_points(clouds: [&Points; 2], cell: f64) -> Result<ChangedPoints> {
    let (low, high) = common_box(clouds[0], clouds[1])?;
    let grid = CellGrid::new((low, high), cell, ("the first cloud", clouds[0]), 0)?;
    let cuts = clouds.map(|points| Cut::of(points, low, high));
    let counts = [&cuts[0], &cuts[1]].map(|cut| grid.counts(cut.offsets()));
    let is_seen = |offset: &[f64; 3]| counts.iter().all(|counts| counts[grid.cell(offset)] > 0.0);
    let trees = [&cuts[0], &cuts[1]].map(KdTree::new);
    let far = |from: usize, to: usize| -> Vec<usize> {
        let is_far = |offset: &[f64; 3]| {
            let found = trees[to].nearest_few(&cuts[to], offset, 1, |_| true);
            let Some((distance, nearest)) = found.first().copied() else { return true };
            // The nearest point is its own first neighbour.
            let place = cuts[to].offset(nearest as usize);
            let around = trees[to].nearest_few(&cuts[to], &place, NEIGHBOUR + 1, |_| true);
            let spacing = around.last().map_or(0.0, |(squared, _)| *squared);
            distance > SPACINGS * SPACINGS * spacing
        };
        let is_changed = |i: &usize| {
            let offset = cuts[from].offset(*i);
            is_seen(&offset) && is_far(&offset)
        };
        let changed = (0..cuts[from].len()).into_par_iter().filter(is_changed);
        changed.map(|i| cuts[from].index(i)).collect()
    };
    Ok(ChangedPoints { gone: far(0, 1), new: far(1, 0) })
}

/// Writes the changed points of both clouds to a file of `group` whose extension is that of a format: those
/// of the first cloud have class 65 (gone), those of the second one class 64 (new).
///
/// # Errors
/// [`Error::Input`] for a file that exists unless it is to be replaced, and for an extension that is no
/// format; [`Error::Io`].
pub fn write_changed(
    path: &Path,
    replace: bool,
    clouds: [&Points; 2],
    changed: &ChangedPoints,
    observer: &Observer,
    group: &mut FileGroup,
) -> Result<()> {
    let format = PointFormat::required(path);
    let format = format.map_err(|unknown| Error::input(format!("{}: {unknown}", path.display())))?;
    let bounds = clouds[0].bounds().union(clouds[1].bounds());
    let origin = bounds.centre();
    let mut settings = CloudSettings::default();
    settings.origin = origin;
    settings.bounds = Aabb { min: bounds.min - origin, max: bounds.max - origin };
    settings.crs = clouds.iter().find_map(|points| points.crs()).map(str::to_owned);
    settings.highest_class = CLASSES[0].into();
    let mut found = Diagnostics::default();
    let mut writer = CloudWriter::create(path, replace, format, &settings, &mut found)?;
    observer.warnings(found)?;
    let all = [&changed.gone, &changed.new];
    for ((points, indices), class) in clouds.into_iter().zip(all).zip(CLASSES) {
        for batch in indices.chunks(BATCH) {
            let record = |i: &usize| {
                let number = |value: Option<u8>| u32::from(value.unwrap_or(1));
                PointRecord {
                    position: points.position(*i) - origin,
                    amplitude: points.intensity_of(*i).map_or(0.0, f64::from),
                    return_number: number(points.return_number_of(*i)),
                    number_of_returns: number(points.number_of_returns_of(*i)),
                    scan_angle: points.scan_angle_of(*i).map_or(0.0, |angle| radians(angle.into())),
                    time_ns: 1e9 * points.time_of(*i).unwrap_or(0.0),
                    class: class.into(),
                    leg: points.source_of(*i).0,
                    ..PointRecord::default()
                }
            };
            writer.write(&batch.iter().map(record).collect::<Vec<_>>())?;
        }
    }
    writer.finish_in(group).map(drop)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cloud::read_points;
    use vlscan_base::rng::{Purpose, Stream};
    use vlscan_formats::{AttributeSet, PointRow};
    use vlscan_geom::DVec3;

    /// Ground of 40 by 40 m with 10 points per m², and a box of 4 by 4 m, 3 m high, at a place.
    fn ground(seed: u64, box_at: f64) -> Points {
        let stream = Stream::new(seed, Purpose::SceneMaking);
        let mut points = Points::new(AttributeSet::of(|_| true));
        for i in 0..16_000 {
            let [x, y] = [0, 1].map(|axis| 40.0 * stream.uniform(1, i, axis));
            let is_box = (x - box_at).abs() <= 2.0 && (y - box_at).abs() <= 2.0;
            let z = if is_box { 3.0 } else { 0.02 * stream.normal(2, i, 0) };
            let position = DVec3::new(x, y, z) + DVec3::new(431_000.0, 5_412_000.0, 100.0);
            points.push(&PointRow { position, intensity: 7.0, class: 2, ..PointRow::default() }, None);
        }
        points
    }

    #[test]
    fn a_box_that_was_moved_is_gone_and_new() {
        let clouds = [ground(1, 10.0), ground(2, 30.0)];
        let clouds = [&clouds[0], &clouds[1]];
        let changed = changed_points(clouds, 1.0).unwrap();
        // 16 m² of roof, and the ground that the other box had covered.
        for (points, indices, own, other) in
            [(clouds[0], &changed.gone, 10.0, 30.0), (clouds[1], &changed.new, 30.0, 10.0)]
        {
            let roof = indices.iter().filter(|i| points.position(**i).z > 102.9).count();
            assert!((120..=200).contains(&roof), "{roof}");
            for i in indices {
                let p = points.position(*i) - DVec3::new(431_000.0, 5_412_000.0, 100.0);
                let is_near = |at: f64| (p.x - at).abs() <= 2.0 && (p.y - at).abs() <= 2.0;
                assert!(is_near(own) || is_near(other), "{p}");
            }
        }
        let unchanged = ground(3, 10.0);
        assert_eq!(changed_points([clouds[0], &unchanged], 1.0).unwrap(), ChangedPoints::default());
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("changed.laz");
        let write = || {
            let mut group = FileGroup::default();
            write_changed(&path, false, clouds, &changed, &Observer::default(), &mut group)?;
            group.commit()
        };
        write().unwrap();
        let written = read_points(&path).unwrap().0;
        let count = |class: u8| (0..written.len()).filter(|i| written.class_of(*i) == Some(class)).count();
        assert_eq!((count(64), count(65)), (changed.new.len(), changed.gone.len()));
        assert_eq!(written.intensity_of(0), Some(7.0));
        assert!((written.position(0) - clouds[0].position(changed.gone[0])).length() < 1e-3);
        assert!(write().is_err());
    }
}
