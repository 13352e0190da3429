//! Characteristics of the same clouds share one table of positions.

use metrology::acceptance::{Characteristic, PositionValue};

/// Most columns of values that a sheet of paper holds.
const WIDEST: usize = 5;

/// Characteristics whose positions are the same, in their order.
pub fn of_same_positions(all: &[Characteristic]) -> Vec<Vec<&Characteristic>> {
    let mut groups: Vec<Vec<&Characteristic>> = Vec::new();
    for one in all.iter().filter(|c| !c.positions.is_empty()) {
        let fits = |group: &&mut Vec<&Characteristic>| {
            group.len() < WIDEST && group.first().is_some_and(|first| same(&first.positions, &one.positions))
        };
        match groups.iter_mut().find(fits) {
            Some(group) => group.push(one),
            None => groups.push(vec![one]),
        }
    }
    groups
}

fn same(a: &[PositionValue], b: &[PositionValue]) -> bool {
    let key = |p: &PositionValue| (p.repeat, p.points, p.rejected);
    a.len() == b.len()
        && a.iter().zip(b).all(|(a, b)| key(a) == key(b) && a.position == b.position && a.views == b.views)
}
