//! Where a measured surface ends along an outline.
//!
//! A cloud has no point on an edge: in a strip across it the outermost point lies a gap inside, and how large that is depends on
//! how the points lie: of points at random the mean gap is 1/(ρ w), with ρ points per square millimetre and strips of width w; of
//! a camera's grid it is up to a sixth of the spacing less, and along its rows all strips share one gap. So the surface itself is
//! asked: virtual borders at many depths within the band cut the same strips, and the mean distance of the next point behind them
//! is the gap. How much the mean over all strips changes from one virtual border to another one is how far the mean over the
//! outermost points may lie off. What light does at an edge is not seen here and belongs to `u_system_mm`.

use super::FitError;
use super::outline::Placed;

/// Most and fewest strips along an outline, and their width in spacings of the points.
const MOST_STRIPS: f64 = 360.0;
const LEAST_STRIPS: f64 = 8.0;
const STRIP_SPACINGS: f64 = 2.0;

/// Fewest strips with a border, as a share of all: less of an outline does not show its size.
const LEAST_COVERED: f64 = 0.5;

/// Share of the expected points below which a strip lies in shadow.
const LEAST_FILLED: f64 = 0.25;

/// Virtual borders, and up to which part of the band they lie: behind the last one some points have to follow.
const VIRTUAL: usize = 32;
const VIRTUAL_SHARE: f64 = 0.6;

/// Virtual borders count as independent beyond so many gaps: nearer ones meet the same points.
const APART_GAPS: f64 = 1.5;

/// The border of a surface along an outline.
#[derive(Debug, Clone, PartialEq)]
pub struct Border {
    /// Points of the border, mm.
    pub points: Vec<[f64; 2]>,
    /// Standard deviation that independent points would need for what the mean over many of them may lie off, mm.
    pub u_point_mm: f64,
    /// Standard deviation of single points about a straight border, from the gaps alone, mm.
    pub scatter_mm: f64,
}

/// A piece of an outline in strips of one width.
struct Piece {
    start: f64,
    width: f64,
    /// Widening of the strips with depth, 1/mm.
    widening: f64,
    /// Depths of the points of each strip with their index, rising.
    strips: Vec<Vec<(f64, usize)>>,
}

/// Mean gap of a piece and how it changes from one virtual border to another.
struct Gaps {
    mean_mm: f64,
    /// Variance of the mean over the strips, times their number, mm².
    variance: Option<f64>,
    /// Sum of squares of single gaps about the mean of their virtual border, and its degrees of freedom.
    squares: f64,
    freedom: f64,
}

/// Finds where a surface ends near an outline. `hole`: the material lies outside of it. Points deeper than `band_mm` in
/// the material, and within `corner_mm` of a corner or end, are not looked at.
///
/// # Errors
/// Too few points, or an outline that the surface borders along less than half of its length.
pub fn border(
    points: &[[f64; 2]],
    near: &Placed,
    hole: bool,
    band_mm: f64,
    corner_mm: f64,
) -> Result<Border, FitError> {
    // An edge's material lies on its left, where the distance is negative.
    let sign = if hole { 1.0 } else { -1.0 };
    let pieces = near.outline.pieces(corner_mm);
    let held = |along: f64| pieces.iter().position(|(start, end, _)| (*start..=*end).contains(&along));
    let seen: Vec<(f64, f64, usize, usize)> = points
        .iter()
        .enumerate()
        .filter_map(|(index, place)| {
            let (distance, along) = near.see(*place);
            let depth = sign * distance;
            Some((depth, along, held(along).filter(|_| depth <= band_mm)?, index))
        })
        .collect();
    let density = density(&seen, &pieces, sign, band_mm)?;
    let mut pieces = divided(&pieces, sign, density);
    for (depth, along, piece, index) in seen {
        let piece = &mut pieces[piece];
        let strip = (((along - piece.start) / piece.width) as usize).min(piece.strips.len() - 1);
        piece.strips[strip].push((depth, index));
    }
    let all: usize = pieces.iter().map(|p| p.strips.len()).sum();
    for piece in &mut pieces {
        let enough = (LEAST_FILLED * density * piece.width * band_mm).max(2.0);
        piece.strips.retain(|strip| strip.len() as f64 >= enough);
        piece
            .strips
            .iter_mut()
            .for_each(|s| s.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1))));
    }
    pieces.retain(|p| !p.strips.is_empty());
    let filled: usize = pieces.iter().map(|p| p.strips.len()).sum();
    if (filled as f64) < LEAST_COVERED * all as f64 {
        return Err(FitError::Degenerate {
            element: "outline",
            why: "less than half of it borders the surface",
        });
    }
    Ok(moved_out(points, near, &pieces, sign, band_mm))
}

/// Points per square millimetre in the material, from those that are no border.
fn density(
    seen: &[(f64, f64, usize, usize)],
    pieces: &[(f64, f64, Option<f64>)],
    sign: f64,
    band_mm: f64,
) -> Result<f64, FitError> {
    let deep = seen.iter().filter(|(depth, ..)| *depth > band_mm / 3.0).count();
    if deep < 10 {
        return Err(FitError::TooFewPoints { element: "outline", points: deep, needs: 10 });
    }
    // Strips of a round piece are as wide in the middle of that depth as the mean.
    let middle =
        |radius: &Option<f64>| radius.map_or(1.0, |r| (1.0 + sign * band_mm * 2.0 / 3.0 / r).max(0.1));
    let length: f64 = pieces.iter().map(|(start, end, radius)| (end - start) * middle(radius)).sum();
    Ok(deep as f64 / (length * band_mm * 2.0 / 3.0))
}

