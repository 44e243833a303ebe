//! Residuals of ground points to the terrain: of all, by scan angle, by height of the terrain.

use super::cut::Cut;
use super::setting::{Findings, Setting};
use super::statistic::Statistic::{self, Mean, Quantile, Spread};
use super::terrain::{GROUND, Terrain};
use rayon::prelude::*;

/// Width of the reported classes of scan angles, degrees.
const ANGLE_CLASS: f64 = 5.0;
/// Number of classes of elevations with equal numbers of points of the first cloud.
const ELEVATION_CLASSES: usize = 4;
/// Minimum number of residuals of each cloud in a reported class.
const MIN_CLASS: usize = 100;
/// Largest distance of an unclassified last return from the terrain that counts as ground, m.
const MAX_GROUND_DISTANCE: f64 = 1.0;

impl Setting<'_> {
    /// Measures residuals.
    pub fn residuals(&self, found: &mut Findings) {
        let Some(terrain) = &self.terrain else {
            return found.note_missing(
                "residuals to a terrain",
                "the first cloud has no ground points (class 2); --terrain FILE gives a raster or mesh",
            );
        };
        let of = self.cuts.map(|cut| residuals_of(cut, terrain, self.most));
        let has_ground = self.cuts.map(has_ground);
        let points = match has_ground {
            [true, true] => "ground points (class 2)".to_owned(),
            _ => format!(
                "ground points (class 2); if a cloud has none, last returns within {MAX_GROUND_DISTANCE} m,"
            ),
        };
        let statistics =
            [Mean, Quantile(0.5), Spread, Quantile(0.05), Quantile(0.25), Quantile(0.75), Quantile(0.95)];
        let meaning = format!("heights of {points} above {}", terrain.description());
        let all = Residuals { setting: self, of, meaning };
        all.measure(found, "residual to the terrain", &statistics, &|_| true, 0);
        all.by_angle(found);
        all.by_elevation(found);
    }
}

/// Statistics of classes of residuals.
const BRIEF: [Statistic; 3] = [Mean, Quantile(0.5), Spread];

/// The residuals of both clouds.
struct Residuals<'s, 'c> {
    setting: &'s Setting<'c>,
    of: [Vec<Residual>; 2],
    /// Description of the residuals.
    meaning: String,
}

impl Residuals<'_, '_> {
    /// Measures the chosen residuals if each cloud has at least `least` of them.
    fn measure(
        &self,
        found: &mut Findings,
        name: &str,
        statistics: &[Statistic],
        is_chosen: &dyn Fn(&Residual) -> bool,
        least: usize,
    ) {
        let [first, second] = [0, 1].map(|cloud: usize| -> Vec<(f64, u32)> {
            let chosen = self.of[cloud].iter().filter(|residual| is_chosen(residual));
            chosen.map(|residual| (residual.millimetres, residual.point)).collect()
        });
        if first.len().min(second.len()) < least {
            return;
        }
        let first = first.into_iter().map(|(mm, point)| (mm, self.setting.block(point)));
        let second = second.into_iter().map(|(mm, _)| mm).collect();
        let definition = self.setting.define("Terrain", name, ("mm", "point"), statistics, &self.meaning);
        found.add(name, definition.measure(first, second, self.setting.halves.as_ref()));
    }

    /// Measures the residuals by scan angle.
    fn by_angle(&self, found: &mut Findings) {
        let (low, high) = self.of.iter().flatten().fold((0.0_f64, 0.0_f64), |(low, high), residual| {
            (low.min(residual.angle), high.max(residual.angle))
        });
        let class_of = |angle: f64| (angle / ANGLE_CLASS).floor() as i32;
        for class in if low < high { class_of(low)..class_of(high) + 1 } else { 0..0 } {
            let name = format!(
                "residual, scan angle {}° to {}°",
                f64::from(class) * ANGLE_CLASS,
                f64::from(class + 1) * ANGLE_CLASS
            );
            self.measure(found, &name, &BRIEF, &|residual| class_of(residual.angle) == class, MIN_CLASS);
        }
    }

    /// Measures the residuals by elevation of the terrain.
    fn by_elevation(&self, found: &mut Findings) {
        let mut elevations: Vec<f64> = self.of[0].iter().map(|residual| residual.elevation).collect();
        elevations.sort_unstable_by(f64::total_cmp);
        if elevations.len() < ELEVATION_CLASSES * MIN_CLASS {
            return;
        }
        let edge = |i: usize| match i {
            0 => f64::NEG_INFINITY,
            ELEVATION_CLASSES => f64::INFINITY,
            _ => elevations[i * elevations.len() / ELEVATION_CLASSES],
        };
        let corner = self.setting.corner();
        for class in 0..ELEVATION_CLASSES {
            let (from, to) = (edge(class), edge(class + 1));
            let name = match (from.is_infinite(), to.is_infinite()) {
                (true, _) => format!("residual, terrain below {:.1} m", to + corner),
                (_, true) => format!("residual, terrain above {:.1} m", from + corner),
                _ => format!("residual, terrain {:.1} to {:.1} m", from + corner, to + corner),
            };
            self.measure(
                found,
                &name,
                &BRIEF,
                &|residual| (from..to).contains(&residual.elevation),
                MIN_CLASS,
            );
        }
    }
}

/// True if a cloud has ground points.
fn has_ground(cut: &Cut) -> bool {
    (0..cut.len()).any(|i| cut.class(i) == Some(GROUND))
}

/// The height of a ground point above the terrain.
struct Residual {
    millimetres: f64,
    /// Number of the point in its cut.
    point: u32,
    /// Scan angle, degrees; 0 if unknown.
    angle: f64,
    /// Height of the terrain relative to the common box, m.
    elevation: f64,
}

/// Residuals of at most `most` ground points, evenly chosen.
fn residuals_of(cut: &Cut, terrain: &Terrain, most: usize) -> Vec<Residual> {
    let is_classified = has_ground(cut);
    let is_last = |i: usize| cut.returns(i).is_none_or(|(number, count)| number >= count);
    let is_candidate = |i: &usize| if is_classified { cut.class(*i) == Some(GROUND) } else { is_last(*i) };
    let candidates = || (0..cut.len()).filter(is_candidate);
    let step = candidates().count().div_ceil(most).max(1);
    let residual = |i: &usize| {
        let [x, y, z] = cut.offset(*i);
        let (elevation, is_supported) = terrain.height([x, y])?;
        let is_ground = is_classified || (z - elevation).abs() <= MAX_GROUND_DISTANCE;
        let angle = cut.points.scan_angle_of(cut.index(*i)).map_or(0.0, f64::from);
        (is_supported && is_ground).then_some(Residual {
            millimetres: 1e3 * (z - elevation),
            point: *i as u32,
            angle,
            elevation,
        })
    };
    let chosen: Vec<usize> = candidates().step_by(step).collect();
    cut.points.release();
    let residuals = chosen.par_iter().filter_map(residual).collect();
    cut.points.release();
    residuals
}
