//! Where a measured surface ends along an outline.
//!
//! A cloud has no point on an edge: in a strip across it the outermost point lies a gap inside, and how large that is depends on
//! how the points lie: of points at random the mean gap is 1/(ρ w), with ρ points per square millimetre and strips of width w; of
//! a camera's grid it is up to a sixth of the spacing less, and along its rows all strips share one gap. So the surface itself is
//! asked: virtual borders at many depths within the band cut the same strips, and the mean distance of the next point behind them
//! is the gap. How much the mean over all strips changes from one virtual border to another one is how far the mean over the
//! outermost points may lie off.
//!
//! A cloud of cameras ends before its surface does: pixels at the rim of a face are left out, where light of both sides mixes. Who knows how many says so
//! ([`LeftOut`]); then the border lies as much further out. What light does at the edge of another cloud is not seen here and belongs to `u_system_mm`.

use super::outline::Placed;
use super::{FitError, LeftOut};

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

/// Pixels that are left out within N of the rim of a face, in squares: N (|cos θ| + |sin θ|) along a rim at the angle θ to the rows, 4/π N in the mean over all
/// directions. The rim that the other camera sees takes more or less: of holes, discs and blocks before three rigs, pictures of another renderer, 0.8 to 1.6 N
/// was missing on a side, which is the mean ± a quarter N.
const RIM_MEAN: f64 = 4.0 / std::f64::consts::PI;
const RIM_U: f64 = 0.25;
/// A pixel that sees both sides counts or not: half a pixel to either side, all alike probable.
const LIGHT_U_PX: f64 = 0.29;
/// What is left out at a rim is at most so much of the band.
const MOST_RIM: f64 = 0.4;

/// The border of a surface along an outline.
#[derive(Debug, Clone, PartialEq)]
pub struct Border {
    /// Points of the border, mm.
    pub points: Vec<[f64; 2]>,
    /// Standard deviation that independent points would need for what the mean over many of them may lie off, mm.
    pub u_point_mm: f64,
    /// Standard deviation of single points about a straight border, from the gaps alone, mm.
    pub scatter_mm: f64,
    /// By how much all of them may lie too far out or in, mm: what was left out at the rim, and light at the edge.
    pub u_rim_mm: f64,
}

/// Why a band is too narrow.
const NARROW: &str = "what the cloud leaves out at rims (edge_px of its reconstruction) is more than 0.4 of its band_mm: widen the band, or reconstruct \
                      with edge_px = 0";

/// What a cloud of cameras leaves out at a rim: how wide it is, and the standard uncertainty of that, mm.
#[derive(Debug, Clone, Copy, Default)]
struct Rim {
    width_mm: f64,
    u_mm: f64,
}

impl Rim {
    /// Where so many points lie on a square millimetre.
    fn of(left_out: LeftOut, density: f64) -> Self {
        let (pixels, pixel_mm) = (f64::from(left_out.pixels), (left_out.layers / density).sqrt());
        let u_px = (RIM_U * pixels * (RIM_U * pixels) + LIGHT_U_PX * LIGHT_U_PX).sqrt();
        Self { width_mm: RIM_MEAN * pixels * pixel_mm, u_mm: u_px * pixel_mm }
    }
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
/// the material, and within `corner_mm` of a corner or end, are not looked at. `left_out`: what the points of cameras lack at the
/// rim of a face; `None`: nothing is known of it.
///
/// # Errors
/// Too few points, an outline that the surface borders along less than half of its length, or a band that hardly reaches the points.
pub fn border(
    points: &[[f64; 2]],
    near: &Placed,
    hole: bool,
    band_mm: f64,
    corner_mm: f64,
    left_out: Option<LeftOut>,
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
    let rim = left_out.map_or_else(Rim::default, |left_out| Rim::of(left_out, density));
    if rim.width_mm > MOST_RIM * band_mm {
        return Err(FitError::Degenerate { element: "outline", why: NARROW });
    }
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
    Ok(moved_out(points, near, &pieces, sign, (band_mm, rim)))
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
fn moved_out(
    points: &[[f64; 2]],
    near: &Placed,
    pieces: &[Piece],
    sign: f64,
    (band_mm, rim): (f64, Rim),
) -> Border {
    let gaps: Vec<Gaps> = pieces.iter().map(|piece| piece.gaps(rim.width_mm, band_mm)).collect();
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
        let gap = sign * (gap_by_width / piece.width + rim.width_mm);
        [place[0] - gap * x, place[1] - gap * y]
    };
    Border {
        points: pieces.iter().flat_map(|p| p.strips.iter().map(move |s| (p, s))).map(outermost).collect(),
        u_point_mm: if weights > 0.0 { variance } else { scatter }.sqrt(),
        scatter_mm: scatter.sqrt(),
        u_rim_mm: rim.u_mm,
    }
}

impl Piece {
    /// Distance of the next point behind a virtual border in a strip, at the border's width, or how far none was seen.
    fn behind(&self, strip: &[(f64, usize)], depth: f64, band_mm: f64) -> (f64, bool) {
        let next = strip.partition_point(|(d, _)| *d < depth);
        let (gap, found) = strip.get(next).map_or((band_mm - depth, false), |(d, _)| (d - depth, true));
        (gap * (1.0 + self.widening * depth).max(0.1), found)
    }

