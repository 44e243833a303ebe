//! Tests with complete pipeline files.

use super::read_survey;
use crate::options::Options;
use proptest::prelude::*;
use std::path::Path;
use vlscan_base::diag::Diagnostics;
use vlscan_survey::Survey;
use vlscan_survey::testkit::documents::*;

mod pipelines;

type Pipeline = (Survey, Options);

fn read_pipeline(path: &Path) -> crate::Result<(Pipeline, Diagnostics)> {
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
