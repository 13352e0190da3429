//! The measured response as a rising curve, forward and backward.

use super::{GreyLevel, ResponseError};

/// A fall that noise and flicker do not explain, as a fraction of the range from black to white.
const FALL_LIMIT: f64 = 0.02;

/// A range below this fraction of full scale is no answer of a projector.
const LEAST_RANGE: f64 = 0.02;

/// Fewest different levels: eight coefficients and one degree of freedom.
pub(super) const LEAST_LEVELS: usize = 9;

/// A point on the curve.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Knot {
    /// Drawn level, 0 … 1.
    level: f64,
    /// Grey value that the camera shows, DN.
    dn: f64,
    /// Slope dDN/dlevel at the knot.
    slope: f64,
}

/// The response between the lowest and the highest level measured: monotone cubic interpolation (Fritsch and Carlson, SIAM
/// J. Numer. Anal. 17, 238 (1980)) of the means after those that noise put in the wrong order were pooled.
#[derive(Debug, Clone)]
pub struct ResponseCurve {
    knots: Vec<Knot>,
}

impl ResponseCurve {
    /// The curve through means that are sorted by level.
    ///
    /// # Errors
    /// Too few levels, no change, or a fall beyond noise.
    pub fn new(levels: &[GreyLevel], full_scale_dn: u16) -> Result<Self, ResponseError> {
        if levels.len() < LEAST_LEVELS {
            return Err(ResponseError::TooFewLevels { found: levels.len(), needed: LEAST_LEVELS });
        }
        let (low, high) = levels
            .iter()
            .fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), g| (l.min(g.mean_dn), h.max(g.mean_dn)));
        let least_dn = LEAST_RANGE * f64::from(full_scale_dn);
        if high - low < least_dn {
            return Err(ResponseError::Flat { range_dn: high - low, least_dn });
        }
        refuse_fall(levels, high - low)?;
        let mut knots = pooled(levels);
        if knots.len() < 2 {
            return Err(ResponseError::Undetermined { what: "a rising response" });
        }
        slopes(&mut knots);
        Ok(Self { knots })
    }

    /// Grey values at the lowest and the highest level, DN.
    pub fn range_dn(&self) -> [f64; 2] {
        [self.knots[0].dn, self.knots[self.knots.len() - 1].dn]
    }

    /// Light 0 … 1 (of the measured range) for a drawn level.
    pub fn light(&self, level: f64) -> f64 {
        let [black, white] = self.range_dn();
        let index = self.knots.partition_point(|k| k.level <= level).clamp(1, self.knots.len() - 1);
        let (a, b) = (self.knots[index - 1], self.knots[index]);
        let part = ((level - a.level) / (b.level - a.level)).clamp(0.0, 1.0);
        (hermite(a, b, part) - black) / (white - black)
    }

    /// The level that gives a light 0 … 1; the inverse of [`Self::light`] to rounding.
    pub fn level(&self, light: f64) -> f64 {
        let [black, white] = self.range_dn();
        let dn = black + (white - black) * light.clamp(0.0, 1.0);
        let index = self.knots.partition_point(|k| k.dn <= dn).clamp(1, self.knots.len() - 1);
        let (a, b) = (self.knots[index - 1], self.knots[index]);
        // Each segment rises, so halving finds the one place; 60 halvings are below rounding.
        let (mut low, mut high) = (0.0, 1.0);
        for _ in 0..60 {
            let middle = 0.5 * (low + high);
            if hermite(a, b, middle) < dn { low = middle } else { high = middle }
        }
        a.level + (b.level - a.level) * 0.5 * (low + high)
    }
}

/// Compares each mean with the highest one before it.
fn refuse_fall(levels: &[GreyLevel], range_dn: f64) -> Result<(), ResponseError> {
    let mut top = levels[0];
    for grey in levels {
        if grey.mean_dn < top.mean_dn - FALL_LIMIT * range_dn {
            return Err(ResponseError::NotMonotonic {
                here: top.level,
                here_dn: top.mean_dn,
                there: grey.level,
                there_dn: grey.mean_dn,
            });
        }
        if grey.mean_dn > top.mean_dn {
            top = *grey;
        }
    }
    Ok(())
}

/// Pools neighbours until all rise (pool adjacent violators). A flat beginning counts at its last level and a flat end at
/// its first one: beyond them the projector does not answer.
fn pooled(levels: &[GreyLevel]) -> Vec<Knot> {
    struct Block {
        first: f64,
        last: f64,
        sum_level: f64,
        sum_dn: f64,
        count: f64,
    }
    let mut blocks: Vec<Block> = Vec::with_capacity(levels.len());
    for grey in levels {
        let mut block = Block {
            first: grey.level,
            last: grey.level,
            sum_level: grey.level,
            sum_dn: grey.mean_dn,
            count: 1.0,
        };
        while let Some(before) = blocks.pop_if(|b| b.sum_dn / b.count >= block.sum_dn / block.count) {
            block.first = before.first;
            block.sum_level += before.sum_level;
            block.sum_dn += before.sum_dn;
            block.count += before.count;
        }
        blocks.push(block);
    }
    let end = blocks.len() - 1;
    let knot = |(index, block): (usize, &Block)| {
        let level = match index {
            0 if end > 0 => block.last,
            last if last == end => block.first,
            _ => block.sum_level / block.count,
        };
        Knot { level, dn: block.sum_dn / block.count, slope: 0.0 }
    };
    blocks.iter().enumerate().map(knot).collect()
}

/// Slopes that keep each segment monotone: weighted harmonic means of the secants, one-sided at the ends.
fn slopes(knots: &mut [Knot]) {
    let last = knots.len() - 1;
    let width = |k: &[Knot], i: usize| k[i + 1].level - k[i].level;
    let secants: Vec<f64> =
        knots.windows(2).map(|k| (k[1].dn - k[0].dn) / (k[1].level - k[0].level)).collect();
    for i in 1..last {
        let (h0, h1) = (width(knots, i - 1), width(knots, i));
        let (w0, w1) = (2.0 * h1 + h0, h1 + 2.0 * h0);
        knots[i].slope = (w0 + w1) / (w0 / secants[i - 1] + w1 / secants[i]);
    }
    let end = |h0: f64, h1: f64, s0: f64, s1: f64| {
        (((2.0 * h0 + h1) * s0 - h0 * s1) / (h0 + h1)).clamp(0.0, 3.0 * s0)
    };
    if last == 1 {
        (knots[0].slope, knots[1].slope) = (secants[0], secants[0]);
        return;
    }
    knots[0].slope = end(width(knots, 0), width(knots, 1), secants[0], secants[1]);
    knots[last].slope =
        end(width(knots, last - 1), width(knots, last - 2), secants[last - 1], secants[last - 2]);
}

/// Between two knots, `part` from 0 to 1.
fn hermite(a: Knot, b: Knot, part: f64) -> f64 {
    let width = b.level - a.level;
    let rest = 1.0 - part;
    let from_a = rest * rest * ((1.0 + 2.0 * part) * a.dn + part * width * a.slope);
    from_a + part * part * ((1.0 + 2.0 * rest) * b.dn - rest * width * b.slope)
}
