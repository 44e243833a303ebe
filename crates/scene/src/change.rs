//! Replaces materials of a part after its files are loaded, and finds changes that replace nothing.

use super::builder::{Extent, PartSource, SceneBuilder};
use super::grid_voxels::GridSurfaces;
use super::library::DefinedBy;
use super::text::printable;
use std::collections::{BTreeMap, BTreeSet};
use vlscan_base::diag::{Place, ProblemKind};
use vlscan_survey::{Identity, MaterialChanges, MaterialDefinition, Replaced};

/// The changes of the parts loaded so far: several parts can have the same, as those of one glTF file.
#[derive(Default)]
pub(super) struct AppliedChanges {
    /// Changes of materials by their names, by the identity of the changes and their number there.
    named: BTreeMap<(Identity, usize), NamedChange>,
    /// Changes of all materials, likewise.
    whole: BTreeMap<(Identity, usize), WholeChange>,
}

/// A change of all materials of a part that a file states.
struct WholeChange {
    name: String,
    place: Option<Place>,
    /// True if a material that is replaced has the name of the new one.
    has_own_name: bool,
    /// Another name of a material that is replaced.
    other: Option<String>,
}

struct NamedChange {
    name: String,
    /// Index of the first part with the change.
    part: u32,
    place: Option<Place>,
    has_replaced: bool,
    /// Names of materials that are not the one to be replaced.
    others: BTreeSet<String>,
}

/// Names of materials that a warning lists.
const MAX_NAMES: usize = 5;

impl AppliedChanges {
    /// The change of materials called `name`, number `number` of the changes of this identity.
    fn named(&mut self, key: (Identity, usize), name: &str, part: &PartSource) -> &mut NamedChange {
        self.named.entry(key).or_insert_with(|| NamedChange {
            name: name.to_owned(),
            part: part.index,
            place: part.place.cloned(),
            has_replaced: false,
            others: BTreeSet::new(),
        })
    }

    /// Records that a change of all materials replaces those called `names`.
    fn replace_all<'n>(
        &mut self,
        key: (Identity, usize),
        material: &MaterialDefinition,
        names: impl Iterator<Item = &'n str>,
    ) {
        // Programs name their materials as they like.
        if !material.has_line() {
            return;
        }
        let applied = self.whole.entry(key).or_insert_with(|| WholeChange {
            name: material.name.clone(),
            place: material.place.clone(),
            has_own_name: false,
            other: None,
        });
        for name in names {
            if name == applied.name {
                applied.has_own_name = true;
            } else if applied.other.is_none() {
                applied.other = Some(name.to_owned());
            }
        }
    }
}

impl NamedChange {
    /// True if the change replaces a material of this name. Records it for [`report_unused`].
    fn replaces(&mut self, name: &str) -> bool {
        if name == self.name {
            self.has_replaced = true;
            return true;
        }
        if self.others.len() <= MAX_NAMES && !self.others.contains(name) {
            self.others.insert(name.to_owned());
        }
        false
    }
}

/// Warns of changes that replace nothing in any of their parts, and of those that replace all materials
/// although they have the name of one.
pub(super) fn report_unused(scene: &mut SceneBuilder) {
    let AppliedChanges { named, whole } = std::mem::take(&mut scene.changes);
    for WholeChange { name, place, has_own_name, other } in whole.into_values() {
        if let Some(other) = other.filter(|_| has_own_name) {
            let (name, other) = (printable(&name), printable(&other));
            let message =
                format!("this replaces all materials of the part, \"{other}\" too, not only \"{name}\"");
            scene.diagnostics.warn(place, message).help(format!("`of = \"{name}\"` replaces that one alone"));
        }
    }
    let mut unused: Vec<NamedChange> =
        named.into_values().filter(|change| !change.has_replaced && !change.others.is_empty()).collect();
    unused.sort_by_key(|change| change.part);
    for change in unused {
        let there_are: Vec<String> =
            change.others.iter().take(MAX_NAMES).map(|n| format!("\"{n}\"")).collect();
        let more = if change.others.len() > MAX_NAMES { " and more" } else { "" };
        let message = format!(
            "no primitive of the part has the material \"{}\", so nothing is replaced; its materials are \
             {}{more}",
            printable(&change.name),
            there_are.join(", ")
        );
        scene.diagnostics.warn(change.place, message);
    }
}

impl SceneBuilder<'_> {
    /// True if a change of the part that is being loaded replaces the materials of this name, which then need
    /// no definition.
    pub fn replaces_material(&self, name: &str) -> bool {
        self.part_changes.iter().any(|change| match &change.replaced {
            Replaced::All => true,
            Replaced::Named(replaced) => replaced == name,
            Replaced::Faces(_) => false,
        })
    }
}

