//! `vlscan unzip`: expands compressed text.

use super::args::UnzipArgs;
use super::{Console, messages};
use std::io::{self, BufRead, BufReader};
use std::path::Path;
use vlscan_base::error::{Error, Result};
use vlscan_base::files::reads;
use vlscan_options::outputs::check_content;
use vlscan_session::output::unzip;

pub fn run(args: &UnzipArgs, console: &Console) -> Result<()> {
    check_content("OUT", &args.out, "TXT")?;
    let file: Box<dyn BufRead> = if is_stream(&args.file) {
        Box::new(io::stdin().lock())
    } else {
        let file = reads::open(&args.file).map_err(|e| Error::open(&args.file, e))?;
        Box::new(BufReader::new(file))
    };
    let out = (!is_stream(&args.out)).then_some(args.out.as_path());
    out.map_or(Ok(()), |out| reads::refuse_input_of(out, [&args.file]))?;
    let lines = unzip(&args.file, file, out, args.force)?;
    let file = messages::written(&args.out, "text");
    console
        .wrote(file, format!("{}  {lines} lines", out.map_or("stdout".into(), |p| p.display().to_string())));
    Ok(())
}

fn is_stream(path: &Path) -> bool {
    path.as_os_str() == "-"
}
