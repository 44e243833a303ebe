//! Table of the scene's parts, next to labelled points.

use crate::output::ObjectIds;
use std::fmt::Write as _;
use vlscan_base::columns::quoted;
use vlscan_base::error::Result;
use vlscan_scene::{PartFacts, Scene};

/// The facts of a scene's parts, kept while later epochs are loaded.
pub struct PartTable {
    rows: Vec<Row>,
}

struct Row {
    /// Number as object of LAS and PLY.
    object: i32,
    /// Everything between number and count of points.
    facts: String,
}

const HEADING: &str = "object,part,id,name,class,materials,areas,leaf_area,x,y,z,height,points";

impl PartTable {
    /// The table of a scene.
    ///
    /// # Errors
    /// When a tile of the scene has to be loaded for it, and cannot be.
    pub fn new(scene: &Scene) -> Result<PartTable> {
        let ids: Vec<String> = scene.parts.iter().map(|part| part.id.clone()).collect();
        let objects = ObjectIds::new(&ids);
        let row = |(index, (part, facts)): (u32, (&vlscan_scene::Part, &PartFacts))| {
            let materials = facts.material_names(scene).join(" ");
            let mut text = format!("{index},{},{},", quoted(&part.id), quoted(&part.name));
            let areas: Vec<String> = facts.areas.iter().map(|area| format!("{:.6}", area.total())).collect();
            let _ = write!(text, "{},{},", facts.class(scene), quoted(&materials));
            let leaves = facts.leaf_area(scene).map(|area| format!("{area:.6}")).unwrap_or_default();
            let _ = write!(text, "{},{leaves},", areas.join(" "));
            let (low, centre, size) = (facts.bounds.min, facts.bounds.centre(), facts.bounds.size());
            let _ = match facts.primitives {
                0 => write!(text, ",,,"),
                _ => write!(text, "{:.3},{:.3},{:.3},{:.3}", centre.x, centre.y, low.z, size.z),
            };
            Row { object: objects.of_part(index), facts: text }
        };
        let facts = PartFacts::of_scene(scene);
        scene.tiles.as_ref().map_or(Ok(()), |tiles| tiles.check())?;
        Ok(PartTable { rows: (0..).zip(scene.parts.iter().zip(&facts)).map(row).collect() })
    }

    /// The table as CSV with the number of points of each part.
    pub fn csv(&self, points: &[u64]) -> String {
        let mut text = format!("{HEADING}\n");
        for (index, Row { object, facts }) in self.rows.iter().enumerate() {
            let count = points.get(index).copied().unwrap_or(0);
            let _ = writeln!(text, "{object},{facts},{count}");
        }
        text
    }
}
