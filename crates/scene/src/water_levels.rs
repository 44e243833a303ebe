//! Water that no beam can reach: surfaces below everything else of the scene in their area.

use super::builder::{Extent, SceneBuilder};
use super::optics::OpticsKind;
use vlscan_base::diag::{Diagnostics, Place};
use vlscan_base::quantity::number;
use vlscan_geom::Aabb;

/// The boxes of parts, those of water by themselves.
#[derive(Default)]
pub(super) struct WaterLevels {
    water: Vec<Water>,
    others: Vec<Aabb>,
}

/// A part whose triangles are the surface of water.
struct Water {
    id: String,
    place: Option<Place>,
    bounds: Aabb,
}

impl WaterLevels {
    /// Adds a part with this box, world frame; `extent` are its stored primitives.
    pub fn add(
        &mut self,
        scene: &SceneBuilder,
        (id, place): (&str, Option<&Place>),
        bounds: Aabb,
        extent: Option<&Extent>,
    ) {
        match extent.is_some_and(|extent| is_water(scene, extent)) {
            true => self.water.push(Water { id: id.to_owned(), place: place.cloned(), bounds }),
            false => self.others.push(bounds),
        }
    }

    /// Warns of water below all other parts in its area.
    pub fn report(&self, diagnostics: &mut Diagnostics) {
        for Water { id, place, bounds } in &self.water {
            let level = bounds.max.z;
            let overlaps = |other: &&Aabb| {
                let (low, high) = (other.min.max(bounds.min), other.max.min(bounds.max));
                low.x < high.x && low.y < high.y
            };
            let lowest = self.others.iter().filter(overlaps).map(|other| other.min.z);
            let lowest = lowest.fold(f64::INFINITY, f64::min);
            if lowest.is_finite() && level <= lowest {
                let (level, lowest) = (number(level), number(lowest));
                diagnostics
                    .warn(
                        place.clone(),
                        format!(
                            "the water of part \"{id}\" at z {level} m lies below everything else in its \
                             area, which begins at z {lowest} m"
                        ),
                    )
                    .help("beams meet water from above, and ground below it is its bottom: check the level");
            }
        }
    }
}

/// True if all primitives are triangles of water.
fn is_water(scene: &SceneBuilder, extent: &Extent) -> bool {
    let is_of_water = |surface: &u32| {
        let material = scene.surfaces[*surface as usize].material as usize;
        let optics = scene.library.materials.get(material).and_then(|material| material.optics);
        optics.is_some_and(|optics| matches!(optics.kind, OpticsKind::Water(_)))
    };
    let triangles = &scene.triangle_surfaces[extent.triangles.clone()];
    let others = [&extent.cubes, &extent.fields, &extent.grids];
    !triangles.is_empty() && others.iter().all(|range| range.is_empty()) && triangles.iter().all(is_of_water)
}
