//! Restrictions of a job's process before it becomes vlscan: it gives up rights of its own, in a program
//! that has one thread and that then executes vlscan in its place. So nothing runs between fork and exec, and
//! the restrictions can be tested by themselves.
//!
//! | what | by | where |
//! |---|---|---|
//! | memory, processor time, size of files, no core dumps | setrlimit(2) | Unix |
//! | files: only the job's, the program and its libraries | Landlock | Linux 5.13 |
//! | processes, sockets, modes and owners of files and other calls (`calls`) | seccomp | Linux on x86-64, AArch64, RISC-V |
//! | names of all other files, Unix sockets among them | a root of its own (`own_root`) | Linux, where users may have namespaces |
//! | any network | an empty network namespace in a user namespace of its own | the same |
//! | threads | RLIMIT_NPROC, which counts within the user namespace | the same, for other users than root |
//! | TCP; abstract sockets and signals of other processes | Landlock, beside seccomp | Linux 6.7; 6.12 |
//! | its end when the service ends | PR_SET_PDEATHSIG, which seccomp keeps | Linux |

use crate::config::ConfineArgs;
use std::io;
use std::process::Command;

/// Most threads of a process: vlscan starts at most 1024, and a few of its own.
#[cfg(target_os = "linux")]
const MAX_THREADS: u64 = 2048;

/// Sandbox features in force.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub struct Held {
    /// Only the named files can be opened.
    pub files: bool,
    /// No TCP connections.
    pub tcp: bool,
    /// No network at all.
    pub network: bool,
    /// No processes, sockets, and changes of modes and owners.
    pub calls: bool,
    /// Other files have no names.
    pub root: bool,
}

/// Restricts this process and becomes the program; returns only if that fails. Without a program, prints what
/// this system allows.
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
    if !held.calls && !args.no_sandbox {
        return Err(io::Error::other("this system has no seccomp filters, which keep a job to one process"));
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
        if args.no_sandbox {
            linux::die_with_parent()?;
            return Ok(Held::default());
        }
        let namespaces = crate::own_root::Namespaces::new();
        // Found before the root changes, in which /proc has no maps of this process.
        let paths = linux::all_paths(args);
        let root = namespaces.root(paths.iter().map(|(path, _)| path.as_path()))?;
        if namespaces.counts_anew() {
            limit_one(nix::sys::resource::Resource::RLIMIT_NPROC, MAX_THREADS)?;
        }
        linux::die_with_parent()?;
        let (files, tcp) = linux::close_files(&paths)?;
        linux::drop_capabilities()?;
        // Last: it denies calls that the rest needs.
        let calls = crate::calls::close()?;
        Ok(Held { files, tcp: tcp || calls, network: namespaces.network, calls, root })
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
    use nix::sys::resource::Resource;
    let limits = [
        (Resource::RLIMIT_AS, args.memory),
        (Resource::RLIMIT_CPU, args.time),
        (Resource::RLIMIT_FSIZE, args.file_size),
        (Resource::RLIMIT_CORE, Some(0)),
    ];
    for (resource, limit) in limits {
        limit.map_or(Ok(()), |limit| limit_one(resource, limit))?;
    }
    Ok(())
}

#[cfg(unix)]
fn limit_one(resource: nix::sys::resource::Resource, limit: u64) -> io::Result<()> {
    use nix::sys::resource::{Resource, getrlimit, setrlimit};
    let (_, hard) = getrlimit(resource)?;
    let limit = limit.min(hard);
    // At the soft limit of time a signal tells why the process ends.
    let grace = if resource == Resource::RLIMIT_CPU { 5 } else { 0 };
    Ok(setrlimit(resource, limit, limit.saturating_add(grace).min(hard))?)
}

#[cfg(target_os = "linux")]
mod linux {
    use crate::config::ConfineArgs;
    use landlock::{
        ABI, Access as _, AccessFs, AccessNet, CompatLevel, Compatible as _, PathBeneath, PathFd, Ruleset,
        RulesetAttr as _, RulesetCreatedAttr as _, RulesetStatus, Scope,
    };
    use rustix::thread::{CapabilitySet, CapabilitySets, set_capabilities};
    use std::collections::BTreeSet;
    use std::io;
    use std::path::{Path, PathBuf};

