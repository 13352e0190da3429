//! System calls that the standard library does not offer.
#![allow(unsafe_code)]

use std::io;
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};

/// Whether the program was started without standard output (`>&-`).
static NO_STDOUT: AtomicBool = AtomicBool::new(false);

extern "C" fn look_at_stdout() {
    // SAFETY: F_GETFD reads a flag of a descriptor and changes nothing; for a closed one it fails.
    if unsafe { libc::fcntl(libc::STDOUT_FILENO, libc::F_GETFD) } == -1 {
        NO_STDOUT.store(true, Ordering::Relaxed);
    }
}

/// Runs before the runtime of the language, which opens the null device in the place of a closed standard output.
// SAFETY: the section holds pointers to functions of this type, which the loader calls once before `main`; this one needs nothing that
// is set up later.
#[used]
#[unsafe(link_section = ".init_array")]
static LOOK_AT_STDOUT: extern "C" fn() = look_at_stdout;

/// Whether the program was started with a standard output; without one all that is printed is lost.
pub fn had_stdout() -> bool {
    // Named, so that the linker keeps it.
    std::hint::black_box(&LOOK_AT_STDOUT);
    !NO_STDOUT.load(Ordering::Relaxed)
}

/// The monotonic clock that all processes of a machine share, ns.
pub fn now_ns() -> u64 {
    let mut now = libc::timespec { tv_sec: 0, tv_nsec: 0 };
    // SAFETY: `now` is a valid timespec that lives through the call; CLOCK_MONOTONIC exists on every Linux.
    unsafe { libc::clock_gettime(libc::CLOCK_MONOTONIC, &raw mut now) };
    now.tv_sec as u64 * 1_000_000_000 + now.tv_nsec as u64
}

/// Resource use of this process since its start, all threads together.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Usage {
    /// Processor time in user and kernel mode, ns (resolution 1 µs).
    pub cpu_ns: u64,
    /// Page faults without disk access.
    pub minor_faults: u64,
    /// Page faults with disk access.
    pub major_faults: u64,
    /// Context switches while waiting.
    pub voluntary_switches: u64,
    /// Context switches at the end of a time slice or by a process of higher priority.
    pub involuntary_switches: u64,
}

impl Usage {
    /// Reads the current values from the operating system.
    pub fn now() -> Self {
        // SAFETY: an all-zero rusage is a valid value of that plain C struct.
        let mut usage: libc::rusage = unsafe { std::mem::zeroed() };
        // SAFETY: `usage` is a valid struct that lives through the call; RUSAGE_SELF exists on every Linux, so it cannot fail.
        unsafe { libc::getrusage(libc::RUSAGE_SELF, &raw mut usage) };
        let ns = |t: libc::timeval| t.tv_sec as u64 * 1_000_000_000 + t.tv_usec as u64 * 1000;
        Self {
            cpu_ns: ns(usage.ru_utime) + ns(usage.ru_stime),
            minor_faults: usage.ru_minflt as u64,
            major_faults: usage.ru_majflt as u64,
            voluntary_switches: usage.ru_nvcsw as u64,
            involuntary_switches: usage.ru_nivcsw as u64,
        }
    }

    /// The increase since an earlier value.
    #[must_use]
    pub fn since(self, earlier: Self) -> Self {
        Self {
            cpu_ns: self.cpu_ns.saturating_sub(earlier.cpu_ns),
            minor_faults: self.minor_faults.saturating_sub(earlier.minor_faults),
            major_faults: self.major_faults.saturating_sub(earlier.major_faults),
            voluntary_switches: self.voluntary_switches.saturating_sub(earlier.voluntary_switches),
            involuntary_switches: self.involuntary_switches.saturating_sub(earlier.involuntary_switches),
        }
    }
}

/// Makes the allocator keep freed memory instead of returning it to the kernel: a stage needs the same memory in every
/// cycle, and new memory costs a page fault per 4 kB. Only glibc returns memory early; elsewhere this does nothing.
pub fn keep_freed_memory() {
    #[cfg(all(target_os = "linux", target_env = "gnu"))]
    // SAFETY: mallopt takes two numbers and is called before other threads exist.
    unsafe {
        // Both limits are dynamic by default and end at 32 MB; large buffers would be mapped and unmapped in each cycle.
        libc::mallopt(libc::M_MMAP_THRESHOLD, 1 << 30);
        libc::mallopt(libc::M_TRIM_THRESHOLD, libc::c_int::MAX);
        // One heap for all threads: what one of them frees the others use again.
        libc::mallopt(libc::M_ARENA_MAX, 1);
    }
}

