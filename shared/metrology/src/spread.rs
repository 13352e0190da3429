//! Some of many points, spread over all of them.
//!
//! Clouds often come row by row, and every k-th point of them may stand in one column: on a line, or in a plane. One of each stretch of k points, at a
//! random place in it, is anywhere.

use fringe::math::random::Key;

/// A choice of indices: one of each stretch of them.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Spread {
    count: usize,
    stretch: usize,
    key: Key,
}

/// At most `most` of many values, in order.
pub(crate) fn some_of<T: Copy>(values: &[T], most: usize) -> Vec<T> {
    Spread::of(values.len(), most).indices().map(|index| values[index]).collect()
}

impl Spread {
    /// At most `most` of `count` indices; all of them where they are no more.
    pub fn of(count: usize, most: usize) -> Self {
        Self { count, stretch: count.div_ceil(most.max(1)).max(1), key: Key::new(0) }
    }

    /// Of so many indices one is chosen.
    pub fn stretch(self) -> usize {
        self.stretch
    }

    /// Whether an index is chosen.
    pub fn holds(self, index: usize) -> bool {
        self.place(index / self.stretch) == index
    }

    /// The chosen ones, in order.
    pub fn indices(self) -> impl Iterator<Item = usize> {
        (0..self.count.div_ceil(self.stretch))
            .map(move |number| self.place(number))
            .filter(move |index| *index < self.count)
    }

    /// The chosen one of a stretch.
    fn place(self, number: usize) -> usize {
        number * self.stretch + (self.key.bits(number as u64) % self.stretch as u64) as usize
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_of_each_stretch_is_chosen_and_not_always_the_same() {
        for (count, most) in [(0, 5), (5, 5), (5, 9), (1000, 100), (1001, 100), (30_000, 1500)] {
            let spread = Spread::of(count, most);
            let chosen: Vec<usize> = spread.indices().collect();
            assert!(
                chosen.len() <= most && (chosen.len() + 1) * spread.stretch() >= count,
                "{count}, {most}"
            );
            assert!((0..count).filter(|index| spread.holds(*index)).eq(chosen.iter().copied()));
            if count <= most {
                assert_eq!(chosen, (0..count).collect::<Vec<_>>());
            }
        }
        // Of a grid of 1500 rows and 20 columns, of which 20 go to a stretch, points of all columns.
        let columns: std::collections::BTreeSet<usize> =
            Spread::of(30_000, 1500).indices().map(|i| i % 20).collect();
        assert_eq!(columns.len(), 20);
    }
}
