//! A union–find forest whose links carry whole turns: joining two pixels fixes the turns between their whole groups.

use super::NO_COMPONENT;
use super::edges::Edge;

/// The link of a pixel.
#[derive(Debug, Clone, Copy)]
struct Link {
    /// Another pixel of the group, or itself at the root.
    parent: u32,
    /// Turns of this pixel above its parent's.
    turns: i32,
}

/// Groups of pixels whose relative turns are known.
#[derive(Debug)]
pub struct Forest {
    links: Vec<Link>,
    size: Vec<u32>,
}

/// What a forest says about each pixel.
#[derive(Debug)]
pub struct Labels {
    /// Number of the group in the order of their first pixels; [`NO_COMPONENT`] where not valid.
    pub component: Vec<u32>,
    /// Whole turns; 0 at the first pixel of each group and where not valid.
    pub turns: Vec<i32>,
}

impl Forest {
    /// Each pixel by itself.
    pub fn new(pixels: usize) -> Self {
        let links = (0..pixels as u32).map(|parent| Link { parent, turns: 0 }).collect();
        Self { links, size: vec![1; pixels] }
    }

    /// Root of a pixel's group, and the pixel's turns above it. Halves the path on its way.
    pub fn find(&mut self, pixel: usize) -> (usize, i32) {
        let (mut at, mut turns) = (pixel, 0);
        loop {
            let link = self.links[at];
            let parent = link.parent as usize;
            if parent == at {
                return (at, turns);
            }
            let above = self.links[parent];
            if above.parent as usize == parent {
                return (parent, turns + link.turns);
            }
            let shorter = Link { parent: above.parent, turns: link.turns + above.turns };
            self.links[at] = shorter;
            turns += shorter.turns;
            at = shorter.parent as usize;
        }
    }

    /// Puts b `step` turns above a. `false` if both belong together already: then nothing changes.
    pub fn join(&mut self, a: usize, b: usize, step: i32) -> bool {
        let ((root_a, turns_a), (root_b, turns_b)) = (self.find(a), self.find(b));
        if root_a == root_b {
            return false;
        }
        let above = step + turns_a - turns_b;
        let (low, high, turns) = if self.size[root_a] >= self.size[root_b] {
            (root_a, root_b, above)
        } else {
            (root_b, root_a, -above)
        };
        self.links[high] = Link { parent: low as u32, turns };
        self.size[low] += self.size[high];
        true
    }

    /// Joins along the least spanning tree: the one that taking the edges (numbers below keys, see
    /// [`Grid::keyed`](super::edges::Grid::keyed)) by rising value would give, each that closes a loop left out.
    ///
    /// Borůvka's rounds find the same tree without sorting: in each round every group takes its least edge outwards. As no
    /// two edges are equal there is only one such tree, and the groups stay small and near in memory for most of the work.
    pub fn span(
        &mut self,
        mut edges: Vec<u64>,
        ends: impl Fn(u32) -> Edge,
        step: impl Fn(usize, usize) -> i32,
    ) {
        let mut least = vec![u64::MAX; self.links.len()];
        while !edges.is_empty() {
            edges.retain(|edge| {
                let (a, b) = ends(*edge as u32);
                let (a, b) = (self.find(a).0, self.find(b).0);
                if a != b {
                    least[a] = least[a].min(*edge);
                    least[b] = least[b].min(*edge);
                }
                a != b
            });
            for taken in &mut least {
                if *taken != u64::MAX {
                    let (a, b) = ends(*taken as u32);
                    self.join(a, b, step(a, b));
                    *taken = u64::MAX;
                }
            }
        }
    }

    /// Numbers the groups and counts the turns from their first pixels.
    pub fn labels(mut self, valid: &[bool]) -> Labels {
        let n = valid.len();
        let mut labels = Labels { component: vec![NO_COMPONENT; n], turns: vec![0; n] };
        // Number and turns of the first pixel by root.
        let mut known: Vec<(u32, i32)> = vec![(NO_COMPONENT, 0); n];
        let mut next = 0;
        for pixel in (0..n).filter(|i| valid[*i]) {
            let (root, turns) = self.find(pixel);
            if known[root].0 == NO_COMPONENT {
                known[root] = (next, turns);
                next += 1;
            }
            labels.component[pixel] = known[root].0;
            labels.turns[pixel] = turns - known[root].1;
        }
        labels
    }
}