/// Populates the page tables of all mappings whose path begins with `prefix`, so that the first use of each message slot
/// costs no page faults. Returns the bytes; 0 on kernels before 5.14, which do not support it.
///
/// # Errors
/// /proc cannot be read, or the kernel refuses, for instance without free memory.
pub fn populate(prefix: &str) -> io::Result<u64> {
    populate_some(|mapping| mapping.path.starts_with(prefix))
}

/// The same for those alone that this process may write: what it reads, others populate.
///
/// # Errors
/// As [`populate`].
pub fn populate_writable(prefix: &str) -> io::Result<u64> {
    populate_some(|mapping| mapping.writable && mapping.path.starts_with(prefix))
}

fn populate_some(wanted: impl Fn(&Mapping) -> bool) -> io::Result<u64> {
    let mut bytes = 0;
    for line in std::fs::read_to_string("/proc/self/maps")?.lines() {
        let Some(mapping) = Mapping::parse(line).filter(&wanted) else { continue };
        // A read-only mapping is populated by reading.
        let advice = if mapping.writable { libc::MADV_POPULATE_WRITE } else { libc::MADV_POPULATE_READ };
        // SAFETY: the range is a whole mapping of this process; populating changes no byte. If another thread unmaps it first,
        // the call fails.
        let code = unsafe { libc::madvise(mapping.start as *mut libc::c_void, mapping.length, advice) };
        if code == 0 {
            bytes += mapping.length as u64;
            continue;
        }
        let error = io::Error::last_os_error();
        if error.raw_os_error() == Some(libc::EINVAL) {
            return Ok(0);
        }
        return Err(error);
    }
    Ok(bytes)
}

/// A line of /proc/self/maps.
#[derive(Debug, PartialEq, Eq)]
struct Mapping<'a> {
    start: usize,
    length: usize,
    writable: bool,
    path: &'a str,
}

impl<'a> Mapping<'a> {
    /// `7f00-7f80 rw-s 00000000 00:1a 5 /dev/shm/name`; `None` for memory without a path.
    fn parse(line: &'a str) -> Option<Self> {
        let (range, rest) = line.split_once(' ')?;
        let (start, end) = range.split_once('-')?;
        let (start, end) = (usize::from_str_radix(start, 16).ok()?, usize::from_str_radix(end, 16).ok()?);
        let path = rest.get(rest.find('/')?..)?;
        Some(Self {
            start,
            length: end.checked_sub(start)?,
            writable: rest.as_bytes().get(1) == Some(&b'w'),
            path,
        })
    }
}

/// Makes the kernel kill this process when its parent dies, so that a killed supervisor leaves no stages.
///
/// Returns whether the parent still is `parent_pid`; it may have died before the call.
///
/// # Errors
/// The kernel refuses.
pub fn die_with_parent(parent_pid: u32) -> io::Result<bool> {
    // SAFETY: PR_SET_PDEATHSIG takes a signal number and touches no memory of ours.
    let code = unsafe { libc::prctl(libc::PR_SET_PDEATHSIG, libc::SIGKILL as libc::c_ulong, 0, 0, 0) };
    if code != 0 {
        return Err(io::Error::last_os_error());
    }
    Ok(std::os::unix::process::parent_id() == parent_pid)
}

/// Free space of a file system for unprivileged users, bytes.
///
/// # Errors
/// The kernel refuses, or the path contains a zero byte.
pub fn free_bytes(path: &Path) -> io::Result<u64> {
    use std::os::unix::ffi::OsStrExt;
    let c_path = std::ffi::CString::new(path.as_os_str().as_bytes())?;
    // SAFETY: an all-zero statvfs is a valid value of that plain C struct.
    let mut stat: libc::statvfs = unsafe { std::mem::zeroed() };
    // SAFETY: the path is a zero-terminated string and `stat` a valid struct, both alive through the call.
    if unsafe { libc::statvfs(c_path.as_ptr(), &raw mut stat) } != 0 {
        return Err(io::Error::last_os_error());
    }
    Ok(stat.f_bavail.saturating_mul(stat.f_frsize))
}

