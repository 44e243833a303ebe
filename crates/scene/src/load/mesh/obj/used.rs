//! Materials that an OBJ file names, read without its geometry.

use super::library_files;
use crate::library::first_word;
use crate::material::DEFAULT;
use crate::mtl;
use crate::number::skip_blanks;
use crate::text::{Lines, Source, Words, operand};
use std::collections::{HashMap, HashSet};
use std::path::{Path, PathBuf};
use vlscan_base::columns::decoded;
use vlscan_base::diag::Diagnostics;
use vlscan_base::error::{Error, Result};
use vlscan_survey::MaterialDefinition;

/// Reads the materials that an OBJ file names, in the order of their first use, from the material files that
/// it names. Materials without a definition are left out. The geometry is not read.
///
/// # Errors
/// [`Error::Io`]; [`Error::Input`] with all problems of the material files.
pub fn obj_materials(path: &Path) -> Result<(Vec<MaterialDefinition>, Diagnostics)> {
    let read = Source::open(path).map_err(|e| Error::open(path, e))?;
    let other = read.with_other_line_ends();
    let source = other.as_ref().unwrap_or(&read);
    let names = ObjNames::of(source);
    let mut problems = Diagnostics::default();
    let mut definitions: Vec<MaterialDefinition> = Vec::new();
    for file in &names.files {
        // A file that cannot be read is a warning when the scene is loaded.
        if let Ok(library) = Source::open(file) {
            definitions.extend(mtl::read(&library, &mut problems));
        }
    }
    let problems = problems.finish(false)?;
    definitions.retain(|definition| definition.name != DEFAULT);
    let index = Index::of(&definitions);
    let mut is_taken = vec![false; definitions.len()];
    let mut found = Vec::new();
    for at in names.materials.iter().filter_map(|name| index.find(name)) {
        if !std::mem::replace(&mut is_taken[at], true) {
            found.push(definitions[at].clone());
        }
    }
    Ok((found, problems))
}

/// Names in an OBJ file, each once.
#[derive(Default)]
struct ObjNames {
    /// Materials of faces.
    materials: Vec<String>,
    /// Material files that exist.
    files: Vec<PathBuf>,
}

impl ObjNames {
    fn of(source: &Source) -> ObjNames {
        let folder = source.path().parent().unwrap_or(Path::new(""));
        let mut names = ObjNames::default();
        let mut seen = HashSet::new();
        for line in Lines::new(source.bytes(), true) {
            let mut words = Words::new(&line.text, skip_blanks(&line.text, 0));
            let Some((keyword @ (b"usemtl" | b"mtllib"), at)) = words.next() else { continue };
            let rest = &line.text[operand(&line.text, at.end)];
            if rest.is_empty() || !seen.insert((keyword == b"usemtl", rest.to_vec())) {
                continue;
            }
            if keyword == b"usemtl" {
                names.materials.push(mtl::name_of(rest));
            } else {
                names.files.extend(library_files(folder, &decoded(rest)).unwrap_or_default());
            }
        }
        names
    }
}

/// Indices of definitions by name; the first one of a name counts.
struct Index<'a> {
    by_name: HashMap<&'a str, usize>,
    by_first_word: HashMap<&'a str, usize>,
}

impl<'a> Index<'a> {
    fn of(definitions: &'a [MaterialDefinition]) -> Index<'a> {
        let (mut by_name, mut by_first_word) = (HashMap::new(), HashMap::new());
        for (at, definition) in definitions.iter().enumerate() {
            by_name.entry(definition.name.as_str()).or_insert(at);
            by_first_word.entry(first_word(&definition.name)).or_insert(at);
        }
        Index { by_name, by_first_word }
    }

    /// The definition of a name, else one with the same first word.
    fn find(&self, name: &str) -> Option<usize> {
        self.by_name.get(name).or_else(|| self.by_first_word.get(first_word(name))).copied()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fixture::Fixture;

    fn names_of(found: &[MaterialDefinition]) -> Vec<&str> {
        found.iter().map(|definition| definition.name.as_str()).collect()
    }

    #[test]
    fn materials_have_the_order_of_their_first_use() {
        let mut f = Fixture::new();
        f.file(
            "a b.mtl",
            "newmtl bark\nhelios_classification 4\nnewmtl leaf old\nnewmtl default\nnewmtl x\n",
        );
        f.file("c.mtl", "newmtl bark\nhelios_classification 9\nnewmtl soil\nhelios_isGround true\n");
        f.obj(
            "x.obj",
            "mtllib a b.mtl # both\nmtllib c.mtl none.mtl\nmtllib c.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl soil\n\
             f 1 2 3\nusemtl leaf\nf 1 2 3\nusemtl bark\nusemtl nowhere\nusemtl default\nusemtl soil\nf 1 2 3\n",
        );
        let (found, warnings) = obj_materials(&f.path().join("x.obj")).unwrap();
        assert_eq!(names_of(&found), ["soil", "leaf old", "bark"]);
        assert_eq!((found[0].is_ground, found[2].classification), (true, 4));
        assert!(warnings.items().is_empty(), "{}", warnings.text());
    }

    #[test]
    fn lines_may_end_in_carriage_returns_and_files_may_be_missing() {
        let mut f = Fixture::new();
        f.file("m.mtl", "newmtl a\n");
        f.obj("x.obj", "mtllib m.mtl\rusemtl a\rf 1 2 3\r");
        f.obj("y.obj", "mtllib none.mtl\nusemtl a\n");
        assert_eq!(names_of(&obj_materials(&f.path().join("x.obj")).unwrap().0), ["a"]);
        assert!(obj_materials(&f.path().join("y.obj")).unwrap().0.is_empty());
        assert!(matches!(obj_materials(&f.path().join("z.obj")), Err(Error::Io { .. } | Error::Input(_))));
    }

    #[test]
    fn a_value_that_cannot_be_read_is_an_error() {
        let mut f = Fixture::new();
        f.file("m.mtl", "newmtl a\nhelios_reflectance much\n");
        f.obj("x.obj", "mtllib m.mtl\nusemtl a\n");
        assert!(matches!(obj_materials(&f.path().join("x.obj")), Err(Error::Input(_))));
    }
}
