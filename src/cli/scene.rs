//! `vlscan scene`: scenes that are made, and information on scenes.

use super::args::{MakeArgs, ReconstructArgs, SceneArgs, SceneCommand, StandArgs};
use super::watch::during;
use super::{Console, info, map, messages, pack};
use vlscan_base::error::Result;
use vlscan_base::quantity::{amount, fixed, metres};
use vlscan_fit::scene;
use vlscan_options::outputs::check_folder;
use vlscan_tools::generate::{make_stand, write_scene};

pub fn run(args: &SceneArgs, console: &Console) -> Result<()> {
    match &args.command {
        SceneCommand::Make(args) => make(args, console),
        SceneCommand::Stand(args) => stand(args, console),
        SceneCommand::Reconstruct(args) => reconstruct(args, console),
        SceneCommand::Info(args) => info::run(args, console),
        SceneCommand::Map(args) => map::run(args, console),
        SceneCommand::Pack(args) => pack::run(args, console),
    }
}

fn make(args: &MakeArgs, console: &Console) -> Result<()> {
    check_folder("-o", &args.out)?;
    let made = during(console, "making the scene", || write_scene(&args.options, &args.out))?;
    let text = format!(
        "{} triangles{} in {}; scan them ({} pulses) with: vlscan run {}",
        amount(made.triangles as f64),
        if made.voxels > 0 { format!(" and {} voxels", amount(made.voxels as f64)) } else { String::new() },
        args.out.display(),
        amount(made.pulses as f64),
        made.survey.display()
    );
    console.wrote(messages::written(&args.out, "scene"), text);
    console.record(|result| result.files.push(messages::written(&made.survey, "survey")));
    Ok(())
}

fn stand(args: &StandArgs, console: &Console) -> Result<()> {
    check_folder("-o", &args.out)?;
    let make = || make_stand(&args.options, &args.out, &|_| true, &console.listener());
    let made = during(console, "making the stand", make)?;
    let counts: Vec<String> = made.trees.iter().map(usize::to_string).collect();
    let text = format!(
        "{}: {} trees of {} models{}; scan them with: vlscan run SURVEY --scene {0}",
        made.scene.display(),
        counts.join(", "),
        made.models,
        if counts.len() > 1 { " in the epochs stand_0, stand_1 …" } else { "" },
    );
    console.wrote(messages::written(&made.scene, "scene"), text);
    Ok(())
}

fn reconstruct(args: &ReconstructArgs, console: &Console) -> Result<()> {
    check_folder("-o", &args.out)?;
    let options = &args.options;
    let work = || scene::reconstruct(options, &console.listener());
    let found = during(console, "reading the cloud", work)?;
    let pipeline = found.write(&args.out, options.overwrite)?;
    let receiver = &found.receiver;
    for path in &found.paths {
        console.say(format!(
            "line {}: instrument found by {} (points {} away on average)",
            path.source,
            path.found_by.phrase(),
            metres(found.mean_range)
        ));
    }
    console.say(format!(
        "{} pulses: terrain with a spread of {:.3} m, {} m² of roofs, {} voxels with {} m² of leaves in \
         elements of {:.2} m",
        amount(found.pulses as f64),
        found.terrain.spread,
        fixed(found.roofs.cells as f64 * found.roofs.cell.powi(2), 0),
        amount(found.foliage.voxels.len() as f64),
        fixed(found.foliage.leaf_area(), 0),
        receiver.element_size,
    ));
    let text = format!(
        "{}: trace pulses through it with: vlscan trace --scanner {} PULSES -o points.laz",
        args.out.display(),
        pipeline.display()
    );
    console.wrote(messages::written(&args.out, "scene"), text);
    console.record(|result| result.files.push(messages::written(&pipeline, "pipeline")));
    Ok(())
}
