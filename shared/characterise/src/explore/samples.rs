//! Grey values at pixels that the patterns change, and at their neighbours.

use super::{ExploreError, FrameFigures};
use fringe::frame::FrameView;

/// Pixels that are looked at: enough for a share to half a percent.
const MAX_PIXELS: usize = 10_000;

/// Pixels that change by less than this part of what the brightest change are dark.
const LIT_SHARE: f32 = 0.25;

/// Least change that is no noise, as a part of full scale.
const LEAST_RANGE: f64 = 0.03;

/// Values of all frames at some pixels and at the neighbours to the right and below.
pub(super) struct Samples {
    /// By frame, by place (the pixel, right of it, below it), by pixel: DN.
    values: Vec<[Vec<f32>; 3]>,
    /// Largest less smallest value over the frames, DN.
    pub range_dn: Vec<f32>,
    /// Mean of largest and smallest value, DN, by place.
    middle_dn: [Vec<f32>; 3],
    /// Share of the picture that changes enough.
    pub lit_share: f64,
    /// Columns and rows of the picture, px.
    pub picture_px: [u32; 2],
}

impl Samples {
    /// Chooses pixels evenly among those that change.
    pub fn gather(frames: &[FrameView<'_>]) -> Result<Self, ExploreError> {
        let (width, height) = (frames[0].width_px as usize, frames[0].height_px as usize);
        let (lowest, highest) = envelope(frames, width * height);
        let range = |pixel: usize| highest[pixel] - lowest[pixel];
        let top = percentile_99((0..width * height).map(range));
        let least_dn = LEAST_RANGE * f64::from(frames.iter().map(|f| f.full_scale_dn).max().unwrap_or(255));
        let unchanged = ExploreError::Unchanged { range_dn: f64::from(top), least_dn };
        if f64::from(top) < least_dn {
            return Err(unchanged);
        }
        let inside = |pixel: &usize| pixel % width + 1 < width && pixel / width + 1 < height;
        let lit: Vec<usize> =
            (0..width * height).filter(inside).filter(|pixel| range(*pixel) > LIT_SHARE * top).collect();
        if lit.is_empty() {
            return Err(unchanged);
        }
        let chosen: Vec<usize> = lit.iter().copied().step_by(lit.len().div_ceil(MAX_PIXELS)).collect();
        let places = [0, 1, width];
        let at =
            |frame: &FrameView, offset: usize| chosen.iter().map(|p| frame.pixels.get(p + offset)).collect();
        Ok(Self {
            values: frames.iter().map(|frame| places.map(|offset| at(frame, offset))).collect(),
            range_dn: chosen.iter().map(|p| range(*p)).collect(),
            middle_dn: places.map(|offset| {
                chosen.iter().map(|p| f32::midpoint(highest[p + offset], lowest[p + offset])).collect()
            }),
            lit_share: lit.len() as f64 / (width * height) as f64,
            picture_px: [frames[0].width_px, frames[0].height_px],
        })
    }

    /// Number of pixels looked at.
    pub fn len(&self) -> usize {
        self.range_dn.len()
    }

    /// Number of frames of the series.
    pub fn frames(&self) -> usize {
        self.values.len()
    }

    /// Grey values of a frame, DN; place 0 is the pixel, 1 its right neighbour, 2 the one below.
    pub fn values_dn(&self, frame: usize, place: usize) -> &[f32] {
        &self.values[frame][place]
    }

    /// Which pixels are nearer to their brightest than to their darkest value.
    pub fn bright(&self, frame: usize, place: usize) -> impl Iterator<Item = bool> {
        self.values[frame][place].iter().zip(&self.middle_dn[place]).map(|(value, middle)| value > middle)
    }

    /// Share of the pixels for which two frames are not on the same side of their middle.
    pub fn contradiction(&self, a: usize, b: usize) -> f64 {
        let differ = self.bright(a, 0).zip(self.bright(b, 0)).filter(|(a, b)| a != b).count();
        differ as f64 / self.len() as f64
    }

    /// What a frame looks like.
    pub fn figures(&self, frame: usize, view: &FrameView<'_>) -> FrameFigures {
        let count = self.len() as f64;
        let edges = |place| {
            let pairs = self.bright(frame, 0).zip(self.bright(frame, place));
            pairs.filter(|(here, there)| here != there).count() as f64 / count
        };
        let pixels = view.pixels.len();
        let full = f32::from(view.full_scale_dn);
        FrameFigures {
            mean_dn: self.values[frame][0].iter().map(|v| f64::from(*v)).sum::<f64>() / count,
            bright_share: self.bright(frame, 0).filter(|bright| *bright).count() as f64 / count,
            edges_x: edges(1),
            edges_y: edges(2),
            saturated_share: (0..pixels).filter(|i| view.pixels.get(*i) >= full).count() as f64
                / pixels as f64,
        }
    }
}

/// Smallest and largest value of each pixel over the frames.
fn envelope(frames: &[FrameView<'_>], pixels: usize) -> (Vec<f32>, Vec<f32>) {
    let (mut lowest, mut highest) = (vec![f32::INFINITY; pixels], vec![f32::NEG_INFINITY; pixels]);
    for frame in frames {
        for (pixel, (low, high)) in lowest.iter_mut().zip(&mut highest).enumerate() {
            let value = frame.pixels.get(pixel);
            *low = low.min(value);
            *high = high.max(value);
        }
    }
    (lowest, highest)
}

/// 99th percentile: a few hot pixels do not count.
fn percentile_99(values: impl Iterator<Item = f32>) -> f32 {
    let mut values: Vec<f32> = values.collect();
    let place = (values.len() - 1) * 99 / 100;
    *values.select_nth_unstable_by(place, f32::total_cmp).1
}
