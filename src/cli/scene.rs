//! `vlscan scene`: generated scenes, and information on scenes.

use super::args::{MakeArgs, SceneArgs, SceneCommand, SceneKind};
use super::{Console, info, pack, stand};
use vlscan_base::error::Result;
use vlscan_base::quantity::amount;
use vlscan_tools::generate::{Kind, SceneOptions, write_scene};

pub fn run(args: &SceneArgs, console: &Console) -> Result<()> {
    match &args.command {
        SceneCommand::Make(args) => make_scene(args, console),
        SceneCommand::Stand(args) => stand::run(args, console),
        SceneCommand::Info(args) => info::run(args, console),
        SceneCommand::Pack(args) => pack::run(args, console),
    }
}

fn make_scene(args: &MakeArgs, console: &Console) -> Result<()> {
    let kind = match args.kind {
        SceneKind::Forest => Kind::Forest,
        SceneKind::Terrain => Kind::Terrain,
        SceneKind::Room => Kind::Room,
    };
    let options = SceneOptions {
        kind,
        triangles: args.triangles.0,
        seed: args.seed,
        extent_m: args.extent,
        pulses: args.pulses.map(|count| count.0),
        separate_trees: args.separate_trees,
        instances: args.models.map(|models| (models, args.copies.unwrap_or(100))),
        voxels: args.voxels.map(|count| count.0),
        overwrite: args.force,
    };
    let made = write_scene(&options, &args.out)?;
    console.say(format!(
        "{} triangles{} in {}; scan them ({} pulses) with: vlscan run {}",
        amount(made.triangles as f64),
        if made.voxels > 0 { format!(" and {} voxels", amount(made.voxels as f64)) } else { String::new() },
        args.out.display(),
        amount(made.pulses as f64),
        made.survey.display()
    ));
    Ok(())
}