/// The material of each change.
fn replacements(scene: &mut SceneBuilder, identity: Identity, changes: &MaterialChanges) -> Vec<u32> {
    let definitions = || changes.iter().map(|change| change.material.clone()).collect();
    scene.library.of(DefinedBy::Memory(identity), definitions, &mut scene.diagnostics)
}

/// The material of primitives of `part` that have `material` before its changes. Adds the surfaces that
/// [`apply`] would add, so that a scene has the same surfaces if the primitives are not in memory. Changes of
/// faces are not applied.
pub(super) fn material_of(
    scene: &mut SceneBuilder,
    part: &PartSource,
    changes: &MaterialChanges,
    material: u32,
) -> u32 {
    scene.surface(part.index, material);
    let Some(identity) = changes.identity() else { return material };
    let mut current = material;
    let materials = replacements(scene, identity, changes);
    for (number, (change, replacement)) in changes.iter().zip(materials).enumerate() {
        scene.surface(part.index, replacement);
        let is_replaced = match &change.replaced {
            Replaced::All => {
                let found = &scene.library.materials[current as usize].name;
                let names = std::iter::once(found.as_str());
                scene.changes.replace_all((identity, number), &change.material, names);
                true
            }
            Replaced::Named(name) => {
                let found = &scene.library.materials[current as usize].name;
                scene.changes.named((identity, number), name, part).replaces(found)
            }
            Replaced::Faces(_) => false,
        };
        if is_replaced {
            current = replacement;
        }
    }
    current
}

