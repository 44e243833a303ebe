//! Leaf angle tables: how much leaf area a direction sees (spec pulse-physics §2.6, input-formats §4.6).

use super::number::float;
use super::text::{Lines, Problems, Source, is_empty_line, shown};
use crate::diag::Diagnostics;
use crate::geom::DVec3;
use libm::acos;

/// The projection function G over the zenith angle, on the scale where an isotropic canopy has G = π.
#[derive(Clone, Debug, PartialEq)]
pub struct LadTable {
    /// Zenith angles, rad, strictly ascending.
    angles: Vec<f64>,
    /// G at each angle.
    values: Vec<f64>,
}

/// No leaves project more than that on a scale where an isotropic canopy has π.
const LARGEST: f64 = 1e3;

fn is_unit(d: DVec3) -> bool {
    (d.length() - 1.0).abs() < 0.01
}

/// Angles closer than this are equal, rad.
const SAME_ANGLE: f64 = 1e-7;

impl LadTable {
    /// The table of rows (unit direction, G). A direction with x < 0 has a zenith angle above π. Of rows with equal angles
    /// the first counts. `None` without rows.
    pub fn new(rows: impl IntoIterator<Item = (DVec3, f64)>) -> Option<LadTable> {
        let angle = |d: DVec3| {
            let angle = acos(d.z.clamp(-1.0, 1.0));
            if d.x < 0.0 { std::f64::consts::TAU - angle } else { angle }
        };
        let mut rows: Vec<(f64, f64)> = rows.into_iter().map(|(d, g)| (angle(d), g)).collect();
        rows.sort_by(|a, b| a.0.total_cmp(&b.0));
        rows.dedup_by(|later, first| later.0 == first.0);
        let (angles, values): (Vec<f64>, Vec<f64>) = rows.into_iter().unzip();
        (!angles.is_empty()).then_some(LadTable { angles, values })
    }

    /// Zenith angle and G of every row.
    pub(super) fn rows(&self) -> impl Iterator<Item = (f64, f64)> {
        self.angles.iter().copied().zip(self.values.iter().copied())
    }

    /// The table of [`LadTable::rows`], of which there is at least one.
    pub(super) fn of_rows(rows: Vec<(f64, f64)>) -> LadTable {
        let (angles, values) = rows.into_iter().unzip();
        LadTable { angles, values }
    }

    /// G for a ray along the unit vector `direction`: linear between the neighbouring angles, constant beyond the first
    /// and the last. A vertical ray whose z exceeds 1 by rounding counts as vertical.
    pub fn g(&self, direction: DVec3) -> f64 {
        let angle = acos(direction.z.clamp(-1.0, 1.0));
        let upper = self.angles.partition_point(|&a| a < angle);
        let Some(&above) = self.angles.get(upper) else { return self.values[upper - 1] };
        if above - angle < SAME_ANGLE || upper == 0 {
            return self.values[upper];
        }
        let (a, b) = (above - angle, angle - self.angles[upper - 1]);
        if b < SAME_ANGLE {
            return self.values[upper - 1];
        }
        (b * self.values[upper] + a * self.values[upper - 1]) / (a + b)
    }

    /// Reads a table of lines `x,y,z,G`. `None` after an error, of which all are reported.
    pub(super) fn read(source: &Source, diagnostics: &mut Diagnostics) -> Option<LadTable> {
        if !source.is_text("a leaf angle table", diagnostics) {
            return None;
        }
        let mut problems = Problems::default();
        let mut rows = Vec::new();
        for line in Lines::new(source.bytes(), false).filter(|l| !is_empty_line(&l.text)) {
            let numbers: Vec<f64> = line
                .text
                .split(|&b| b == b',')
                .filter_map(|w| float(w.trim_ascii()))
                .filter(|v| v.is_finite())
                .collect();
            match numbers[..] {
                [x, y, z, g] if is_unit(DVec3::new(x, y, z)) && (0.0..=LARGEST).contains(&g) => {
                    rows.push((DVec3::new(x, y, z), g))
                }
                _ => problems.error(line.number, line.start..line.start + line.text.len(), || {
                    format!(
                        "expected x,y,z,G with a unit vector and a G of 0 or more, found \"{}\"",
                        shown(line.text.trim_ascii())
                    )
                }),
            }
        }
        let is_sound = problems.report(source, diagnostics);
        let table = LadTable::new(rows);
        if table.is_none() && is_sound {
            let message = "the leaf angle table has no rows; a row is x,y,z,G";
            diagnostics.error(Some(source.place(1, 0..0)), message);
        }
        table.filter(|_| is_sound)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geom::unit;
    use proptest::prelude::*;

    fn example() -> LadTable {
        LadTable::new([(DVec3::Z, 2.4), (DVec3::X, 3.4), (-DVec3::Z, 2.4)]).unwrap()
    }

    #[test]
    fn the_worked_example() {
        // spec pulse-physics §2.8 (g)
        assert!((example().g(DVec3::new(0.6, 0.0, 0.8)) - 2.809665529).abs() < 1e-9);
        assert_eq!(example().g(DVec3::Y), 3.4);
        assert_eq!(example().g(DVec3::new(0.0, 0.0, 1.0 + f64::EPSILON)), 2.4);
    }

    #[test]
    fn beyond_the_table_the_nearest_row_counts() {
        let table = LadTable::new([(unit(DVec3::new(1.0, 0.0, 1.0)), 1.0), (DVec3::X, 2.0)]).unwrap();
        assert_eq!((table.g(DVec3::Z), table.g(-DVec3::Z)), (1.0, 2.0));
        let mirrored = LadTable::new([(unit(DVec3::new(-1.0, 0.0, 1.0)), 5.0), (DVec3::Z, 1.0)]).unwrap();
        assert!(mirrored.g(unit(DVec3::new(1.0, 0.0, 1.0))) < 2.0, "its angle is 315°, not 45°");
    }

    #[test]
    fn a_file_with_mistakes_names_them_all() {
        let mut d = Diagnostics::default();
        let good = Source::of("l.lut", b"1.0,0.0,0.0,0.5\r\n\r\n0.0, 0.0, 1.0, 0.25\n");
        assert_eq!(LadTable::read(&good, &mut d).unwrap().g(DVec3::Z), 0.25);
        assert!(d.items().is_empty());
        let bad = Source::of("l.lut", b"1,0,0,0.5\n1,0,0\nx,0,0,1\n1,1,1,1\n0,0,1,nan\n0,0,1,-1\n");
        assert!(LadTable::read(&bad, &mut d).is_none());
        assert_eq!(d.items().len(), 5);
        assert!(LadTable::read(&Source::of("l.lut", b"\n"), &mut d).is_none() && d.items().len() == 6);
    }

    proptest! {
        #[test]
        fn values_stay_within_those_of_the_neighbours(z in -1.0..=1.0f64, phi in 0.0..6.3f64) {
            let r = (1.0 - z * z).sqrt();
            let g = example().g(DVec3::new(r * phi.cos(), r * phi.sin(), z));
            prop_assert!((2.4..=3.4).contains(&g));
        }
    }
}
