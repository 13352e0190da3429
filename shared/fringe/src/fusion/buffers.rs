//! Memory that is used again from cycle to cycle.

/// Empties a list and reserves memory for `entries` elements, and a quarter more where it has to grow: the next cloud of the same
/// part is a little larger or smaller.
pub(super) fn clear_and_reserve<T>(list: &mut Vec<T>, entries: usize) {
    list.clear();
    if list.capacity() < entries {
        list.reserve_exact(entries + entries / 4);
    }
}
