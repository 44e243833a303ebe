//! The height of level ground below a mesh that has none.

use crate::records::Kind;
use crate::store::{Result, Store};

/// Largest mesh and file of materials that are looked into, bytes.
const MAX_MESH: u64 = 16 << 20;
const MAX_MATERIALS: u64 = 1 << 20;
/// Most files of materials of a mesh that are looked into.
const MAX_LIBRARIES: usize = 16;

/// The lowest place, m, of a mesh (OBJ) of an upload that has no ground. `None` for other scenes.
///
/// # Errors
/// Errors of the store.
pub fn level(store: &Store, owner: &str, scene: &str) -> Result<Option<f64>> {
    let Some((name, path)) = scene.split_once('/').filter(|_| scene.to_ascii_lowercase().ends_with(".obj"))
    else {
        return Ok(None);
    };
    let Some(upload) = store.upload(owner, name)? else { return Ok(None) };
    let Some(bytes) = store.read(Kind::Upload, &upload.id, path, MAX_MESH)? else { return Ok(None) };
    let mesh = String::from_utf8_lossy(&bytes);
    let folder = path.rsplit_once('/').map_or(String::new(), |(folder, _)| format!("{folder}/"));
    for library in mesh.lines().filter_map(|line| line.strip_prefix("mtllib ")).take(MAX_LIBRARIES) {
        let materials =
            store.read(Kind::Upload, &upload.id, &format!("{folder}{}", library.trim()), MAX_MATERIALS)?;
        if materials.is_some_and(|materials| has_ground(&String::from_utf8_lossy(&materials))) {
            return Ok(None);
        }
    }
    Ok(lowest(&mesh))
}

/// True if a material is ground.
fn has_ground(materials: &str) -> bool {
    let mut words = materials.lines().map(str::split_whitespace);
    words.any(|mut line| {
        let is_key = line.next().is_some_and(|key| key.eq_ignore_ascii_case("helios_isGround"));
        is_key && line.next().is_some_and(|value| value.eq_ignore_ascii_case("true") || value == "1")
    })
}

/// The least height of the vertices of a mesh, rounded down to centimetres.
fn lowest(mesh: &str) -> Option<f64> {
    let vertices = mesh.lines().filter_map(|line| line.strip_prefix("v "));
    let heights = vertices.filter_map(|line| line.split_whitespace().nth(2)?.parse::<f64>().ok());
    let lowest = heights.filter(|height| height.is_finite()).fold(f64::INFINITY, f64::min);
    lowest.is_finite().then_some((lowest * 100.0).floor() / 100.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_lowest_vertex_is_level_ground() {
        assert_eq!(lowest("v 0 0 3.129\nvn 0 0 -9\nv 1 1 2.5\nf 1 2 3\n"), Some(2.5));
        assert_eq!(lowest("v 0 0 -0.001"), Some(-0.01));
        assert_eq!(lowest("v 0 0\nv a b c\n"), None);
    }

    #[test]
    fn materials_tell_ground() {
        assert!(has_ground("newmtl a\n  helios_isGround true\n"));
        assert!(!has_ground("newmtl a\nhelios_isGround false\n# helios_isGround true\n"));
    }
}
