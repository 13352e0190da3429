//! Which phase and which order: the options that `decode` and `reconstruct` share, and what they do between frames and phase maps.

use anyhow::{Context, Result, bail};
use fringe::decode::{DecodeSettings, Decoder, OrderMethod, SineSet};
use fringe::frame::Frame;
use fringe::wrapped::harmonics::PhaseHarmonics;
use fringe::wrapped::windowed::{WindowedSettings, filter};
use fringe::wrapped::{Method, Stack, Wrapped};
use std::collections::BTreeMap;

/// Options of the phase and of the fringe order.
#[derive(clap::Args, Clone, Default)]
pub struct PhaseArgs {
    /// Method of the fringe order.
    #[arg(long, value_enum, default_value_t)]
    order: OrderName,
    /// Average all sine sets of an axis, weighted by inverse variance, instead of using the finest alone.
    #[arg(long)]
    fuse: bool,
    /// Estimate the harmonic (gamma) error from the phase and remove it.
    #[arg(long)]
    remove_harmonics: bool,
    /// Windowed Fourier filtering of the wrapped phase; the window's standard deviation in pixels.
    #[arg(long = "windowed-filter", value_name = "PX", num_args = 0..=1, default_missing_value = "4")]
    filter: Option<f64>,
}

/// [`Method`] on the command line.
#[derive(Clone, Copy, Default, clap::ValueEnum)]
pub enum PhaseName {
    /// N steps, even or with `shifts_rad`, by least squares.
    #[default]
    LeastSquares,
    /// Three equal steps in closed form.
    ThreeStep,
    /// Four equal steps of unknown size.
    Carre,
    /// Five steps of about 90 degrees.
    Hariharan,
    /// One frame, by the Fourier transform of its rows (or columns); sets of fewer than 4 periods keep least squares.
    FourierRows,
    /// One frame, by the Fourier transform in the plane; sets of fewer than 4 periods keep least squares.
    Fourier,
}

/// [`OrderMethod`] on the command line.
#[derive(Clone, Copy, Default, clap::ValueEnum)]
enum OrderName {
    /// What survives the most noise.
    #[default]
    Auto,
    /// Reflected Gray code: neighbouring stripes differ in one bit.
    Gray,
    /// Plain binary code: the bits are the stripe number.
    Binary,
    /// Two codes half a stripe apart.
    ShiftedGray,
    /// Stairs of phase or grey level.
    Stair,
    /// Sines from long to short periods.
    Hierarchical,
    /// Sines and their beats.
    Heterodyne,
    /// Sines with coprime periods, by table.
    NumberTheoretical,
}

/// Sets with fewer periods over the projector keep the plain phase of their steps: one frame of them has no carrier, and the
/// error of a harmonic does not average out over the part. Such sets only number the fringes of finer ones.
const LEAST_PERIODS: f64 = 4.0;

/// What is done with the frames of the sine sets.
#[derive(Debug, Clone, Copy, Default)]
pub struct PhaseMethod {
    /// None: the decoder's own running sums.
    method: Option<Method>,
    remove_harmonics: bool,
    window_px: Option<f64>,
    /// Whether what each pixel's order rests on is kept beside the map: as large again twice.
    pub keep_diagnosis: bool,
}

impl PhaseArgs {
    /// Settings of the decoder and what is done besides.
    pub fn choose(&self, method: PhaseName) -> (DecodeSettings, PhaseMethod) {
        let order = match self.order {
            OrderName::Auto => OrderMethod::Auto,
            OrderName::Gray => OrderMethod::Gray,
            OrderName::Binary => OrderMethod::Binary,
            OrderName::ShiftedGray => OrderMethod::ShiftedGray,
            OrderName::Stair => OrderMethod::Stair,
            OrderName::Hierarchical => OrderMethod::Hierarchical,
            OrderName::Heterodyne => OrderMethod::Heterodyne,
            OrderName::NumberTheoretical => OrderMethod::NumberTheoretical,
        };
        let method = match method {
            PhaseName::LeastSquares => None,
            PhaseName::ThreeStep => Some(Method::ThreeStep),
            PhaseName::Carre => Some(Method::Carre),
            PhaseName::Hariharan => Some(Method::Hariharan),
            PhaseName::FourierRows => Some(Method::FourierRows),
            PhaseName::Fourier => Some(Method::Fourier),
        };
        let settings = DecodeSettings { order, fuse: self.fuse, ..DecodeSettings::default() };
        let (remove_harmonics, window_px) = (self.remove_harmonics, self.filter);
        (settings, PhaseMethod { method, remove_harmonics, window_px, keep_diagnosis: false })
    }
}

/// The frames of the sine sets, kept until the last one has landed.
pub struct Kept {
    sets: Vec<SineSet>,
    frames: BTreeMap<usize, Frame>,
}

impl Kept {
    /// Keeps a frame that a method will ask for.
    pub fn keep(&mut self, number: usize, frame: Frame) {
        let of = |set: &SineSet| (set.first_frame..set.first_frame + set.shifts_rad.len()).contains(&number);
        if self.sets.iter().any(of) {
            self.frames.insert(number, frame);
        }
    }
}

impl PhaseMethod {
    /// A choice of its own; without a method, the decoder's least squares.
    pub fn new(method: Option<Method>, remove_harmonics: bool, window_px: Option<f64>) -> Self {
        Self { method, remove_harmonics, window_px, keep_diagnosis: false }
    }

    /// Room for the frames that the method needs; none for the decoder's own.
    pub fn keeper(&self, decoder: &Decoder) -> Kept {
        let own = self.method.is_none() && !self.remove_harmonics && self.window_px.is_none();
        Kept { sets: if own { Vec::new() } else { decoder.sine_sets() }, frames: BTreeMap::new() }
    }

    /// Puts the method's phases in the place of the decoder's.
    pub fn apply(&self, decoder: &mut Decoder, kept: &Kept) -> Result<()> {
        if let Some(px) = self.window_px.filter(|px| !(1.0..=32.0).contains(px)) {
            bail!("--windowed-filter {px}: must be 1 to 32 pixels");
        }
        for set in &kept.sets {
            let map = self.wrap(decoder, kept, set).with_context(|| format!("sine set {}", set.index))?;
            decoder.replace(set.index, &map)?;
        }
        Ok(())
    }

    fn wrap(&self, decoder: &Decoder, kept: &Kept, set: &SineSet) -> Result<Wrapped> {
        let numbers = set.first_frame..set.first_frame + set.shifts_rad.len();
        let views: Vec<_> = numbers.filter_map(|n| kept.frames.get(&n)).map(Frame::view).collect();
        let stack = Stack::new(&views, &set.shifts_rad)?;
        let many = set.periods >= LEAST_PERIODS;
        let by_fringes = |method: &Method| many || !matches!(method, Method::FourierRows | Method::Fourier);
        let method = self.method.filter(by_fringes).unwrap_or(Method::LeastSquares);
        let mut map = stack.wrap(method, &decoder.limits(set.axis)?)?;
        if self.remove_harmonics && many {
            if !set.even {
                bail!(
                    "--remove-harmonics needs even steps: with shifts_rad the error of a harmonic has no order"
                );
            }
            let found = PhaseHarmonics::find(&map, set.shifts_rad.len() as u32);
            let found = found.context("--remove-harmonics: too few pixels with light to tell the error")?;
            found.remove(&mut map);
        }
        Ok(match self.window_px {
            Some(window_px) => filter(&map, &WindowedSettings { window_px, ..WindowedSettings::default() }),
            None => map,
        })
    }
}
