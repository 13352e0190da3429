//! Temperature and link of the cameras as they last told them, and whether their temperature has settled. Pure.

use super::protocol::CameraStatus;
use cell::configuration::WarmUp;
use devices::CameraState;
use std::collections::{BTreeMap, VecDeque};

/// Pieces of the window: within one the smallest and the largest temperature are kept.
const PIECES: u64 = 256;

/// Temperatures of a piece of time.
#[derive(Debug, Clone, Copy)]
struct Piece {
    /// When it began, ns.
    begin_ns: u64,
    least_c: f64,
    most_c: f64,
}

/// What the cameras of a cell told.
#[derive(Debug, Default)]
pub(super) struct Cameras {
    limits: Option<WarmUp>,
    names: Vec<String>,
    states: BTreeMap<String, CameraState>,
    /// Temperatures of each camera, the oldest first.
    temperatures: BTreeMap<String, VecDeque<Piece>>,
}

impl Cameras {
    /// Cameras of these names that have told nothing yet.
    pub(super) fn new(names: Vec<String>, limits: Option<WarmUp>) -> Self {
        Self { limits, names, ..Self::default() }
    }

    /// Takes what a camera told at a time.
    pub(super) fn told(&mut self, camera: &str, state: CameraState, now_ns: u64) {
        self.states.insert(camera.to_owned(), state);
        let Some(celsius) = state.temperature_c else { return };
        let window_ns = self.limits.map_or(0, |limits| (limits.window_s * 1e9) as u64);
        let kept = self.temperatures.entry(camera.to_owned()).or_default();
        // The oldest piece is the last one from before the window: it shows that the window is covered.
        while kept.get(1).is_some_and(|piece| now_ns.saturating_sub(piece.begin_ns) >= window_ns) {
            kept.pop_front();
        }
        match kept.back_mut().filter(|piece| now_ns.saturating_sub(piece.begin_ns) < window_ns / PIECES) {
            Some(piece) => {
                (piece.least_c, piece.most_c) = (piece.least_c.min(celsius), piece.most_c.max(celsius));
            }
            None => kept.push_back(Piece { begin_ns: now_ns, least_c: celsius, most_c: celsius }),
        }
    }

    /// Why the cameras have not settled; `Ok` where they have, or where nobody asks.
    pub(super) fn settled(&self, now_ns: u64) -> Result<(), String> {
        let Some(WarmUp { max_change_k, window_s }) = self.limits else { return Ok(()) };
        for camera in &self.names {
            let Some(kept) = self.temperatures.get(camera) else {
                return Err(format!("camera \"{camera}\" has not told its temperature (warm_up)"));
            };
            let first_ns = kept.front().map_or(now_ns, |piece| piece.begin_ns);
            let known_s = now_ns.saturating_sub(first_ns) as f64 * 1e-9;
            let most_c = kept.iter().map(|piece| piece.most_c).fold(f64::NEG_INFINITY, f64::max);
            let range_k = most_c - kept.iter().map(|piece| piece.least_c).fold(f64::INFINITY, f64::min);
            if range_k > max_change_k {
                return Err(format!(
                    "camera \"{camera}\" has not settled: its temperature changed by {range_k:.2} K within {:.0} s, limit \
                     {max_change_k} K (warm_up.max_change_k)",
                    known_s.min(window_s)
                ));
            }
            if known_s < window_s {
                return Err(format!(
                    "camera \"{camera}\" has not settled: its temperature is known for {known_s:.0} s, {window_s} s are needed \
                     (warm_up.window_s)"
                ));
            }
        }
        Ok(())
    }

    /// What the cameras last told, for status and metrics.
    pub(super) fn status(&self) -> Vec<CameraStatus> {
        let status =
            |(name, state): (&String, &CameraState)| CameraStatus { name: name.clone(), state: *state };
        self.states.iter().map(status).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const S: u64 = 1_000_000_000;

    fn warm(celsius: f64) -> CameraState {
        CameraState { temperature_c: Some(celsius), link: None }
    }

    fn cameras() -> Cameras {
        Cameras::new(vec!["cam1".into()], Some(WarmUp { max_change_k: 0.5, window_s: 60.0 }))
    }

    #[test]
    fn a_camera_settles_when_its_temperature_is_known_and_steady_over_the_window() {
        let mut cameras = cameras();
        assert!(cameras.settled(0).unwrap_err().contains("not told"));
        for second in 0..200 {
            // 10 K with a time constant of 20 s.
            let celsius = 45.0 - 10.0 * (-(second as f64) / 20.0).exp();
            cameras.told("cam1", warm(celsius), second * S);
            let steady = |from: f64| 10.0 * (-from / 20.0).exp() <= 0.5;
            let settled = cameras.settled(second * S);
            match second {
                0..60 => assert!(settled.is_err(), "{second}"),
                _ if steady((second - 60) as f64) => assert!(settled.is_ok(), "{second}: {settled:?}"),
                _ => assert!(second > 118 || settled.unwrap_err().contains("changed by"), "{second}"),
            }
        }
        assert!(cameras.temperatures["cam1"].len() < 80);
    }

    #[test]
    fn many_cycles_a_second_take_no_more_memory_and_lose_no_jump() {
        let mut cameras = cameras();
        for ms in 0..200_000_u64 {
            cameras.told("cam1", warm(if ms == 150_000 { 36.0 } else { 35.0 }), ms * S / 1000);
        }
        assert!(cameras.temperatures["cam1"].len() <= PIECES as usize + 2);
        assert!(cameras.settled(200 * S).unwrap_err().contains("changed by 1.00 K"));
    }

    #[test]
    fn nobody_waits_who_does_not_ask() {
        let cameras = Cameras::new(vec!["cam1".into()], None);
        assert!(cameras.settled(0).is_ok());
    }
}
