//! The same survey gives the same bytes for any number of threads and any chunk size, in every format.

mod common;

use common::{files, fixture, folder, succeed};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// A survey with noise on every source that may draw random numbers.
fn outputs(survey: &Path, extra: &[&str]) -> BTreeMap<PathBuf, Vec<u8>> {
    let dir = folder();
    let survey = survey.to_str().unwrap();
    let mut args = vec!["run", survey, "-q", "--seed", "11", "--waveforms", "--pulses", "--waveform-noise"];
    for path in ["all.xyz", "all.las", "all.laz", "all.ply", "legs"] {
        args.extend(["-o", path]);
    }
    args.extend(extra);
    succeed(dir.path(), &args);
    files(dir.path()).into_iter().map(|f| (f.clone(), std::fs::read(dir.path().join(&f)).unwrap())).collect()
}

#[test]
fn threads_and_chunk_sizes_leave_no_trace() {
    for survey in ["forest/survey.xml", "room/survey.xml"] {
        let survey = fixture(survey);
        let reference = outputs(&survey, &["-j", "1"]);
        assert!(reference.len() >= 5, "outputs are missing: {:?}", reference.keys());
        assert!(reference.values().all(|bytes| !bytes.is_empty()));
        let settings: &[&[&str]] = &[
            &["-j", "2"],
            &["-j", "8"],
            &["-j", "2", "--chunk-size", "1"],
            &["-j", "8", "--chunk-size", "64", "--warehouse-factor", "1"],
            &["-j", "2", "--chunk-size", "4096"],
            &["-j", "1", "--chunk-size", "7", "--tree-jobs", "1"],
            &["-j", "2", "--tree-bins", "8"],
        ];
        for extra in settings {
            for (file, bytes) in outputs(&survey, extra) {
                assert!(reference.get(&file) == Some(&bytes), "{} differs with {extra:?}", file.display());
            }
        }
    }
}

#[test]
fn another_seed_gives_other_noise() {
    let survey = fixture("forest/survey.xml");
    let one = outputs(&survey, &[]);
    let dir = folder();
    let args = ["run", survey.to_str().unwrap(), "-q", "--seed", "12", "-o", "all.xyz"];
    succeed(dir.path(), &args);
    let other = std::fs::read(dir.path().join("all.xyz")).unwrap();
    assert!(
        !other.is_empty() && one[Path::new("all.xyz")] != other,
        "range noise does not depend on the seed"
    );
}