/// The pieces in strips about two spacings wide.
fn divided(pieces: &[(f64, f64, Option<f64>)], sign: f64, density: f64) -> Vec<Piece> {
    let covered: f64 = pieces.iter().map(|(start, end, _)| end - start).sum();
    let piece = |(start, end, radius): &(f64, f64, Option<f64>)| {
        let length = end - start;
        let of = |strips: f64| (strips * length / covered).ceil();
        let count =
            (length * density.sqrt() / STRIP_SPACINGS).floor().clamp(of(LEAST_STRIPS), of(MOST_STRIPS));
        Piece {
            start: *start,
            width: length / count,
            widening: radius.map_or(0.0, |r| sign / r),
            strips: vec![Vec::new(); count as usize],
        }
    };
    pieces.iter().map(piece).collect()
}

/// The outermost point of each strip, moved out by the gap of its piece.
fn moved_out(points: &[[f64; 2]], near: &Placed, pieces: &[Piece], sign: f64, band_mm: f64) -> Border {
    let gaps: Vec<Gaps> = pieces.iter().map(|piece| piece.gaps(band_mm)).collect();
    let both = || pieces.iter().zip(&gaps);
    let count: f64 = pieces.iter().map(|p| p.strips.len() as f64).sum();
    // A gap is the smaller the wider its strip; all pieces together know it best.
    let gap_by_width = both().map(|(p, g)| p.strips.len() as f64 * g.mean_mm * p.width).sum::<f64>() / count;
    let freedom: f64 = gaps.iter().map(|g| g.freedom).sum();
    let gap_mm = gap_by_width * pieces.iter().map(|p| p.strips.len() as f64 / p.width).sum::<f64>() / count;
    let scatter = gaps.iter().map(|g| g.squares).sum::<f64>() / freedom.max(1.0);
    let scatter = if freedom > 0.0 { scatter } else { gap_mm * gap_mm };
    let of_means = || both().filter_map(|(p, g)| Some((p.strips.len() as f64, g.variance?)));
    let weights: f64 = of_means().map(|(n, _)| n).sum();
    let variance = of_means().map(|(n, variance)| n * variance).sum::<f64>() / weights;
    let outermost = |(piece, strip): (&Piece, &Vec<(f64, usize)>)| {
        let place = points[strip[0].1];
        let [x, y] = near.global(near.outline.out(near.local(place)));
        let gap = sign * gap_by_width / piece.width;
        [place[0] - gap * x, place[1] - gap * y]
    };
    Border {
        points: pieces.iter().flat_map(|p| p.strips.iter().map(move |s| (p, s))).map(outermost).collect(),
        u_point_mm: if weights > 0.0 { variance } else { scatter }.sqrt(),
        scatter_mm: scatter.sqrt(),
    }
}

impl Piece {
    /// Distance of the next point behind a virtual border in a strip, at the border's width, or how far none was seen.
    fn behind(&self, strip: &[(f64, usize)], depth: f64, band_mm: f64) -> (f64, bool) {
        let next = strip.partition_point(|(d, _)| *d < depth);
        let (gap, found) = strip.get(next).map_or((band_mm - depth, false), |(d, _)| (d - depth, true));
        (gap * (1.0 + self.widening * depth).max(0.1), found)
    }

    fn gaps(&self, band_mm: f64) -> Gaps {
        let step = VIRTUAL_SHARE * band_mm / VIRTUAL as f64;
        let (mut sum, mut found, mut squares, mut freedom) = (0.0, 0.0, 0.0, 0.0);
        let mut means = Vec::with_capacity(VIRTUAL);
        for border in 0..VIRTUAL {
            let depth = border as f64 * step;
            let all: Vec<(f64, bool)> = self.strips.iter().map(|s| self.behind(s, depth, band_mm)).collect();
            let seen: Vec<f64> = all.iter().filter(|(_, found)| *found).map(|(gap, _)| *gap).collect();
            // Strips that end without a point have waited that long for one.
            sum += all.iter().map(|(gap, _)| gap).sum::<f64>();
            found += seen.len() as f64;
            if seen.is_empty() {
                continue;
            }
            let mean = seen.iter().sum::<f64>() / seen.len() as f64;
            means.push((border, mean));
            squares += seen.iter().map(|gap| (gap - mean) * (gap - mean)).sum::<f64>();
            freedom += (seen.len() - 1) as f64;
        }
        let mean_mm = sum / found.max(1.0);
        let apart = ((APART_GAPS * mean_mm / step).ceil() as usize).max(1);
        let (mut differences, mut pairs) = (0.0, 0.0);
        for (i, (first, a)) in means.iter().enumerate() {
            for (second, b) in &means[i + 1..] {
                if second - first >= apart {
                    differences += 0.5 * (a - b) * (a - b);
                    pairs += 1.0;
                }
            }
        }
        let variance = (pairs > 0.0).then(|| differences / pairs * self.strips.len() as f64);
        Gaps { mean_mm, variance, squares, freedom }
    }
}
