//! Real-time priority and locked memory. If the system refuses one, the cell prints why and runs without it.

use crate::terminal;
use cell::Cell;
use ipc::os;

/// Sets the priority of the supervisor above that of the stages, and reports what the stages will not get.
pub(super) fn claim(cell: &Cell) {
    let schedule = &cell.config.schedule;
    if let Some(priority) = schedule.realtime_priority
        && let Err(error) = os::realtime(priority + 1)
    {
        terminal::print_note(&format!(
            "warning: schedule.realtime_priority: the system refuses ({error}), so the cell runs without; grant CAP_SYS_NICE or raise `ulimit -r`"
        ));
    }
    let bytes = cell.schedule.memory_bytes();
    if schedule.lock_memory && !os::may_lock_memory(bytes).unwrap_or(false) {
        terminal::print_note(&format!(
            "warning: schedule.lock_memory: the system does not allow locking {} MB, so the cell runs without; grant CAP_IPC_LOCK or raise `ulimit -l`",
            bytes.div_ceil(1_000_000)
        ));
    }
}
