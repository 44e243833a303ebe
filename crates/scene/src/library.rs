//! Resolves material definitions to the scene's materials (spec pulse-physics §3.2, input-formats §3.5 and
//! §5).

mod resolve;

use super::material::{DEFAULT, Material};
use super::mtl;
use super::reflectance_issues::{ReflectanceIssue, ReflectanceIssues, assumed};
use super::reflectance_units::ReflectanceUnits;
use super::spectra::Spectra;
use super::text::Source;
use resolve::reflection;
use std::collections::HashMap;
use std::collections::hash_map::Entry;
use std::path::{Path, PathBuf};
use vlscan_base::corrections::Corrections;
use vlscan_base::diag::{Diagnostics, Place};
use vlscan_base::rng::{Purpose, Stream};
use vlscan_survey::{ColourDefinition, Identity, MaterialChoice, MaterialDefinition};

/// Maximum number of randomised variants of one material.
const MAX_VARIANTS: u32 = 10_000;

/// The materials of a scene and the files that define them. A material is resolved at its first use by a
/// primitive.
#[derive(Clone)]
pub(super) struct Library {
    spectra: Spectra,
    rules: Corrections,
    /// Rules that change some material.
    pub relevant_rules: Corrections,
    /// Reflectances that are missing or not fractions.
    pub issues: ReflectanceIssues,
    /// All reflectances, whose units should be alike.
    pub units: ReflectanceUnits,
    seed: u64,
    files: Vec<MtlFile>,
    /// Index in `files`.
    file_of: HashMap<DefinedBy, usize>,
    /// Definitions without a source and places, by name, with their materials: meshes with equal definitions
    /// share materials.
    of_memory: HashMap<String, Vec<(MaterialDefinition, u32)>>,
    index_of: HashMap<Key, u32>,
    /// The material from which another one differs only in its class or its colours.
    base_of: HashMap<u32, u32>,
    /// Colours of materials that have one, with the places of their definitions.
    colours: HashMap<u32, (ColourDefinition, Option<Place>)>,
    /// In the order of first use.
    pub materials: Vec<Material>,
}

/// Definitions of a file, or of a mesh in memory.
#[derive(Clone)]
struct MtlFile {
    /// `None` for definitions that were read elsewhere, and for files that cannot be read.
    path: Option<PathBuf>,
    definitions: Vec<MaterialDefinition>,
}

/// Source of definitions.
#[derive(Clone, PartialEq, Eq, Hash)]
pub(super) enum DefinedBy {
    /// An MTL file.
    MtlFile(PathBuf),
    /// A mesh, or changes of materials, in memory.
    Memory(Identity),
    /// A mesh file with the table of materials that it is read with, or such a table.
    MeshFile(PathBuf, Option<PathBuf>),
}

#[derive(Clone, PartialEq, Eq, Hash)]
enum Key {
    Defined(DefinitionId),
    Named(String),
    /// Copy of a material with another class.
    Classified(u32, u8),
}

/// A definition: the index of its file and its position in it.
#[derive(Clone, Copy, PartialEq, Eq, Hash)]
pub(super) struct DefinitionId {
    file: usize,
    index: usize,
}

/// The names available to the files of one part; the first definition of a name counts.
#[derive(Default)]
pub(super) struct Names {
    by_name: HashMap<String, DefinitionId>,
    /// Names by their first word, which is all that the reference reads of a name.
    by_first_word: HashMap<String, String>,
    /// In the order in which they were added.
    all: Vec<(String, DefinitionId)>,
}

impl Names {
    /// Number of names.
    pub fn len(&self) -> usize {
        self.all.len()
    }

    /// The first `count` names.
    pub fn first(&self, count: usize) -> Names {
        let mut names = Names::default();
        self.all.iter().take(count).for_each(|(name, id)| names.add(name, *id));
        names
    }

