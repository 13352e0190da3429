//! What a cell needs of the computer: cores, shared memory, permissions, clock of the processor, buffers of the network.

use super::{Check, State, largest_frame_bytes};
use devices::LoadedCell;
use ipc::left_behind::{LeftBehind, left_behind};
use ipc::os;
use std::path::Path;

const SHARED_MEMORY: &str = "/dev/shm";

/// Shared memory that a small cell takes, where none is named, bytes.
const SMALL_CELL_BYTES: u64 = 500_000_000;

/// Receive buffer that the driver of the cameras asks for at least, bytes.
const RECEIVE_BYTES: usize = 8 << 20;

/// Number of the capability in `linux/capability.h`: to take a real-time priority.
const CAP_SYS_NICE: u32 = 23;

/// All checks of the computer for a cell; `config` names its file in what mends them.
pub(super) fn checks(cell: Option<&LoadedCell>, config: &str) -> Vec<Check> {
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    vec![
        check_cores(cell, cores, config),
        check_shared_memory(
            cell,
            os::free_bytes(Path::new(SHARED_MEMORY)).map_err(|e| e.to_string()),
            &left_behind(),
        ),
        check_priority(cell, &read("/proc/self/limits"), &read("/proc/self/status")),
        check_locking(cell),
        check_large_pages(&read("/sys/kernel/mm/transparent_hugepage/enabled")),
        check_governor(&governors()),
        check_receive_buffer(cell, read("/proc/sys/net/core/rmem_max").trim().parse().ok()),
    ]
}

fn read(path: &str) -> String {
    std::fs::read_to_string(path).unwrap_or_default()
}

fn mb(bytes: u64) -> u64 {
    bytes.div_ceil(1_000_000)
}

fn check_cores(cell: Option<&LoadedCell>, cores: usize, config: &str) -> Check {
    let planned = cell.map_or(2, |cell| cell.schedule.cores);
    let state = if cores >= planned { State::Good } else { State::Warning };
    let found = format!("{cores} cores, the schedule is planned for {planned}");
    let mend =
        format!("write cores = {cores} under [schedule] of {config}, or use a computer with {planned} cores");
    Check::new("processor cores", state, found).mended_by(format!("{planned} cores"), mend)
}

fn check_shared_memory(cell: Option<&LoadedCell>, free: Result<u64, String>, left: &[LeftBehind]) -> Check {
    let needed = cell.map_or(SMALL_CELL_BYTES, |cell| cell.schedule.memory_bytes());
    let whose = if cell.is_some() { "the cell takes at most" } else { "a small cell takes" };
    let name = "shared memory (/dev/shm)";
    let free = match free {
        Ok(free) => free,
        Err(error) => return Check::new(name, State::Unknown, error),
    };
    let state = match free >= needed {
        true if left.is_empty() => State::Good,
        true => State::Warning,
        false => State::Bad,
    };
    let found = format!("{} MB free, {whose} {} MB", mb(free), mb(needed));
    if let Some(left) = left.first() {
        let check = Check::new(name, state, format!("{found}, {left}"));
        return check.mended_by(format!("{} MB", mb(needed)), left.remove.clone());
    }
    // Room for what else lies there.
    let size = (needed + needed / 4).div_ceil(1 << 20);
    let mend = format!("sudo mount -o remount,size={size}M /dev/shm");
    Check::new(name, state, found).mended_by(format!("{} MB", mb(needed)), mend)
}

fn check_priority(cell: Option<&LoadedCell>, limits: &str, status: &str) -> Check {
    let name = "real-time priority";
    let wanted = cell.and_then(|cell| cell.config.schedule.realtime_priority);
    let soft = limits.lines().find_map(|line| line.strip_prefix("Max realtime priority"));
    let soft: Option<u32> = soft.and_then(|rest| rest.split_whitespace().next()?.parse().ok());
    let held = status.lines().find_map(|line| line.strip_prefix("CapEff:"));
    let held = held.and_then(|bits| u64::from_str_radix(bits.trim(), 16).ok()).unwrap_or(0);
    let most = if held & (1 << CAP_SYS_NICE) != 0 { 99 } else { soft.unwrap_or(0) };
    let Some(wanted) = wanted else {
        let found = format!("up to {most} permitted; the cell asks for none (schedule.realtime_priority)");
        return Check::new(name, State::Good, found);
    };
    // The supervisor takes the priority above that of the stages.
    let state = if most > wanted { State::Good } else { State::Warning };
    let found = format!("up to {most} permitted, the cell asks for {wanted}");
    let mend = format!(
        "echo \"$USER - rtprio {}\" | sudo tee /etc/security/limits.d/70-fringecell.conf, then log in again",
        wanted + 1
    );
    Check::new(name, state, found).mended_by(format!("{}", wanted + 1), mend)
}

fn check_locking(cell: Option<&LoadedCell>) -> Check {
    let name = "locking memory";
    let bytes = cell.filter(|cell| cell.config.schedule.lock_memory).map(|cell| cell.schedule.memory_bytes());
    let Some(bytes) = bytes else {
        return Check::new(name, State::Good, "the cell does not ask for it (schedule.lock_memory)");
    };
    match os::may_lock_memory(bytes) {
        Ok(true) => Check::new(name, State::Good, format!("{} MB may be locked", mb(bytes))),
        Ok(false) => {
            let mend = "echo \"$USER - memlock unlimited\" | sudo tee -a /etc/security/limits.d/70-fringecell.conf, then log in again";
            let found = format!("less than {} MB may be locked", mb(bytes));
            Check::new(name, State::Warning, found).mended_by(format!("{} MB", mb(bytes)), mend)
        }
        Err(error) => Check::new(name, State::Unknown, error.to_string()),
    }
}

