//! Sorting by counting, where the keys are few.

/// Numbers of the items in the order of their places, those of a place in their own order. All places are below `places`.
pub fn counted_order(of: &[u32], places: usize) -> Vec<u32> {
    let mut starts = vec![0_u32; places];
    for place in of {
        starts[*place as usize] += 1;
    }
    let mut total = 0;
    for start in &mut starts {
        total += std::mem::replace(start, total);
    }
    let mut order = vec![0; of.len()];
    for (place, index) in of.iter().zip(0..) {
        let start = &mut starts[*place as usize];
        order[*start as usize] = index;
        *start += 1;
    }
    order
}
