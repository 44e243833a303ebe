//! A root of its own for the process of a job, in a mount namespace: only what the job may read and write has
//! a name there, so that it cannot even find out what else exists on the machine. Landlock closes the same
//! files where the system has no such namespaces.

use nix::mount::{MntFlags, MsFlags, mount, umount2};
use nix::sched::{CloneFlags, unshare};
use nix::unistd::{getegid, geteuid, pivot_root};
use rustix::fs::{CWD, Mode, OFlags, openat};
use std::fs;
use std::io;
use std::os::fd::{AsRawFd as _, OwnedFd};
use std::path::{Path, PathBuf};

/// Namespaces of this process.
#[derive(Clone, Copy, Debug, Default)]
pub struct Namespaces {
    /// A network without devices.
    pub network: bool,
    /// Users of its own, in which limits are counted anew.
    users: bool,
    /// Mounts of its own.
    mounts: bool,
}

impl Namespaces {
    /// Moves this process to new namespaces, as far as the system lets it.
    pub fn new() -> Namespaces {
        let (user, group) = (geteuid(), getegid());
        let inner = CloneFlags::CLONE_NEWNET | CloneFlags::CLONE_NEWIPC;
        let all = inner | CloneFlags::CLONE_NEWNS;
        let users = CloneFlags::CLONE_NEWUSER;
        for (flags, made) in [
            (users | all, Namespaces { network: true, users: true, mounts: true }),
            (users | inner, Namespaces { network: true, users: true, mounts: false }),
            (users | CloneFlags::CLONE_NEWNET, Namespaces { network: true, users: true, mounts: false }),
            (all, Namespaces { network: true, users: false, mounts: true }),
            (inner, Namespaces { network: true, users: false, mounts: false }),
            (CloneFlags::CLONE_NEWNET, Namespaces { network: true, users: false, mounts: false }),
        ] {
            if unshare(flags).is_ok() {
                // The user keeps its number: files that it makes are its own.
                let is_mapped = !made.users
                    || (fs::write("/proc/self/setgroups", "deny").is_ok()
                        && fs::write("/proc/self/uid_map", format!("{user} {user} 1")).is_ok()
                        && fs::write("/proc/self/gid_map", format!("{group} {group} 1")).is_ok());
                return Namespaces { mounts: made.mounts && is_mapped, ..made };
            }
        }
        Namespaces::default()
    }

    /// True if limits of a user count the processes of this namespace only.
    pub fn counts_anew(&self) -> bool {
        self.users
    }

    /// Gives this process a root that has only these files and folders, by the names that they have now.
    /// Returns false, and changes nothing that the process sees, if the system does not allow it.
    ///
    /// # Errors
    /// If the system fails halfway.
    pub fn root<'p>(&self, paths: impl Iterator<Item = &'p Path>) -> io::Result<bool> {
        if !self.mounts {
            return Ok(false);
        }
        let here = std::env::current_dir()?;
        let private = MsFlags::MS_REC | MsFlags::MS_PRIVATE;
        if mount(NONE, "/", NONE, private, NONE).is_err() {
            return Ok(false);
        }
        // Opened before anything is hidden.
        let mut opened: Vec<Opened> = Vec::new();
        for path in paths {
            let path = std::path::absolute(path)?;
            // What a system does not have is not shown.
            let Ok(file) = openat(CWD, &path, OFlags::PATH | OFlags::CLOEXEC, Mode::empty()) else {
                continue;
            };
            let is_folder = path.is_dir();
            opened.push(Opened { path, file, is_folder });
        }
        opened.sort_by(|a, b| a.path.cmp(&b.path));
        let Some(new) =
            ["/tmp", "/var", "/usr", "/proc"].map(Path::new).into_iter().find(|path| path.is_dir())
        else {
            return Ok(false);
        };
        let flags = MsFlags::MS_NOSUID | MsFlags::MS_NODEV | MsFlags::MS_NOEXEC;
        if mount(Some("vlscan"), new, Some("tmpfs"), flags, Some("size=1m,mode=0755")).is_err() {
            return Ok(false);
        }
        if show(&opened, new).and_then(|()| enter(new)).is_err() {
            // Systems that let processes mount, but not bind or change the root.
            std::env::set_current_dir("/")?;
            umount2(new, MntFlags::MNT_DETACH)?;
            std::env::set_current_dir(here)?;
            return Ok(false);
        }
        umount2(".", MntFlags::MNT_DETACH)?;
        std::env::set_current_dir("/")?;
        // The folder of the job has the name that it had; a folder that the job does not see is no place to
        // be.
        let _ = std::env::set_current_dir(here);
        Ok(true)
    }
}

const NONE: Option<&str> = None;

/// A file or folder that the new root shows.
struct Opened {
    path: PathBuf,
    file: OwnedFd,
    is_folder: bool,
}

/// Shows files and folders below the new root.
fn show(opened: &[Opened], new: &Path) -> io::Result<()> {
    for Opened { path, file, is_folder } in opened {
        let target = new.join(path.strip_prefix("/").unwrap_or(path));
        if target.symlink_metadata().is_ok() {
            // It is within a folder that is shown already.
            continue;
        }
        match (*is_folder, target.parent()) {
            (true, _) => fs::create_dir_all(&target)?,
            (false, Some(parent)) => {
                fs::create_dir_all(parent)?;
                fs::write(&target, "")?;
            }
            (false, None) => continue,
        }
        let source = PathBuf::from(format!("/proc/self/fd/{}", file.as_raw_fd()));
        mount(Some(&source), &target, NONE, MsFlags::MS_BIND | MsFlags::MS_REC, NONE)?;
    }
    Ok(())
}

/// Makes a folder the root; the old one lies on it, and is the working directory.
fn enter(new: &Path) -> io::Result<()> {
    std::env::set_current_dir(new)?;
    Ok(pivot_root(".", ".")?)
}
