//! Heights over a plane.

/// A surface with at most one height at each position, such as the ground of a scene.
pub trait HeightField: Send + Sync {
    /// Height at x and y, m; `None` where there is none. The frame of the coordinates is that of the field.
    fn height(&self, x: f64, y: f64) -> Option<f64>;
}

impl<F: Fn(f64, f64) -> Option<f64> + Send + Sync> HeightField for F {
    fn height(&self, x: f64, y: f64) -> Option<f64> {
        self(x, y)
    }
}