    fn add(&mut self, name: &str, id: DefinitionId) {
        if let Entry::Vacant(free) = self.by_name.entry(name.to_owned()) {
            free.insert(id);
            self.all.push((name.to_owned(), id));
            self.by_first_word.entry(first_word(name).to_owned()).or_insert_with(|| name.to_owned());
        }
    }

    /// The definition of a name, and how it was found.
    fn find(&self, name: &str) -> Option<(DefinitionId, Known)> {
        if let Some(&id) = self.by_name.get(name) {
            return Some((id, Known::Whole));
        }
        let other = self.by_first_word.get(first_word(name)).filter(|_| !name.is_empty())?;
        Some((*self.by_name.get(other)?, Known::FirstWord(other.clone())))
    }
}

/// How a name of a material was resolved.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum Known {
    /// A file defines it, or it belongs to faces without a material.
    Whole,
    /// A file defines this name, whose first word is the same.
    FirstWord(String),
    /// No file defines it.
    Nowhere,
}

/// A name up to its first blank.
pub(super) fn first_word(name: &str) -> &str {
    name.split_whitespace().next().unwrap_or_default()
}

impl Library {
    pub fn new(spectra: Spectra, rules: Corrections, seed: u64) -> Library {
        Library {
            spectra,
            rules,
            relevant_rules: Corrections::NONE,
            issues: ReflectanceIssues::default(),
            units: ReflectanceUnits::default(),
            seed,
            files: Vec::new(),
            file_of: HashMap::new(),
            of_memory: HashMap::new(),
            index_of: HashMap::new(),
            base_of: HashMap::new(),
            colours: HashMap::new(),
            materials: Vec::new(),
        }
    }

    pub fn files(&self) -> impl Iterator<Item = PathBuf> {
        let own = self.files.iter().filter_map(|f| f.path.clone());
        own.chain(self.spectra.files().cloned())
    }

    /// Adds the definitions of an MTL file to `names`; `false` if the file cannot be read.
    pub fn add_file(&mut self, path: &Path, names: &mut Names, diagnostics: &mut Diagnostics) -> bool {
        let Some(file) = self.open(path, diagnostics) else { return false };
        for (index, definition) in self.files[file].definitions.iter().enumerate() {
            if definition.name != DEFAULT {
                names.add(&definition.name, DefinitionId { file, index });
            }
        }
        true
    }

    /// Index of an MTL file; `None` if it cannot be read.
    fn open(&mut self, path: &Path, diagnostics: &mut Diagnostics) -> Option<usize> {
        let file = self.file(DefinedBy::MtlFile(path.to_path_buf()), || match Source::open(path) {
            Ok(source) => MtlFile {
                definitions: mtl::read(&source, diagnostics),
                path: Some(source.path().to_path_buf()),
            },
            Err(_) => MtlFile { path: None, definitions: Vec::new() },
        });
        Some(file).filter(|&file| self.files[file].path.is_some())
    }

    /// Index of a file, which is read the first time.
    fn file(&mut self, by: DefinedBy, read: impl FnOnce() -> MtlFile) -> usize {
        let files = &mut self.files;
        *self.file_of.entry(by).or_insert_with(|| {
            files.push(read());
            files.len() - 1
        })
    }

    /// Resolves a name to a material: the definition of this name, else one with the same first word.
    pub fn named(&mut self, name: &str, names: &Names, diagnostics: &mut Diagnostics) -> (u32, Known) {
        if name == DEFAULT && !names.by_name.contains_key(name) {
            return (self.unnamed(name), Known::Whole);
        }
        match names.find(name) {
            Some((id, known)) => (self.defined(id, diagnostics), known),
            None => (self.unnamed(name), Known::Nowhere),
        }
    }

    /// The materials of definitions, in their order.
    pub fn of(
        &mut self,
        by: DefinedBy,
        definitions: impl FnOnce() -> Vec<MaterialDefinition>,
        diagnostics: &mut Diagnostics,
    ) -> Vec<u32> {
        let file = self.file(by, || MtlFile { path: None, definitions: definitions() });
        let count = self.files[file].definitions.len();
        (0..count).map(|index| self.defined(DefinitionId { file, index }, diagnostics)).collect()
    }

