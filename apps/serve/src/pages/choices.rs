//! Files of an owner to choose from in forms.

use super::titles::file_title;
use crate::store::{FileKind, Listed, Result as StoreResult, Status, UploadFile};
use crate::worker::Workshop;
use maud::{Markup, html};

/// Formats that the form of a run offers: ending and name.
pub const FORMATS: [(&str, &str); 7] = [
    ("copc.laz", "LAZ, COPC: shown at once"),
    ("laz", "LAZ"),
    ("las", "LAS"),
    ("xyz", "text"),
    ("ply", "PLY"),
    ("e57", "E57"),
    ("parquet", "Parquet"),
];
/// Most files in a list to choose from.
const MAX_CHOICES: usize = 500;
/// Number of files after which older uploads are not looked into.
const MAX_FILES: usize = 20_000;
/// Most jobs whose results are offered for comparisons.
const MAX_COMPARED: u32 = 50;
/// Most stands that are offered as scenes.
const MAX_STANDS: u32 = 20;
/// Endings of files that are scenes, areas, clouds.
const SCENES: [&str; 10] = ["obj", "ply", "stl", "gltf", "glb", "tif", "tiff", "vrt", "vox", "vlscene"];
pub(super) const AREAS: [&str; 4] = ["geojson", "json", "kml", "wkt"];
pub(super) const CLOUDS: [&str; 10] =
    ["laz", "las", "ply", "pcd", "e57", "pts", "xyz", "csv", "arrow", "parquet"];
pub(super) const TRAJECTORIES: [&str; 5] = ["csv", "txt", "out", "sbet", "trj"];
pub(super) const TABLES: [&str; 3] = ["csv", "txt", "tsv"];
const MESHES: [&str; 6] = ["obj", "ply", "stl", "off", "gltf", "glb"];
pub(super) const TERRAINS: [&str; 6] = ["tif", "tiff", "vrt", "obj", "ply", "stl"];

/// True if a scene can be made of the file by itself.
pub fn is_scene(name: &str) -> bool {
    has_ending(name, &SCENES)
}

/// True if the file is a mesh, perhaps of a building or a room.
pub fn is_mesh(name: &str) -> bool {
    has_ending(name, &MESHES)
}

/// True if the file may be an inventory.
pub fn is_table(name: &str) -> bool {
    has_ending(name, &TABLES)
}

/// True if the file may be a trajectory.
pub fn is_trajectory(name: &str) -> bool {
    has_ending(name, &TRAJECTORIES)
}

/// A file of an owner: the name that requests give it, and what lists call it.
#[derive(Debug)]
struct Named {
    name: String,
    label: String,
    kind: FileKind,
}

/// Files of an owner, newest upload first.
#[derive(Debug, Default)]
pub(super) struct Files(Vec<Named>);

impl Files {
    /// The files of all uploads, and the newest stands.
    pub fn of(workshop: &Workshop, owner: &str) -> StoreResult<Files> {
        let store = &workshop.store;
        let mut files = Vec::new();
        for upload in store.uploads(owner)? {
            let named = |file: UploadFile| {
                let name = format!("{}/{}", upload.name, file.path);
                Named { label: name.clone(), name, kind: file.kind }
            };
            files.extend(store.files(&upload.id)?.into_iter().map(named));
            if files.len() >= MAX_FILES {
                break;
            }
        }
        for job in
            store.jobs(Listed::States, owner, &[Status::Successful], &["stand".to_owned()], 0, MAX_STANDS)?
        {
            let label = file_title(workshop, &job, "stand")?;
            files.push(Named {
                name: format!("jobs/{}/stand/stand.xml", job.id),
                label,
                kind: FileKind::Scene,
            });
        }
        Ok(Files(files))
    }

