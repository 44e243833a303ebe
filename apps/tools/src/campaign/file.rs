//! The file of a campaign.

use serde::{Deserialize, Serialize, Serializer};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use toml::Spanned;
use vlscan_base::diag::Place;
use vlscan_base::error::{Error, Result};
use vlscan_base::recognise::{Expected, foreign_file};
use vlscan_survey::Source;
use vlscan_tables::input::read_text;

/// Maximum size of the file, bytes.
const MAX_BYTES: u64 = 16 << 20;
const MAX_SEEDS: usize = 1_000_000;

/// A campaign as written. Paths are relative to the file's folder; options are those of the commands that
/// they are for, as typed.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct File {
    /// The folder of the data set.
    pub out: PathBuf,
    /// Seeds: a list, or how many, from 1.
    #[serde(default = "Seeds::one")]
    pub seeds: Seeds,
    /// Format of the points.
    #[serde(default = "laz")]
    pub format: String,
    /// Options of vlscan run for all variants.
    #[serde(default)]
    pub run: Option<Spanned<String>>,
    /// Training, validation and test.
    #[serde(default)]
    pub split: Option<Spanned<Split>>,
    /// The scenes, from the `[[scene]]` tables.
    #[serde(default, rename = "scene")]
    pub scenes: Vec<SceneEntry>,
    /// The variants, from the `[[variant]]` tables.
    #[serde(default, rename = "variant")]
    pub variants: Vec<VariantEntry>,
    /// The text, for places.
    #[serde(skip)]
    source: Option<Arc<Source>>,
}

/// The text of a key that may be missing.
pub fn text_of(key: &Option<Spanned<String>>) -> &str {
    key.as_ref().map_or("", |text| text.get_ref().as_str())
}

fn is_blank(key: &Option<Spanned<String>>) -> bool {
    text_of(key).is_empty()
}

/// Seeds as written.
#[derive(Clone, Debug, Deserialize)]
#[serde(untagged, expecting = "expected a number of seeds or a list of seeds")]
pub enum Seeds {
    /// How many, from 1.
    Count(u32),
    /// These.
    List(Vec<u64>),
}

impl Seeds {
    fn one() -> Seeds {
        Seeds::Count(1)
    }

    fn len(&self) -> usize {
        match self {
            Seeds::Count(count) => *count as usize,
            Seeds::List(seeds) => seeds.len(),
        }
    }

    /// All seeds.
    pub fn all(&self) -> Vec<u64> {
        match self {
            Seeds::Count(count) => (1..=u64::from(*count)).collect(),
            Seeds::List(seeds) => seeds.clone(),
        }
    }
}

fn laz() -> String {
    "laz".to_owned()
}

/// Kind of the groups of a split.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum GroupBy {
    /// The scene; a plot is a scene.
    #[default]
    Scene,
    /// The variant.
    Variant,
    /// The seed.
    Seed,
    /// Every cell is a group of its own.
    Cell,
}

/// Shares of groups for training, validation and test; they are taken in proportion to their sum.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Split {
    /// Kind of the groups.
    #[serde(default)]
    pub by: GroupBy,
    /// Share of the groups for training.
    #[serde(default)]
    pub train: f64,
    /// Share of the groups for validation.
    #[serde(default)]
    pub validation: f64,
    /// Share of the groups for testing.
    #[serde(default)]
    pub test: f64,
    /// Another seed, another split.
    #[serde(default)]
    pub seed: u64,
}

impl Split {
    /// Purposes of groups, with their shares.
    pub fn shares(&self) -> [(&'static str, f64); 3] {
        [("train", self.train), ("validation", self.validation), ("test", self.test)]
    }
}

/// A scene, or plots of a stand, each of which is a scene.
#[derive(Clone, Debug, Default, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct SceneEntry {
    /// Name of the scene, part of the names of its cells.
    pub name: String,
    /// A scene (file.xml#id) or a file of geometry.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub file: Option<String>,
    /// Words of vlscan scene make.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub make: Option<Spanned<String>>,
    /// Words of vlscan scene stand.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub stand: Option<Spanned<String>>,
    /// The polygon that is scanned and within which points are kept.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub area: Option<Spanned<String>>,
    /// Number of square plots within the area, each of which is a scene.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub plots: Option<u32>,
    /// Edge length of a plot, m.
    #[serde(default, serialize_with = "plot_size")]
    pub plot_m: Option<f64>,
    /// Trees up to this distance from the area stand, too, m.
    #[serde(default, serialize_with = "margin")]
    pub margin_m: Option<f64>,
}

