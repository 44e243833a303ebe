//! Leaf angle tables: the projection of leaf area in each direction (spec pulse-physics §2.6, input-formats
//! §4.6).
//!
//! G is the mean projection of a unit of leaf area, |cos| averaged over the leaf normals (Ross 1981): its
//! average over all directions is 1/2 for any leaf angles. The reference's tables contain 2πG, whose average
//! is π.

use super::material::SPHERICAL_MEAN_COSINE;
use super::number::float;
use super::text::{Lines, Problems, Source, is_empty_line, shown};
use libm::acos;
use std::f64::consts::{PI, TAU};
use vlscan_base::corrections::Corrections;
use vlscan_base::diag::Diagnostics;
use vlscan_base::recognise::Expected;
use vlscan_geom::DVec3;

/// The projection function G over the zenith angle, on the scale where an isotropic canopy has the value π.
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct LadTable {
    /// Zenith angles, rad, strictly ascending.
    angles: Vec<f64>,
    /// 2πG at each angle.
    values: Vec<f64>,
    /// Mean of the values over all directions.
    mean: f64,
    /// Mean over the leaves of (3 cos² − 1)/2 of the angle between normal and zenith: 1 for horizontal
    /// leaves, 0 for a uniform distribution of directions, −1/2 for vertical leaves.
    horizontality: f64,
}

/// Properties found in the values of a table.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct TableKind {
    /// Mean of the values over all directions.
    pub mean: f64,
    /// The values are G itself.
    pub is_g: bool,
    /// The table covers one hemisphere only.
    pub is_half: bool,
}

/// Number of steps of the integrals over the sphere.
const INTEGRATION_STEPS: u32 = 4096;

/// Maximum relative deviation of a table's mean from 1/2 or π that is not reported.
const MAX_MEAN_ERROR: f64 = 0.1;

/// Maximum value of a table, far above any projection on a scale where an isotropic canopy has π.
const MAX_G: f64 = 1e3;

fn is_unit(d: DVec3) -> bool {
    (d.length() - 1.0).abs() < 0.01
}

/// Angles closer than this are equal, rad.
const SAME_ANGLE: f64 = 1e-7;

impl LadTable {
    /// The table of rows (unit direction, G). A direction with x < 0 has a zenith angle above π. The first of
    /// several rows with equal angles counts. `None` without rows.
    pub fn new(rows: impl IntoIterator<Item = (DVec3, f64)>) -> Option<LadTable> {
        let angle = |d: DVec3| {
            let angle = acos(d.z.clamp(-1.0, 1.0));
            if d.x < 0.0 { TAU - angle } else { angle }
        };
        let mut rows: Vec<(f64, f64)> = rows.into_iter().map(|(d, g)| (angle(d), g)).collect();
        rows.sort_by(|a, b| a.0.total_cmp(&b.0));
        rows.dedup_by(|later, first| later.0 == first.0);
        (!rows.is_empty()).then(|| LadTable::of_rows(rows))
    }

    /// The table of rows (unit direction, value) according to the rules, and its properties. `None` without
    /// rows.
    fn by_rules(rows: Vec<(DVec3, f64)>, rules: Corrections) -> Option<(LadTable, TableKind)> {
        let is_half =
            rows.iter().all(|(d, _)| d.z > -SAME_ANGLE) || rows.iter().all(|(d, _)| d.z < SAME_ANGLE);
        let table = if rules.leaf_table_mirror {
            // The azimuth does not matter: rows of all azimuths describe the same curve.
            let folded = rows.into_iter().map(|(d, g)| (DVec3::new(d.x.abs(), d.y, d.z), g));
            let opposite = |(d, g): (DVec3, f64)| [(d, g), (DVec3::new(d.x, d.y, -d.z), g)];
            let folded: Vec<_> = if is_half { folded.flat_map(opposite).collect() } else { folded.collect() };
            LadTable::new(folded)?
        } else {
            LadTable::new(rows)?
        };
        let kind = TableKind { mean: table.mean, is_g: table.mean < (0.5 * PI).sqrt(), is_half };
        let scale = if rules.leaf_table_scale && kind.is_g { TAU } else { 1.0 };
        let rows = table.rows().map(|(angle, g)| (angle, g * scale)).collect();
        Some((LadTable::of_rows(rows), kind))
    }

