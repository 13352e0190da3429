//! Real-time priority and locked memory: what the system refuses is told in a plain line, and the cell runs without it.

use crate::graph::Cell;
use ipc::os;

/// Takes the priority above the stages', and says what the stages will not get.
pub(super) fn claim(cell: &Cell) {
    let schedule = &cell.config.schedule;
    if let Some(priority) = schedule.realtime_priority
        && let Err(error) = os::realtime(priority + 1)
    {
        eprintln!(
            "schedule.realtime_priority: the system refuses ({error}), the cell runs without; it needs CAP_SYS_NICE or a higher `ulimit -r`"
        );
    }
    let bytes = cell.schedule.memory_bytes();
    if schedule.lock_memory && !os::may_lock_memory(bytes).unwrap_or(false) {
        eprintln!(
            "schedule.lock_memory: the system does not let {} MB be locked, the cell runs without; it needs CAP_IPC_LOCK or a higher `ulimit -l`",
            bytes.div_ceil(1_000_000)
        );
    }
}
