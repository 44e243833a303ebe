//! Points divided among files by position or by object, instead of by leg.

use vlscan_formats::ObjectIds;
use vlscan_geom::{Aabb, DVec3};
use vlscan_lidar::pulse::Echo;

/// Files that a division can have at most.
pub(super) const MAX_FILES: usize = 10_000;

/// Margin of the tiles around the scene, m: the first of these with at most [`MAX_FILES`] files. Errors of
/// range and navigation move points away from the surfaces that they come from.
const MARGINS_M: [f64; 3] = [25.0, 5.0, 1.0];

/// How points are divided among the files of a folder.
#[derive(Clone, Debug, PartialEq)]
pub enum Division {
    /// Squares of this edge length, m, from multiples of it on, in world coordinates: `tile_X_Y`, named by
    /// their lower left corners.
    Tiles(f64),
    /// A file per part of the scene: `object_N`, with the number of the object in the points.
    Objects,
}

/// Area in which points are kept: within a polygon, world coordinates, m; its last corner is joined to the
/// first one.
pub type Ring = Vec<[f64; 2]>;

/// A division of the points of a scene.
#[derive(Clone, Debug)]
pub(super) struct Divider {
    kind: Kind,
    /// Names of the files without extension.
    pub names: Vec<String>,
}

/// A division into this number of files, which is not from 1 to [`MAX_FILES`].
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[error("{files} files are too many, at most {max} are written", files = shown(*.0), max = MAX_FILES)]
pub(super) struct TooManyFiles(f64);

/// A number of files, for messages.
fn shown(count: f64) -> String {
    if count < 1e9 { format!("{count:.0}") } else { format!("{count:e}") }
}

#[derive(Clone, Debug)]
enum Kind {
    Tiles {
        size: f64,
        first: [i64; 2],
        columns: usize,
    },
    /// Index of the file by part.
    Objects(Vec<usize>),
}

impl Divider {
    /// # Errors
    /// Divisions into too many files.
    pub fn new(
        division: &Division,
        bounds: &Aabb,
        shift: DVec3,
        parts: &ObjectIds,
    ) -> Result<Divider, TooManyFiles> {
        match division {
            Division::Tiles(size) => {
                let world = bounds.translated(shift);
                let cell = |value: f64| (value / size).floor();
                let grid = |margin: f64| {
                    let first = [world.min.x, world.min.y].map(|v| cell(v - margin));
                    let last = [world.max.x, world.max.y].map(|v| cell(v + margin));
                    (first, [last[0] - first[0] + 1.0, last[1] - first[1] + 1.0])
                };
                let grids = MARGINS_M.map(grid);
                let fits = |counts: &[f64; 2]| (1.0..=MAX_FILES as f64).contains(&(counts[0] * counts[1]));
                let Some((first, counts)) = grids.into_iter().find(|(_, counts)| fits(counts)) else {
                    let [_, _, (_, least)] = grids;
                    return Err(TooManyFiles(least[0] * least[1]));
                };
                let first = first.map(|v| v as i64);
                let (columns, rows) = (counts[0] as usize, counts[1] as usize);
                let corner = |index: i64| {
                    let metres = index as f64 * size;
                    if metres.fract() == 0.0 { format!("{metres:.0}") } else { format!("{metres:.2}") }
                };
                let names = (0..columns * rows)
                    .map(|i| {
                        let (x, y) = (first[0] + (i % columns) as i64, first[1] + (i / columns) as i64);
                        format!("tile_{}_{}", corner(x), corner(y))
                    })
                    .collect();
                Ok(Divider { kind: Kind::Tiles { size: *size, first, columns }, names })
            }
            Division::Objects => {
                let mut numbers: Vec<i32> = Vec::new();
                let mut of_part = Vec::with_capacity(parts.count());
                let mut known = std::collections::BTreeMap::new();
                for part in 0..parts.count() as u32 {
                    let number = parts.of_part(part);
                    of_part.push(*known.entry(number).or_insert_with(|| {
                        numbers.push(number);
                        numbers.len() - 1
                    }));
                }
                if numbers.len() > MAX_FILES {
                    return Err(TooManyFiles(numbers.len() as f64));
                }
                let names = numbers.iter().map(|number| format!("object_{number}")).collect();
                Ok(Divider { kind: Kind::Objects(of_part), names })
            }
        }
    }

    /// Index of the file of an echo; `None` for echoes beyond the scene and those of no part. `shift` is the
    /// position of the scene frame's origin.
    pub fn file_of(&self, echo: &Echo, shift: DVec3) -> Option<usize> {
        match &self.kind {
            Kind::Tiles { size, first, columns } => {
                let at = echo.position + shift;
                let column = usize::try_from((at.x / size).floor() as i64 - first[0]).ok()?;
                let row = usize::try_from((at.y / size).floor() as i64 - first[1]).ok()?;
                let index = row * columns + column;
                (column < *columns && index < self.names.len()).then_some(index)
            }
            Kind::Objects(of_part) => of_part.get(echo.part as usize).copied(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tiles_begin_at_multiples_of_their_size() {
        let bounds = Aabb { min: DVec3::new(-15.0, -5.0, 0.0), max: DVec3::new(15.0, 14.0, 9.0) };
        let shift = DVec3::new(1000.0, 0.0, 0.0);
        let divider = Divider::new(&Division::Tiles(10.0), &bounds, shift, &ObjectIds::default()).unwrap();
        let name = |x: f64, y: f64| {
            let echo = Echo { position: DVec3::new(x, y, 1.0), ..crate::output::testing::echo(1, 1) };
            divider.file_of(&echo, shift).map(|i| divider.names[i].as_str())
        };
        assert_eq!(name(-15.0, -5.0), Some("tile_980_-10"));
        assert_eq!(name(0.0, 0.0), Some("tile_1000_0"));
        // Errors of navigation move points out of the scene.
        assert_eq!(name(-38.0, 36.0), Some("tile_960_30"));
        assert_eq!((name(500.0, 0.0), name(0.0, -500.0)), (None, None));
        // A smaller margin where the large one takes too many files.
        let small = Divider::new(&Division::Tiles(0.5), &bounds, shift, &ObjectIds::default()).unwrap();
        assert!(small.names.len() <= MAX_FILES && small.names.iter().any(|name| name == "tile_980_-10"));
        let most = Divider::new(&Division::Tiles(1e-200), &bounds, shift, &ObjectIds::default()).unwrap_err();
        assert!(most.to_string().len() < 80, "{most}");
        let many = Divider::new(&Division::Tiles(1e-3), &bounds, shift, &ObjectIds::default());
        assert!(matches!(many, Err(TooManyFiles(count)) if count > MAX_FILES as f64));
        let message = TooManyFiles(2.5e12).to_string();
        assert_eq!(message, "2.5e12 files are too many, at most 10000 are written");
    }
}