    /// Adds the definitions of a table of materials to `names`, in which they precede those of files added
    /// later.
    pub fn add_definitions(
        &mut self,
        path: &Path,
        definitions: impl FnOnce() -> Vec<MaterialDefinition>,
        names: &mut Names,
    ) {
        let by = DefinedBy::MeshFile(path.to_path_buf(), None);
        let file = self.file(by, || MtlFile { path: None, definitions: definitions() });
        for (index, definition) in self.files[file].definitions.iter().enumerate() {
            names.add(&definition.name, DefinitionId { file, index });
        }
    }

    /// The material for a name that is not defined.
    pub fn unnamed(&mut self, name: &str) -> u32 {
        self.unnamed_at(name, None)
    }

    /// As [`Library::unnamed`]; `place` is where a part lacks a material.
    fn unnamed_at(&mut self, name: &str, place: Option<&Place>) -> u32 {
        let (materials, rules) = (&mut self.materials, self.rules);
        self.relevant_rules.reflectance_fraction = true;
        self.relevant_rules.lambert_default = true;
        let units = &mut self.units;
        *self.index_of.entry(Key::Named(name.to_owned())).or_insert_with(|| {
            if !rules.reflectance_fraction {
                units.add(materials.len() as u32, name, 50.0, || place.cloned());
            }
            materials.push(Material::unnamed(name, rules));
            materials.len() as u32 - 1
        })
    }

    /// A copy of a material with another class.
    pub fn of_class(&mut self, material: u32, class: u8) -> u32 {
        let base = &self.materials[material as usize];
        if base.classification == i32::from(class) {
            return material;
        }
        if let Some(&index) = self.index_of.get(&Key::Classified(material, class)) {
            return index;
        }
        let classified = Material { classification: i32::from(class), ..base.clone() };
        self.materials.push(classified);
        let index = self.materials.len() as u32 - 1;
        self.index_of.insert(Key::Classified(material, class), index);
        self.base_of.insert(index, material);
        index
    }

    /// The materials in use, given those that primitives refer to: each also includes the material from which
    /// it differs only in its class or its colours.
    pub fn with_bases(&self, mut used: Vec<bool>) -> Vec<bool> {
        for material in (0..self.materials.len()).filter(|m| used[*m]).collect::<Vec<_>>() {
            let mut next = self.base_of.get(&(material as u32));
            while let Some(base) = next {
                used[*base as usize] = true;
                next = self.base_of.get(base);
            }
        }
        used
    }

    /// The colour of a material, if its definition has one, and the place of the definition.
    pub fn colour_of(&self, material: u32) -> Option<&(ColourDefinition, Option<Place>)> {
        let mut of = material;
        loop {
            match (self.colours.get(&of), self.base_of.get(&of)) {
                (Some(found), _) => return Some(found),
                (None, Some(base)) => of = *base,
                (None, None) => return None,
            }
        }
    }

    fn defined(&mut self, known: DefinitionId, diagnostics: &mut Diagnostics) -> u32 {
        if let Some(&index) = self.index_of.get(&Key::Defined(known)) {
            return index;
        }
        let is_last = known.index + 1 == self.files[known.file].definitions.len();
        let definition = self.files[known.file].definitions[known.index].clone();
        let is_in_memory = self.files[known.file].path.is_none();
        let mut placeless = MaterialDefinition { place: None, ..definition.clone() };
        placeless.unused_optics.iter_mut().for_each(|optics| optics.place = None);
        let equal = self.of_memory.get(&definition.name).into_iter().flatten();
        if let Some(&(_, index)) = equal.filter(|_| is_in_memory).find(|(other, _)| *other == placeless) {
            self.index_of.insert(Key::Defined(known), index);
            return index;
        }
        let material = self.resolve(&definition, is_last, diagnostics);
        self.materials.push(material);
        let index = self.materials.len() as u32 - 1;
        self.index_of.insert(Key::Defined(known), index);
        if let Some(colour) = definition.colour {
            self.colours.insert(index, (colour, definition.place));
        }
        if is_in_memory {
            self.of_memory.entry(definition.name).or_default().push((placeless, index));
        }
        index
    }

