//! Places that two views have in common, found from the phases alone.

use super::HealthError;
use super::quadratic::{Quadratic, REACH};
use fringe::math::statistics::median;
use fringe::pattern::Axis;
use fringe::phase::PhaseView;
use nalgebra::{Matrix2, Point2, Vector2};
use std::f64::consts::TAU;

/// Windows of the left view stand side by side and share no pixel, so that their noise is independent.
const STRIDE: usize = 2 * REACH + 1;

/// A window whose misfit is this many times the median is on a step or at a shadow's edge.
const ROUGH: f64 = 3.0;

/// Moves of the window in the right view until it lies about the place looked for.
const MOST_MOVES: usize = 12;

/// Cells of the index for each pixel of the right view, at most.
const CELLS_PER_PIXEL: f64 = 2.0;

/// No window of the right view.
const NONE: u32 = u32::MAX;

/// One place in both views.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Match {
    /// Pixel of the left view: the middle of its window.
    pub left: Point2<f64>,
    /// Pixel of the right view.
    pub right: Point2<f64>,
    /// Covariance of `right` by the phase noise of both views, px².
    pub covariance_px2: Matrix2<f64>,
    /// The projector's pixel that lights the place, of two cameras under one projector.
    pub lit: Option<Lit>,
}

/// The projector's pixel of a place that two cameras see, as the left one measures it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Lit {
    /// Pixel of the projector.
    pub pixel: Point2<f64>,
    /// Covariance of the pixel by the phase noise of the left view, px².
    pub covariance_px2: Matrix2<f64>,
    /// Covariance of the right pixel (rows) with this one (columns), px².
    pub with_right_px2: Matrix2<f64>,
}

impl Match {
    /// The same place with left and right exchanged. Both views see alike: the covariance of the place is taken for that in the other picture.
    #[must_use]
    pub fn turned(self) -> Self {
        Self { left: self.right, right: self.left, ..self }
    }
}

/// What became of the windows of the left view.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, serde::Serialize)]
pub struct MatchCounts {
    /// Windows whose pixels are all valid.
    pub windows: usize,
    /// Left out on either side: a step or a shadow's edge crosses the window.
    pub rough: usize,
    /// The other view does not see the place.
    pub unseen: usize,
}

/// Matches, in the order of the left pixels.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Matches {
    /// Matches of both views.
    pub matches: Vec<Match>,
    /// Number of windows by outcome.
    pub counts: MatchCounts,
}

/// Both phases of a view about one pixel.
#[derive(Clone, Copy)]
struct Window {
    fits: [Quadratic; 2],
}

/// A view with both phases of one projector.
struct Maps<'a> {
    axes: [&'a PhaseView<'a>; 2],
    /// Projector pixels per radian.
    scale: [f64; 2],
    width: usize,
    height: usize,
}

impl<'a> Maps<'a> {
    fn new(side: &'static str, maps: [&'a PhaseView<'a>; 2]) -> Result<Self, HealthError> {
        let [x, y] = maps;
        let fault = |what: String| Err(HealthError::Maps { side, what });
        if (x.info.axis, y.info.axis) != (Axis::X, Axis::Y) {
            return fault("one map for the columns and one for the rows is needed".into());
        }
        let size = |map: &PhaseView| (map.info.width_px, map.info.height_px);
        if size(x) != size(y) {
            return fault(format!("{:?} px and {:?} px", size(x), size(y)));
        }
        let planes = |map: &PhaseView| {
            let n = map.info.len();
            [map.phase_rad.len(), map.sigma_rad.len(), map.valid.len()].iter().all(|l| *l == n)
        };
        if !planes(x) || !planes(y) {
            return fault("planes of another size".into());
        }
        let scale = maps.map(|map| map.info.period_px / TAU);
        Ok(Self { axes: maps, scale, width: x.info.width_px as usize, height: x.info.height_px as usize })
    }

    fn window(&self, column: usize, row: usize) -> Option<Window> {
        let [x, y] = self.axes.map(|map| Quadratic::new(map, column, row));
        Some(Window { fits: [x?, y?] })
    }

    /// Projector pixel of a camera pixel, as measured.
    fn lit(&self, index: usize) -> Option<[f64; 2]> {
        let [x, y] = self.axes;
        let valid = x.valid[index] == 1 && y.valid[index] == 1;
        let value = |axis: usize| f64::from(self.axes[axis].phase_rad[index]) * self.scale[axis];
        valid.then(|| [value(0), value(1)])
    }

