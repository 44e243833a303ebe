//! Places of the cubes of a grid.

use crate::Cube;
use vlscan_geom::{DVec3, Rotation};

/// Positions and size of the cubes of a grid.
///
/// A cube is computed as a program that stores cubes would compute it, operation by operation: the centre of
/// its cell, the scale and the translation of the part, its raise, less the scene's shift.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct GridPlace {
    /// Lower corner of cell 0, m.
    pub corner: DVec3,
    /// Edge of a cell, m, > 0.
    pub spacing: f64,
    /// Half edge of a cube, m.
    pub half: f64,
    /// Factor > 0 of all centres, and what is then added to them, m.
    pub transform: Option<(f64, DVec3)>,
    /// Added to z after the translation, m; −0 leaves every z unchanged, which +0 would not.
    pub raise: f64,
    /// Subtracted last, m.
    pub shift: DVec3,
}

impl GridPlace {
    /// Cubes that fill cells of edge `spacing` from `corner` on, m.
    pub fn new(corner: DVec3, spacing: f64) -> GridPlace {
        let half = 0.5 * spacing;
        GridPlace { corner, spacing, half, transform: None, raise: -0.0, shift: DVec3::ZERO }
    }

    /// The cube of a cell, numbered along x, y, z.
    #[inline(always)]
    pub fn cube(&self, cell: [u32; 3]) -> Cube {
        let mut centre = self.corner + (DVec3::from(cell.map(f64::from)) + 0.5) * self.spacing;
        if let Some((scale, translation)) = self.transform {
            // A transform without rotation may change the sign of a zero.
            centre = Rotation::IDENTITY.apply(centre) * scale + translation;
        }
        Cube { centre: DVec3::new(centre.x, centre.y, centre.z + self.raise) - self.shift, half: self.half }
    }

    /// Distance of the centres of neighbours, m, approximately.
    pub(super) fn step(&self) -> f64 {
        self.spacing * self.transform.map_or(1.0, |(scale, _)| scale)
    }

    /// Bound of the numbers that occur when the cubes of the first `count` cells along any axis are computed.
    pub(super) fn magnitude(&self, count: u32) -> f64 {
        let size = self.corner.abs().max_element() + f64::from(count) * self.spacing;
        let (scale, translation) = self.transform.unwrap_or((1.0, DVec3::ZERO));
        size * scale.max(1.0)
            + translation.abs().max_element()
            + self.raise.abs()
            + self.shift.abs().max_element()
            + self.half
    }
}
