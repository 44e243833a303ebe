//! Loads meshes in memory.

use crate::builder::{PartSource, SceneBuilder};
use crate::library::DefinedBy;
use crate::material::DEFAULT;
use std::collections::BTreeSet;
use std::path::Path;
use std::sync::Arc;
use vlscan_base::error::Result;
use vlscan_base::quantity::counted;
use vlscan_geom::DVec3;
use vlscan_survey::{Mesh, MeshColours};

/// Appends the triangles of a mesh to the scene. Triangles without area are left out and counted in a
/// warning.
pub(crate) fn load(scene: &mut SceneBuilder, part: &PartSource, mesh: &Arc<Mesh>) -> Result<()> {
    let materials: Vec<u32> = match mesh.materials() {
        [] => vec![scene.library.unnamed(DEFAULT)],
        all => {
            let by = DefinedBy::Memory(mesh.identity());
            scene.library.of(by, || all.to_vec(), &mut scene.diagnostics)
        }
    };
    load_with(scene, part, mesh, materials, &[])
}

/// [`load`] with materials of the scene in place of those of the mesh, in its order. `face_of` is the face of
/// each triangle, from 0; without it each triangle is a face.
pub(crate) fn load_with(
    scene: &mut SceneBuilder,
    part: &PartSource,
    mesh: &Mesh,
    materials: Vec<u32>,
    face_of: &[u32],
) -> Result<()> {
    let start = scene.end();
    let (vertices, triangles) = (mesh.vertices(), mesh.triangles());
    scene.reserve(vertices.len(), triangles.len(), 0, Path::new("a mesh in memory"))?;
    let surfaces: Vec<u32> = materials.iter().map(|&material| scene.surface(part.index, material)).collect();
    let has_area = |t: &[u32; 3]| {
        let [a, b, c] = t.map(|v| vertices[v as usize]);
        (b - a).cross(c - a) != DVec3::ZERO
    };
    scene.geometry.vertices.extend_from_slice(vertices);
    let textured: Vec<bool> = materials.iter().map(|&material| scene.has_texture(material)).collect();
    let mut untextured = BTreeSet::new();
    let first_face = scene.faces.count;
    scene.faces.count += face_of.last().map_or(triangles.len(), |last| *last as usize + 1);
    let mut colours = MeshColours::default();
    let mut without_area = 0_usize;
    for (i, triangle) in triangles.iter().enumerate() {
        if !has_area(triangle) {
            without_area += 1;
            continue;
        }
        if scene.faces.are_requested {
            let face = face_of.get(i).map_or(i, |&face| face as usize);
            scene.faces.of_triangles.push((first_face + face) as u32);
        }
        scene.geometry.triangles.push(*triangle);
        let material = mesh.material_of().get(i).map_or(0, |&m| m as usize);
        scene.triangle_surfaces.push(surfaces[material]);
        if scene.options.colours {
            let texels = mesh.colours().texels.get(i);
            if textured[material] && texels.is_none_or(|texels| texels.iter().flatten().any(|t| t.is_nan())) {
                untextured.insert(material);
            }
            colours.texels.extend(texels);
            colours.tints.extend(mesh.colours().tints.get(i));
        }
    }
    if without_area > 0 {
        let message = format!("left out: {} without area", counted(without_area, "triangle"));
        scene.diagnostics.warn(part.place.cloned(), message);
    }
    for material in untextured.into_iter().filter_map(|number: usize| mesh.materials().get(number)) {
        let place = material.place.clone().or(part.place.cloned());
        let message = format!(
            "the material \"{}\" has a texture, which triangles without texture coordinates do not show",
            material.name
        );
        scene.diagnostics.warn(place, message);
    }
    scene.finish_mesh(&start)?;
    scene.add_colours(start.triangles.start, colours);
    Ok(())
}
