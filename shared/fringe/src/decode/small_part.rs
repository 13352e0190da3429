//! The noise of a part so small that the probed pixels, every few of the picture, do not show it: then each of its own pixels is asked.

use super::Decoder;
use super::block::state;
use super::noise_estimate::Probe;
use super::rasters::Rasters;
use crate::phase::PhaseViewMut;

impl Probe {
    /// Asks the valid pixels of a map, as far as there is room for them, in place of every few.
    fn aim_at(&mut self, valid: &[u8]) {
        let room = self.positions.len();
        self.positions.clear();
        let sure =
            || valid.iter().enumerate().filter(|(_, valid)| **valid == state::SURE).map(|(index, _)| index);
        let every = sure().count().div_ceil(room.max(1)).max(1);
        self.positions.extend(sure().step_by(every));
        self.begin();
    }

    /// Asks every few again.
    fn aim_at_all(&mut self, pixels: usize) {
        self.positions.clear();
        self.positions.extend((0..pixels).step_by(self.stride));
    }

    /// Keeps the grey values of a step, wherever the positions are.
    fn keep_each(&mut self, step: usize, raster: usize, rasters: &Rasters) {
        let count = self.positions.len();
        let Some(kept) = self.frames.get_mut(step * count..(step + 1) * count) else { return };
        for (kept, index) in kept.iter_mut().zip(&self.positions) {
            *kept = rasters.value(raster, *index);
        }
    }
}

impl Decoder {
    /// Whether the pixels of a small part gave the noise model that the probed ones did not; then the map was decoded with an assumption, and
    /// is to be decoded again.
    pub(super) fn ask_small_part(&mut self, home: usize, out: &PhaseViewMut) -> bool {
        let (given, limits) = (self.is_noise_given(), self.probe_limits());
        let axis = &mut self.axes[home];
        if given || axis.estimate.is_some() || std::mem::replace(&mut axis.asked_small_part, true) {
            return false;
        }
        let probe = &mut self.axes[home].probe;
        // What the frames leave unexplained was judged before.
        let judged = (probe.unexplained, probe.unexplained_of_four);
        probe.aim_at(out.valid);
        for (set, slot) in self.plan.axes[home].sines.iter().enumerate() {
            if !self.findings[*slot].is_empty() {
                continue;
            }
            for (step, raster) in self.plan.sines[*slot].rasters().enumerate() {
                probe.keep_each(step, raster, &self.rasters);
            }
            probe.close_set(set, &self.sums[*slot], limits);
        }
        self.axes[home].estimate = probe.model();
        // Pixels side by side are too alike to lessen what residuals say.
        if self.axes[home].estimate.is_none() {
            self.axes[home].settled = false;
            self.estimate_from_neighbours(home);
        }
        let probe = &mut self.axes[home].probe;
        probe.aim_at_all(self.pixels);
        (probe.unexplained, probe.unexplained_of_four) = judged;
        self.axes[home].estimate.is_some()
    }
}