    /// The windows of the stride that are valid throughout.
    fn windows(&self) -> Vec<(Point2<f64>, Window)> {
        let rows = (REACH..self.height).step_by(STRIDE);
        let places =
            rows.flat_map(|row| (REACH..self.width).step_by(STRIDE).map(move |column| (column, row)));
        let fitted = places.filter_map(|(c, r)| Some((Point2::new(c as f64, r as f64), self.window(c, r)?)));
        fitted.collect()
    }
}

impl Window {
    /// Projector pixel at an offset.
    fn lit(&self, scale: [f64; 2], at: Vector2<f64>) -> Vector2<f64> {
        Vector2::from_fn(|axis, _| self.fits[axis].at(at.x, at.y) * scale[axis])
    }

    /// Derivative of [`Self::lit`] by the place.
    fn slope(&self, scale: [f64; 2], at: Vector2<f64>) -> Matrix2<f64> {
        Matrix2::from_fn(|axis, by| self.fits[axis].slope(at.x, at.y)[by] * scale[axis])
    }

    /// Variances of [`Self::lit`], px².
    fn variance(&self, scale: [f64; 2], at: Vector2<f64>) -> Matrix2<f64> {
        let variance = |axis: usize| self.fits[axis].variance_at(at.x, at.y) * scale[axis] * scale[axis];
        Matrix2::new(variance(0), 0.0, 0.0, variance(1))
    }

    fn misfit(&self) -> f64 {
        self.fits[0].misfit.max(self.fits[1].misfit)
    }
}

/// The median misfit of all windows: about 1 where the stated noise is the real one.
fn median_misfit<'a>(windows: impl Iterator<Item = &'a Window>) -> f64 {
    median(&mut windows.map(Window::misfit).collect::<Vec<f64>>()).unwrap_or(1.0)
}

/// Matches two cameras under one projector by the phases of both axes; the maps are those of x, then y.
///
/// # Errors
/// Maps that do not belong together.
pub fn match_views(left: [&PhaseView; 2], right: [&PhaseView; 2]) -> Result<Matches, HealthError> {
    let (left, right) = (Maps::new("left", left)?, Maps::new("right", right)?);
    let windows = left.windows();
    let (typical, index) = (median_misfit(windows.iter().map(|(_, w)| w)), Index::new(&right));
    let mut out = Matches {
        counts: MatchCounts { windows: windows.len(), ..MatchCounts::default() },
        ..Matches::default()
    };
    let mut found = Vec::new();
    for (place, window) in windows {
        if window.misfit() > ROUGH * typical {
            out.counts.rough += 1;
            continue;
        }
        let wanted = window.lit(left.scale, Vector2::zeros());
        match index.start(wanted).and_then(|start| approach(&right, start, wanted)) {
            Some(place_right) => found.push((place, window, place_right)),
            None => out.counts.unseen += 1,
        }
    }
    let typical = median_misfit(found.iter().map(|(_, _, at)| &at.window));
    for (place, window, at) in found {
        if at.window.misfit() > ROUGH * typical {
            out.counts.rough += 1;
            continue;
        }
        let own = window.variance(left.scale, Vector2::zeros());
        let noise = own + at.window.variance(right.scale, at.offset);
        let covariance_px2 = at.inverse * noise * at.inverse.transpose();
        // What the left view measures wrongly leads to another place of the right view.
        let lit = Lit {
            pixel: Point2::from(window.lit(left.scale, Vector2::zeros())),
            covariance_px2: own,
            with_right_px2: at.inverse * own,
        };
        out.matches.push(Match { left: place, right: at.middle + at.offset, covariance_px2, lit: Some(lit) });
    }
    Ok(out)
}

/// Matches a camera with the projector that lit it: the phases of x and y are the projector's pixel.
///
/// # Errors
/// Maps that do not belong together.
pub fn match_projector(camera: [&PhaseView; 2]) -> Result<Matches, HealthError> {
    let maps = Maps::new("left", camera)?;
    let windows = maps.windows();
    let typical = median_misfit(windows.iter().map(|(_, w)| w));
    let mut out = Matches {
        counts: MatchCounts { windows: windows.len(), ..MatchCounts::default() },
        ..Matches::default()
    };
    for (left, window) in windows {
        if window.misfit() > ROUGH * typical {
            out.counts.rough += 1;
            continue;
        }
        let at = Vector2::zeros();
        let right = Point2::from(window.lit(maps.scale, at));
        out.matches.push(Match { left, right, covariance_px2: window.variance(maps.scale, at), lit: None });
    }
    Ok(out)
}

