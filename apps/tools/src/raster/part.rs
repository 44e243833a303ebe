//! The points of a block that a raster sums, chosen on the thread that decodes them.

use crate::cloud::{NOISE, is_placed};
use vlscan_formats::{Attribute, AttributeSet, PointPart, PointRow, Strays};
use vlscan_geom::DVec3;

/// Class of ground points in LAS.
const GROUND: u8 = 2;

/// The points that count, in their order, and the number of the others.
#[derive(Debug, Default)]
pub(super) struct BlockPart {
    attributes: AttributeSet,
    /// Points that are left out.
    left_out: Option<Strays>,
    pub positions: Vec<DVec3>,
    pub kinds: Vec<PointKind>,
    pub skipped: u64,
    pub misses: u64,
    pub noise: u64,
}

/// The sums of a cell that a point belongs to.
#[derive(Clone, Copy, Debug)]
pub(super) struct PointKind {
    pub is_first_return: bool,
    pub is_ground: bool,
}

impl BlockPart {
    /// No points yet, which have these attributes.
    pub fn new(attributes: AttributeSet, left_out: Option<Strays>) -> BlockPart {
        BlockPart { attributes, left_out, ..BlockPart::default() }
    }
}

impl PointPart for BlockPart {
    fn add(&mut self, row: &PointRow) {
        let p = row.position;
        if !is_placed(p) {
            self.skipped += 1;
        } else if row.is_miss {
            self.misses += 1;
        } else if NOISE.contains(&row.class) {
            self.noise += 1;
        } else if self.left_out.is_none_or(|strays| !strays.contains(p)) {
            let is_first_return = !self.attributes.has(Attribute::ReturnNumber) || row.return_number <= 1;
            self.positions.push(p);
            self.kinds.push(PointKind { is_first_return, is_ground: row.class == GROUND });
        }
    }

    fn takes_names(&self) -> bool {
        // Objects are not used.
        true
    }

    fn clear(&mut self) {
        self.positions.clear();
        self.kinds.clear();
        (self.skipped, self.misses, self.noise) = (0, 0, 0);
    }
}