/// Pins this thread, and threads that it starts later, to some processors.
///
/// # Errors
/// The kernel refuses, for instance if none of the processors exists.
pub fn pin(cores: &[usize]) -> io::Result<()> {
    // SAFETY: an all-zero cpu_set_t is the empty set.
    let mut set: libc::cpu_set_t = unsafe { std::mem::zeroed() };
    for &core in cores.iter().filter(|&&core| core < libc::CPU_SETSIZE as usize) {
        // SAFETY: the core number is inside the set.
        unsafe { libc::CPU_SET(core, &mut set) };
    }
    // SAFETY: 0 is this thread, the size is that of the set passed.
    if unsafe { libc::sched_setaffinity(0, size_of::<libc::cpu_set_t>(), &raw const set) } != 0 {
        return Err(io::Error::last_os_error());
    }
    Ok(())
}

/// Gives this thread, and threads that it starts later, a real-time priority (`SCHED_FIFO`, 1 to 99).
///
/// # Errors
/// The kernel refuses, usually without the permission.
pub fn realtime(priority: u32) -> io::Result<()> {
    let parameters = libc::sched_param { sched_priority: priority as libc::c_int };
    // SAFETY: 0 is this thread, and the parameters are a valid struct that lives through the call.
    if unsafe { libc::sched_setscheduler(0, libc::SCHED_FIFO, &raw const parameters) } != 0 {
        return Err(io::Error::last_os_error());
    }
    Ok(())
}

/// Gives this process the ordinary scheduling class at a low priority: others that want the processor come first.
///
/// # Errors
/// The kernel refuses.
pub fn yield_to_others() -> io::Result<()> {
    /// Half of the way to the lowest priority.
    const NICE: libc::c_int = 10;
    let parameters = libc::sched_param { sched_priority: 0 };
    // SAFETY: 0 is this thread, and the parameters are a valid struct that lives through the call.
    if unsafe { libc::sched_setscheduler(0, libc::SCHED_OTHER, &raw const parameters) } != 0 {
        return Err(io::Error::last_os_error());
    }
    // SAFETY: setpriority takes numbers and touches no memory of ours; 0 is this process.
    if unsafe { libc::setpriority(libc::PRIO_PROCESS, 0, NICE) } != 0 {
        return Err(io::Error::last_os_error());
    }
    Ok(())
}

/// Whether this process may lock this number of bytes in memory.
///
/// # Errors
/// The limits cannot be read.
pub fn may_lock_memory(bytes: u64) -> io::Result<bool> {
    /// Number of the capability in `linux/capability.h`.
    const CAP_IPC_LOCK: u32 = 14;
    let mut limit = libc::rlimit { rlim_cur: 0, rlim_max: 0 };
    // SAFETY: `limit` is a valid struct that lives through the call.
    if unsafe { libc::getrlimit(libc::RLIMIT_MEMLOCK, &raw mut limit) } != 0 {
        return Err(io::Error::last_os_error());
    }
    let status = std::fs::read_to_string("/proc/self/status")?;
    let held = status.lines().find_map(|line| line.strip_prefix("CapEff:"));
    let held = held.and_then(|bits| u64::from_str_radix(bits.trim(), 16).ok()).unwrap_or(0);
    Ok(limit.rlim_cur >= bytes || held & (1 << CAP_IPC_LOCK) != 0)
}

/// Raises the number of files that this process, and those that it starts, may have open to the most that is allowed. Where the kernel
/// refuses, it stays as it is.
pub fn raise_open_files() {
    use rustix::process::{Resource, Rlimit, getrlimit, setrlimit};
    let limit = getrlimit(Resource::Nofile);
    // Too few are said where a file cannot be opened.
    let _ = setrlimit(Resource::Nofile, Rlimit { current: limit.maximum, maximum: limit.maximum });
}

/// Locks all present and future memory of this process: no page faults during a cycle.
///
/// # Errors
/// The kernel refuses, usually without the permission.
pub fn lock_memory() -> io::Result<()> {
    // SAFETY: mlockall takes flags and touches no memory of ours.
    if unsafe { libc::mlockall(libc::MCL_CURRENT | libc::MCL_FUTURE) } != 0 {
        return Err(io::Error::last_os_error());
    }
    Ok(())
}

/// Set by the termination signals.
static TERMINATED: AtomicBool = AtomicBool::new(false);

extern "C" fn terminate(_signal: libc::c_int) {
    TERMINATED.store(true, Ordering::Relaxed);
}

