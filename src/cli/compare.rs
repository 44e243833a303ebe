//! `vlscan compare`: what two point clouds of one place have in common.

use super::Console;
use super::args::CompareArgs;
use super::preview::read_cloud;
use vlscan_base::error::{Error, Result};
use vlscan_base::files::{FileWriter, Patched, reads, refuse_existing, write_stdout};
use vlscan_tools::compare::{compare, json, page, table};

pub fn run(args: &CompareArgs, console: &Console) -> Result<()> {
    args.page.as_deref().map_or(Ok(()), |page| refuse_existing(page, args.force))?;
    args.page.as_deref().map_or(Ok(()), |page| reads::refuse_input_of(page, [&args.first, &args.second]))?;
    let [first, second] = [&args.first, &args.second].map(|path| read_cloud(path, console));
    let (first, second) = (first?, second?);
    let names = [&args.first, &args.second].map(|path| path.display().to_string());
    let comparison =
        compare([(&names[0], &first), (&names[1], &second)], &args.options).map_err(Error::input)?;
    if let Some(path) = &args.page {
        let mut file = FileWriter::create(path, args.force, Patched::Never)?;
        file.append(page(&comparison, [&first, &second])?.as_bytes())?;
        file.finish()?;
        console.say(format!("{}: open it in a browser", path.display()));
    }
    match args.json {
        true => write_stdout(&(json(&comparison)? + "\n")),
        false => write_stdout(&table(&comparison)),
    }
}
