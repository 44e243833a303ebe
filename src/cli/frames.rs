//! `vlscan frames`: frames of MCAP in the layouts of KITTI and nuScenes.

use super::args::FramesArgs;
use super::watch::during;
use super::{Console, messages};
use std::io::{BufReader, Read};
use std::path::Path;
use vlscan_base::diag::Diagnostics;
use vlscan_base::error::{Error, Result};
use vlscan_base::files::reads;
use vlscan_base::quantity::{amount_of, counted};
use vlscan_tools::frames::{FrameLayout, write_frames};

pub fn run(args: &FramesArgs, console: &Console) -> Result<()> {
    if args.options.sequence != 0 && args.options.layout != FrameLayout::Kitti {
        let mut found = Diagnostics::default();
        found.warn(None, "--sequence has no effect: it is for --layout kitti");
        console.warnings(&found)?;
    }
    let is_stdin = args.points.as_os_str() == "-";
    let (name, source): (&Path, Box<dyn Read>) = match is_stdin {
        true => (Path::new("<stdin>"), Box::new(std::io::stdin().lock())),
        false => {
            let file = reads::open(&args.points).map_err(|e| Error::open(&args.points, e))?;
            (&args.points, Box::new(file))
        }
    };
    let mut source = BufReader::with_capacity(1 << 20, source);
    let observer = console.listener();
    let write = || write_frames(&mut source, name, &args.out, &args.options, &observer);
    let counts = during(console, "writing frames", write)?;
    let (frames, points) = (counted(counts.frames, "frame"), amount_of(counts.points as f64, "point"));
    let boxes = match (&args.options.objects.objects, counts.boxes) {
        (None, _) => String::new(),
        (_, 1) => ", 1 box".to_owned(),
        (_, count) => format!(", {count} boxes"),
    };
    let text = format!("{}: {frames}, {points}{boxes}", args.out.display());
    console.wrote(messages::written(&args.out, "frames"), text);
    Ok(())
}
