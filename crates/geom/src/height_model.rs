//! Heights over a plane.

/// A surface with at most one height at each position, such as the ground of a scene.
pub trait HeightModel: Send + Sync {
    /// Height at x and y, m; `None` where there is none. The frame of the coordinates is that of the model.
    fn height(&self, x: f64, y: f64) -> Option<f64>;
}

impl<F: Fn(f64, f64) -> Option<f64> + Send + Sync> HeightModel for F {
    fn height(&self, x: f64, y: f64) -> Option<f64> {
        self(x, y)
    }
}
