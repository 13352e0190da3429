//! A union–find forest whose links carry whole turns: joining two pixels fixes the turns between their whole groups.

use super::NO_COMPONENT;

/// The link of a pixel.
#[derive(Debug, Clone, Copy)]
pub struct Link {
    /// Another pixel of the group, or itself at the root.
    pub parent: u32,
    /// Turns of this pixel above its parent's.
    pub turns: i32,
}

/// Groups of pixels whose relative turns are known.
#[derive(Debug)]
pub struct Forest {
    links: Vec<Link>,
    /// Pixels of the group; counts at its root only.
    size: Vec<u32>,
}

/// Labels of each pixel by the forest.
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

    /// Numbers the groups and counts the turns from their first pixels.
    pub fn labels(mut self, valid: &[bool]) -> Labels {
        let n = valid.len();
        let mut labels = Labels { component: vec![NO_COMPONENT; n], turns: vec![0; n] };
        // Sizes have done their work: number of the group by root from here on.
        let mut number = std::mem::take(&mut self.size);
        number.fill(NO_COMPONENT);
        let mut first_turns = Vec::new();
        for pixel in (0..n).filter(|i| valid[*i]) {
            let (root, turns) = self.find(pixel);
            if number[root] == NO_COMPONENT {
                number[root] = first_turns.len() as u32;
                first_turns.push(turns);
            }
            labels.component[pixel] = number[root];
            labels.turns[pixel] = turns - first_turns[number[root] as usize];
        }
        labels
    }
}