/// Edge length of plots if none is given, m.
const DEFAULT_PLOT: f64 = 30.0;
/// Distance from the area up to which trees stand if none is given, m.
const DEFAULT_MARGIN: f64 = 10.0;

fn plot_size<S: Serializer>(value: &Option<f64>, serializer: S) -> Result<S::Ok, S::Error> {
    serializer.serialize_f64(value.unwrap_or(DEFAULT_PLOT))
}

fn margin<S: Serializer>(value: &Option<f64>, serializer: S) -> Result<S::Ok, S::Error> {
    serializer.serialize_f64(value.unwrap_or(DEFAULT_MARGIN))
}

impl SceneEntry {
    /// Edge length of a plot, m.
    pub fn plot_size(&self) -> f64 {
        self.plot_m.unwrap_or(DEFAULT_PLOT)
    }

    /// Distance from the area up to which trees stand, m.
    pub fn margin(&self) -> f64 {
        self.margin_m.unwrap_or(DEFAULT_MARGIN)
    }
}

/// How scenes are scanned.
#[derive(Clone, Debug, Default, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct VariantEntry {
    /// Name of the variant, part of the names of its cells.
    pub name: String,
    /// Words of vlscan plan.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub plan: Option<Spanned<String>>,
    /// A survey (.xml) or pipeline (.toml), whose scene is replaced.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub survey: Option<PathBuf>,
    /// Options of vlscan run.
    #[serde(default, skip_serializing_if = "is_blank")]
    pub run: Option<Spanned<String>>,
}

impl File {
    /// Reads a campaign.
    ///
    /// # Errors
    /// [`Error::Input`] with the line of what is wrong, [`Error::Io`].
    pub fn read(path: &Path) -> Result<File> {
        match foreign_file(path, &Expected::CAMPAIGN) {
            Some(found) => Err(found.error(path)),
            None => File::parse(path, read_text(path, MAX_BYTES)?),
        }
    }

    /// Reads the text of a campaign; `path` is for messages.
    ///
    /// # Errors
    /// [`Error::Input`] with the line of what is wrong.
    pub fn parse(path: &Path, text: String) -> Result<File> {
        let source = Source::of_text(path, text);
        let file: File = source.parse()?;
        file.check().map_err(|problem| Error::input(format!("{}: {problem}", path.display())))?;
        Ok(File { source: Some(Arc::new(source)), ..file })
    }

    /// Place of a value; `None` if the file was not read as one.
    pub fn place<T>(&self, value: &Spanned<T>) -> Option<Place> {
        self.source.as_ref().map(|source| source.place(value.span()))
    }

    fn check(&self) -> Result<(), CampaignError> {
        for (what, count) in [
            ("[[scene]]", self.scenes.len()),
            ("[[variant]]", self.variants.len()),
            ("seed", self.seeds.len()),
        ] {
            if count == 0 {
                return Err(CampaignError::Missing(what));
            }
        }
        if self.seeds.len() > MAX_SEEDS {
            return Err(CampaignError::Seeds);
        }
        for scene in &self.scenes {
            let wrong = |problem| Err(CampaignError::Scene { scene: scene.name.clone(), problem });
            let sources = [scene.file.is_some(), scene.make.is_some(), scene.stand.is_some()];
            if sources.iter().filter(|given| **given).count() != 1 {
                return wrong(SceneProblem::Sources);
            }
            if scene.plots.is_some() && (scene.area.is_none() || scene.stand.is_none()) {
                return wrong(SceneProblem::Plots);
            }
            if scene.plot_m.is_some() && scene.plots.is_none() {
                return wrong(SceneProblem::PlotSize);
            }
            if scene.margin_m.is_some() && (scene.stand.is_none() || scene.area.is_none()) {
                return wrong(SceneProblem::Margin);
            }
            let (plot, margin) = (scene.plot_size(), scene.margin());
            if !(plot > 0.0 && plot <= 1e5 && (0.0..=1e4).contains(&margin)) {
                return wrong(SceneProblem::Lengths);
            }
            if scene.plots.is_some_and(|count| count == 0 || count > 100_000) {
                return wrong(SceneProblem::PlotCount);
            }
        }
        for variant in &self.variants {
            if variant.plan.is_some() == variant.survey.is_some() {
                return Err(CampaignError::Variant(variant.name.clone()));
            }
        }
        if let Some(split) = &self.split {
            let shares = split.get_ref().shares().map(|(_, share)| share);
            let sum: f64 = shares.iter().sum();
            if !(sum > 0.0 && sum.is_finite() && shares.iter().all(|share| *share >= 0.0)) {
                return Err(CampaignError::Split);
            }
        }
        Ok(())
    }
}

