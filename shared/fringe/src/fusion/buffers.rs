//! Memory that is used again from cycle to cycle.

/// Reserves memory for so many more elements, and a quarter of all more where the list has to grow.
pub(super) fn reserve<T>(list: &mut Vec<T>, more: usize) {
    let entries = list.len() + more;
    if list.capacity() < entries {
        list.reserve_exact(more + entries / 4);
    }
}

/// Empties a list and reserves memory for `entries` elements, and a quarter more where it has to grow: the next cloud of the same
/// part is a little larger or smaller.
pub(super) fn clear_and_reserve<T>(list: &mut Vec<T>, entries: usize) {
    list.clear();
    reserve(list, entries);
}
