//! Heights of points above the ground.

use std::fmt::Debug;
use std::sync::Arc;
use vlscan_geom::DVec3;

/// The ground of a scene.
pub trait Ground: Debug + Send + Sync {
    /// Height of the ground at x and y, m, scene frame; `None` where there is none.
    fn height(&self, x: f64, y: f64) -> Option<f64>;
}

/// Height of a point above the ground, m; NaN where there is none.
pub(super) fn height_above(ground: Option<&Arc<dyn Ground>>, point: DVec3) -> f32 {
    ground.and_then(|ground| ground.height(point.x, point.y)).map_or(f32::NAN, |z| (point.z - z) as f32)
}
