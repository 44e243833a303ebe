//! `vlscan unzip`: expands compressed text.

use super::Console;
use super::args::UnzipArgs;
use crate::error::{Error, Result};
use crate::files::identity;
use crate::output::unzip;
use std::fs::File;
use std::io::{self, BufRead, BufReader};
use std::path::Path;

pub fn run(args: &UnzipArgs, console: &Console) -> Result<()> {
    let file: Box<dyn BufRead> = if is_stream(&args.file) {
        Box::new(io::stdin().lock())
    } else {
        let file = File::open(&args.file).map_err(|e| Error::open(&args.file, e))?;
        Box::new(BufReader::new(file))
    };
    let out = (!is_stream(&args.out)).then_some(args.out.as_path());
    if out.is_some_and(|out| out.is_file() && identity(out) == identity(&args.file)) {
        return Err(Error::input(format!(
            "{} is the compressed file, expected another name",
            args.out.display()
        )));
    }
    let lines = unzip(&args.file, file, out, args.force)?;
    console.say(format!("{}  {lines} lines", out.map_or("stdout".into(), |p| p.display().to_string())));
    Ok(())
}

fn is_stream(path: &Path) -> bool {
    path.as_os_str() == "-"
}
