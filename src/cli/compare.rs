//! `vlscan compare`: what two point clouds of one place have in common, and what not.

use super::args::CompareArgs;
use super::cloud_info::stdin_twice;
use super::coverage::has_extension;
use super::preview::read_cloud;
use super::watch::during;
use super::{Console, messages};
use std::path::Path;
use vlscan_base::error::{Error, Result};
use vlscan_base::files::{FileGroup, reads, refuse_unwritable, write_stdout};
use vlscan_base::quantity::amount;
use vlscan_formats::PointFormat;
use vlscan_tools::cloud::read_within;
use vlscan_tools::compare::{changed_points, compare, compared_attributes, json, page, table, write_changed};

pub fn run(args: &CompareArgs, console: &Console) -> Result<()> {
    check(args)?;
    let observer = console.listener();
    let max_bytes = args.memory.of_each(2);
    let read = |path: &Path| read_within(path, Some(compared_attributes()), max_bytes);
    let [first, second] = [&args.first, &args.second].map(|path| read_cloud(path, console, read));
    let (first, second) = (first?, second?);
    let names = [&args.first, &args.second].map(|path| path.display().to_string());
    let clouds = [(names[0].as_str(), &first), (names[1].as_str(), &second)];
    let comparison = during(console, "comparing the clouds", || compare(clouds, &args.options, &observer))?;
    let (mut group, mut written) = (FileGroup::default(), Vec::new());
    if let Some(path) = &args.page {
        let page = during(console, "drawing the page", || page(&comparison, [&first, &second]))?;
        group.write(path, args.force, page.as_bytes())?;
        written.push((messages::written(path, "page"), format!("{}: open it in a browser", path.display())));
    }
    if let Some(path) = &args.change {
        let raster = comparison.change.map.geotiff(comparison.crs.as_deref())?;
        group.write(path, args.force, &raster)?;
        let system = match comparison.crs.as_deref().and_then(vlscan_crs::projected_epsg) {
            Some(code) => format!("EPSG:{code}"),
            None => "no coordinate system: the clouds name none with an EPSG code".to_owned(),
        };
        let text = format!("{}: {} cells, {system}", path.display(), comparison.change.cells);
        written.push((messages::written(path, "raster"), text));
    }
    if let Some(path) = &args.changed {
        let find = || changed_points([&first, &second], args.options.cell);
        let changed = during(console, "looking for changed points", find)?;
        write_changed(path, args.force, [&first, &second], &changed, &observer, &mut group)?;
        let [new, gone] = [&changed.new, &changed.gone].map(|points| amount(points.len() as f64));
        let text = format!("{}: {new} new and {gone} gone points", path.display());
        written.push((messages::written(path, "points"), text));
    }
    group.commit()?;
    written.into_iter().for_each(|(file, line)| console.wrote(file, line));
    match args.json {
        true => write_stdout(&(json(&comparison)? + "\n")),
        false => write_stdout(&table(&comparison)),
    }
}

/// Refuses files that would replace others, names of no format, and standard input as both clouds, before
/// anything is read.
fn check(args: &CompareArgs) -> Result<()> {
    if [&args.first, &args.second].iter().all(|path| path.as_os_str() == "-") {
        return Err(stdin_twice());
    }
    let outputs: Vec<&Path> =
        [&args.page, &args.change, &args.changed].into_iter().flatten().map(|p| &**p).collect();
    for (i, path) in outputs.iter().enumerate() {
        refuse_unwritable(path, args.force)?;
        reads::refuse_input_of(path, [&args.first, &args.second])?;
        if outputs[..i].contains(path) {
            return Err(Error::input(format!("{}: two outputs have the same name", path.display())));
        }
    }
    for (option, path, endings) in
        [("page", &args.page, ["html", "htm"]), ("change", &args.change, ["tif", "tiff"])]
    {
        if let Some(path) = path
            && !has_extension(path, &endings)
        {
            let (shown, ending) = (path.display(), endings[0]);
            return Err(Error::input(format!("--{option} {shown}: expected a name that ends in .{ending}")));
        }
    }
    if let Some(path) = &args.changed
        && let Err(unknown) = PointFormat::required(path)
    {
        return Err(Error::input(format!("--changed {}: {unknown}", path.display())));
    }
    Ok(())
}
