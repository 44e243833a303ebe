//! The forest scenes.

use vlscan::scene::{LoadOptions, load};
use vlscan::tools::generate::{SceneKind, SceneOptions, write_scene};
use vlscan::trace::Geometry;
use vlscan::{ReadOptions, read_survey};

/// Makes the forest of `vlscan scene make forest -n SIZE` and loads it as a run does.
pub fn forest(size: &str) -> Geometry {
    let triangles = match size.strip_suffix('M') {
        Some(millions) => millions.parse().map(|n: f64| (n * 1e6) as u64),
        None => size.parse().map(|n: f64| n as u64),
    };
    let triangles = triangles.unwrap_or_else(|e| panic!("{size} is no number of triangles: {e}"));
    let folder = tempfile::tempdir().expect("a place for the scene");
    let made = write_scene(&SceneOptions::new(SceneKind::Forest, triangles), folder.path());
    let survey = made.and_then(|made| read_survey(&made.survey, &ReadOptions::default()));
    let scene = survey.and_then(|(survey, _)| load(&survey.scene, &LoadOptions::default()));
    scene.unwrap_or_else(|e| panic!("the forest cannot be made: {e}")).0.geometry
}
