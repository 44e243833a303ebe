//! `vlscan preview`: a picture of a point cloud.

use super::Console;
use super::args::{Colour, PreviewArgs};
use super::watch::amount;
use crate::error::{Error, Result};
use crate::preview::{ColourBy, PreviewOptions, draw, read_points};

/// Runs `vlscan preview`.
pub fn run(args: &PreviewArgs, console: &Console) -> Result<()> {
    let to_stdout = args.out.as_os_str() == "-";
    if !to_stdout && args.out.exists() && !args.force {
        return Err(Error::input(format!("{} exists already; --force overwrites it", args.out.display())));
    }
    let points = read_points(&args.points)?;
    let colour = match args.colour {
        Colour::Height => ColourBy::Height,
        Colour::Class => ColourBy::Class,
        Colour::Intensity => ColourBy::Intensity,
        Colour::Object => ColourBy::Object,
        Colour::Return => ColourBy::Return,
    };
    let title =
        if args.points.as_os_str() == "-" { String::new() } else { args.points.display().to_string() };
    let options =
        PreviewOptions { colour, width: args.width, height: args.height, title, ..PreviewOptions::default() };
    let picture = draw(&points, &options);
    picture.write_png(&args.out)?;
    console.say(format!("{}: {} points", args.out.display(), amount(points.len() as f64)));
    Ok(())
}
