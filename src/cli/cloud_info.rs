//! `vlscan info`: what a point cloud is.

use super::Console;
use super::args::CloudInfoArgs;
use super::watch::during;
use std::collections::HashSet;
use std::path::{Path, PathBuf};
use vlscan_base::diag::{Diagnostics, Place};
use vlscan_base::error::{Error, Result};
use vlscan_base::files::{identity, write_stdout};
use vlscan_base::recognise::{Expected, foreign_file};
use vlscan_tools::cloud::{CloudSource, cloud_facts};

pub fn run(args: &CloudInfoArgs, console: &Console) -> Result<()> {
    check_clouds(&args.clouds, console)?;
    let read = || cloud_facts(&CloudSource::files(&args.clouds));
    let (facts, found) = during(console, "reading points", read)?;
    console.warnings(&found)?;
    if !args.json {
        return write_stdout(&facts.text());
    }
    let text = serde_json::to_string_pretty(&facts.json()).map_err(|e| Error::Internal(e.to_string()))?;
    write_stdout(&(text + "\n"))
}

/// Rejects files that are not point clouds, and standard input named twice; warns of files named twice.
pub(super) fn check_clouds(clouds: &[PathBuf], console: &Console) -> Result<()> {
    let (mut seen, mut found) = (HashSet::new(), Diagnostics::default());
    for cloud in clouds {
        check_cloud(cloud)?;
        let is_stdin = cloud.as_os_str() == "-";
        if seen.insert(if is_stdin { cloud.clone() } else { identity(cloud) }) {
            continue;
        }
        if is_stdin {
            return Err(stdin_twice());
        }
        found.warn(Some(Place::of_file(cloud)), "the file is named twice, so that its points count twice");
    }
    console.warnings(&found)
}

/// The error of standard input as two inputs.
pub(super) fn stdin_twice() -> Error {
    Error::input_with_help(
        "- is named twice, but standard input can be read only once",
        "write the points to a file first, and name it",
    )
}

/// Rejects files that are not point clouds and have another command.
fn check_cloud(path: &Path) -> Result<()> {
    if path.is_dir() {
        return Err(Error::input(format!("{} is a folder; name files of points", path.display())));
    }
    let ending = path.extension().unwrap_or_default().to_string_lossy().to_ascii_lowercase();
    if ["xml", "toml", "obj", "gltf", "glb", "stl", "tif", "tiff", "vrt", "vox", "vlscene"]
        .contains(&&*ending)
    {
        if let Some(found) = foreign_file(path, &Expected::POINTS) {
            return Err(found.error(path));
        }
        return Err(Error::input_with_help(
            format!("{} is no point cloud", path.display()),
            format!("describe a scene with: vlscan scene info {}", path.display()),
        ));
    }
    Ok(())
}