    /// Mean over all directions of a function of the zenith angle and the table's value.
    fn mean_of(&self, f: impl Fn(f64, f64) -> f64) -> f64 {
        let mean = |i: u32| {
            let z = 2.0 * (f64::from(i) + 0.5) / f64::from(INTEGRATION_STEPS) - 1.0;
            f(z, self.at(acos(z)))
        };
        (0..INTEGRATION_STEPS).map(mean).sum::<f64>() / f64::from(INTEGRATION_STEPS)
    }

    /// Zenith angle and G of every row.
    pub(super) fn rows(&self) -> impl Iterator<Item = (f64, f64)> {
        self.angles.iter().copied().zip(self.values.iter().copied())
    }

    /// The inverse of [`LadTable::rows`]; needs at least one row.
    pub(super) fn of_rows(rows: Vec<(f64, f64)>) -> LadTable {
        let (angles, values) = rows.into_iter().unzip();
        let mut table = LadTable { angles, values, mean: 0.0, horizontality: 0.0 };
        table.mean = table.mean_of(|_, g| g);
        // G is the cosine transform of the leaf normals' density: its second Legendre coefficient is 5/8 of
        // that mean.
        let second = table.mean_of(|z, g| g * (1.5 * z * z - 0.5));
        table.horizontality = (4.0 * second / table.mean).clamp(-0.5, 1.0);
        if table.horizontality.is_nan() {
            table.horizontality = 0.0;
        }
        table
    }

    /// Mean cosine of the incidence on the leaves that a ray along the unit vector `direction` hits, weighted
    /// by their projection: the mean of cos² over the leaf normals, which follows from the second moment of
    /// G, divided by G.
    pub fn mean_cosine(&self, direction: DVec3) -> f64 {
        let g = 0.5 * self.g(direction) / self.mean;
        let square = (1.0 + self.horizontality * (3.0 * direction.z * direction.z - 1.0)) / 3.0;
        let mean = (square / g).min(1.0);
        if mean.is_nan() { SPHERICAL_MEAN_COSINE } else { mean }
    }

    /// 2πG for a ray along the unit vector `direction`: linear between neighbouring angles, constant beyond
    /// the first and the last. A vertical ray whose z exceeds 1 by rounding counts as vertical.
    pub fn g(&self, direction: DVec3) -> f64 {
        self.at(acos(direction.z.clamp(-1.0, 1.0)))
    }

