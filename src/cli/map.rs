//! `vlscan scene map`: a scene from above, and the coordinates of its pixels.

use super::args::MapArgs;
use super::watch::during;
use super::{Console, info, messages};
use std::path::Path;
use vlscan_base::error::{Error, Result};
use vlscan_base::files::{FileGroup, reads, refuse_unwritable};
use vlscan_base::quantity::number;
use vlscan_campaign::{NamedScene, scene_points};
use vlscan_session::LoadedScene;
use vlscan_tools::preview::Map;
use vlscan_trace::BuildOptions;

pub fn run(args: &MapArgs, console: &Console) -> Result<()> {
    if !args.out.extension().is_some_and(|e| e.eq_ignore_ascii_case("png")) {
        return Err(Error::input(format!("{}: expected a name that ends in .png", args.out.display())));
    }
    let place = args.out.with_extension("pgw");
    for path in [&args.out, &place] {
        refuse_unwritable(path, args.force)?;
        reads::refuse_input_of(path, [Path::new(&args.scene)])?;
    }
    let observer = console.listener();
    let name = NamedScene { name: &args.scene, assets: &args.assets };
    let (recipe, scanning, warnings) = name.recipe()?;
    console.warnings(&warnings)?;
    let options = info::options(&recipe, &scanning, false)?;
    let trees = BuildOptions::default();
    let points = during(console, "reading the scene", || {
        let loaded = LoadedScene::load(&recipe, &options, &trees, console.is_strict(), &observer.callback())?;
        observer.step("drawing the scene");
        scene_points(&loaded, Map::points(args.side), Path::new(&args.scene), &observer)
    })?;
    let map = Map::draw(&points, args.side).ok_or_else(|| {
        Error::input_with_help(
            format!("{} has no surfaces to draw", args.scene),
            "`vlscan scene info` lists the contents of a scene",
        )
    })?;
    let mut group = FileGroup::default();
    group.write(&args.out, args.force, &map.picture.png()?)?;
    group.write(&place, args.force, map.world_file().as_bytes())?;
    group.commit()?;
    let text = format!(
        "{}: {} m per pixel; {} contains its position",
        args.out.display(),
        number(map.pixel),
        place.display()
    );
    console.wrote(messages::written(&args.out, "picture"), text);
    console.record(|result| result.files.push(messages::written(&place, "world file")));
    Ok(())
}