    /// The materials of a part whose loader defines none: the selected one and its randomised variants.
    /// Primitive i of the part uses material i modulo their number. `None` after an error.
    pub fn chosen(
        &mut self,
        choice: &MaterialChoice,
        part: u32,
        place: Option<&Place>,
        diagnostics: &mut Diagnostics,
    ) -> Option<Vec<u32>> {
        let Some(path) = &choice.file else {
            if let Some(place) = place {
                self.issues.add(ReflectanceIssue::Missing, DEFAULT, place.clone());
            }
            return Some(vec![self.unnamed_at(DEFAULT, place)]);
        };
        let Some(file) = self.open(path, diagnostics) else {
            let assumed = assumed(self.rules);
            let message =
                format!("cannot read the material file {}; the part reflects {assumed}", path.display());
            diagnostics.warn(place.cloned(), message);
            return Some(vec![self.unnamed(DEFAULT)]);
        };
        let definitions = &self.files[file].definitions;
        let index = match &choice.name {
            Some(name) => {
                let same_word = || definitions.iter().position(|d| first_word(&d.name) == first_word(name));
                definitions.iter().position(|d| d.name == *name).or_else(|| {
                    let index = same_word()?;
                    let other = &definitions[index].name;
                    let message = format!(
                        "{} defines no material \"{name}\"; \"{other}\" is used, which has the same first \
                         word",
                        path.display()
                    );
                    diagnostics.warn(place.cloned(), message);
                    Some(index)
                })
            }
            None => (0..definitions.len()).min_by(|&a, &b| definitions[a].name.cmp(&definitions[b].name)),
        };
        let Some(index) = index else {
            let known: Vec<&str> = definitions.iter().map(|d| d.name.as_str()).collect();
            let missing = choice.name.as_ref().map_or("material".to_owned(), |n| format!("material \"{n}\""));
            let message = format!("{} defines no {missing}", path.display());
            diagnostics.error(place.cloned(), message).help(format!("it defines: {}", known.join(", ")));
            return None;
        };
        if choice.random_variants > MAX_VARIANTS || !choice.random_range.is_finite() {
            let message = format!(
                "expected at most {MAX_VARIANTS} randomised materials with a finite range, found {} with {}",
                choice.random_variants, choice.random_range
            );
            diagnostics.error(place.cloned(), message);
            return None;
        }
        let definition = definitions[index].clone();
        let mut all = vec![self.defined(DefinitionId { file, index }, diagnostics)];
        for variant in 0..choice.random_variants {
            let base = self.materials[all[0] as usize].clone();
            all.push(self.materials.len() as u32);
            self.base_of.insert(self.materials.len() as u32, all[0]);
            self.materials.push(self.varied(base, &definition, choice.random_range, part, variant));
        }
        Some(all)
    }

    fn varied(
        &self,
        base: Material,
        definition: &MaterialDefinition,
        range: f64,
        part: u32,
        variant: u32,
    ) -> Material {
        let stream = Stream::new(self.seed, Purpose::Material);
        let change = |value: f64, component: u32| {
            let u = 2.0 * stream.uniform(part, u64::from(variant), component) - 1.0;
            (value + range * u).clamp(0.0, 1.0)
        };
        let mut varied = definition.clone();
        for axis in 0..3u32 {
            let i = axis as usize;
            varied.kd[i] = change(varied.kd[i], axis);
            varied.ks[i] = change(varied.ks[i], 3 + axis);
        }
        Material { reflection: reflection(&varied, true, self.rules), ..base }
    }
}

#[cfg(test)]
mod tests;
