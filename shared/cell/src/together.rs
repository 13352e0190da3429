//! Projectors that show at the same time: those of which no camera sees the light of two.
//!
//! Two projectors *meet* when a camera that looks at one of them sees light of the other. Projectors that meet get different groups: a
//! colouring of the graph of meetings. Among all of them the one is taken that shows in the fewest frames.

/// Most projectors of which all ways to group them are tried; eight have 4140.
const MOST_TRIED: usize = 8;

/// Groups of projectors of which no two meet, with the least sum of their longest sequences; of equally good ones the first, which keeps
/// projectors with the earliest that they can join. Beyond eight projectors each joins the first group that it can.
///
/// Each projector is in one group, in rising order; groups are in the order of their first projector.
pub fn groups(frames: &[usize], meet: &dyn Fn(usize, usize) -> bool) -> Vec<Vec<usize>> {
    let mut best = None;
    place(frames, meet, &mut Vec::new(), 0, &mut best);
    best.map_or_else(Vec::new, |(_, groups)| groups)
}

/// Frames that groups take: in each the longest sequence.
pub fn frames_of(frames: &[usize], groups: &[Vec<usize>]) -> usize {
    groups.iter().map(|group| group.iter().map(|p| frames[*p]).max().unwrap_or(0)).sum()
}

/// Places a projector and those after it in every way that is allowed, the groups there are before a new one.
fn place(
    frames: &[usize],
    meet: &dyn Fn(usize, usize) -> bool,
    groups: &mut Vec<Vec<usize>>,
    projector: usize,
    best: &mut Option<(usize, Vec<Vec<usize>>)>,
) {
    let total = frames_of(frames, groups);
    if best.as_ref().is_some_and(|(least, _)| total >= *least) {
        return;
    }
    if projector == frames.len() {
        *best = Some((total, groups.clone()));
        return;
    }
    let is_greedy = frames.len() > MOST_TRIED;
    for number in 0..groups.len() {
        if groups[number].iter().all(|other| !meet(*other, projector)) {
            groups[number].push(projector);
            place(frames, meet, groups, projector + 1, best);
            groups[number].pop();
            if is_greedy {
                return;
            }
        }
    }
    groups.push(vec![projector]);
    place(frames, meet, groups, projector + 1, best);
    groups.pop();
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Proves: every way to group four projectors is beside the one found, for all 64 graphs of meetings.
    #[test]
    fn no_other_grouping_takes_fewer_frames() {
        let pairs = [(0, 1), (0, 2), (0, 3), (1, 2), (1, 3), (2, 3)];
        let frames = [10, 4, 12, 7];
        for graph in 0..64_u32 {
            let meet = |a: usize, b: usize| {
                let edge = pairs.iter().position(|pair| *pair == (a.min(b), a.max(b)));
                edge.is_some_and(|edge| graph >> edge & 1 == 1)
            };
            let found = groups(&frames, &meet);
            let mut members: Vec<usize> = found.concat();
            members.sort_unstable();
            assert_eq!(members, [0, 1, 2, 3]);
            // All assignments of four projectors to four groups.
            let least = (0..256_usize)
                .map(|code| (0..4).map(|p| code >> (2 * p) & 3).collect::<Vec<usize>>())
                .filter(|of| pairs.iter().all(|(a, b)| of[*a] != of[*b] || !meet(*a, *b)))
                .map(|of| {
                    let group = |g: usize| (0..4).filter(|p| of[*p] == g).collect::<Vec<_>>();
                    frames_of(&frames, &(0..4).map(group).collect::<Vec<_>>())
                })
                .min();
            assert_eq!(Some(frames_of(&frames, &found)), least, "{graph:06b}");
            for group in &found {
                assert!(group.iter().all(|a| group.iter().all(|b| a == b || !meet(*a, *b))));
            }
        }
    }

    #[test]
    fn many_projectors_are_grouped_one_by_one() {
        let found = groups(&[5; 16], &|a, b| a.abs_diff(b) == 1);
        assert_eq!(found, [(0..16).step_by(2).collect::<Vec<_>>(), (1..16).step_by(2).collect()]);
        assert_eq!(groups(&[3, 3], &|_, _| true), [[0], [1]]);
        assert!(groups(&[], &|_, _| true).is_empty());
    }
}
