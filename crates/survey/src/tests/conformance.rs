//! Every survey of the conformance suite is read without an error.

use super::*;

/// The folder of the suite, if this machine has it.
fn suite() -> Option<PathBuf> {
    let named = std::env::var_os("VLSCAN_CONFORMANCE").map(PathBuf::from);
    let beside = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/conformance");
    named.into_iter().chain([beside]).find(|p| p.is_dir())
}

#[test]
fn surveys_of_the_conformance_suite() {
    let Some(suite) = suite() else {
        println!("skipped: the conformance suite is not here (set VLSCAN_CONFORMANCE)");
        return;
    };
    let mut count = 0;
    for case in suite.read_dir().unwrap().flatten() {
        let path = case.path().join("survey.xml");
        if !path.exists() {
            continue;
        }
        let options = ReadOptions { assets: vec![case.path()], ..ReadOptions::default() };
        match read_survey(&path, &options) {
            Err(Error::Input(problems) | Error::Limits(problems)) => {
                panic!("{}\n{}", path.display(), problems.render(false))
            }
            Err(e) => panic!("{}: {e}", path.display()),
            Ok((survey, warnings)) => {
                println!("{}", warnings.render(false));
                assert!(!survey.legs.is_empty() && !survey.scene.parts.is_empty(), "{}", path.display());
            }
        }
        count += 1;
    }
    assert_eq!(count, 40);
}

#[test]
fn surveys_of_the_fixtures() {
    for case in ["forest", "terrain", "room"] {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../fixtures").join(case).join("survey.xml");
        let (survey, warnings) =
            read_survey(&path, &ReadOptions::default()).unwrap_or_else(|e| panic!("{}", report(&e)));
        assert!(warnings.is_empty(), "{}", warnings.render(false));
        assert_eq!(survey.scene.id, case);
    }
}
