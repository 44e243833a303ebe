//! Detection of parts in local coordinates next to parts on a projected grid, and of parts far from each
//! other on it.

use super::builder::SceneBuilder;
use vlscan_base::diag::Place;
use vlscan_base::quantity::metres;
use vlscan_geom::{Aabb, DVec3};

/// Distance from the origin up to which coordinates are taken as local, m.
const MAX_LOCAL: f64 = 20_000.0;
/// Distance from the origin from which coordinates count as grid coordinates, m.
const MIN_GRID: f64 = 100_000.0;
/// Distance of two parts on a grid from which one of them is misplaced, m.
const MAX_APART: f64 = 300_000.0;

/// A part and its box, world coordinates.
struct Framed {
    id: String,
    place: Option<Place>,
    bounds: Aabb,
}

/// The first part near the origin, and the first ones far from it.
#[derive(Default)]
pub(super) struct PartFrames {
    local: Option<Framed>,
    grid: Option<Framed>,
    /// The first part on the grid that is far from the first one there.
    stray: Option<Framed>,
}

impl PartFrames {
    pub fn add(&mut self, id: &str, place: Option<&Place>, bounds: Aabb) {
        let reach = |p: DVec3| p.x.abs().max(p.y.abs());
        let slot = match reach(bounds.min).max(reach(bounds.max)) {
            far if far <= MAX_LOCAL => &mut self.local,
            _ if reach(bounds.centre()) >= MIN_GRID => match &self.grid {
                Some(grid) if apart(grid.bounds.centre(), bounds.centre()) > MAX_APART => &mut self.stray,
                _ => &mut self.grid,
            },
            _ => return,
        };
        slot.get_or_insert_with(|| Framed { id: id.to_owned(), place: place.cloned(), bounds });
    }

    pub fn report(self, scene: &mut SceneBuilder) {
        if let (Some(grid), Some(stray)) = (&self.grid, &self.stray) {
            report_stray(grid, stray, scene);
        }
        let (Some(local), Some(grid)) = (self.local, self.grid) else { return };
        let (near, far) = (local.bounds.centre(), grid.bounds.centre());
        let message = format!(
            "part \"{}\" has local coordinates (about x {:.0}, y {:.0}), part \"{}\" those of a grid such as \
             UTM (about x {:.0}, y {:.0}): they are {} apart",
            local.id,
            near.x,
            near.y,
            grid.id,
            far.x,
            far.y,
            metres((far - near).length())
        );
        scene.diagnostics.warn(local.place.or(grid.place), message).help(
            "move the first to its position on the grid with a translate filter (offset = \
             easting;northing;height), or the second to the origin",
        );
    }
}

/// Horizontal distance, m.
fn apart(one: DVec3, other: DVec3) -> f64 {
    (one.x - other.x).hypot(one.y - other.y)
}

/// Warns of two parts of a grid that no scene spans.
fn report_stray(grid: &Framed, stray: &Framed, scene: &mut SceneBuilder) {
    let (here, there) = (grid.bounds.centre(), stray.bounds.centre());
    let message = format!(
        "part \"{}\" (about x {:.0}, y {:.0}) is {} from part \"{}\" (about x {:.0}, y {:.0})",
        stray.id,
        there.x,
        there.y,
        metres(apart(here, there)),
        grid.id,
        here.x,
        here.y
    );
    let swapped = |p: DVec3| DVec3::new(p.y, p.x, p.z);
    let of_stray = apart(here, swapped(there)) <= MAX_APART;
    let help = match (of_stray, apart(swapped(here), there) <= MAX_APART) {
        (true, _) => format!(
            "with x and y exchanged part \"{}\" would be beside it; x is the easting, y the northing",
            stray.id
        ),
        (_, true) => format!(
            "with x and y exchanged part \"{}\" would be beside it; x is the easting, y the northing",
            grid.id
        ),
        _ => "give all parts of a scene coordinates of one system".to_owned(),
    };
    scene.diagnostics.warn(stray.place.clone().or(grid.place.clone()), message).help(help);
}

#[cfg(test)]
mod tests {
    use crate::fixture::Fixture;
    use vlscan_geom::DVec3;

    const MESH: &str = "v 0 0 0\nv 10 0 0\nv 0 10 0\nf 1 2 3\n";

    #[test]
    fn parts_in_two_frames_are_reported() {
        let warnings = |offsets: &[DVec3]| {
            let mut f = Fixture::new();
            offsets.iter().for_each(|&offset| f.obj("a.obj", MESH).transform.offset = offset);
            let found = f.load().unwrap().1;
            found.items().iter().filter(|d| d.message.contains("local coordinates")).count()
        };
        let utm = DVec3::new(476_000.0, 5_429_000.0, 200.0);
        assert_eq!(warnings(&[utm, DVec3::ZERO]), 1);
        let swapped = DVec3::new(5_429_000.0, 476_000.0, 200.0);
        let stray = |offsets: &[DVec3]| {
            let mut f = Fixture::new();
            offsets.iter().for_each(|&offset| f.obj("a.obj", MESH).transform.offset = offset);
            let found = f.load().unwrap().1;
            found.items().iter().filter_map(|d| d.help.clone()).find(|help| help.contains("exchanged"))
        };
        assert!(stray(&[utm, utm, swapped]).is_some() && stray(&[swapped, utm]).is_some());
        assert_eq!(stray(&[utm, utm + DVec3::X * 200_000.0]), None);
        assert_eq!(warnings(&[utm, utm + DVec3::X]) + warnings(&[DVec3::ZERO, DVec3::X * 9000.0]), 0);
    }
}
