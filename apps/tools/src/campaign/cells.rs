//! The matrix of a campaign: scenes × variants × seeds.

use super::file::{File, GroupBy, SceneEntry, Split, VariantEntry};
use super::plots;
use crate::plan::{Area, read_area};
use std::collections::BTreeSet;
use std::sync::Arc;
use vlscan_base::diag::{Diagnostics, Place};
use vlscan_base::error::{Error, Result};
use vlscan_base::rng::{Purpose, Stream};

/// Maximum number of cells.
const MAX_CELLS: usize = 1_000_000;

/// One run of the campaign.
#[derive(Clone, Debug)]
pub struct Cell {
    /// Its folder in the data set: SCENE-VARIANT-SEED.
    pub name: String,
    /// The scene that is scanned, as the campaign's file states it.
    pub scene: Arc<SceneEntry>,
    /// Index of the scene in the campaign's file.
    pub scene_index: usize,
    /// Name of the scene, or of the plot.
    pub scene_name: String,
    /// Area that is scanned and kept.
    pub area: Option<Arc<Area>>,
    /// How the scene is scanned, as the campaign's file states it.
    pub variant: Arc<VariantEntry>,
    /// Index of the variant in the campaign's file.
    pub variant_index: usize,
    /// Seed of the run.
    pub seed: u64,
    /// Its group, and the use of that group: train, validation or test; empty without a split.
    pub group: String,
    /// Subset of the split: `train`, `validation` or `test`; empty without a split.
    pub split: &'static str,
}

/// All cells, scene by scene, and messages about the files of their areas.
#[derive(Clone, Debug)]
pub struct Cells(pub Vec<Cell>, Diagnostics);

impl Cells {
    /// The cells of a campaign; areas are read.
    ///
    /// # Errors
    /// [`Error::Input`] for areas that cannot be read, plots that do not fit and duplicate names.
    pub fn of(file: &File) -> Result<Cells> {
        let (scenes, found) = scenes_of(file)?;
        let seeds = file.seeds.all();
        let count = scenes.len().saturating_mul(file.variants.len()).saturating_mul(seeds.len());
        if count > MAX_CELLS {
            return Err(Error::input(format!("{count} cells, expected at most {MAX_CELLS}")));
        }
        let variants: Vec<Arc<VariantEntry>> = file.variants.iter().cloned().map(Arc::new).collect();
        let by = file.split.as_ref().map_or(GroupBy::Scene, |split| split.get_ref().by);
        let mut cells = Vec::with_capacity(count);
        for scene in &scenes {
            for &seed in &seeds {
                let of_variant = |(index, variant)| cell_of(scene, (index, variant), seed, by);
                cells.extend(variants.iter().enumerate().map(of_variant));
            }
        }
        let mut names = BTreeSet::new();
        if let Some(cell) = cells.iter().find(|cell| !names.insert(cell.name.as_str())) {
            return Err(Error::input(format!("duplicate cell name {}", cell.name)));
        }
        if let Some(split) = &file.split {
            assign(&mut cells, split.get_ref());
        }
        Ok(Cells(cells, found))
    }

    /// Warnings about the files of areas and about shares of the split without a group.
    pub fn warnings(&self, file: &File) -> Diagnostics {
        let mut found = self.1.clone();
        let Some(written) = &file.split else { return found };
        let split = written.get_ref();
        let groups = self.0.iter().map(|cell| cell.group.as_str()).collect::<BTreeSet<_>>().len();
        for (name, share) in split.shares() {
            if share > 0.0 && !self.0.iter().any(|cell| cell.split == name) {
                let message = format!(
                    "the split has no group for {name}: its share is {share}, and there are {groups} groups"
                );
                let help = "add scenes (or plots) for more groups; by = \"cell\" makes each cell a group";
                found.warn(file.place(written), message).help(help);
            }
        }
        found
    }
}

/// A scene, or a plot of one.
struct ScenePart {
    /// Index of the scene in the campaign's file.
    index: usize,
    scene: Arc<SceneEntry>,
    /// Name of the scene, or of the plot.
    name: String,
    area: Option<Arc<Area>>,
}

/// The scenes of a campaign, divided into plots; areas are read. Also returns notes for the user.
fn scenes_of(file: &File) -> Result<(Vec<ScenePart>, Diagnostics)> {
    let (mut scenes, mut found) = (Vec::new(), Diagnostics::default());
    for (index, scene) in file.scenes.iter().enumerate() {
        let scene = Arc::new(scene.clone());
        let place = scene.area.as_ref().and_then(|area| file.place(area));
        let area = scene.area.as_ref().map(|area| read_area(area.get_ref(), None, None)).transpose();
        let area = area.map_err(|error| placed(error, place.as_ref()))?;
        let area = area.map(|(area, told)| {
            found.extend(told);
            area
        });
        match (scene.plots, area) {
            (Some(count), Some(area)) => {
                let plots = plots::draw(&area, count as usize, scene.plot_size(), 0)
                    .map_err(|problem| Error::input(format!("scene {}: {problem}", scene.name)))
                    .map_err(|error| placed(error, place.as_ref()))?;
                let digits = count.to_string().len();
                for (number, plot) in (1..).zip(plots) {
                    let name = format!("{}_{number:0digits$}", scene.name);
                    scenes.push(ScenePart { index, scene: scene.clone(), name, area: Some(Arc::new(plot)) });
                }
            }
            (_, area) => {
                let name = scene.name.clone();
                scenes.push(ScenePart { index, scene, name, area: area.map(Arc::new) });
            }
        }
    }
    Ok((scenes, found))
}

