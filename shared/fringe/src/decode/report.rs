//! What a decoding did.

use super::bounce::Bounced;
use super::code_shift::CodeShift;
use super::continuity::Continuity;
use super::dirt::Finding;
use super::error::DecodeError;
use super::identity::FrameOrder;
use super::linearity::Linearity;
use super::motion::Motion;
use super::noise_model::NoiseModel;
use super::sensor_test::SensorTest;
use crate::pattern::Axis;
use std::sync::Arc;

/// With fewer lit pixels the sequence is not checked.
const LEAST_LIT: usize = 200;
/// Contradiction that a person should know of: few edges of a part make so many.
const MUCH_CONTRADICTION: f64 = 0.1;
/// Part of the pixels that light from other faces masks, from which on a person should know.
const MUCH_MASKED: f64 = 0.03;
/// Where more than this part of the pixels seems to be lit by other faces …
const TOUCHED: f64 = 0.1;
/// … and the noise is this many times that of the rig file, another gain is as likely.
const NOISIER: f64 = 1.1;

impl DecodeReport {
    /// How far code and phase contradict each other: the larger of jumps per wrap and lit pixels without order.
    pub fn contradiction(&self) -> f64 {
        let (unresolved, lit) = self.unresolved();
        let pixels = if lit < LEAST_LIT { 0.0 } else { unresolved as f64 / lit as f64 };
        self.continuity.jump_fraction().max(pixels)
    }

    /// By how much the variance of the footprint differs from what was taken off, px²: as the frames show it, where they contradict the
    /// calibration, or what is left of it.
    pub fn footprint_off_px2(&self) -> Option<f64> {
        self.sensor.footprint_off_px2().or(self.footprint_left_px2)
    }

    /// What contradicts the calibration, a motion beyond the uncertainty, and an order of frames that nothing proves, in words; `camera` is
    /// named.
    pub fn warnings(&self, camera: &str) -> Vec<String> {
        let moved = self.motion.and_then(|motion| motion.warning(camera));
        let stands_off = self.code_shift.and_then(|shift| shift.warning(camera));
        let bent = self.linearity.and_then(|linearity| linearity.warning(camera));
        let moved = moved.into_iter().chain(stands_off).chain(bent).chain(self.noise_as_light(camera));
        let moved = moved.chain(self.doubtful_orders(camera)).chain(self.much_light(camera));
        self.sensor.warnings(camera).into_iter().chain(moved).chain(self.order.warning(camera)).collect()
    }

    /// Noise that the calibration understates looks like light from other faces, everywhere a little.
    fn noise_as_light(&self, camera: &str) -> Option<String> {
        let test =
            self.sensor.noise.filter(|test| !test.contradicts && test.seen_dn > NOISIER * test.known_dn)?;
        let (touched, all) = (self.bounced.raised + self.bounced.masked, self.valid + self.bounced.masked);
        (touched as f64 > TOUCHED * all as f64).then(|| {
            format!(
                "camera \"{camera}\": light from other faces seems to reach {touched} of {all} pixels, but these frames also show a noise of {:.2} DN at \
                 {:.0} DN, the rig file states {:.2} DN: another gain, or light that flickers, looks the same; look at both, or calibrate again",
                test.seen_dn, test.background_dn, test.known_dn
            )
        })
    }

    /// Orders that do not fit the phase at many places, though not at so many that they are refused.
    fn doubtful_orders(&self, camera: &str) -> Option<String> {
        let (share, Continuity { wraps, jumps }) = (self.contradiction(), self.continuity);
        (share > MUCH_CONTRADICTION).then(|| {
            format!(
                "camera \"{camera}\": code and phase contradict each other at {:.0} % ({jumps} order jumps at {wraps} wraps), so that points may be wrong by \
                 whole periods: check the order of the code's frames, stripe_px, direction and first_step_rad; frames of another recording or exchanged \
                 sets look so, and parts of many small faces",
                100.0 * share
            )
        })
    }

    /// Frames of two places of the part in one set look like light from other faces in many places.
    fn much_light(&self, camera: &str) -> Option<String> {
        let (masked, all) = (self.bounced.masked, self.valid + self.bounced.masked);
        (masked as f64 > MUCH_MASKED * all as f64).then(|| {
            format!(
                "camera \"{camera}\": light from other faces is so strong at {masked} of {all} pixels that they are left out; frames of another place of the part \
                 among the others look the same: look at the frames, or turn the part"
            )
        })
    }

    /// Refuses orders that contradict the phase beyond a limit.
    ///
    /// # Errors
    /// [`DecodeError::Contradiction`].
    pub(super) fn check_orders(&self, axis: Axis, limit: f64) -> Result<(), DecodeError> {
        if self.contradiction() <= limit {
            return Ok(());
        }
        let (unresolved, lit) = self.unresolved();
        let Continuity { wraps, jumps } = self.continuity;
        Err(DecodeError::Contradiction { axis, jumps, wraps, unresolved, lit, limit })
    }

    /// Pixels whose order stays open; and these together with the valid ones.
    pub fn unresolved(&self) -> (usize, usize) {
        let unresolved = self.ambiguous - self.resolved.min(self.ambiguous);
        (unresolved, self.valid + unresolved)
    }
}

/// Counts of one decoded axis. Pixels that fail several tests are counted at the first one in the order of the fields.
#[derive(Debug, Clone, PartialEq)]
pub struct DecodeReport {
    /// Pixels with a usable absolute phase.
    pub valid: usize,
    /// Masked: a sine frame is clipped.
    pub saturated: usize,
    /// Clipped in some sine frames, and decoded from the others; not masked.
    pub recovered: usize,
    /// Masked: too little modulation.
    pub dark: usize,
    /// Masked: phase noise beyond the limit.
    pub noisy: usize,
    /// Pixels whose own frames did not settle the order.
    pub ambiguous: usize,
    /// Of these, settled by their neighbours.
    pub resolved: usize,
    /// Single pixels whose order was corrected by whole periods because all neighbours agree on it.
    pub spikes_repaired: usize,
    /// Single pixels masked because all neighbours contradict them.
    pub spikes_masked: usize,
    /// Pixels that light from other faces reaches: raised uncertainty, and masked ones.
    pub bounced: Bounced,
    /// Noise model behind the phase uncertainty.
    pub noise: NoiseModel,
    /// Standard deviation of the pixel's footprint whose bias was removed, camera pixels; `None` where nothing was.
    pub footprint_px: Option<f64>,
    /// Whether that is of any lens in focus: neither rig file nor settings state one, and white and black do not show it.
    pub footprint_assumed: bool,
    /// What is left of its variance, px²: where settings state what is removed and the calibration another one, where settings remove nothing, and of
    /// an axis of a code alone.
    pub footprint_left_px2: Option<f64>,
    /// What the frames say of the camera's constants, where the calibration found them.
    pub sensor: SensorTest,
    /// How the fringes moved between the frames, where five or more steps tell.
    pub motion: Option<Motion>,
    /// How far the frames of the code stand from the fringes, where frames that are all right tell.
    pub code_shift: Option<CodeShift>,
    /// What white and black say of a sine of three steps.
    pub linearity: Option<Linearity>,
    /// Of every 4th row and column: places where the phase passes 2π, and where it jumps by whole periods.
    pub continuity: Continuity,
    /// Faults of the frames that were found and made up for.
    pub findings: Vec<Finding>,
    /// What the frames proved of their order.
    pub order: FrameOrder,
    /// Sets of the sequence that were not used; every set stands in the report of exactly one axis.
    pub ignored: Arc<[String]>,
}
