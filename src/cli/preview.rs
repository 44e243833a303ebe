//! `vlscan preview`: a picture of a point cloud, an interactive page, or the waveform of a pulse.

use super::Console;
use super::args::{Colour, PreviewArgs};
use super::sketch::survey_points;
use crate::options::holds_survey;
use crate::output::expand;
use std::io::{BufReader, BufWriter, IsTerminal, Seek, Write};
use std::path::Path;
use vlscan_base::diag::Diagnostics;
use vlscan_base::error::{Error, Result};
use vlscan_base::files::{FileWriter, Patched, reads, refuse_existing};
use vlscan_base::quantity::amount;
use vlscan_tools::preview::{
    Chart, ColourBy, PageOptions, Points, PreviewOptions, Wave, draw, read_packet, read_points, read_wave,
    write_page,
};

pub fn run(args: &PreviewArgs, console: &Console) -> Result<()> {
    check(args)?;
    if let Some(pulse) = args.pulse {
        return plot(args, pulse, console);
    }
    let is_survey = holds_survey(&args.points);
    let points = if is_survey { survey_points(args, console)? } else { read_cloud(&args.points, console)? };
    let usual = if is_survey { Colour::Leg } else { Colour::Height };
    let colour = match args.colour.unwrap_or(usual) {
        Colour::Height => ColourBy::Height,
        Colour::Class => ColourBy::Class,
        Colour::Intensity => ColourBy::Intensity,
        Colour::Object => ColourBy::Object,
        Colour::Return => ColourBy::Return,
        Colour::Leg => ColourBy::Leg,
        Colour::Channel => ColourBy::Channel,
        Colour::Time => ColourBy::Time,
    };
    console.warnings(&points.doubts_of_colours(&args.points, colour))?;
    let title = title(&args.points);
    let count = amount(points.total() as f64);
    if !is_page(&args.out) {
        let (width, height) = (args.width, args.height);
        let options =
            PreviewOptions { colour, width, height, light: args.light, title, ..PreviewOptions::default() };
        let picture = draw(&points, &options).png()?;
        write(args, |out| out.write_all(&picture))?;
        console.say(format!("{}: {count} points", args.out.display()));
        return Ok(());
    }
    let options = PageOptions {
        colour,
        light: args.light,
        title,
        max_points: usize::try_from(args.most_points.0).unwrap_or(usize::MAX),
    };
    let page = write(args, |out| write_page(&points, &options, out))?;
    let sampled = if page.shown < page.total {
        format!("{} of {count} points, evenly chosen (--most-points)", amount(page.shown as f64))
    } else {
        format!("{count} points")
    };
    console.say(format!("{}: {sampled}; open it in a browser", args.out.display()));
    Ok(())
}

/// Reads points, and tells what there is to say of their file.
pub(super) fn read_cloud(path: &Path, console: &Console) -> Result<Points> {
    let (points, found) = read_points(path)?;
    console.warnings(&found)?;
    Ok(points)
}

fn plot(args: &PreviewArgs, pulse: u64, console: &Console) -> Result<()> {
    let wave = waveform(&args.points, pulse)?;
    let chart = Chart::new(&wave, &title(&args.points), args.width, args.height);
    let content = if is_page(&args.out) { chart.page().into_bytes() } else { chart.picture().png()? };
    write(args, |out| out.write_all(&content))?;
    console.say(format!("{}: pulse {pulse}, {} samples", args.out.display(), wave.samples.len()));
    Ok(())
}

fn waveform(path: &Path, pulse: u64) -> Result<Wave> {
    if is_stdout(path) {
        return read_wave(std::io::stdin().lock(), Path::new("<stdin>"), pulse);
    }
    if path.extension().is_some_and(|e| e.eq_ignore_ascii_case("las") || e.eq_ignore_ascii_case("laz")) {
        return read_packet(path, pulse);
    }
    let file = reads::open(path).map_err(|e| Error::open(path, e))?;
    if path.extension().is_none_or(|e| !e.eq_ignore_ascii_case("bin")) {
        return read_wave(file, path, pulse);
    }
    let mut text = FileWriter::scratch()?;
    expand(path, BufReader::new(file), |bytes| text.append(bytes))?;
    text.rewind().map_err(|e| text.failed("read", e))?;
    read_wave(text, path, pulse)
}

fn check(args: &PreviewArgs) -> Result<()> {
    let (points, out) = (&args.points, &args.out);
    if points.is_dir() {
        return Err(Error::input(format!("{} is a folder; name a file of points in it", points.display())));
    }
    let is_xml = points.extension().is_some_and(|e| e.eq_ignore_ascii_case("xml"));
    if (is_xml && !holds_survey(points)) || (args.pulse.is_some() && holds_survey(points)) {
        let what = if args.pulse.is_some() { "pulses" } else { "points and no survey" };
        let mut problems = Diagnostics::default();
        problems
            .error(None, format!("{} holds no {what}", points.display()))
            .help("name points, or a survey whose points are to be drawn; a scene by itself is described by `vlscan scene info`");
        return Err(Error::Input(Box::new(problems)));
    }
    if is_stdout(out) {
        if std::io::stdout().is_terminal() && !args.force {
            return Err(Error::input(
                "a picture is not written to a terminal; --force does it, -o NAME.png makes a file",
            ));
        }
        return Ok(());
    }
    refuse_existing(out, args.force)?;
    reads::refuse_input_of(out, [points])?;
    let ending = out.extension().map(|e| e.to_string_lossy().to_ascii_lowercase());
    if is_page(out) || ending.as_deref() == Some("png") {
        return Ok(());
    }
    Err(Error::input(format!("{}: expected a name that ends in .png or .html", out.display())))
}

fn is_stdout(path: &Path) -> bool {
    path.as_os_str() == "-"
}

fn is_page(path: &Path) -> bool {
    path.extension().is_some_and(|e| e.eq_ignore_ascii_case("html") || e.eq_ignore_ascii_case("htm"))
}

fn title(points: &Path) -> String {
    if is_stdout(points) { String::new() } else { points.display().to_string() }
}

/// Writes the picture or page.
fn write<T>(args: &PreviewArgs, content: impl FnOnce(&mut dyn Write) -> std::io::Result<T>) -> Result<T> {
    let file = match is_stdout(&args.out) {
        true => FileWriter::stdout(Patched::Never)?,
        false => FileWriter::create(&args.out, args.force, Patched::Never)?,
    };
    let mut out = BufWriter::new(file);
    let written = content(&mut out).and_then(|written| out.flush().map(|()| written));
    let written = written.map_err(|e| out.get_ref().failed("write", e))?;
    out.into_parts().0.finish().map(|_| written)
}
