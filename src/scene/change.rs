//! Replaces materials of a part after its files are loaded.

use super::builder::{Extent, SceneBuilder};
use crate::survey::{MaterialChange, Replaced};
use std::sync::Arc;

/// Applies the changes in their order to the primitives of `extent`, which are those of part `part`.
pub(super) fn apply(scene: &mut SceneBuilder, part: u32, changes: &Arc<[MaterialChange]>, extent: &Extent) {
    if changes.is_empty() {
        return;
    }
    let definitions = || changes.iter().map(|change| change.material.clone()).collect();
    let address = Arc::as_ptr(changes).cast::<u8>() as usize;
    let materials = scene.library.of_definitions(address, definitions, &mut scene.diagnostics);
    let triangles = extent.triangles.len();
    for (change, material) in changes.iter().zip(materials) {
        let surface = scene.surface(part, material);
        let (triangle_surfaces, cube_surfaces) = (
            &mut scene.triangle_surfaces[extent.triangles.clone()],
            &mut scene.cube_surfaces[extent.cubes.clone()],
        );
        match &change.replaced {
            Replaced::All => {
                triangle_surfaces.fill(surface);
                cube_surfaces.fill(surface);
            }
            Replaced::Named(name) => {
                let (surfaces, library) = (&scene.surfaces, &scene.library);
                let is_named =
                    |s: u32| library.materials[surfaces[s as usize].material as usize].name == *name;
                let all = triangle_surfaces.iter_mut().chain(cube_surfaces);
                all.filter(|own| is_named(**own)).for_each(|own| *own = surface);
            }
            Replaced::Primitives(indices) => {
                for &i in indices {
                    let own = match (i as usize).checked_sub(triangles) {
                        None => triangle_surfaces.get_mut(i as usize),
                        Some(cube) => cube_surfaces.get_mut(cube),
                    };
                    own.map(|own| *own = surface).unwrap_or_default();
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::fixture::Fixture;
    use crate::survey::MaterialDefinition;

    #[test]
    fn materials_are_replaced_by_name_and_by_primitive() {
        let mut f = Fixture::new();
        f.file("m.mtl", "newmtl bark\nhelios_classification 1\nnewmtl leaf\nhelios_classification 2\n");
        let part = f.obj(
            "a.obj",
            "mtllib m.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nusemtl bark\nf 1 2 3\nf 1 2 4\nusemtl leaf\nf 1 3 4\n",
        );
        let change = |replaced, classification| MaterialChange {
            replaced,
            material: MaterialDefinition { classification, ..MaterialDefinition::new("new") },
        };
        let classes = |changes: Vec<MaterialChange>, f: &mut Fixture| {
            f.parts[0].changes = changes.into();
            let (scene, _) = f.load().unwrap();
            (0..3).map(|i| scene.material_of(i).classification).collect::<Vec<_>>()
        };
        part.id = Some("tree".to_owned());
        assert_eq!(classes(vec![], &mut f), [1, 1, 2]);
        assert_eq!(classes(vec![change(Replaced::Named("bark".to_owned()), 7)], &mut f), [7, 7, 2]);
        let second = change(Replaced::Primitives(vec![1, 9]), 8);
        assert_eq!(classes(vec![change(Replaced::All, 7), second], &mut f), [7, 8, 7]);
    }
}