    /// System paths that a program needs: its loader, and information on processors and memory.
    const SYSTEM: [&str; 9] = [
        "/lib64",
        "/usr/lib64",
        "/etc/ld.so.cache",
        "/nix/store",
        "/proc/self/cgroup",
        "/proc/self/limits",
        "/proc/self/status",
        "/proc/meminfo",
        "/sys/devices/system/cpu",
    ];
    /// Limits of memory and processors of containers.
    const GROUPS: &str = "/sys/fs/cgroup";
    const DEVICES: [&str; 3] = ["/dev/null", "/dev/zero", "/dev/urandom"];

    /// The folders of the libraries that this program has, which are those of vlscan, too; all folders of
    /// libraries for a program that has none.
    fn libraries() -> Vec<PathBuf> {
        let maps = std::fs::read_to_string("/proc/self/maps").unwrap_or_default();
        let files = maps.lines().filter_map(|line| line.split_once('/').map(|(_, path)| format!("/{path}")));
        let folders: BTreeSet<PathBuf> = files
            .filter(|path| path.contains(".so"))
            .filter_map(|path| Path::new(&path).parent().map(Path::to_owned))
            .collect();
        if folders.is_empty() {
            return ["/lib", "/usr/lib"].map(PathBuf::from).to_vec();
        }
        // A system may have /lib as a link to /usr/lib, or the other way around.
        let other = folders.iter().map(|folder| match folder.strip_prefix("/usr") {
            Ok(inner) => Path::new("/").join(inner),
            Err(_) => Path::new("/usr").join(folder.strip_prefix("/").unwrap_or(folder)),
        });
        folders.iter().cloned().chain(other).collect()
    }

    /// The loaders of programs: their names in programs are links in /lib on most processors.
    fn loaders() -> impl Iterator<Item = PathBuf> {
        let entries = std::fs::read_dir("/lib").into_iter().flatten().flatten();
        let is_loader = |name: &str| name.starts_with("ld-linux") || name.starts_with("ld-musl");
        entries.filter(move |entry| is_loader(&entry.file_name().to_string_lossy())).map(|entry| entry.path())
    }

    /// Paths that a job can access.
    pub fn all_paths(args: &ConfineArgs) -> Vec<(PathBuf, Access)> {
        let libraries = libraries().into_iter().chain(loaders()).map(|path| (path, Access::Program));
        let system = SYSTEM.iter().map(|path| (PathBuf::from(path), Access::Program));
        let groups = std::iter::once((PathBuf::from(GROUPS), Access::Read));
        let devices = DEVICES.iter().map(|path| (PathBuf::from(path), Access::Device));
        let program = args.program.first().map(|program| (PathBuf::from(program), Access::Program));
        let read = args.read.iter().map(|path| (path.clone(), Access::Read));
        let written = args.write.iter().map(|path| (path.clone(), Access::Write));
        let all = libraries.chain(system).chain(groups).chain(devices);
        all.chain(program).chain(read).chain(written).collect()
    }

    /// Access of a job to a file or folder.
    #[derive(Clone, Copy, Debug)]
    pub enum Access {
        Read,
        Write,
        Program,
        Device,
    }

    /// Gives up all rights of root.
    pub fn drop_capabilities() -> io::Result<()> {
        let none = CapabilitySet::empty();
        Ok(set_capabilities(None, CapabilitySets { effective: none, permitted: none, inheritable: none })?)
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

    /// Closes all files but those at these paths. Returns two flags: true if files are closed, and true if
    /// TCP is.
    pub fn close_files(paths: &[(PathBuf, Access)]) -> io::Result<(bool, bool)> {
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
        let mut created = ruleset;
        for (path, access) in paths {
            let access = match access {
                Access::Read => read,
                Access::Write => all & !AccessFs::Execute,
                Access::Program => read | AccessFs::Execute,
                Access::Device => AccessFs::ReadFile | AccessFs::WriteFile,
            };
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
