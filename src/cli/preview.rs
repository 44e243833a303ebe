//! `vlscan preview`: a picture of a point cloud, an interactive page, a copy for viewers, or the waveform of
//! a pulse.

use super::args::PreviewArgs;
use super::watch::during;
use super::{Console, interrupt, messages};
use std::io::{BufReader, BufWriter, IsTerminal, Seek, Write};
use std::path::Path;
use vlscan_base::diag::{Diagnostics, Place};
use vlscan_base::error::{Error, Result};
use vlscan_base::files::{FileWriter, Patched, means_stdout, reads, refuse_unwritable};
use vlscan_base::quantity::{amount, amount_of};
use vlscan_campaign::SurveySketch;
use vlscan_options::holds_survey;
use vlscan_session::output::expand;
use vlscan_tools::cloud::{Points, Wave, read_packet, read_wave, read_within};
use vlscan_tools::preview::{Chart, ColourBy, Picture, PreviewOptions, draw, write_octree, write_page};

pub fn run(args: &PreviewArgs, console: &Console) -> Result<()> {
    check(args)?;
    if let Some(pulse) = args.pulse {
        warn_of_unused(args, false, console)?;
        return plot(args, pulse, console);
    }
    let is_survey = holds_survey(&args.points);
    warn_of_unused(args, is_survey, console)?;
    if is_octree(&args.out) {
        let write = || write_octree(&args.points, &args.out, args.force, &console.listener());
        let count = during(console, "dividing the points", write)?;
        let text = format!("{}: {}", args.out.display(), amount_of(count as f64, "point"));
        console.wrote(messages::written(&args.out, "points"), text);
        return Ok(());
    }
    let options = PreviewOptions {
        colour: args.colour.unwrap_or(if is_survey { ColourBy::Leg } else { ColourBy::Height }),
        width: args.width,
        height: args.height,
        light: args.light,
        title: title(&args.points),
        max_points: usize::try_from(args.max_points.0).unwrap_or(usize::MAX),
        heights: None,
    };
    if is_survey {
        return survey(args, &options, console);
    }
    // A page offers all colours.
    let needs_all = is_page(&args.out) || options.colour == ColourBy::Rgb;
    let attributes = (!needs_all).then(|| options.colour.attributes());
    let read = |path: &Path| read_within(path, attributes, args.memory.of_each(1));
    let points = read_cloud(&args.points, console, read)?;
    console.warnings(&options.colour.doubts(&points, &args.points))?;
    match is_page(&args.out) {
        true => page(args, &points, &options, console),
        false => {
            let drawn = during(console, "drawing the picture", || draw(&points, &options));
            picture(args, &points, &drawn, console)
        }
    }
}

/// Draws a survey before it is flown.
fn survey(args: &PreviewArgs, options: &PreviewOptions, console: &Console) -> Result<()> {
    let sketch = during(console, "flying the survey", || {
        SurveySketch::of_file(&args.points, &args.assets, &console.listener(), &interrupt::STOP)
    })?;
    if is_page(&args.out) {
        let points = sketch.into_points();
        console.warnings(&options.colour.doubts(&points, &args.points))?;
        return page(args, &points, options, console);
    }
    // Instead of legs, pictures show the density of pulses.
    if options.colour != ColourBy::Leg {
        console.warnings(&options.colour.doubts(sketch.points(), &args.points))?;
    }
    picture(args, sketch.points(), &sketch.picture(options), console)
}

/// Writes a picture of points.
fn picture(args: &PreviewArgs, points: &Points, picture: &Picture, console: &Console) -> Result<()> {
    let bytes = picture.png()?;
    write(args, |out| out.write_all(&bytes))?;
    let text = format!("{}: {}", args.out.display(), amount_of(points.total() as f64, "point"));
    console.wrote(messages::written(&args.out, "picture"), text);
    Ok(())
}

/// Writes a page of points.
fn page(args: &PreviewArgs, points: &Points, options: &PreviewOptions, console: &Console) -> Result<()> {
    let work = || write(args, |out| write_page(points, options, out));
    let page = during(console, "writing the page", work)?;
    let count = amount_of(points.total() as f64, "point");
    let sampled = if page.shown < page.total {
        format!("{} of {count}, evenly chosen (--max-points)", amount(page.shown as f64))
    } else {
        count
    };
    let text = format!("{}: {sampled}; open it in a browser", args.out.display());
    console.wrote(messages::written(&args.out, "page"), text);
    Ok(())
}

/// Reads points by `read`, and reports remarks about their file.
pub(super) fn read_cloud(
    path: &Path,
    console: &Console,
    read: impl FnOnce(&Path) -> Result<(Points, Diagnostics)>,
) -> Result<Points> {
    let (points, found) = during(console, "reading points", || read(path))?;
    console.warnings(&found)?;
    Ok(points)
}

