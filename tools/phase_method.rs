//! Which phase and which order: the options that `decode` and `reconstruct` share.

use crate::numbers::within;
use cell::executor::PhaseMethod;
use fringe::decode::{DecodeSettings, OrderMethod};
use fringe::wrapped::Method;

/// Options of the phase and of the fringe order.
#[derive(clap::Args, Clone, Default)]
pub struct PhaseArgs {
    /// Method of the fringe order.
    #[arg(long, value_enum, default_value_t)]
    order: OrderName,
    /// Average all sine sets of an axis, weighted by inverse variance, instead of using the finest alone.
    #[arg(long)]
    fuse: bool,
    /// Decode pixels that are clipped in some sine frames from the others, where these determine the phase.
    #[arg(long)]
    use_clipped: bool,
    /// Estimate the harmonic (gamma) error from the phase and remove it.
    #[arg(long)]
    remove_harmonics: bool,
    /// Windowed Fourier filtering of the wrapped phase; the window's standard deviation in pixels.
    #[arg(long = "windowed-filter", value_name = "PX", num_args = 0..=1, default_missing_value = "4", value_parser = |text: &str| within(text, 1.0..=32.0))]
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
        let settings = DecodeSettings {
            order,
            fuse: self.fuse,
            use_clipped: self.use_clipped,
            ..DecodeSettings::default()
        };
        let (remove_harmonics, window_px) = (self.remove_harmonics, self.filter);
        (settings, PhaseMethod { method, remove_harmonics, window_px })
    }
}
