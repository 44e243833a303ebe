//! How a job's process is restricted before it becomes vlscan: it gives up rights of its own, in a program that has one thread and that
//! then executes vlscan in its place. So nothing runs between fork and exec, and the restrictions can be tested by themselves.
//!
//! | what | by | where |
//! |---|---|---|
//! | memory, processor time, size of files, no core dumps | setrlimit(2) | Unix |
//! | files: only the job's, the program and its libraries | Landlock | Linux 5.13 |
//! | TCP | Landlock, which allows no port | Linux 6.7 |
//! | sockets and signals of other processes | Landlock scopes | Linux 6.12 |
//! | any network | an empty network namespace in a user namespace of its own | Linux, where users may have them |
//! | its end when the service ends | PR_SET_PDEATHSIG | Linux |

use crate::config::ConfineArgs;
use std::io;
use std::process::Command;

/// What of the sandbox is in force.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub struct Held {
    /// Only the named files can be opened.
    pub files: bool,
    /// No TCP connections.
    pub tcp: bool,
    /// No network at all.
    pub network: bool,
}

/// Restricts this process and becomes the program; returns only if that fails. Without a program, prints what this system allows.
///
/// # Errors
/// When a limit or the sandbox cannot be set, or the program cannot be started.
pub fn confine(args: &ConfineArgs) -> io::Result<()> {
    let held = restrict(args)?;
    let Some((program, arguments)) = args.program.split_first() else {
        println!("{}", serde_json::to_string(&held)?);
        return Ok(());
    };
    if !held.files && !args.no_sandbox {
        return Err(io::Error::other("this system has no Landlock, which keeps a job to its own files"));
    }
    let mut command = Command::new(program);
    command.args(arguments);
    Err(execute(command))
}

#[cfg(unix)]
fn execute(mut command: Command) -> io::Error {
    use std::os::unix::process::CommandExt as _;
    command.exec()
}

#[cfg(not(unix))]
fn execute(mut command: Command) -> io::Error {
    match command.status() {
        Ok(status) => std::process::exit(status.code().unwrap_or(1)),
        Err(error) => error,
    }
}

#[cfg(unix)]
fn restrict(args: &ConfineArgs) -> io::Result<Held> {
    limit(args)?;
    #[cfg(target_os = "linux")]
    {
        let network = !args.no_sandbox && linux::leave_network();
        linux::die_with_parent()?;
        let (files, tcp) = if args.no_sandbox { (false, false) } else { linux::close_files(args)? };
        Ok(Held { files, tcp, network })
    }
    #[cfg(not(target_os = "linux"))]
    Ok(Held::default())
}

#[cfg(not(unix))]
fn restrict(_: &ConfineArgs) -> io::Result<Held> {
    Ok(Held::default())
}

/// Sets the limits of resources.
#[cfg(unix)]
fn limit(args: &ConfineArgs) -> io::Result<()> {
    use nix::sys::resource::{Resource, getrlimit, setrlimit};
    let limits = [
        (Resource::RLIMIT_AS, args.memory),
        (Resource::RLIMIT_CPU, args.time),
        (Resource::RLIMIT_FSIZE, args.file_size),
        (Resource::RLIMIT_CORE, Some(0)),
    ];
    for (resource, limit) in limits {
        let Some(limit) = limit else { continue };
        let (_, hard) = getrlimit(resource)?;
        let limit = limit.min(hard);
        // At the soft limit of time a signal tells why the process ends.
        let grace = if resource == Resource::RLIMIT_CPU { 5 } else { 0 };
        setrlimit(resource, limit, limit.saturating_add(grace).min(hard))?;
    }
    Ok(())
}

#[cfg(target_os = "linux")]
mod linux {
    use crate::config::ConfineArgs;
    use landlock::{
        ABI, Access as _, AccessFs, AccessNet, CompatLevel, Compatible as _, PathBeneath, PathFd, Ruleset,
        RulesetAttr as _, RulesetCreatedAttr as _, RulesetStatus, Scope,
    };
    use nix::sched::{CloneFlags, unshare};
    use std::io;
    use std::path::{Path, PathBuf};

    /// What a program needs of the system: libraries, and what it asks about processors and memory.
    const SYSTEM: [&str; 10] = [
        "/lib",
        "/lib64",
        "/usr/lib",
        "/usr/lib64",
        "/etc/ld.so.cache",
        "/nix/store",
        "/proc/self",
        "/proc/meminfo",
        "/sys/fs/cgroup",
        "/sys/devices/system/cpu",
    ];
    const DEVICES: [&str; 3] = ["/dev/null", "/dev/zero", "/dev/urandom"];

    /// Moves to a network namespace without devices. Many systems allow it only within a user namespace, some not at all.
    pub fn leave_network() -> bool {
        unshare(CloneFlags::CLONE_NEWUSER | CloneFlags::CLONE_NEWNET).is_ok()
            || unshare(CloneFlags::CLONE_NEWNET).is_ok()
    }

    /// Ends this process when its parent does.
    pub fn die_with_parent() -> io::Result<()> {
        nix::sys::prctl::set_pdeathsig(nix::sys::signal::Signal::SIGKILL)?;
        // It may have ended already.
        let parent = std::env::var("VLSCAN_PARENT").ok().and_then(|id| id.parse().ok());
        if parent.is_some_and(|id: i32| nix::unistd::getppid().as_raw() != id) {
            return Err(io::Error::other("the service has ended"));
        }
        Ok(())
    }

    /// Closes all files but those of the job. Returns whether files and TCP are closed.
    pub fn close_files(args: &ConfineArgs) -> io::Result<(bool, bool)> {
        let newest = ABI::V6;
        let all = AccessFs::from_all(newest);
        let read = AccessFs::ReadFile | AccessFs::ReadDir;
        let ruleset = Ruleset::default()
            .set_compatibility(CompatLevel::BestEffort)
            .handle_access(all)
            .and_then(|rules| rules.handle_access(AccessNet::from_all(newest)))
            .and_then(|rules| rules.scope(Scope::from_all(newest)))
            .and_then(Ruleset::create)
            .map_err(io::Error::other)?;
        let program: Option<PathBuf> = args.program.first().map(PathBuf::from);
        let system = SYSTEM
            .iter()
            .map(Path::new)
            .chain(program.as_deref())
            .map(|path| (path, read | AccessFs::Execute));
        let devices = DEVICES.iter().map(|path| (Path::new(path), AccessFs::ReadFile | AccessFs::WriteFile));
        let own = args.read.iter().map(|path| (path.as_path(), read));
        let written = args.write.iter().map(|path| (path.as_path(), all & !AccessFs::Execute));
        let mut created = ruleset;
        for (path, access) in system.chain(devices).chain(own).chain(written) {
            // What a system does not have needs no rule.
            let Ok(opened) = PathFd::new(path) else { continue };
            let access = if path.is_dir() { access } else { access & AccessFs::from_file(newest) };
            created = created.add_rule(PathBeneath::new(opened, access)).map_err(io::Error::other)?;
        }
        let status = created.restrict_self().map_err(io::Error::other)?;
        let files = status.ruleset != RulesetStatus::NotEnforced;
        let abi = match status.landlock {
            landlock::LandlockStatus::Available { effective_abi, .. } => effective_abi as i32,
            _ => 0,
        };
        Ok((files, abi >= ABI::V4 as i32))
    }
}
