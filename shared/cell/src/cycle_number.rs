//! How cycles are numbered in messages.

/// The number of a cycle in messages: 0 there means "outside of cycles".
pub fn wire(cycle: u64) -> u64 {
    cycle + 1
}

/// The cycle, counted from 0, of a number from [`wire`].
pub fn unwire(cycle: u64) -> Option<u64> {
    cycle.checked_sub(1)
}
