//! Colours of the cells of a cloud, which are read only if they are requested, in another pass over the file.

use super::Voxels;
use super::cells::Cell;
use crate::builder::SceneBuilder;
use std::collections::HashMap;
use vlscan_base::diag::Diagnostics;
use vlscan_base::error::Result;
use vlscan_formats::Selection;

/// Greatest component of colours of 8 bits.
const MAX_BYTE: f64 = 255.0;

/// Sums over the points of a cell.
#[derive(Clone, Copy, Default)]
struct Sums {
    /// Components as stored.
    colour: [u64; 3],
    /// The upper eight bits of components.
    upper: [u64; 3],
    points: u32,
}

impl Voxels<'_> {
    /// The mean colour of the points in each of the cells; empty if the points have no colours. Cells whose
    /// points have no colour are black.
    pub(super) fn mean_colours(&self, scene: &SceneBuilder, cells: &[Cell]) -> Result<Vec<[u8; 3]>> {
        let index_of: HashMap<Cell, usize> = cells.iter().copied().zip(0..).collect();
        let mut sums = vec![Sums::default(); cells.len()];
        let (mut max, mut failure) = (0u16, Ok(()));
        // Warnings were reported when the extent was determined.
        let mut found = Diagnostics::default();
        self.cloud.each_batch(self.source, Selection::All, &mut found, |batches| {
            failure = scene.options.check_stop();
            for point in batches.iter().flatten() {
                let Some(colour) = point.colour else { continue };
                let Some(point) = self.settings.usable(*point) else { continue };
                let Some(&index) = index_of.get(&self.grid.cell_of(point.position)) else { continue };
                let of_cell: &mut Sums = &mut sums[index];
                of_cell.points += 1;
                for (i, component) in colour.into_iter().enumerate() {
                    of_cell.colour[i] += u64::from(component);
                    of_cell.upper[i] += u64::from(component >> 8);
                    max = max.max(component);
                }
            }
            failure.is_ok()
        })?;
        failure?;
        if max == 0 {
            return Ok(Vec::new());
        }
        // Numbers above the greatest one that the scene states have 16 bits, of which the upper eight count:
        // programs multiply 8 bits by 256 or by 257.
        let stated = self.settings.max_colour;
        let (has_16_bits, scale) = (f64::from(max) > stated, MAX_BYTE / stated);
        let mean = |of_cell: &Sums| {
            let (sums, scale) = if has_16_bits { (of_cell.upper, 1.0) } else { (of_cell.colour, scale) };
            // The conversion saturates, and NaN of a cell without points becomes 0.
            sums.map(|sum| (sum as f64 / f64::from(of_cell.points) * scale).round() as u8)
        };
        Ok(sums.iter().map(mean).collect())
    }
}