/// `enabled`: what the kernel says, the choice in brackets.
fn check_large_pages(enabled: &str) -> Check {
    let name = "large pages";
    if enabled.is_empty() {
        return Check::new(name, State::Unknown, "this kernel makes none");
    }
    if !enabled.contains("[never]") {
        return Check::new(name, State::Good, "buffers lie on pages of 2 MB where some are free");
    }
    let mend = "echo madvise | sudo tee /sys/kernel/mm/transparent_hugepage/enabled";
    Check::new(name, State::Warning, "switched off: the first use of a buffer after a pause takes longer")
        .mended_by("madvise", mend)
}

/// The governor of every core that has one.
fn governors() -> Vec<String> {
    let cores = std::fs::read_dir("/sys/devices/system/cpu").into_iter().flatten().flatten();
    let mut found: Vec<String> = cores
        .filter_map(|core| std::fs::read_to_string(core.path().join("cpufreq/scaling_governor")).ok())
        .map(|text| text.trim().to_owned())
        .collect();
    found.sort_unstable();
    found.dedup();
    found
}

fn check_governor(governors: &[String]) -> Check {
    let name = "clock of the processor";
    match governors {
        [] => Check::new(name, State::Unknown, "this system does not control it, as in a virtual machine"),
        [one] if one == "performance" => Check::new(name, State::Good, "governor performance"),
        other => {
            let found = format!("governor {}: the first frames of a cycle come late", other.join(", "));
            Check::new(name, State::Warning, found)
                .mended_by("performance", "sudo cpupower frequency-set --governor performance")
        }
    }
}

fn check_receive_buffer(cell: Option<&LoadedCell>, most: Option<usize>) -> Check {
    let name = "receive buffer of the network (net.core.rmem_max)";
    let frame = cell.map_or(Some(0), largest_frame_bytes);
    let Some(frame) = frame else {
        return Check::new(name, State::Good, "the cell has no camera on the network");
    };
    let needed = (2 * frame).max(RECEIVE_BYTES);
    let Some(most) = most else {
        return Check::new(name, State::Unknown, "cannot read /proc/sys/net/core/rmem_max");
    };
    let state = if most >= needed { State::Good } else { State::Warning };
    let found = format!("{most} bytes, a camera driver asks for {needed}");
    let mend = format!(
        "echo net.core.rmem_max={needed} | sudo tee /etc/sysctl.d/70-fringecell.conf && sudo sysctl --system"
    );
    Check::new(name, state, found)
        .mended_by(format!("{needed} bytes, so that no packet is dropped while a core is busy"), mend)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_too_small_is_named_with_the_command_that_mends_it() {
        let small = check_shared_memory(None, Ok(1000), &[]);
        assert_eq!(
            (small.state, small.mend.as_deref()),
            (State::Bad, Some("sudo mount -o remount,size=597M /dev/shm"))
        );
        assert_eq!(check_shared_memory(None, Ok(1 << 40), &[]).mend, None);
        assert_eq!(check_shared_memory(None, Err("gone".into()), &[]).state, State::Unknown);
        let left = [LeftBehind { cell: "demo".into(), bytes: 1_594_000_000, remove: "rm fc-abcde*".into() }];
        let held = check_shared_memory(None, Ok(1 << 40), &left);
        assert_eq!((held.state, held.mend.as_deref()), (State::Warning, Some("rm fc-abcde*")));
        assert!(held.found.contains("1594 MB are what the killed cell \"demo\" left"), "{}", held.found);
        let buffer = check_receive_buffer(None, Some(212_992));
        assert!(buffer.mend.is_some_and(|mend| mend.contains("net.core.rmem_max=8388608")));
        assert_eq!(check_receive_buffer(None, Some(1 << 30)).state, State::Good);
        assert_eq!(check_receive_buffer(None, None).state, State::Unknown);
        let save = check_governor(&["performance".into(), "powersave".into()]);
        assert!(save.state == State::Warning && save.mend.is_some_and(|mend| mend.contains("cpupower")));
        assert_eq!(check_governor(&["performance".into()]).state, State::Good);
        assert_eq!(check_cores(None, 1, "cell.toml").state, State::Warning);
        let never = check_large_pages("always madvise [never]\n");
        assert!(never.state == State::Warning && never.mend.is_some_and(|mend| mend.contains("madvise")));
        assert_eq!(check_large_pages("always [madvise] never\n").state, State::Good);
        assert_eq!(check_large_pages("").state, State::Unknown);
    }

    #[test]
    fn permissions_are_read_as_the_kernel_writes_them() {
        let limits = "Max realtime priority     95                   95\n";
        assert!(check_priority(None, limits, "").found.contains("up to 95"));
        assert!(check_priority(None, "", "CapEff:\t0000000000800000\n").found.contains("up to 99"));
        assert!(check_priority(None, "nonsense", "CapEff: nonsense").found.contains("up to 0"));
    }
}