fn plot(args: &PreviewArgs, pulse: u64, console: &Console) -> Result<()> {
    let wave = waveform(&args.points, pulse)?;
    let chart = Chart::new(&wave, &title(&args.points), args.width, args.height);
    let content = if is_page(&args.out) { chart.page().into_bytes() } else { chart.picture().png()? };
    write(args, |out| out.write_all(&content))?;
    let text = format!("{}: pulse {pulse}, {} samples", args.out.display(), wave.samples.len());
    let content = if is_page(&args.out) { "page" } else { "picture" };
    console.wrote(messages::written(&args.out, content), text);
    Ok(())
}

fn waveform(path: &Path, pulse: u64) -> Result<Wave> {
    if means_stdout(path) {
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
        return Err(Error::input(format!("{} is a folder; name a file of points", points.display())));
    }
    let is_xml = points.extension().is_some_and(|e| e.eq_ignore_ascii_case("xml"));
    if (is_xml && !holds_survey(points)) || (args.pulse.is_some() && holds_survey(points)) {
        let what = if args.pulse.is_some() { "pulses" } else { "points and no survey" };
        return Err(Error::input_with_help(
            format!("{} contains no {what}", points.display()),
            "name a file of points, a survey or a pipeline; `vlscan scene info` describes a scene",
        ));
    }
    if means_stdout(out) {
        if std::io::stdout().is_terminal() && !args.force {
            return Err(Error::input("a picture is not written to a terminal: use -o NAME.png, or --force"));
        }
        return Ok(());
    }
    refuse_unwritable(out, args.force)?;
    reads::refuse_input_of(out, [points])?;
    if is_octree(out) {
        let refused =
            |what: &str| Err(Error::input(format!("{}: COPC holds points, no {what}", out.display())));
        return match (args.pulse.is_some(), holds_survey(points)) {
            (true, _) => refused("waveforms; name a file .png or .html"),
            (_, true) => refused("surveys; name a file .png or .html, or a cloud"),
            _ => Ok(()),
        };
    }
    let ending = out.extension().map(|e| e.to_string_lossy().to_ascii_lowercase());
    if is_page(out) || ending.as_deref() == Some("png") {
        return Ok(());
    }
    Err(Error::input(format!("{}: expected a name that ends in .png, .html or .copc.laz", out.display())))
}

/// Warns of options that the output has no use for.
fn warn_of_unused(args: &PreviewArgs, is_survey: bool, console: &Console) -> Result<()> {
    let (is_page, is_octree, is_wave) = (is_page(&args.out), is_octree(&args.out), args.pulse.is_some());
    let has_colours = !is_octree && !is_wave;
    let has_size = is_wave || !is_page && !is_octree;
    let options = [
        ("--colour", args.colour.is_some(), has_colours),
        ("--light", args.light, has_colours),
        ("--width", args.width != PreviewArgs::WIDTH, has_size),
        ("--height", args.height != PreviewArgs::HEIGHT, has_size),
        ("--max-points", args.max_points.0 != PreviewArgs::PAGE_POINTS, is_page && !is_wave),
        ("--assets", !args.assets.is_empty(), is_survey),
    ];
    let unused = options.into_iter().filter(|(_, is_given, is_used)| *is_given && !is_used);
    let unused: Vec<&str> = unused.map(|(option, ..)| option).collect();
    let mut found = Diagnostics::default();
    if !unused.is_empty() {
        let place = Place::of_file(&args.out);
        found.warn(Some(place), format!("no effect on this output: {}", unused.join(", "))).help(
            "--width and --height are for pictures, --max-points for pages, --colour and --light for both, \
             --assets for surveys",
        );
    }
    console.warnings(&found)
}

fn is_page(path: &Path) -> bool {
    path.extension().is_some_and(|e| e.eq_ignore_ascii_case("html") || e.eq_ignore_ascii_case("htm"))
}

fn is_octree(path: &Path) -> bool {
    path.to_string_lossy().to_ascii_lowercase().ends_with(".copc.laz")
}

fn title(points: &Path) -> String {
    if means_stdout(points) { String::new() } else { points.display().to_string() }
}

/// Writes the picture or page.
fn write<T>(args: &PreviewArgs, content: impl FnOnce(&mut dyn Write) -> std::io::Result<T>) -> Result<T> {
    let file = match means_stdout(&args.out) {
        true => FileWriter::stdout(Patched::Never)?,
        false => FileWriter::create(&args.out, args.force, Patched::Never)?,
    };
    let mut out = BufWriter::new(file);
    let written = content(&mut out).and_then(|written| out.flush().map(|()| written));
    let written = written.map_err(|e| out.get_ref().failed("write", e))?;
    out.into_parts().0.finish().map(|_| written)
}