    fn at(&self, angle: f64) -> f64 {
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

    /// Reads a table of lines `x,y,z,G` according to the rules, and returns the rules that change it. `None`
    /// after errors, all of which are reported.
    pub(super) fn read(
        source: &Source,
        rules: Corrections,
        diagnostics: &mut Diagnostics,
    ) -> Option<(LadTable, Corrections)> {
        if !source.is_text(&Expected::LEAF_ANGLES, diagnostics) {
            return None;
        }
        let mut problems = Problems::default();
        let mut rows = Vec::new();
        for line in Lines::new(source.bytes(), false).filter(|l| !is_empty_line(&l.text)) {
            let numbers: Option<Vec<f64>> = line
                .text
                .split(|&b| b == b',')
                .map(|w| float(w.trim_ascii()).filter(|v| v.is_finite()))
                .collect();
            match numbers.unwrap_or_default()[..] {
                [x, y, z, g] if is_unit(DVec3::new(x, y, z)) && (0.0..=MAX_G).contains(&g) => {
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
        let is_valid = problems.report(source, diagnostics);
        let table = LadTable::by_rules(rows, rules);
        if table.is_none() && is_valid {
            let message = "the leaf angle table has no rows; a row is x,y,z,G";
            diagnostics.error(Some(source.place(1, 0..0)), message);
        }
        let (table, kind) = table.filter(|_| is_valid)?;
        if rules.leaf_table_scale || rules.leaf_table_mirror {
            kind.report(source, rules, diagnostics);
        }
        let relevant =
            Corrections { leaf_table_scale: kind.is_g, leaf_table_mirror: true, ..Corrections::NONE };
        Some((table, relevant))
    }
}

impl TableKind {
    /// Reports how the table was interpreted.
    fn report(&self, source: &Source, rules: Corrections, diagnostics: &mut Diagnostics) {
        let place = || Some(source.place(0, 0..0));
        let is_g = self.is_g && rules.leaf_table_scale;
        let (scale, expected) = if is_g { ("G", 0.5) } else { ("2πG", PI) };
        let half = match self.is_half && rules.leaf_table_mirror {
            true => ", in one hemisphere only; they are used for the opposite directions too",
            false => "",
        };
        let mean = self.mean;
        let message = format!(
            "the leaf angle table's values are taken for {scale}: they average {mean:.4} over all \
             directions{half}"
        );
        diagnostics.note(place(), message);
        if (mean / expected - 1.0).abs() > MAX_MEAN_ERROR {
            let message = format!(
                "the leaf angle table's values average {mean:.4} over all directions, where G averages 0.5 \
                 and 2πG π; the foliage is {:.3} times as dense as its voxels say",
                mean / expected
            );
            diagnostics.warn(place(), message);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fixture::HELIOS;
    use proptest::prelude::*;
    use vlscan_geom::unit;

    const REFINED: Corrections = Corrections { leaf_table_scale: true, leaf_table_mirror: true, ..HELIOS };

    /// Rows every 5° between two zenith angles.
    fn rows(from: u32, to: u32, g: impl Fn(f64) -> f64) -> Vec<(DVec3, f64)> {
        let row = |degrees: u32| {
            let z = f64::from(degrees).to_radians();
            (DVec3::new(z.sin(), 0.0, z.cos()), g(z))
        };
        (from..=to).step_by(5).map(row).collect()
    }

    fn towards(degrees: f64) -> DVec3 {
        let z = degrees.to_radians();
        DVec3::new(0.0, z.sin(), z.cos())
    }

    /// G of horizontal leaves.
    fn level(z: f64) -> f64 {
        z.cos().abs()
    }

    /// G of vertical leaves of all azimuths.
    fn upright(z: f64) -> f64 {
        2.0 / PI * z.sin()
    }

    #[test]
    fn both_scales_are_recognised_by_their_mean() {
        for g in [level, upright, |_| 0.5] {
            for scale in [1.0, TAU] {
                let (table, kind) = LadTable::by_rules(rows(0, 180, |z| scale * g(z)), REFINED).unwrap();
                assert_eq!((kind.is_g, kind.is_half), (scale == 1.0, false));
                assert!((kind.mean / scale - 0.5).abs() < 2e-3, "{}", kind.mean);
                assert!((table.g(towards(35.0)) / TAU - g(35f64.to_radians())).abs() < 1e-12);
                let (helios, _) = LadTable::by_rules(rows(0, 180, |z| scale * g(z)), HELIOS).unwrap();
                assert_eq!(helios, LadTable::new(rows(0, 180, |z| scale * g(z))).unwrap());
            }
        }
    }

    #[test]
    fn half_tables_hold_for_opposite_directions() {
        for (from, to) in [(0, 90), (90, 180)] {
            let (table, kind) = LadTable::by_rules(rows(from, to, |z| TAU * level(z)), REFINED).unwrap();
            assert!(kind.is_half && !kind.is_g);
            for degrees in [0.0, 40.0, 65.0, 115.0, 140.0, 180.0] {
                let g = table.g(towards(degrees)) / TAU;
                assert!((g - level(f64::to_radians(degrees))).abs() < 1e-12, "{degrees}°: {g}");
            }
        }
        let (helios, _) = LadTable::by_rules(rows(0, 90, |z| TAU * level(z)), HELIOS).unwrap();
        assert!(helios.g(towards(140.0)) < 1e-12, "the reference repeats the edge");
        // The other half of the circle, which the reference ignores.
        let west = rows(0, 90, level).into_iter().map(|(d, g)| (DVec3::new(-d.x, d.y, d.z), g)).collect();
        let (table, _) = LadTable::by_rules(west, REFINED).unwrap();
        assert!((table.g(towards(40.0)) / TAU - level(40f64.to_radians())).abs() < 1e-12);
    }

    #[test]
    fn what_a_table_is_taken_for_is_reported() {
        let text = |scale: f64| {
            let line = |(d, g): (DVec3, f64)| format!("{},{},{},{}\n", d.x, d.y, d.z, g);
            rows(0, 90, |z| scale * level(z)).into_iter().map(line).collect::<String>()
        };
        let report = |text: &str, rules| {
            let mut d = Diagnostics::default();
            LadTable::read(&Source::of("l.lut", text.as_bytes()), rules, &mut d).unwrap();
            assert!(d.items().iter().all(|i| i.place.as_ref().is_some_and(|p| p.path.ends_with("l.lut"))));
            (d.is_fatal(true), d.items().iter().map(|i| i.message.clone()).collect::<Vec<_>>())
        };
        let (fatal, g) = report(&text(1.0), REFINED);
        assert!(
            !fatal && g.len() == 1 && g[0].contains("taken for G") && g[0].contains("hemisphere"),
            "{g:?}"
        );
        let (_, scaled) = report(&text(TAU), REFINED);
        assert!(scaled.len() == 1 && scaled[0].contains("taken for 2πG"), "{scaled:?}");
        let (fatal, off) = report(&text(0.5), REFINED);
        assert!(fatal && off.len() == 2 && off[1].contains("times as dense"), "{off:?}");
        assert_eq!(report(&text(1.0), HELIOS), (false, vec![]));
    }

    /// Mean cosines for closed forms of the leaf angles: cos² over |cos| is |cos| for horizontal leaves,
    /// (sin²/2)/(2 sin/π) for vertical ones, and 2/3 for spherical ones.
    #[test]
    fn mean_cosines_by_leaf_angle() {
        let fine = |g: fn(f64) -> f64| {
            let row = |i: u32| {
                let z = PI * f64::from(i) / 720.0;
                (DVec3::new(z.sin(), 0.0, z.cos()), g(z))
            };
            LadTable::by_rules((0..=720).map(row).collect(), REFINED).unwrap().0
        };
        for degrees in [10.0f64, 35.0, 60.0, 80.0, 120.0] {
            let (s, c) = (degrees.to_radians().sin(), degrees.to_radians().cos().abs());
            assert!((fine(level).mean_cosine(towards(degrees)) - c).abs() < 1e-3, "{degrees}°");
            assert!((fine(upright).mean_cosine(towards(degrees)) - s * PI / 4.0).abs() < 1e-3, "{degrees}°");
            assert!((fine(|_| 0.5).mean_cosine(towards(degrees)) - 2.0 / 3.0).abs() < 1e-6);
        }
    }

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
        assert_eq!(LadTable::read(&good, HELIOS, &mut d).unwrap().0.g(DVec3::Z), 0.25);
        assert!(d.items().is_empty());
        let bad = Source::of("l.lut", b"1,0,0,0.5\n1,0,0\nx,0,0,1\n1,1,1,1\n0,0,1,nan\n0,0,1,-1\n");
        assert!(LadTable::read(&bad, HELIOS, &mut d).is_none());
        assert_eq!(d.items().len(), 5);
        assert!(
            LadTable::read(&Source::of("l.lut", b"\n"), HELIOS, &mut d).is_none() && d.items().len() == 6
        );
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