/// Catches SIGINT, SIGTERM, SIGQUIT and SIGHUP (closed terminal); [`is_terminated`] reports them. A SIGHUP that is ignored,
/// as under `nohup`, stays so.
///
/// # Errors
/// The kernel refuses.
pub fn catch_termination() -> io::Result<()> {
    for signal in [libc::SIGINT, libc::SIGTERM, libc::SIGQUIT, libc::SIGHUP] {
        // SAFETY: an all-zero sigaction is a valid value of that plain C struct.
        let mut action: libc::sigaction = unsafe { std::mem::zeroed() };
        // SAFETY: a null new action only reads the current one into a valid struct.
        if unsafe { libc::sigaction(signal, std::ptr::null(), &raw mut action) } != 0 {
            return Err(io::Error::last_os_error());
        }
        if signal == libc::SIGHUP && action.sa_sigaction == libc::SIG_IGN {
            continue;
        }
        action.sa_sigaction = terminate as extern "C" fn(libc::c_int) as libc::sighandler_t;
        action.sa_flags = libc::SA_RESTART;
        // SAFETY: the handler only stores to an atomic, which is allowed in a signal handler.
        if unsafe { libc::sigaction(signal, &raw const action, std::ptr::null_mut()) } != 0 {
            return Err(io::Error::last_os_error());
        }
    }
    Ok(())
}

/// Whether a termination signal arrived since [`catch_termination`].
pub fn is_terminated() -> bool {
    TERMINATED.load(Ordering::Relaxed)
}

/// Ignores SIGINT (Ctrl-C): the supervisor stops the stages.
pub fn ignore_interrupts() {
    // SAFETY: setting a disposition to SIG_IGN runs no handler of ours.
    unsafe { libc::signal(libc::SIGINT, libc::SIG_IGN) };
}

/// Makes a file that reaches the size limit of the process (`ulimit -f`) an error of the write instead of the end of the process.
pub fn report_file_size_limit() {
    // SAFETY: setting a disposition to SIG_IGN runs no handler of ours.
    unsafe { libc::signal(libc::SIGXFSZ, libc::SIG_IGN) };
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_clock_does_not_go_backwards() {
        let (a, b) = (now_ns(), now_ns());
        assert!(0 < a && a <= b);
    }

    #[test]
    fn zero_bytes_may_always_be_locked() {
        assert!(may_lock_memory(0).unwrap());
    }

    #[test]
    fn touching_fresh_memory_is_counted_as_page_faults_and_time() {
        let before = Usage::now();
        // 16 MB: far beyond what an allocator keeps mapped, and enough pages that other threads' faults do not matter.
        let mut memory = vec![0_u8; 16 << 20];
        for page in memory.chunks_mut(4096) {
            page[0] = 1;
        }
        assert_eq!(std::hint::black_box(&memory).iter().map(|&b| u64::from(b)).sum::<u64>(), 4096);
        let used = Usage::now().since(before);
        assert!(used.minor_faults > 0 && used.cpu_ns > 0, "{used:?}");
    }

    #[test]
    fn lines_of_the_memory_map_are_read() {
        let shared = Mapping { start: 0x7f00, length: 0x80, writable: true, path: "/dev/shm/fc-a b.data" };
        assert_eq!(Mapping::parse("7f00-7f80 rw-s 00000000 00:1a 5      /dev/shm/fc-a b.data"), Some(shared));
        assert_eq!(Mapping::parse("7f00-7f80 r--p 00000000 00:00 0").map(|m| m.length), None);
        assert_eq!(Mapping::parse("7f80-7f00 r--s 00000000 00:1a 5 /x"), None);
        assert_eq!(populate("/no/such/file").unwrap(), 0);
    }

    #[test]
    fn as_many_files_may_be_open_as_are_allowed() {
        use rustix::process::{Resource, Rlimit, getrlimit, setrlimit};
        let maximum = getrlimit(Resource::Nofile).maximum;
        setrlimit(Resource::Nofile, Rlimit { current: Some(256), maximum }).unwrap();
        raise_open_files();
        let raised = getrlimit(Resource::Nofile);
        assert_eq!((raised.current, raised.maximum), (maximum, maximum));
    }

    #[test]
    fn free_space_of_an_existing_path_only() {
        assert!(free_bytes(Path::new("/dev/shm")).is_ok());
        assert!(free_bytes(Path::new("/no/such/place")).is_err());
    }
}
