//! The maps of several exposures, until the last one has landed.

use super::evidence::Expected;
use fringe::decode::{DecodeError, DecodeReport, Decoder, Exposed, merge_exposures};
use fringe::pattern::Axis;
use fringe::phase::{PhaseMap, PhaseViewMut};

/// The maps of several exposures of one view. One decoder makes them one after another.
#[derive(Debug)]
pub(super) struct Exposures {
    times_ms: Vec<f64>,
    axes: Vec<AxisMaps>,
    /// The frame that is due; frames count on from one exposure to the next.
    next: usize,
    /// Exposures that are complete.
    done: usize,
}

/// The maps of the exposures along one axis.
#[derive(Debug)]
struct AxisMaps {
    axis: Axis,
    /// One map for each exposure.
    maps: Vec<PhaseMap>,
    reports: Vec<DecodeReport>,
    expected: Vec<Expected>,
    best_of: Vec<usize>,
}

impl Exposures {
    pub(super) fn new(decoder: &Decoder, exposures_ms: &[f64]) -> Result<Self, DecodeError> {
        let axis_maps = |axis| {
            let info = decoder.info(axis)?;
            Ok(AxisMaps {
                axis,
                maps: exposures_ms.iter().map(|_| PhaseMap::new(info)).collect(),
                reports: Vec::new(),
                expected: Vec::new(),
                best_of: vec![0; exposures_ms.len()],
            })
        };
        let axes = decoder.axes().into_iter().map(axis_maps).collect::<Result<_, _>>()?;
        Ok(Self { times_ms: exposures_ms.to_vec(), axes, next: 0, done: 0 })
    }

    pub(super) fn begin(&mut self) {
        (self.next, self.done) = (0, 0);
        for axis in &mut self.axes {
            axis.reports.clear();
            axis.expected.clear();
        }
    }

    /// The place of a frame in the sequence.
    pub(super) fn place(&self, decoder: &Decoder, frame: usize) -> Result<usize, DecodeError> {
        let count = decoder.frames() * self.times_ms.len();
        if frame != self.next || frame >= count {
            return Err(DecodeError::FrameOrder { expected: self.next, got: frame, count });
        }
        Ok(frame % decoder.frames())
    }

    /// Time of the exposure that is under way, ms.
    pub(super) fn exposure_ms(&self) -> f64 {
        self.times_ms.get(self.done).copied().unwrap_or_default()
    }

    /// A frame has landed; the last one of an exposure makes its maps.
    pub(super) fn landed(&mut self, decoder: &mut Decoder, evidence: bool) -> Result<(), DecodeError> {
        self.next += 1;
        if !self.next.is_multiple_of(decoder.frames()) {
            return Ok(());
        }
        for axis in &mut self.axes {
            let map = &mut axis.maps[self.done];
            axis.reports.push(decoder.finish(axis.axis, &mut map.view_mut())?);
            if evidence {
                axis.expected.push(Expected::of(map, &decoder.diagnose(axis.axis)?));
            }
        }
        self.done += 1;
        decoder.begin();
        Ok(())
    }

    /// Merges the maps of an axis. The report is that of the exposure with the most valid pixels.
    pub(super) fn merge(
        &mut self,
        decoder: &Decoder,
        axis: Axis,
        out: &mut PhaseViewMut<'_>,
    ) -> Result<DecodeReport, DecodeError> {
        let info = decoder.info(axis)?;
        let needed = decoder.frames() * self.times_ms.len();
        let all = self.axes.iter_mut().find(|all| all.axis == axis);
        let all = all.filter(|all| all.reports.len() == self.times_ms.len());
        let Some(all) = all else { return Err(DecodeError::Incomplete { axis, landed: self.next, needed }) };
        let sizes = [out.phase_rad.len(), out.sigma_rad.len(), out.modulation.len(), out.valid.len()];
        if out.info != info || sizes != [info.len(); 4] {
            return Err(DecodeError::Output);
        }
        let exposed = all.maps.iter().zip(&self.times_ms);
        let exposed: Vec<Exposed<'_>> =
            exposed.map(|(map, &exposure_ms)| Exposed { map, exposure_ms }).collect();
        merge_exposures(&exposed, out, &mut all.best_of);
        let best = all.reports.iter().rev().max_by_key(|report| report.valid);
        let mut report = best.unwrap_or(&all.reports[0]).clone();
        report.valid = out.valid.iter().map(|v| usize::from(*v)).sum();
        // No exposure measures what the shortest clips and the longest leaves dark.
        report.saturated = all.reports.iter().map(|r| r.saturated).min().unwrap_or(0);
        report.dark = all.reports.iter().map(|r| r.dark).min().unwrap_or(0);
        Ok(report)
    }

    /// Errors to be expected in all exposures together, and the pixels that each measures best.
    pub(super) fn evidence(&self, axis: Axis) -> (Expected, Vec<usize>) {
        let Some(all) = self.axes.iter().find(|all| all.axis == axis) else { return Default::default() };
        let expected = all.expected.iter().copied().reduce(Expected::and).unwrap_or_default();
        (expected, all.best_of.clone())
    }
}
