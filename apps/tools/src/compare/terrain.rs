//! The terrain that residuals and heights refer to: the ground points of the first cloud, or a raster or
//! mesh.

use super::cut::Cut;
use crate::kd_tree::{KdTree, Places};
use std::path::Path;
use vlscan_base::error::{Error, Result};
use vlscan_base::recognise::{Expected, foreign_file};
use vlscan_base::{Observer, machine};
use vlscan_geom::DVec3;
use vlscan_lidar::pulse::Corrections;
use vlscan_scene::{GroundModel, LoadOptions};
use vlscan_survey::{ReadOptions, names_raster, read_scene};

/// Class of ground points in LAS.
pub(super) const GROUND: u8 = 2;
/// Number of points by which a terrain is found to be elsewhere.
const SAMPLED_POINTS: usize = 10_000;
/// Number of neighbours that a plane is fitted to.
const NEIGHBOURS: usize = 12;
/// Largest leverage of a place in the fit of its plane; beyond it the plane is extrapolated.
const MAX_LEVERAGE: f64 = 0.5;

/// A terrain.
pub(super) enum Terrain<'c> {
    /// Planes through the nearest ground points of the first cloud.
    Planes(Planes<'c>),
    /// A raster or mesh, and the corner of the common box that places are relative to.
    Model(GroundModel, DVec3),
}

impl<'c> Terrain<'c> {
    /// Loads a raster (.tif, .asc, .vrt, a folder of tiles) or mesh (.obj, .ply, .stl, .off).
    ///
    /// # Errors
    /// The errors of reading it.
    pub fn load(path: &Path, corner: DVec3, observer: &Observer) -> Result<Terrain<'c>> {
        let is_mesh = path.extension().is_some_and(|extension| {
            ["obj", "ply", "stl", "off"].iter().any(|known| extension.eq_ignore_ascii_case(known))
        });
        if let Some(found) = foreign_file(path, &Expected::SURFACE) {
            return Err(found.error(path));
        }
        let name = path.to_str().filter(|_| is_mesh || names_raster(path)).ok_or_else(|| {
            let shown = path.display();
            Error::input(format!(
                "--terrain {shown}: expected a raster (.tif, .asc, .vrt, a folder of tiles) or a mesh (.obj, \
                 .ply, .stl, .off)"
            ))
        })?;
        let (recipe, found) = read_scene(name, &ReadOptions::default())?;
        observer.warnings(found)?;
        let options = LoadOptions {
            max_memory: machine::memory(),
            rules: Corrections::REFINED,
            ..LoadOptions::default()
        };
        let (model, found) = GroundModel::load(&recipe, &options)?;
        observer.warnings(found)?;
        Ok(Terrain::Model(model, corner))
    }

    /// Height of the terrain at a place relative to the common box, m, and whether its surroundings support
    /// it.
    pub fn height(&self, [x, y]: [f64; 2]) -> Option<(f64, bool)> {
        match self {
            Terrain::Planes(planes) => planes.height([x, y]),
            Terrain::Model(model, corner) => {
                Some((model.height(x + corner.x, y + corner.y)? - corner.z, true))
            }
        }
    }

    /// True if the terrain has a height below one of many points of a cloud.
    pub fn is_below(&self, cut: &Cut) -> bool {
        let every = cut.len().div_ceil(SAMPLED_POINTS).max(1);
        (0..cut.len()).step_by(every).any(|i| {
            let [x, y, _] = cut.offset(i);
            self.height([x, y]).is_some()
        })
    }

    /// Description for users.
    pub fn description(&self) -> &'static str {
        match self {
            Terrain::Planes(_) => {
                "planes through the 12 nearest ground points of the first cloud, without the nearest scan \
                 line"
            }
            Terrain::Model(..) => "the terrain that was given",
        }
    }
}

/// Planes through the nearest ground points.
pub(super) struct Planes<'c> {
    tree: KdTree,
    ground: Ground<'c>,
    /// The scan line of each ground point, if there are any.
    lines: Option<Vec<u32>>,
}

/// The ground points of a cloud.
struct Ground<'c> {
    cut: &'c Cut<'c>,
    /// Their numbers in the cut.
    points: Vec<u32>,
}

impl Ground<'_> {
    fn position(&self, index: u32) -> [f64; 3] {
        self.cut.offset(self.points[index as usize] as usize)
    }
}

impl Places for Ground<'_> {
    fn count(&self) -> usize {
        self.points.len()
    }

    fn at(&self, index: u32) -> [f64; 3] {
        let [x, y, _] = self.position(index);
        [x, y, 0.0]
    }
}

