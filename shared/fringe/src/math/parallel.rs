//! Fixed parts, joined in order: parallel work whose bytes do not depend on the number of threads.

/// Applies `work` to consecutive parts of `data`, each with its own scratch, and allocates nothing.
///
/// Part i is `data[starts[i] .. starts[i + 1]]` (`starts` counts from `starts[0]`, the first element of `data`);
/// `scratch` has one element per part. The parts are fixed by the caller, so the threads only decide who does what.
pub fn for_parts<T: Send, S: Send>(
    starts: &[usize],
    data: &mut [T],
    scratch: &mut [S],
    work: &(impl Fn(usize, &mut [T], &mut S) + Sync),
) {
    descend(0, starts, data, scratch, work);
}

fn descend<T: Send, S: Send>(
    first: usize,
    starts: &[usize],
    data: &mut [T],
    scratch: &mut [S],
    work: &(impl Fn(usize, &mut [T], &mut S) + Sync),
) {
    if let [only] = scratch {
        work(first, data, only);
        return;
    }
    if scratch.is_empty() {
        return;
    }
    let half = scratch.len() / 2;
    let (low_scratch, high_scratch) = scratch.split_at_mut(half);
    let (low, high) = data.split_at_mut(starts[first + half] - starts[first]);
    rayon::join(
        || descend(first, starts, low, low_scratch, work),
        || descend(first + half, starts, high, high_scratch, work),
    );
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_part_gets_its_slice_and_its_scratch() {
        let starts = [0, 2, 2, 7, 10];
        let mut data = [0_usize; 10];
        let mut scratch = [0_usize; 4];
        for_parts(&starts, &mut data, &mut scratch, &|part, slice, length| {
            slice.fill(part + 1);
            *length = slice.len();
        });
        assert_eq!(data, [1, 1, 3, 3, 3, 3, 3, 4, 4, 4]);
        assert_eq!(scratch, [2, 0, 5, 3]);
    }
}
