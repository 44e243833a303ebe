//! Folders of the service: their names, and how they are made and removed.

use std::path::Path;

/// The folder of files that are not complete, in that of the service.
pub(crate) const INCOMING: &str = "incoming";
/// Random bytes of the names in it that `tempfile` does not give.
pub(crate) const INCOMING_BYTES: usize = 8;

/// Makes a folder that only its owner can open, if it does not exist.
pub(crate) fn make_private(folder: &Path) -> std::io::Result<()> {
    let mut builder = std::fs::DirBuilder::new();
    builder.recursive(true);
    #[cfg(unix)]
    {
        use std::os::unix::fs::DirBuilderExt as _;
        builder.mode(0o700);
    }
    builder.create(folder)
}

/// Removes a folder with everything in it, also folders that their owner cannot read or change.
pub(crate) fn remove_folder(folder: &Path) -> std::io::Result<()> {
    use std::io::ErrorKind;
    match std::fs::remove_dir_all(folder) {
        Err(error) if error.kind() == ErrorKind::PermissionDenied => {
            open_folders(folder)?;
            std::fs::remove_dir_all(folder)
        }
        Err(error) if error.kind() != ErrorKind::NotFound => Err(error),
        _ => Ok(()),
    }
}

/// Gives the owner of a folder, and of all folders in it, all rights to them.
fn open_folders(folder: &Path) -> std::io::Result<()> {
    let mut folders = vec![folder.to_owned()];
    while let Some(folder) = folders.pop() {
        #[cfg(unix)]
        {
            use std::os::unix::fs::PermissionsExt as _;
            std::fs::set_permissions(&folder, std::fs::Permissions::from_mode(0o700))?;
        }
        for entry in std::fs::read_dir(&folder)? {
            let entry = entry?;
            // Links are not followed.
            if entry.file_type()?.is_dir() {
                folders.push(entry.path());
            }
        }
    }
    Ok(())
}