    /// The clouds of the newest jobs, then the files of [`Files::of`].
    pub fn with_results(workshop: &Workshop, owner: &str) -> StoreResult<Files> {
        let mut files = Files::of(workshop, owner)?;
        let mut results = Vec::new();
        let processes = ["run", "preview"].map(str::to_owned);
        for job in
            workshop.store.jobs(Listed::Results, owner, &[Status::Successful], &processes, 0, MAX_COMPARED)?
        {
            for file in job.result_files().iter().filter(|file| has_ending(&file.path, &CLOUDS)) {
                let label = file_title(workshop, &job, &file.path)?;
                results.push(Named {
                    name: format!("jobs/{}/{}", job.id, file.path),
                    label,
                    kind: FileKind::Other,
                });
            }
        }
        results.append(&mut files.0);
        Ok(Files(results))
    }

    /// True if there are no files.
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// Files with these endings. Inventories are in the list of tables only.
    pub fn with(&self, endings: &[&str]) -> Vec<&str> {
        let is_table = endings == TABLES.as_slice();
        let is_of_list = |kind: FileKind| is_table || kind != FileKind::Inventory;
        self.chosen(|name, kind| is_of_list(kind) && has_ending(name, endings)).take(MAX_CHOICES).collect()
    }

    /// Scenes: first XML files that hold one, then geometry.
    pub fn scenes(&self) -> Vec<&str> {
        let described = self.chosen(|_, kind| kind == FileKind::Scene);
        described.chain(self.chosen(|name, _| has_ending(name, &SCENES))).take(MAX_CHOICES).collect()
    }

    /// The newest upload with a scene, as names of its files begin; empty if there is none.
    pub fn newest(&self) -> &str {
        let first = self.chosen(|name, kind| kind == FileKind::Scene || has_ending(name, &SCENES)).next();
        first.and_then(|name| name.split_inclusive('/').next()).unwrap_or_default()
    }

    /// Surveys and pipelines.
    pub fn surveys(&self) -> Vec<&str> {
        let is_survey = |name: &str, kind: FileKind| kind == FileKind::Survey || has_ending(name, &["toml"]);
        self.chosen(is_survey).take(MAX_CHOICES).collect()
    }

    /// Folders that have files with this ending themselves.
    pub fn folders(&self, ending: &str) -> Vec<&str> {
        let parents =
            self.chosen(|name, _| has_ending(name, &[ending])).filter_map(|name| name.rsplit_once('/'));
        let mut folders: Vec<&str> = parents.map(|(folder, _)| folder).collect();
        folders.dedup();
        folders.truncate(MAX_CHOICES);
        folders
    }

    /// Name of a file or folder in lists.
    fn label<'f>(&'f self, name: &'f str) -> &'f str {
        self.0.iter().find(|file| file.name == name).map_or(name, |file| &file.label)
    }

    /// A list of files to choose from. `first` stands for no file, where none is needed; the first file that
    /// begins with `wanted` is chosen.
    pub fn choice(
        &self,
        name: &str,
        label: &str,
        files: &[&str],
        first: Option<&str>,
        wanted: &str,
    ) -> Markup {
        let chosen = files.iter().position(|file| !wanted.is_empty() && file.starts_with(wanted));
        html! {
            label {
                (label)
                select name=(name) required[first.is_none()] {
                    option value="" { (first.unwrap_or("choose …")) }
                    @for (at, file) in files.iter().enumerate() {
                        option value=(file) selected[chosen == Some(at)] { (self.label(file)) }
                    }
                }
            }
        }
    }

    fn chosen(&self, is_chosen: impl Fn(&str, FileKind) -> bool) -> impl Iterator<Item = &str> {
        self.0.iter().filter(move |file| is_chosen(&file.name, file.kind)).map(|file| file.name.as_str())
    }
}

fn has_ending(name: &str, endings: &[&str]) -> bool {
    name.rsplit_once('.').is_some_and(|(_, end)| endings.iter().any(|known| end.eq_ignore_ascii_case(known)))
}

/// Seed and format of a run.
pub fn run_fields() -> Markup {
    html! {
        div .row {
            label { "Format" select name="format" { @for (ending, name) in FORMATS { option value=(ending) { (name) } } } }
            label { "Seed" input name="seed" inputmode="numeric" size="8" placeholder="0" autocomplete="off"; }
        }
    }
}
