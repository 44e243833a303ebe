//! System calls denied to job processes, by seccomp: those that Landlock does not cover, or not on older
//! kernels.
//!
//! | denied | why |
//! |---|---|
//! | processes: fork, clone without a thread or with open files of its own, close_range(CLOSE_RANGE_UNSHARE), ptrace, signals to others, prctl(PR_SET_PDEATHSIG, PR_SET_DUMPABLE) | a job is one process, which ends with the service and shows it its open files |
//! | sockets of every kind, message queues, shared memory, io_uring | sockets of the file system, which Landlock does not cover; TCP before Linux 6.7 |
//! | modes, owners, times, attributes and flags of files; all of ioctl(2) but questions of terminals and pipes | Landlock does not cover them; reservations of disk space |
//! | umask(2), and folders that their owner cannot read or change | the service could not count or remove their files |
//! | truncate(2), symbolic links, pipes and devices | truncation before Linux 6.2; names that lead elsewhere |
//! | fallocate(2) with any mode | space on the disk that the size of a file does not tell |
//! | namespaces, mounts, credentials, limits and priorities of others, modules, clocks, keys, tracing | nothing of it belongs to a job |

use std::io;

/// Denies the calls to this process from now on. Returns whether this processor has such a filter.
///
/// # Errors
/// If the system refuses the filter.
#[cfg(any(target_arch = "x86_64", target_arch = "aarch64", target_arch = "riscv64"))]
pub fn close() -> io::Result<bool> {
    use nix::libc;
    use seccompiler::{SeccompAction, SeccompFilter, SeccompRule, TargetArch};
    use std::collections::BTreeMap;
    let wrong = |e: &dyn std::fmt::Display| io::Error::other(format!("seccomp: {e}"));
    let arch = TargetArch::try_from(std::env::consts::ARCH).map_err(|e| wrong(&e))?;
    let apply = |rules: BTreeMap<i64, Vec<SeccompRule>>, errno: i32| -> io::Result<()> {
        let action = SeccompAction::Errno(errno as u32);
        let filter = SeccompFilter::new(rules, SeccompAction::Allow, action, arch).map_err(|e| wrong(&e))?;
        let program: seccompiler::BpfProgram = filter.try_into().map_err(|e| wrong(&e))?;
        seccompiler::apply_filter(&program).map_err(|e| wrong(&e))
    };
    // Its arguments are in memory, which a filter does not see: libraries fall back to clone.
    apply(BTreeMap::from([(libc::SYS_clone3, Vec::new())]), libc::ENOSYS)?;
    apply(denied::rules().map_err(|e| wrong(&e))?, libc::EPERM)?;
    Ok(true)
}

#[cfg(not(any(target_arch = "x86_64", target_arch = "aarch64", target_arch = "riscv64")))]
pub fn close() -> io::Result<bool> {
    Ok(false)
}

#[cfg(any(target_arch = "x86_64", target_arch = "aarch64", target_arch = "riscv64"))]
mod denied {
    use nix::libc;
    use seccompiler::SeccompCmpOp::{self, Eq, MaskedEq, Ne};
    use seccompiler::{BackendError, SeccompCmpArgLen as Len, SeccompCondition, SeccompRule};
    use std::collections::BTreeMap;

