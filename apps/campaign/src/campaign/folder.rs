//! The working directory of a process while a campaign is read or computed.

use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use vlscan_base::error::{Error, Result};

/// True if a campaign has the working directory. A process has one, so that two campaigns would take each
/// other's files.
static IS_TAKEN: AtomicBool = AtomicBool::new(false);

/// A working directory, which is left when this value is dropped.
pub struct WorkingFolder {
    before: Option<PathBuf>,
}

impl WorkingFolder {
    /// Makes a folder the working directory.
    ///
    /// # Errors
    /// [`Error::Input`] while another campaign has the working directory; [`Error::Io`].
    pub fn enter(folder: &Path) -> Result<WorkingFolder> {
        if IS_TAKEN.swap(true, Ordering::AcqRel) {
            return Err(Error::input_with_help(
                "another campaign is running in this process, and the working directory is its folder",
                "wait for it, or run each campaign in its own process",
            ));
        }
        let mut entered = WorkingFolder { before: None };
        let before = std::env::current_dir().ok().filter(|before| before != folder);
        if before.is_some() {
            std::env::set_current_dir(folder).map_err(|e| Error::open(folder, e))?;
        }
        entered.before = before;
        Ok(entered)
    }
}

impl Drop for WorkingFolder {
    fn drop(&mut self) {
        if let Some(before) = &self.before {
            // It may have been removed meanwhile.
            let _ = std::env::set_current_dir(before);
        }
        IS_TAKEN.store(false, Ordering::Release);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_process_has_one_campaign_at_a_time() {
        let here = std::env::current_dir().unwrap();
        let first = WorkingFolder::enter(&here).unwrap();
        let Err(refused) = WorkingFolder::enter(&here) else { panic!("entered twice") };
        assert!(refused.to_string().contains("another campaign"), "{refused}");
        drop(first);
        WorkingFolder::enter(&here).unwrap();
        // A folder that cannot be entered leaves it free.
        assert!(WorkingFolder::enter(&here.join("none")).is_err());
        WorkingFolder::enter(&here).unwrap();
    }
}