/// Entries of a campaign that do not fit each other.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
enum CampaignError {
    /// No entry of a kind.
    #[error("a campaign needs at least one {0}")]
    Missing(&'static str),
    /// Too many seeds.
    #[error("at most {max} seeds are possible", max = MAX_SEEDS)]
    Seeds,
    /// A scene whose keys do not fit each other.
    #[error("scene {scene}: {problem}")]
    Scene { scene: String, problem: SceneProblem },
    /// A variant with two sources or without one.
    #[error("variant {0}: expected either `plan` or `survey`")]
    Variant(String),
    /// Shares of which nothing can be divided.
    #[error("split: train, validation and test must be at least 0, and not all 0")]
    Split,
}

/// Keys of a scene that do not fit each other.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
enum SceneProblem {
    #[error("expected one of `file`, `make` and `stand`")]
    Sources,
    #[error("`plots` need a `stand` with an `area`")]
    Plots,
    #[error("`plot_m` is the size of `plots`, but the scene has no `plots`")]
    PlotSize,
    #[error("`margin_m` is for trees of a `stand` around an `area`")]
    Margin,
    #[error("plot_m and margin_m are metres, plot_m above 0")]
    Lengths,
    #[error("expected 1 to 100000 plots")]
    PlotCount,
}

/// A line with a quote that does not end.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("a quote does not end in: {0}")]
pub struct UnclosedQuote(pub String);

/// The words of a command line; single and double quotes keep blanks.
///
/// # Errors
/// A quote that does not end.
pub fn words(line: &str) -> Result<Vec<String>, UnclosedQuote> {
    let mut all = Vec::new();
    let mut word: Option<String> = None;
    let mut quote = None;
    for c in line.chars() {
        match (quote, c) {
            (Some(end), c) if c == end => quote = None,
            (None, '\'' | '"') => {
                quote = Some(c);
                word.get_or_insert_default();
            }
            (None, c) if c.is_whitespace() => all.extend(word.take()),
            (_, c) => word.get_or_insert_default().push(c),
        }
    }
    if quote.is_some() {
        return Err(UnclosedQuote(line.to_owned()));
    }
    all.extend(word);
    Ok(all)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_are_those_of_a_shell() {
        assert_eq!(words("a  'b c' d\"e f\"g ''").unwrap(), ["a", "b c", "de fg", ""]);
        assert!(words("a 'b").unwrap_err().to_string().contains("quote"));
        assert!(words(" ").unwrap().is_empty());
    }

    #[test]
    fn mistakes_are_told() {
        let parse = |text: &str| File::parse(Path::new("campaign.toml"), text.to_owned());
        let wrong = |text: &str| parse(text).unwrap_err().to_string();
        assert!(wrong("out = \"a\"\nseedz = 3").contains("seedz"));
        assert!(wrong("out = \"a\"").contains("[[scene]]"));
        let scene = "out = \"a\"\n[[scene]]\nname = \"s\"\n";
        let variant = "[[variant]]\nname = \"v\"\n";
        assert!(wrong(&format!("{scene}{variant}plan = \"p\"")).contains("expected one of `file`"));
        let scene = format!("{scene}file = \"s.obj\"\n");
        assert!(wrong(&format!("{scene}{variant}")).contains("either `plan` or `survey`"));
        assert!(wrong(&format!("{scene}plots = 3\n{variant}plan = \"p\"")).contains("`plots` need"));
        assert!(wrong(&format!("{scene}plot_m = 3\n{variant}plan = \"p\"")).contains("`plot_m` is the size"));
        assert!(wrong(&format!("{scene}margin_m = 3\n{variant}plan = \"p\"")).contains("`margin_m` is for"));
        let split = "split = { train = -1 }\n";
        assert!(wrong(&format!("{split}{scene}{variant}plan = \"p\"")).contains("at least 0"));
        let file = parse(&format!("seeds = [7, 9]\n{scene}{variant}plan = \"p\"")).unwrap();
        assert_eq!((file.seeds.all(), file.format.as_str()), (vec![7, 9], "laz"));
    }
}
