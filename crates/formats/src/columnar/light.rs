//! Labels of the way of light: the columns that formats without columns have, too.

use super::Column;
use crate::record::PointRecord;
use std::slice;
use vlscan_geom::DVec3;

/// The labels, in the order in which they are written.
const LABELS: [Column; 6] = [
    Column::Path,
    Column::PathOrder,
    Column::Primitive,
    Column::SurfaceX,
    Column::SurfaceY,
    Column::SurfaceZ,
];

/// The labels of the way of light among the chosen columns: a bit for each of [`LABELS`].
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct LightColumns(u8);

impl Column {
    /// True for labels of the way of light, which files of other columns have, too, if one of them is chosen;
    /// these have the primitive then, if it is chosen.
    pub fn is_light_label(self) -> bool {
        self != Column::Primitive && LABELS.contains(&self)
    }
}

impl LightColumns {
    /// The labels among the chosen columns. The primitive by itself is none.
    pub fn of(columns: Option<&[Column]>) -> LightColumns {
        let columns = columns.unwrap_or_default();
        if !columns.iter().any(|column| column.is_light_label()) {
            return LightColumns::default();
        }
        let bit = |(i, label): (usize, &Column)| u8::from(columns.contains(label)) << i;
        LightColumns(LABELS.iter().enumerate().map(bit).fold(0, |all, bit| all | bit))
    }

    /// These labels but the primitive, for files that have it anyway if `is_there`.
    pub fn without_primitive_if(self, is_there: bool) -> LightColumns {
        let primitive = LABELS.iter().position(|label| *label == Column::Primitive && is_there);
        LightColumns(primitive.map_or(self.0, |i| self.0 & !(1 << i)))
    }

    /// True if no label is chosen.
    pub fn is_empty(self) -> bool {
        self.0 == 0
    }

    /// The labels.
    pub fn iter(self) -> impl Iterator<Item = Column> {
        LABELS.into_iter().enumerate().filter(move |(i, _)| self.0 & (1 << i) != 0).map(|(_, label)| label)
    }

    /// Name of a label in formats whose names have no capitals.
    pub fn small_name(label: Column) -> &'static str {
        match label {
            Column::Path => "path",
            Column::PathOrder => "path_order",
            Column::Primitive => "primitive",
            Column::SurfaceX => "surface_x",
            Column::SurfaceY => "surface_y",
            _ => "surface_z",
        }
    }

    /// Bytes of the labels of a point.
    pub fn width(self) -> usize {
        self.iter().map(|label| label.kind().width()).sum()
    }

    /// Appends the labels of a point, little-endian; positions are relative to a point with the coordinates
    /// `-origin` in the frame of the records.
    pub fn push_bytes(self, out: &mut Vec<u8>, point: &PointRecord, origin: DVec3) {
        self.iter().for_each(|label| label.push_bytes(out, slice::from_ref(point), origin));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::record::Cause;

    #[test]
    fn labels_are_chosen_and_written_in_one_order() {
        use Column::{Path, Primitive, SurfaceY, X};
        assert!(LightColumns::of(Some(&[X, Primitive])).is_empty() && LightColumns::of(None).is_empty());
        let labels = LightColumns::of(Some(&[SurfaceY, X, Primitive, Path]));
        assert!(labels.iter().eq([Path, Primitive, SurfaceY]));
        assert!(labels.without_primitive_if(false) == labels);
        assert!(labels.without_primitive_if(true).iter().eq([Path, SurfaceY]));
        assert_eq!(labels.width(), 13);
        let cause = Cause { path: 8, surface: DVec3::Y * 2.0, ..Cause::UNKNOWN };
        let point = PointRecord { cause, primitive: 7, ..PointRecord::default() };
        let mut bytes = Vec::new();
        labels.push_bytes(&mut bytes, &point, DVec3::splat(1.0));
        assert_eq!(bytes, [&[8_u8, 7, 0, 0, 0][..], &3f64.to_le_bytes()].concat());
    }
}