    /// Calls that are denied whatever their arguments.
    const ALWAYS: &[i64] = &[
        // Sockets, and other ways to speak to processes.
        libc::SYS_socket,
        libc::SYS_socketpair,
        libc::SYS_mq_open,
        libc::SYS_shmget,
        libc::SYS_msgget,
        libc::SYS_semget,
        libc::SYS_io_setup,
        libc::SYS_io_uring_setup,
        libc::SYS_io_uring_enter,
        libc::SYS_io_uring_register,
        // Files: all but reading, writing, making, hard links, renaming and removing.
        libc::SYS_truncate,
        libc::SYS_fchmod,
        libc::SYS_fchmodat,
        FCHMODAT2,
        libc::SYS_fchown,
        libc::SYS_fchownat,
        libc::SYS_utimensat,
        libc::SYS_setxattr,
        libc::SYS_lsetxattr,
        libc::SYS_fsetxattr,
        SETXATTRAT,
        libc::SYS_removexattr,
        libc::SYS_lremovexattr,
        libc::SYS_fremovexattr,
        REMOVEXATTRAT,
        FILE_SETATTR,
        libc::SYS_symlinkat,
        libc::SYS_mknodat,
        libc::SYS_name_to_handle_at,
        libc::SYS_open_by_handle_at,
        libc::SYS_fanotify_init,
        libc::SYS_inotify_add_watch,
        libc::SYS_quotactl,
        libc::SYS_umask,
        libc::SYS_memfd_create,
        libc::SYS_memfd_secret,
        libc::SYS_execveat,
        // Other processes.
        libc::SYS_ptrace,
        libc::SYS_process_vm_readv,
        libc::SYS_process_vm_writev,
        libc::SYS_process_madvise,
        PROCESS_MRELEASE,
        libc::SYS_pidfd_open,
        libc::SYS_pidfd_getfd,
        libc::SYS_pidfd_send_signal,
        libc::SYS_rt_sigqueueinfo,
        libc::SYS_rt_tgsigqueueinfo,
        libc::SYS_kcmp,
        libc::SYS_move_pages,
        libc::SYS_migrate_pages,
        libc::SYS_perf_event_open,
        // Credentials.
        libc::SYS_setuid,
        libc::SYS_setgid,
        libc::SYS_setreuid,
        libc::SYS_setregid,
        libc::SYS_setresuid,
        libc::SYS_setresgid,
        libc::SYS_setfsuid,
        libc::SYS_setfsgid,
        libc::SYS_setgroups,
        libc::SYS_capset,
        libc::SYS_personality,
        libc::SYS_add_key,
        libc::SYS_request_key,
        libc::SYS_keyctl,
        // The system.
        libc::SYS_unshare,
        libc::SYS_setns,
        libc::SYS_mount,
        libc::SYS_umount2,
        libc::SYS_pivot_root,
        libc::SYS_chroot,
        libc::SYS_open_tree,
        libc::SYS_move_mount,
        libc::SYS_fsopen,
        libc::SYS_fsconfig,
        libc::SYS_fsmount,
        libc::SYS_fspick,
        libc::SYS_mount_setattr,
        libc::SYS_bpf,
        libc::SYS_userfaultfd,
        libc::SYS_init_module,
        libc::SYS_finit_module,
        libc::SYS_delete_module,
        libc::SYS_kexec_load,
        libc::SYS_reboot,
        libc::SYS_swapon,
        libc::SYS_swapoff,
        libc::SYS_acct,
        libc::SYS_syslog,
        libc::SYS_sethostname,
        libc::SYS_setdomainname,
        libc::SYS_settimeofday,
        libc::SYS_clock_settime,
        libc::SYS_clock_adjtime,
        libc::SYS_adjtimex,
        libc::SYS_vhangup,
    ];
    // Numbers that are the same on all processors, and that `libc` does not have everywhere.
    const PROCESS_MRELEASE: i64 = 448;
    const FCHMODAT2: i64 = 452;
    const SETXATTRAT: i64 = 463;
    const REMOVEXATTRAT: i64 = 466;
    const FILE_SETATTR: i64 = 469;
    /// Calls that newer processors do not have.
    #[cfg(target_arch = "x86_64")]
    const OLD: &[i64] = &[
        libc::SYS_fork,
        libc::SYS_vfork,
        libc::SYS_chmod,
        libc::SYS_chown,
        libc::SYS_lchown,
        libc::SYS_utime,
        libc::SYS_utimes,
        libc::SYS_futimesat,
        libc::SYS_symlink,
        libc::SYS_mknod,
        libc::SYS_modify_ldt,
        libc::SYS_iopl,
        libc::SYS_ioperm,
        libc::SYS_uselib,
    ];
    #[cfg(not(target_arch = "x86_64"))]
    const OLD: &[i64] = &[];

    /// Requests of ioctl(2) that are allowed: TCGETS, TCGETS2, TIOCGWINSZ, FIONREAD, FIONBIO, FIONCLEX and
    /// FIOCLEX. Others change flags and keys of files that are open for reading only, or reserve disk space
    /// that the size of a file does not include.
    const REQUESTS: [u64; 7] = [0x5401, 0x802c_542a, 0x5413, 0x541b, 0x5421, 0x5450, 0x5451];
    /// Rights of a folder's owner, without which the service could not count or remove its files.
    const FOLDER_RIGHTS: [u64; 3] = [0o400, 0o200, 0o100];
    /// CLOSE_RANGE_UNSHARE: open files of a thread of its own, which the service would not find.
    const UNSHARE: u64 = 2;
    /// Commands of fcntl(2): signals to others (F_SETOWN, F_SETSIG, F_SETOWN_EX, F_NOTIFY), and leases, which
    /// keep others waiting.
    const COMMANDS: [u64; 5] = [8, 10, 15, 1024, 1026];

