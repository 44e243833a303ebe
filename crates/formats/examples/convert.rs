//! Converts a cloud to the format that the extension of the second file names: `cargo run -p vlscan-formats
//! --example convert -- cloud.laz cloud.parquet`.

use std::path::Path;
use vlscan_base::{Error, Result};
use vlscan_formats::{CloudSettings, copy};

fn main() -> Result<()> {
    let mut paths = std::env::args().skip(1);
    let (Some(from), Some(to)) = (paths.next(), paths.next()) else {
        return Err(Error::input("usage: convert FROM TO"));
    };
    let (tally, warnings) = copy(Path::new(&from), Path::new(&to), &CloudSettings::default())?;
    eprint!("{}", warnings.text());
    println!("{} points in {to}", tally.records);
    Ok(())
}