    /// Behind virtual borders from a depth on.
    fn gaps(&self, from_mm: f64, band_mm: f64) -> Gaps {
        let step = (VIRTUAL_SHARE * band_mm - from_mm) / VIRTUAL as f64;
        let (mut sum, mut found, mut squares, mut freedom) = (0.0, 0.0, 0.0, 0.0);
        let mut means = Vec::with_capacity(VIRTUAL);
        for border in 0..VIRTUAL {
            let depth = from_mm + border as f64 * step;
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

#[cfg(test)]
mod tests {
    use super::super::outline::Outline;
    use super::*;
    use fringe::math::{cos, hypot, sin};

    const PIXEL_MM: f64 = 0.25;
    const RADIUS_MM: f64 = 8.0;

    /// Pixels of a plate with a hole, `turn` their angle to it, without those within so many of one inside the hole.
    fn plate(turn: f64, shift: [f64; 2], left_out: i32) -> Vec<[f64; 2]> {
        let at = |u: i32, v: i32| {
            let (u, v) = (f64::from(u) + shift[0], f64::from(v) + shift[1]);
            [PIXEL_MM * (u * cos(turn) - v * sin(turn)), PIXEL_MM * (u * sin(turn) + v * cos(turn))]
        };
        let is_hole = |u: i32, v: i32| {
            let [x, y] = at(u, v);
            hypot(x, y) < RADIUS_MM
        };
        let near = |u: i32, v: i32| {
            (-left_out..=left_out).any(|a| (-left_out..=left_out).any(|b| is_hole(u + a, v + b)))
        };
        let all = (-60..=60).flat_map(|v| (-60..=60).map(move |u| (u, v)));
        all.filter(|(u, v)| !near(*u, *v)).map(|(u, v)| at(u, v)).collect()
    }

    /// What one pair leaves out.
    fn alone(pixels: u32) -> LeftOut {
        LeftOut { pixels, layers: 1.0 }
    }

    /// Mean distance of the border from the middle, mm, and its uncertainty.
    fn radius(points: &[[f64; 2]], pixels: Option<u32>) -> (f64, f64) {
        let near = Placed { outline: Outline::Circle(RADIUS_MM), center: [0.0; 2], turn_rad: 0.0 };
        let found = border(points, &near, true, 4.0, 0.0, pixels.map(alone)).unwrap();
        let sum: f64 = found.points.iter().map(|[x, y]| hypot(*x, *y)).sum();
        (sum / found.points.len() as f64, found.u_rim_mm)
    }

    /// Half a pixel of a side is the light's; the rest of u is that of the rim, which squares leave out as they lie.
    #[test]
    fn a_hole_is_as_large_as_before_its_rim_was_left_out() {
        for left_out in 0..=3 {
            for (turn, shift) in [(0.0, [0.2, 0.4]), (0.4, [0.0, 0.7]), (0.785, [0.5, 0.1])] {
                let points = plate(turn, shift, left_out as i32);
                let (told, u_mm) = radius(&points, Some(left_out));
                assert!((told - RADIUS_MM).abs() < 1.5 * u_mm, "{left_out}, {turn}: {told}, u {u_mm}");
                assert!(u_mm < PIXEL_MM * (0.3 + 0.25 * f64::from(left_out)), "{left_out}: u {u_mm}");
                let (untold, none) = radius(&points, None);
                let missing = untold - RADIUS_MM;
                assert!(
                    none == 0.0 && missing > (f64::from(left_out) - 0.3) * PIXEL_MM,
                    "{left_out}, {turn}: {missing}"
                );
            }
        }
    }

    #[test]
    fn a_band_that_hardly_reaches_the_points_is_refused() {
        let near = Placed { outline: Outline::Circle(RADIUS_MM), center: [0.0; 2], turn_rad: 0.0 };
        let points = plate(0.3, [0.0; 2], 2);
        let refused = border(&points, &near, true, 1.5, 0.0, Some(alone(2))).unwrap_err();
        assert!(refused.to_string().contains("edge_px = 0"), "{refused}");
    }
}