impl<'c> Planes<'c> {
    /// Of the ground points of a cloud, with the scan line of each of its points; `None` if they are too few.
    pub fn of(cut: &'c Cut<'c>, line_of: Option<&[u32]>) -> Option<Planes<'c>> {
        let is_ground = |i: &u32| cut.class(*i as usize) == Some(GROUND);
        let points: Vec<u32> = (0..cut.len() as u32).filter(is_ground).collect();
        if points.len() <= NEIGHBOURS {
            return None;
        }
        let lines = line_of.map(|of| points.iter().map(|i| of[*i as usize]).collect());
        let ground = Ground { cut, points };
        Some(Planes { tree: KdTree::new(&ground), ground, lines })
    }

    /// Height of the least-squares plane through the nearest ground points, and true if it is not an
    /// extrapolation; otherwise it is their mean height. The nearest ground point is left out with its scan
    /// line: of a point that makes the terrain that is itself, and other points lie as far from the lines
    /// that remain as it does.
    fn height(&self, [x, y]: [f64; 2]) -> Option<(f64, bool)> {
        let place = [x, y, 0.0];
        let (_, nearest) = *self.tree.nearest_few(&self.ground, &place, 1, |_| true).first()?;
        let is_other = |i: u32| match &self.lines {
            Some(lines) => lines[i as usize] != lines[nearest as usize],
            None => i != nearest,
        };
        let nearest = self.tree.nearest_few(&self.ground, &place, NEIGHBOURS, is_other);
        let points: Vec<[f64; 3]> = nearest.iter().map(|(_, i)| self.ground.position(*i)).collect();
        plane(&points, [x, y]).map(|at| (at.height, at.is_supported))
    }
}

/// The least-squares plane through points, at a place.
pub(super) struct PlaneAt {
    /// Height at the place, or the mean height of the points where that would be extrapolated.
    pub height: f64,
    /// True if the place is within what the points support.
    pub is_supported: bool,
    /// Variance of the height over that of a point.
    pub leverage: f64,
    /// Sum of the squares of the points' distances from the plane, or from their mean.
    pub squares: f64,
}

/// The least-squares plane through points, or their mean height where the place has too high a leverage;
/// `None` without points.
pub(super) fn plane(points: &[[f64; 3]], place: [f64; 2]) -> Option<PlaneAt> {
    if points.is_empty() {
        return None;
    }
    let fitted = fitted_plane(points, place).filter(|at| at.leverage <= MAX_LEVERAGE);
    fitted.or_else(|| {
        let count = points.len() as f64;
        let height = points.iter().map(|p| p[2]).sum::<f64>() / count;
        let squares = points.iter().map(|p| (p[2] - height) * (p[2] - height)).sum();
        Some(PlaneAt { height, is_supported: false, leverage: 1.0 / count, squares })
    })
}

/// The least-squares plane through points, at a place, however far it lies from them; `None` of points on a
/// line.
pub(super) fn fitted_plane(points: &[[f64; 3]], [x, y]: [f64; 2]) -> Option<PlaneAt> {
    let count = points.len() as f64;
    let mean = [0, 1, 2].map(|axis| points.iter().map(|p| p[axis]).sum::<f64>() / count);
    let [mut xx, mut xy, mut yy, mut xz, mut yz, mut zz] = [0.0; 6];
    for p in points {
        let [dx, dy, dz] = [0, 1, 2].map(|axis| p[axis] - mean[axis]);
        xx += dx * dx;
        xy += dx * dy;
        yy += dy * dy;
        xz += dx * dz;
        yz += dy * dz;
        zz += dz * dz;
    }
    let determinant = xx * yy - xy * xy;
    let (dx, dy) = (x - mean[0], y - mean[1]);
    let leverage = 1.0 / count + (yy * dx * dx - 2.0 * xy * dx * dy + xx * dy * dy) / determinant;
    // Of points on a line the determinant is 0, and without points it is NaN.
    if !(determinant > 0.0 && leverage.is_finite()) {
        return None;
    }
    let slope = [(xz * yy - yz * xy) / determinant, (yz * xx - xz * xy) / determinant];
    let height = mean[2] + slope[0] * dx + slope[1] * dy;
    let squares = (zz - slope[0] * xz - slope[1] * yz).max(0.0);
    Some(PlaneAt { height, is_supported: true, leverage, squares })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_plane_is_met_within_and_not_extrapolated() {
        let points: Vec<[f64; 3]> = (0..12)
            .map(|i| {
                let (x, y) = (f64::from(i % 4), f64::from(i / 4));
                [x, y, 5.0 + 0.3 * x - 0.2 * y]
            })
            .collect();
        let at = plane(&points, [1.7, 1.2]).unwrap();
        assert!((at.height - (5.0 + 0.51 - 0.24)).abs() < 1e-12 && at.is_supported && at.squares < 1e-12);
        let far = plane(&points, [40.0, 1.0]).unwrap();
        assert!(!far.is_supported && (far.height - 5.25).abs() < 1e-12, "{}", far.height);
        let line: Vec<[f64; 3]> = (0..12).map(|i| [f64::from(i), 0.0, 1.0]).collect();
        assert!(plane(&line, [3.0, 2.0]).is_some_and(|at| at.height == 1.0 && !at.is_supported));
        assert!(plane(&[], [0.0; 2]).is_none());
    }
}