/// A window of the left view and its match in the right view.
struct MatchedWindow {
    middle: Point2<f64>,
    offset: Vector2<f64>,
    window: Window,
    /// Inverse of the slope.
    inverse: Matrix2<f64>,
}

/// Newton's method on the local surface; the window follows until the place lies about its middle.
fn approach(right: &Maps, start: usize, wanted: Vector2<f64>) -> Option<MatchedWindow> {
    let (mut column, mut row) = (start % right.width, start / right.width);
    for _ in 0..MOST_MOVES {
        let window = right.window(column, row)?;
        let (mut offset, mut inverse) = (Vector2::zeros(), Matrix2::zeros());
        for _ in 0..3 {
            inverse = window.slope(right.scale, offset).try_inverse()?;
            offset += inverse * (wanted - window.lit(right.scale, offset));
        }
        // Written so that NaN leaves too: no window is that far from its neighbour of the same phase.
        let near = offset.amax() < 64.0;
        if !near {
            return None;
        }
        if offset.amax() <= 0.75 {
            return Some(MatchedWindow {
                middle: Point2::new(column as f64, row as f64),
                offset,
                window,
                inverse,
            });
        }
        // The curvature of one window does not hold over a long way.
        let step = |v: f64| v.clamp(-8.0, 8.0).round() as i64;
        column = usize::try_from(column as i64 + step(offset.x)).ok()?;
        row = usize::try_from(row as i64 + step(offset.y)).ok()?;
    }
    None
}

/// Which pixel of the right view sees about which projector pixel.
struct Index {
    low: [f64; 2],
    cell_px: f64,
    columns: usize,
    rows: usize,
    pixels: Vec<u32>,
}

impl Index {
    fn new(right: &Maps) -> Self {
        let (mut low, mut high) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
        let pixels = right.width * right.height;
        let lit = || (0..pixels).filter_map(|index| Some((index, right.lit(index)?)));
        for (_, at) in lit() {
            for axis in 0..2 {
                low[axis] = low[axis].min(at[axis]);
                high[axis] = high[axis].max(at[axis]);
            }
        }
        if low[0] > high[0] {
            return Self { low: [0.0; 2], cell_px: 1.0, columns: 0, rows: 0, pixels: Vec::new() };
        }
        let extent = [high[0] - low[0] + 1.0, high[1] - low[1] + 1.0];
        let cell_px = (extent[0] * extent[1] / (CELLS_PER_PIXEL * pixels as f64)).sqrt().max(1.0);
        let count = |axis: usize| (extent[axis] / cell_px) as usize + 1;
        let mut index = Self { low, cell_px, columns: count(0), rows: count(1), pixels: Vec::new() };
        index.pixels = vec![NONE; index.columns * index.rows];
        for (pixel, at) in lit() {
            if let Some(cell) = index.cell(Vector2::from(at), [0, 0]) {
                index.pixels[cell] = pixel as u32;
            }
        }
        index
    }

    fn cell(&self, at: Vector2<f64>, beside: [i64; 2]) -> Option<usize> {
        let place = |axis: usize| ((at[axis] - self.low[axis]) / self.cell_px).floor() as i64 + beside[axis];
        let (column, row) = (place(0), place(1));
        let inside =
            column >= 0 && row >= 0 && (column as usize) < self.columns && (row as usize) < self.rows;
        inside.then(|| row as usize * self.columns + column as usize)
    }

    /// A pixel near the place: of its cell, or of one about it.
    fn start(&self, at: Vector2<f64>) -> Option<usize> {
        const ABOUT: [[i64; 2]; 9] =
            [[0, 0], [1, 0], [-1, 0], [0, 1], [0, -1], [1, 1], [-1, 1], [1, -1], [-1, -1]];
        ABOUT
            .iter()
            .filter_map(|beside| self.cell(at, *beside))
            .map(|cell| self.pixels[cell])
            .find(|pixel| *pixel != NONE)
            .map(|pixel| pixel as usize)
    }
}
