//! The ground that heights of points count from.

use crate::output::Ground;
use vlscan_scene::GroundModel;

impl Ground for GroundModel {
    fn height(&self, x: f64, y: f64) -> Option<f64> {
        self.local_height(x, y)
    }
}
