//! The `.prj` file beside a raster: its system of coordinates as text.

use std::path::Path;
use vlscan_base::files::reads;
use vlscan_tables::input::read_file;

/// Maximum size of a `.prj` file, bytes.
const MAX_PRJ_BYTES: u64 = 1 << 16;

/// The text of the `.prj` file beside a raster.
pub(super) fn prj_text(path: &Path) -> Option<String> {
    let files = ["prj", "PRJ"].map(|ending| path.with_extension(ending));
    let prj = files.into_iter().find(|prj| reads::is_file(prj))?;
    let bytes = read_file(&prj, MAX_PRJ_BYTES).ok()?;
    Some(String::from_utf8_lossy(&bytes).trim_start_matches('\u{feff}').to_owned())
}