/// The cell of a scene, a variant with its index in the campaign's file and a seed.
fn cell_of(part: &ScenePart, (index, variant): (usize, &Arc<VariantEntry>), seed: u64, by: GroupBy) -> Cell {
    let name = format!("{}-{}-{seed}", file_name(&part.name), file_name(&variant.name));
    let group = match by {
        GroupBy::Scene => part.name.clone(),
        GroupBy::Variant => variant.name.clone(),
        GroupBy::Seed => seed.to_string(),
        GroupBy::Cell => name.clone(),
    };
    Cell {
        name,
        scene: part.scene.clone(),
        scene_index: part.index,
        scene_name: part.name.clone(),
        area: part.area.clone(),
        variant: variant.clone(),
        variant_index: index,
        seed,
        group,
        split: "",
    }
}

/// A name without characters that separate folders or words.
fn file_name(name: &str) -> String {
    let is_plain = |c: char| c.is_alphanumeric() || matches!(c, '_' | '.' | '+');
    let clean: String = name.chars().map(|c| if is_plain(c) { c } else { '_' }).collect();
    if clean.chars().all(|c| c == '.') { format!("_{clean}") } else { clean }
}

/// Assigns groups to training, validation and test: in an order drawn by the seed, each gets its share of the
/// groups.
fn assign(cells: &mut [Cell], split: &Split) {
    let groups: BTreeSet<&str> = cells.iter().map(|cell| cell.group.as_str()).collect();
    let stream = Stream::new(split.seed, Purpose::SceneMaking);
    let mut order: Vec<(f64, String)> =
        (0..).zip(&groups).map(|(i, group)| (stream.uniform(i, 1, 0), (*group).to_owned())).collect();
    order.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    let count = order.len() as f64;
    let sum: f64 = split.shares().iter().map(|(_, share)| share).sum();
    let bounds =
        [split.train, split.train + split.validation].map(|share| (share / sum * count).round() as usize);
    let kind = |i: usize| match i {
        i if i < bounds[0] => "train",
        i if i < bounds[1] => "validation",
        _ => "test",
    };
    let kinds: std::collections::BTreeMap<String, &'static str> =
        order.into_iter().enumerate().map(|(i, (_, group))| (group, kind(i))).collect();
    for cell in cells {
        cell.split = kinds.get(&cell.group).copied().unwrap_or_default();
    }
}

/// An error whose problems without a place have this one.
fn placed(error: Error, place: Option<&Place>) -> Error {
    let Error::Input(problems) = error else { return error };
    let mut found = Diagnostics::default();
    for item in problems.items() {
        let mine = found.error(item.place.as_ref().or(place).cloned(), item.message.clone());
        mine.of_kind(item.kind);
        mine.help = item.help.clone();
    }
    Error::Input(Box::new(found))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn cells(text: &str) -> Vec<Cell> {
        Cells::of(&toml::from_str(text).unwrap()).unwrap().0
    }

    #[test]
    fn every_scene_variant_and_seed_is_a_cell_and_groups_stay_together() {
        let text = "out = \"o\"\nseeds = 3\nsplit = { train = 6, validation = 2, test = 2 }\n\
            [[scene]]\nname = \"s/t\"\nstand = \"x\"\narea = \"POLYGON ((0 0, 200 0, 200 200, 0 200))\"\nplots = 10\n\
            [[variant]]\nname = \"a\"\nplan = \"p\"\n[[variant]]\nname = \"b\"\nplan = \"p\"\n";
        let all = cells(text);
        assert_eq!((all.len(), all[0].name.as_str()), (60, "s_t_01-a-1"));
        let of = |kind: &str| all.iter().filter(|cell| cell.split == kind).count();
        assert_eq!((of("train"), of("validation"), of("test")), (36, 12, 12));
        for cell in &all {
            assert!(
                all.iter().filter(|other| other.group == cell.group).all(|other| other.split == cell.split)
            );
        }
    }

    #[test]
    fn what_of_an_area_is_not_used_is_told() {
        let text = "out = \"o\"\n[[scene]]\nname = \"s\"\nfile = \"x\"\n\
            area = \"POLYGON ((0 0, 200 0, 200 200, 0 200), (1 1, 2 1, 2 2))\"\n\
            [[variant]]\nname = \"v\"\nplan = \"p\"\n";
        let file = toml::from_str(text).unwrap();
        let told = Cells::of(&file).unwrap().warnings(&file);
        assert!(told.is_fatal(true) && told.text().contains("holes of the polygon (1)"));
    }

    #[test]
    fn equal_names_are_refused() {
        let text = "out = \"o\"\n[[scene]]\nname = \"a b\"\nfile = \"x\"\n[[scene]]\nname = \"a_b\"\nfile = \"x\"\n\
            [[variant]]\nname = \"v\"\nplan = \"p\"\n";
        assert!(Cells::of(&toml::from_str(text).unwrap()).is_err());
    }
}
