//! `vlscan info`: what a point cloud is.

use super::Console;
use super::args::CloudInfoArgs;
use super::watch::during;
use std::path::Path;
use vlscan_base::error::{Error, Result};
use vlscan_base::files::write_stdout;
use vlscan_base::recognise::{Expected, foreign_file};
use vlscan_tools::cloud::{CloudSource, cloud_facts};

pub fn run(args: &CloudInfoArgs, console: &Console) -> Result<()> {
    args.clouds.iter().try_for_each(|cloud| check_cloud(cloud))?;
    let read = || cloud_facts(&CloudSource::files(&args.clouds));
    let (facts, found) = during(console, "reading points", read)?;
    console.warnings(&found)?;
    if !args.json {
        return write_stdout(&facts.text());
    }
    let text = serde_json::to_string_pretty(&facts.json()).map_err(|e| Error::Internal(e.to_string()))?;
    write_stdout(&(text + "\n"))
}

/// Rejects files that are not point clouds and have another command.
pub(super) fn check_cloud(path: &Path) -> Result<()> {
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
