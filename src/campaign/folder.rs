//! The working directory of a process while a campaign is read or computed.

use std::path::{Path, PathBuf};
use vlscan_base::error::{Error, Result};

/// A working directory, which is left when this value is dropped.
pub struct WorkingFolder {
    before: Option<PathBuf>,
}

impl WorkingFolder {
    /// Makes a folder the working directory.
    ///
    /// # Errors
    /// [`Error::Io`].
    pub fn enter(folder: &Path) -> Result<WorkingFolder> {
        let before = std::env::current_dir().ok().filter(|before| before != folder);
        if before.is_some() {
            std::env::set_current_dir(folder).map_err(|e| Error::open(folder, e))?;
        }
        Ok(WorkingFolder { before })
    }
}

impl Drop for WorkingFolder {
    fn drop(&mut self) {
        if let Some(before) = &self.before {
            // It may have been removed meanwhile.
            let _ = std::env::set_current_dir(before);
        }
    }
}