    fn rule(conditions: &[(u8, SeccompCmpOp, u64)]) -> Result<SeccompRule, BackendError> {
        let conditions = conditions.iter().map(|(argument, operator, value)| {
            SeccompCondition::new(*argument, Len::Dword, operator.clone(), *value)
        });
        SeccompRule::new(conditions.collect::<Result<_, _>>()?)
    }

    /// The calls that are denied, each where one of its rules holds, or always if it has none.
    pub fn rules() -> Result<BTreeMap<i64, Vec<SeccompRule>>, BackendError> {
        let own = u64::from(std::process::id());
        let (thread, files) = (libc::CLONE_THREAD as u64, libc::CLONE_FILES as u64);
        let another = || rule(&[(0, Ne, 0), (0, Ne, own)]);
        let mut rules: BTreeMap<i64, Vec<SeccompRule>> =
            ALWAYS.iter().chain(OLD).map(|call| (*call, Vec::new())).collect();
        rules.extend([
            // Threads, but no processes, and no threads whose open files the service would not find.
            (libc::SYS_clone, vec![rule(&[(0, MaskedEq(thread), 0)])?, rule(&[(0, MaskedEq(files), 0)])?]),
            (libc::SYS_close_range, vec![rule(&[(2, MaskedEq(UNSHARE), UNSHARE)])?]),
            (libc::SYS_mkdirat, folders(2)?),
            // A process ends itself, but no other: `kill` of 0 is that of its group.
            (libc::SYS_kill, vec![rule(&[(0, Ne, own)])?]),
            (libc::SYS_tkill, vec![rule(&[(0, Ne, own)])?]),
            (libc::SYS_tgkill, vec![rule(&[(0, Ne, own)])?]),
            // A process that cannot be dumped hides its open files from the service, which counts them.
            (
                libc::SYS_prctl,
                vec![
                    rule(&[(0, Eq, libc::PR_SET_PDEATHSIG as u64)])?,
                    rule(&[(0, Eq, libc::PR_SET_DUMPABLE as u64)])?,
                ],
            ),
            // Space beyond the end of a file is not part of its size, which the service counts and limits.
            (libc::SYS_fallocate, vec![rule(&[(1, Ne, 0)])?]),
            (libc::SYS_prlimit64, vec![another()?]),
            (libc::SYS_sched_setaffinity, vec![another()?]),
            (libc::SYS_sched_setscheduler, vec![another()?]),
            (libc::SYS_sched_setparam, vec![another()?]),
            (libc::SYS_sched_setattr, vec![another()?]),
            (libc::SYS_setpriority, vec![rule(&[(0, Ne, 0)])?, rule(&[(1, Ne, 0), (1, Ne, own)])?]),
            (libc::SYS_ioprio_set, vec![rule(&[(0, Ne, 1)])?, rule(&[(1, Ne, 0), (1, Ne, own)])?]),
            (libc::SYS_ioctl, vec![rule(&REQUESTS.map(|request| (1u8, Ne, request)))?]),
            (
                libc::SYS_fcntl,
                COMMANDS.iter().map(|command| rule(&[(1, Eq, *command)])).collect::<Result<_, _>>()?,
            ),
        ]);
        #[cfg(target_arch = "x86_64")]
        {
            rules.insert(libc::SYS_mkdir, folders(1)?);
            add_x32(&mut rules);
        }
        Ok(rules)
    }

    /// Rules for folders whose mode, in this argument, lacks a right of their owner.
    fn folders(argument: u8) -> Result<Vec<SeccompRule>, BackendError> {
        FOLDER_RIGHTS.iter().map(|right| rule(&[(argument, MaskedEq(*right), 0)])).collect()
    }

    /// Adds the calls by the numbers of the x32 interface, which some kernels have and which counts as the
    /// same processor.
    #[cfg(target_arch = "x86_64")]
    fn add_x32(rules: &mut BTreeMap<i64, Vec<SeccompRule>>) {
        const X32: i64 = 0x4000_0000;
        // Those that have numbers of their own: ioctl, ptrace, rt_sigqueueinfo, kexec_load, move_pages,
        // rt_tgsigqueueinfo, process_vm_readv, process_vm_writev, io_setup, execveat.
        const OWN: [i64; 10] = [514, 521, 524, 528, 533, 536, 539, 540, 543, 545];
        let same: Vec<_> = rules.iter().map(|(call, rules)| (call | X32, rules.clone())).collect();
        rules.extend(same);
        rules.extend(OWN.map(|call| (call | X32, Vec::new())));
        rules.insert(libc::SYS_clone3 | X32, Vec::new());
    }
}
