//! Tests with complete pipeline files.

use super::read_survey;
use crate::Options;
use proptest::prelude::*;
use std::path::Path;
use vlscan_base::diag::Diagnostics;
use vlscan_base::error::{Error, Result};
use vlscan_survey::Survey;
use vlscan_survey::testkit::documents::*;

mod pipelines;
mod scanners;

type Pipeline = (Survey, Options);

fn read_pipeline(path: &Path) -> Result<(Pipeline, Diagnostics)> {
    let (survey, options, warnings) = read_survey(path, Options::default())?;
    Ok(((survey, options), warnings))
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(300))]

    #[test]
    fn damaged_pipelines_are_answered(at in 0.0..1.0f64, cut in 0usize..12, put in "[-\\[\\]{}='\"#a-z_0-9.\n]{0,6}") {
        let text = pipelines::EVERYTHING;
        let start = text.floor_char_boundary((at * text.len() as f64) as usize);
        let end = text.floor_char_boundary((start + cut).min(text.len())).max(start);
        let text = format!("{}{put}{}", &text[..start], &text[end..]);
        let folder = Folder::new(&[("p.toml", &text), ("a.obj", "")]);
        if let Err(e) = read_pipeline(&folder.path("p.toml")) {
            drop(report(&e));
        }
    }
}

#[test]
fn switches_of_a_pipeline_are_undone() {
    let text = pipelines::EVERYTHING.replacen("strict = false", "misses = true\nforce = true", 1);
    let folder = Folder::new(&[("p.toml", &text), ("a.obj", "")]);
    let read = |words: &[&str]| {
        let typed = Options::parse(words.iter().map(|word| (*word).to_owned())).unwrap();
        let (_, options, _) = read_survey(&folder.path("p.toml"), typed).unwrap();
        let Options { output, echoes, noise, .. } = options;
        [output.misses, output.force, output.labels, echoes.legacy_energy, noise.no_platform_noise]
            .map(super::Switch::is_on)
    };
    assert_eq!(read(&[]), [true, true, false, true, true]);
    let undone = ["--no-misses", "--no-force", "--no-labels", "--no-legacy-energy", "--platform-noise"];
    assert_eq!(read(&undone), [false; 5]);
    assert_eq!(read(&["--labels", "--no-misses", "--misses"]), [true; 5]);
}