/// Applies the changes in their order to the primitives of `extent`, which are those of `part`. An index
/// beyond them is an error.
pub(super) fn apply(scene: &mut SceneBuilder, part: &PartSource, changes: &MaterialChanges, extent: &Extent) {
    let Some(identity) = changes.identity() else { return };
    let materials = replacements(scene, identity, changes);
    let faces = &mut scene.faces;
    if faces.are_requested && faces.count == 0 {
        // The triangles of rasters and voxels have no numbers.
        faces.count = extent.triangles.len();
        faces.of_triangles = (0..faces.count as u32).collect();
    }
    for (number, (change, material)) in changes.iter().zip(materials).enumerate() {
        let surface = scene.surface(part.index, material);
        let (triangle_surfaces, field_surfaces, cube_surfaces, grids) = (
            &mut scene.triangle_surfaces[extent.triangles.clone()],
            &mut scene.field_surfaces[extent.fields.clone()],
            &mut scene.cube_surfaces[extent.cubes.clone()],
            &mut scene.grid_voxels[extent.grids.clone()],
        );
        match &change.replaced {
            Replaced::All => {
                let (surfaces, materials) = (&scene.surfaces, &scene.library.materials);
                let stored = triangle_surfaces.iter().chain(&*field_surfaces).chain(&*cube_surfaces);
                let mut last = u32::MAX;
                let names = stored
                    .filter(|own| std::mem::replace(&mut last, **own) != **own)
                    .map(|own| materials[surfaces[*own as usize].material as usize].name.as_str());
                scene.changes.replace_all((identity, number), &change.material, names);
                triangle_surfaces.fill(surface);
                field_surfaces.fill(surface);
                cube_surfaces.fill(surface);
                grids.iter_mut().for_each(|voxels| voxels.surfaces = GridSurfaces::InTurn(vec![surface]));
            }
            Replaced::Named(name) => {
                let (surfaces, materials) = (&scene.surfaces, &scene.library.materials);
                let applied = scene.changes.named((identity, number), name, part);
                let mut replaced = |own: u32| {
                    let found = &materials[surfaces[own as usize].material as usize].name;
                    if applied.replaces(found) { surface } else { own }
                };
                let stored = triangle_surfaces.iter_mut().chain(field_surfaces).chain(cube_surfaces);
                stored.for_each(|own| *own = replaced(*own));
                grids.iter_mut().for_each(|voxels| voxels.surfaces.replace(&mut replaced));
            }
            Replaced::Faces(indices) => {
                let (faces, count) = (scene.faces.count, scene.faces.count + cube_surfaces.len());
                let mut is_chosen = vec![false; count];
                for &i in indices {
                    let Some(face) = is_chosen.get_mut(i as usize) else {
                        if !scene.diagnostics.is_fatal(false) {
                            let message = format!(
                                "a material is for face {i}, but the part has {count}, counted from 0"
                            );
                            let problem = scene.diagnostics.error(part.place.cloned(), message);
                            problem.of_kind(ProblemKind::MissingEntry);
                        }
                        break;
                    };
                    *face = true;
                }
                for (own, &face) in triangle_surfaces.iter_mut().zip(&scene.faces.of_triangles) {
                    if is_chosen[face as usize] {
                        *own = surface;
                    }
                }
                for (own, chosen) in cube_surfaces.iter_mut().zip(&is_chosen[faces..]) {
                    if *chosen {
                        *own = surface;
                    }
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fixture::Fixture;
    use crate::library::Library;
    use crate::spectra::Spectra;
    use vlscan_base::error::Error;
    use vlscan_survey::{MaterialChange, MaterialDefinition};

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
        let second = change(Replaced::Faces(vec![1]), 8);
        assert_eq!(classes(vec![change(Replaced::All, 7), second], &mut f), [7, 8, 7]);

        // What replaces nothing is said; a material is enough in one of the parts with the same changes.
        f.obj("b.obj", "mtllib m.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl bark\nf 1 2 3\n");
        let named = |name: &str| change(Replaced::Named(name.to_owned()), 7);
        let mut warnings = |changes: Vec<MaterialChange>| {
            f.parts[0].changes = changes.into();
            f.parts[1].changes = f.parts[0].changes.clone();
            f.load().unwrap().1.text()
        };
        let found = warnings(vec![named("leaf")]);
        assert!(!found.contains("replaced"), "{found}");
        let found = warnings(vec![named("nosuch")]);
        let expected =
            "the material \"nosuch\", so nothing is replaced; its materials are \"bark\", \"leaf\"\n";
        assert!(found.contains(expected) && found.matches("nosuch").count() == 1, "{found}");
    }

    #[test]
    fn a_material_that_is_called_as_one_of_those_that_it_replaces_is_a_warning() {
        let mut f = Fixture::new();
        f.file("m.mtl", "newmtl wall\nhelios_reflectance 0.1\nnewmtl glass\nhelios_reflectance 0.2\n");
        let mesh = "mtllib m.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nusemtl wall\nf 1 2 3\n";
        f.obj("a.obj", format!("{mesh}usemtl glass\nf 1 3 4\n"));
        let place = Place { line: 3, ..Place::of_file(std::path::Path::new("p.toml")) };
        let mut said = |replaced: Replaced, name: &str, place: Option<&Place>| {
            let material = MaterialDefinition {
                reflectance: Some(0.3),
                place: place.cloned(),
                ..MaterialDefinition::new(name)
            };
            f.parts[0].changes = vec![MaterialChange { replaced, material }].into();
            f.load().unwrap().1.text()
        };
        let found = said(Replaced::All, "glass", Some(&place));
        let expected = "this replaces all materials of the part, \"wall\" too, not only \"glass\"";
        assert!(found.contains(expected) && found.contains("`of = \"glass\"`"), "{found}");
        for found in [
            said(Replaced::All, "paint", Some(&place)),
            said(Replaced::All, "glass", None),
            said(Replaced::Named("glass".to_owned()), "glass", Some(&place)),
        ] {
            assert!(!found.contains("replaces all"), "{found}");
        }
    }

    #[test]
    fn the_changed_material_is_known_without_primitives() {
        let options = crate::LoadOptions::default();
        let mut scene =
            SceneBuilder::new(&options, Library::new(Spectra::new(&[], [1064.0]), options.rules, 0));
        let part = PartSource { index: 0, place: None };
        let change =
            |replaced, name: &str| MaterialChange { replaced, material: MaterialDefinition::new(name) };
        let named = |name: &str| Replaced::Named(name.to_owned());
        let own = MaterialChanges::from(vec![change(Replaced::All, "own")]);
        let own = material_of(&mut scene, &part, &own, 0);
        let mut name_after = |changes: Vec<MaterialChange>| {
            let material = material_of(&mut scene, &part, &changes.into(), own);
            scene.library.materials[material as usize].name.clone()
        };
        assert_eq!(name_after(vec![]), "own");
        assert_eq!(name_after(vec![change(named("own"), "a"), change(named("a"), "b")]), "b");
        assert_eq!(
            name_after(vec![change(named("other"), "a"), change(Replaced::Faces(vec![0]), "b")]),
            "own"
        );
        assert_eq!(name_after(vec![change(named("own"), "a"), change(Replaced::All, "b")]), "b");
        report_unused(&mut scene);
        let warnings = scene.diagnostics.text();
        assert!(
            warnings.contains("\"other\", so nothing is replaced; its materials are \"own\""),
            "{warnings}"
        );
    }

    #[test]
    fn only_materials_in_use_have_units() {
        let mut f = Fixture::new();
        f.file("m.mtl", "newmtl bark\nhelios_reflectance 0.4\nnewmtl leaf\nhelios_reflectance 45\n");
        let mesh = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\n";
        f.obj("a.obj", format!("mtllib m.mtl\n{mesh}usemtl bark\nf 1 2 3\nusemtl leaf\nf 1 2 4\n"));
        f.obj("b.obj", format!("{mesh}f 1 2 3\nf 1 2 4\n"));
        let new = MaterialDefinition { reflectance: Some(0.3), ..MaterialDefinition::new("new") };
        let mut two_units = |of_first, of_second| {
            let change = |replaced| MaterialChange { replaced, material: new.clone() };
            f.parts[0].changes = vec![change(of_first)].into();
            f.parts[1].changes = vec![change(of_second)].into();
            let said = f.load().unwrap().1.text();
            said.lines().find(|line| line.contains("are in two units")).map(str::to_owned)
        };
        let leaf = || Replaced::Named("leaf".to_owned());
        assert_eq!(two_units(leaf(), Replaced::All), None);
        assert_eq!(two_units(Replaced::All, Replaced::All), None);
        let said = two_units(leaf(), Replaced::Faces(vec![0])).expect("the default");
        assert!(said.contains("\"default\" 50") && !said.contains("leaf"), "{said}");
        let said = two_units(Replaced::Faces(vec![0]), Replaced::All).expect("leaves");
        assert!(
            said.contains("\"leaf\" 45") && !said.contains("default") && !said.contains("bark"),
            "{said}"
        );
    }

    #[test]
    fn indices_count_triangles_that_are_left_out() {
        let mut f = Fixture::new();
        let part = f.obj("a.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 1 2\nf 1 2 3\nf 1 2 2\nf 1 3 4\n");
        part.id = Some("tree".to_owned());
        for (index, expected) in [(0, [0, 0]), (1, [8, 0]), (2, [0, 0]), (3, [0, 8])] {
            let material = MaterialDefinition { classification: 8, ..MaterialDefinition::new("new") };
            f.parts[0].changes =
                vec![MaterialChange { replaced: Replaced::Faces(vec![index]), material }].into();
            let (scene, _) = f.load().unwrap();
            assert_eq!([0, 1].map(|i| scene.material_of(i).classification), expected, "{index}");
        }
        let material = MaterialDefinition::new("new");
        f.parts[0].changes = vec![MaterialChange { replaced: Replaced::Faces(vec![2, 4]), material }].into();
        let error = f.load().unwrap_err();
        assert!(error.to_string().contains("face 4, but the part has 4"), "{error}");
        assert!(matches!(error, Error::Input(problems) if problems.has(ProblemKind::MissingEntry)));
    }

    #[test]
    fn indices_count_the_faces_of_the_file() {
        let vertices = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [2, 0, 0], [2, 1, 0]];
        let text = |v: [i32; 3]| v.map(|c| c.to_string()).join(" ");
        let obj: String = vertices.iter().map(|v| format!("v {}\n", text(*v))).collect();
        let ply: String = vertices.iter().map(|v| format!("{}\n", text(*v))).collect();
        let obj = format!("{obj}f 1 2 3 4\nf 1 1 2\nf 2 5 6 3\nf 1 2 5 6 4\nf 1 2 3\n");
        let ply = format!(
            "ply\nformat ascii 1.0\nelement vertex 6\nproperty float x\nproperty float y\nproperty float z\n\
             element face 5\nproperty list uchar int vertex_indices\nend_header\n\
             {ply}4 0 1 2 3\n3 0 0 1\n4 1 4 5 2\n5 0 1 4 5 3\n3 0 1 2\n"
        );
        for (name, content) in [("a.obj", obj), ("a.ply", ply)] {
            let mut f = Fixture::new();
            f.obj(name, &content);
            // One triangle of face 3 has no area.
            for (index, expected) in
                [(0, vec![0, 1]), (1, vec![]), (2, vec![2, 3]), (3, vec![4, 5]), (4, vec![6])]
            {
                let material = MaterialDefinition { classification: 8, ..MaterialDefinition::new("new") };
                f.parts[0].changes =
                    vec![MaterialChange { replaced: Replaced::Faces(vec![index]), material }].into();
                let (scene, _) = f.load().unwrap();
                let changed = (0..7).filter(|&i| scene.material_of(i).classification == 8);
                assert_eq!(changed.collect::<Vec<_>>(), expected, "{name} {index}");
            }
        }
    }
}
