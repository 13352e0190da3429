//! Motion between frames: found where there is one, with its size; not where there is none, whatever the projector and the light do.

use super::super::dirt::{Fault, Finding, Remedy};
use super::super::{DecodeError, DecodeReport, DecodeSettings, Decoder, Motion};
use crate::frame::FrameView;
use crate::math::{cos, pow};
use crate::pattern::{Axis, PatternSet};
use crate::phase::PhaseMap;
use crate::synthetic::Noise;
use std::f64::consts::TAU;

const SIZE: [usize; 2] = [320, 200];
const STEPS: usize = 10;

/// What the frames of a set and a code show.
#[derive(Clone, Copy)]
struct Shown<'a> {
    /// Steps of the set.
    steps: usize,
    /// How far the fringes of a frame stand beside their place, rad.
    shift: &'a dyn Fn(usize) -> f64,
    /// What the projector makes of a level from 0 to 1.
    response: &'a dyn Fn(f64) -> f64,
    /// Light of a frame.
    light: &'a dyn Fn(usize) -> f64,
    /// Light of the room beside it, DN.
    room: &'a dyn Fn(usize) -> f64,
    /// Columns and rows of the part; the rest of the picture is dark.
    part: [usize; 2],
    /// What the part makes of the light in a column, but not of that of the room.
    colour: &'a dyn Fn(usize) -> f64,
}

const AT_REST: Shown<'static> = Shown {
    steps: STEPS,
    shift: &|_| 0.0,
    response: &|level| level,
    light: &|_| 1.0,
    room: &|_| 0.0,
    part: SIZE,
    colour: &|_| 1.0,
};

impl Shown<'_> {
    /// The report of a decoder, and the root mean square by which its phases differ from those of the fringes' mean place, rad.
    fn decoded(&self) -> Result<(DecodeReport, f64), DecodeError> {
        let sequence =
            [PatternSet::sine(Axis::X, 16.0, self.steps as u32), PatternSet::gray(Axis::X, 6, 8.0)];
        let [width, height] = SIZE;
        let settings = DecodeSettings { max_contradiction: 1e6, ..DecodeSettings::default() };
        let mut decoder =
            Decoder::new(&sequence, width as u32, height as u32, 255, [320, 200], &settings).unwrap();
        let mut noise = Noise(3);
        let coordinate = |index: usize| (index % width) as f64 + 0.02 * (index / width) as f64;
        for frame in 0..decoder.frames() {
            let value = |index: usize| {
                let x = coordinate(index);
                let level = if frame < self.steps {
                    let step = TAU * frame as f64 / self.steps as f64;
                    0.5 + 0.5 * cos(TAU * x / 16.0 - step + (self.shift)(frame))
                } else {
                    let bit = frame - self.steps;
                    let stripe = ((x + 0.5) / 8.0).floor() as u32;
                    f64::from(((stripe ^ (stripe >> 1)) >> (5 - bit)) & 1)
                };
                let lit = index % width < self.part[0] && index / width < self.part[1];
                let colour = if lit { (self.colour)(index % width) } else { 0.0 };
                let light = 20.0 + 160.0 * (self.response)(level) * colour;
                ((self.light)(frame) * light + (self.room)(frame) + 1.5 * noise.gauss())
                    .round()
                    .clamp(0.0, 255.0) as u8
            };
            let bytes: Vec<u8> = (0..width * height).map(value).collect();
            let view = FrameView::from_bytes(width as u32, height as u32, 255, &bytes).unwrap();
            decoder.push(frame, &view).unwrap();
        }
        let mut map = PhaseMap::new(decoder.info(Axis::X).unwrap());
        let report = decoder.finish(Axis::X, &mut map.view_mut())?;
        let mean = (0..self.steps).map(|frame| (self.shift)(frame)).sum::<f64>() / self.steps as f64;
        let valid = (0..map.valid.len()).filter(|index| map.valid[*index] == 1);
        let square = |index: usize| {
            let off = f64::from(map.phase_rad[index]) - TAU * coordinate(index) / 16.0 - mean;
            off * off
        };
        let squares = valid.clone().map(square).sum::<f64>();
        Ok((report, (squares / valid.count() as f64).sqrt()))
    }
}

/// The motion that a decoder reports of ten steps and a code, whose fringes stand `shift(frame)` rad beside their place.
fn reported(
    shift: impl Fn(usize) -> f64,
    response: impl Fn(f64) -> f64,
    light: impl Fn(usize) -> f64,
) -> Motion {
    let shown = Shown { shift: &shift, response: &response, light: &light, ..AT_REST };
    shown.decoded().unwrap().0.motion.unwrap()
}

#[test]
fn a_part_at_rest_did_not_move_whatever_projector_and_light_do() {
    let steady = |_: usize| 1.0;
    let still = reported(|_| 0.0, |level| level, steady);
    assert!(
        !still.moved && still.rms_rad < 5e-4 && still.drift_rad.abs() < 4.0 * still.u_drift_rad,
        "{still:?}"
    );
    let gamma = reported(|_| 0.0, |level| pow(level.max(1e-9), 2.2), steady);
    assert!(!gamma.moved && gamma.rms_rad < 2e-3, "{gamma:?}");
    let flicker = reported(|_| 0.0, |level| level, |frame| 1.0 + 0.01 * cos(frame as f64 * 2.1));
    assert!(!flicker.moved && flicker.rms_rad < 2e-3, "{flicker:?}");
}

#[test]
fn a_drift_and_a_vibration_are_found_with_their_size() {
    let drift = reported(|frame| 0.004 * frame as f64, |level| level, |_| 1.0);
    // 16 frames of the sequence.
    assert!((drift.drift_rad - 0.064).abs() < 0.004 && drift.moved, "{drift:?}");
    assert!((drift.drift_rad - 0.064).abs() < 4.0 * drift.u_drift_rad, "{drift:?}");
    let shifts = [3.0, -2.0, 1.0, 4.0, -5.0, 2.0, 0.0, -3.0, 1.0, -1.0];
    let vibration = reported(|frame| 0.01 * shifts.get(frame).unwrap_or(&0.0), |level| level, |_| 1.0);
    let rms = 0.01 * (70.0_f64 / 10.0).sqrt();
    // Part of it may as well be light that changes: what is stated is the least.
    assert!((0.6..1.05).contains(&(vibration.rms_rad / rms)) && vibration.moved, "{vibration:?}, {rms}");
}

#[test]
fn a_motion_within_the_uncertainty_is_stated_and_not_blamed() {
    let small = reported(|frame| 0.0001 * frame as f64, |level| level, |_| 1.0);
    assert!(!small.moved && small.drift_rad > 0.0, "{small:?}");
    assert!(small.warning("cam1").is_none());
    let large = reported(|frame| 0.004 * frame as f64, |level| level, |_| 1.0);
    assert!(large.warning("cam1").is_some_and(|text| text.contains("\"cam1\"") && text.contains("mrad")));
}

/// Frames that stand off by two waves a sequence ripple the phases at twice their frequency, which no smoothing of neighbours takes out.
#[test]
fn a_vibration_within_the_uncertainty_leaves_no_ripple() {
    let off = |size: f64| {
        let shift =
            |frame: usize| if frame < STEPS { size * cos(TAU * 0.2 * frame as f64 + 1.0) } else { 0.0 };
        let (report, off_rad) = Shown { shift: &shift, ..AT_REST }.decoded().unwrap();
        assert!(!report.motion.unwrap().moved && report.findings.is_empty(), "{size}: {report:?}");
        off_rad
    };
    let still = off(0.0);
    for size in [0.006, 0.010] {
        // The ripple would have size/√8.
        let rippled = (still * still + size * size / 8.0).sqrt();
        let left = off(size) - still;
        assert!(
            left < 0.2 * (rippled - still) + 0.003 * still,
            "{size}: {left} rad left of {still}, {rippled} expected"
        );
    }
}

/// Root mean square about the mean.
fn deviation(of: impl Fn(usize) -> f64, count: usize) -> f64 {
    let mean = (0..count).map(&of).sum::<f64>() / count as f64;
    ((0..count).map(|i| (of(i) - mean) * (of(i) - mean)).sum::<f64>() / count as f64).sqrt()
}

/// By a fifth to three quarters of a radian the nominal steps leave so much that it looks like a changing light.
#[test]
fn a_part_that_steps_by_a_good_part_of_a_fringe_moved_and_is_decoded_where_it_stood() {
    for steps in [5, 6, 8, 10] {
        for (from, size) in
            [(1, 0.5), (steps / 2, 0.2), (steps / 2, 0.5), (steps / 2, -0.75), (steps - 2, 0.5)]
        {
            let shift = |frame: usize| if (from..steps).contains(&frame) { size } else { 0.0 };
            let (report, off_rad) = match (Shown { steps, shift: &shift, ..AT_REST }).decoded() {
                Ok(decoded) => decoded,
                // Half of the frames stand so far off that they follow no sequence.
                Err(DecodeError::Disorder { .. }) if size.abs() > 0.4 => continue,
                Err(error) => panic!("{steps} steps, by {size} from {from} on: {error}"),
            };
            let (motion, rms) = (report.motion, deviation(shift, steps));
            let case = format!(
                "{steps} steps, by {size} from {from} on: {motion:?} of {rms}, {:?}",
                report.findings
            );
            // A first or last frame that stands apart from all others is left out.
            let left_out = matches!(
                report.findings[..],
                [Finding { fault: Fault::Moved(_), remedy: Remedy::LeftOut, .. }]
            );
            assert!(left_out == motion.is_none() && motion.is_none_or(|motion| motion.moved), "{case}");
            assert!(report.findings.iter().all(|found| found.kind() == "moved"), "{case}");
            if let [found] = report.findings[..]
                && let Fault::Unsteady(found_rad) = found.fault
            {
                assert!(
                    (found_rad / rms - 1.0).abs() < 0.05 && found.remedy == Remedy::StepsAsFound,
                    "{case}"
                );
                // Fringes that run ahead from a frame on drift ahead.
                assert!(motion.is_some_and(|motion| motion.drift_rad * size > 0.0), "{case}");
                assert!(off_rad < 0.03, "{off_rad} rad, {case}");
            }
        }
    }
}

#[test]
fn a_light_that_changes_is_no_motion_and_hides_none() {
    let changes = [0.3, -1.0, 0.6, 1.0, -0.8, 0.2, -0.5, 0.9, -0.9, 0.2];
    let step = |frame: usize| if (5..STEPS).contains(&frame) { 0.4 } else { 0.0 };
    for size in [0.06, 0.1, 0.15] {
        let of = |frame: usize| size * changes.get(frame).unwrap_or(&0.0);
        let scaled: &dyn Fn(usize) -> f64 = &|frame| 1.0 + of(frame);
        let added: &dyn Fn(usize) -> f64 = &|frame| 100.0 * of(frame);
        for (light, room) in [(scaled, AT_REST.room), (AT_REST.light, added)] {
            let told =
                |shift: &dyn Fn(usize) -> f64| Shown { shift, light, room, ..AT_REST }.decoded().unwrap().0;
            let still = told(AT_REST.shift);
            assert!(
                matches!(still.findings[..], [ref found] if found.kind() == "flicker"),
                "{:?}",
                still.findings
            );
            assert!(still.motion.is_some_and(|motion| !motion.moved), "{size}: {:?}", still.motion);
            let moved = told(&step);
            assert!(
                moved.motion.is_some_and(|motion| motion.moved),
                "{size}: {:?}, {:?}",
                moved.motion,
                moved.findings
            );
        }
    }
    // Less than is told of a light.
    for steps in [5, 6, 8, 10] {
        for size_dn in [1.5, 3.0, 3.8] {
            let room = |frame: usize| size_dn * changes.get(frame).unwrap_or(&0.0);
            let (still, _) = Shown { steps, room: &room, ..AT_REST }.decoded().unwrap();
            let motion = still.motion.unwrap();
            assert!(!motion.moved && still.findings.is_empty(), "{steps} steps, {size_dn} DN: {motion:?}");
        }
    }
    // A light whose changes look like a fringe that stands still.
    for size_dn in [6.0, 12.0] {
        let room = |frame: usize| size_dn * cos(TAU * frame as f64 / 10.0 + 1.0);
        let (still, _) = Shown { room: &room, ..AT_REST }.decoded().unwrap();
        assert!(still.findings.iter().all(|found| found.kind() == "flicker"), "{:?}", still.findings);
        assert!(still.motion.is_none_or(|motion| !motion.moved), "{size_dn}: {:?}", still.motion);
    }
}

/// Lamps and exposures that change by less than is told of: what they leave shifts no phase, and passes for no noise.
#[test]
fn a_slight_change_of_the_lamp_shifts_no_phase_and_is_no_noise() {
    let told = |steps: usize, light: &dyn Fn(usize) -> f64| {
        let (report, off_rad) = Shown { steps, light, ..AT_REST }.decoded().unwrap();
        assert!(report.findings.is_empty(), "{:?}", report.findings);
        (report.motion.unwrap().sigma_rad, off_rad)
    };
    for steps in [5, 8, 10] {
        let (sigma_rad, still_rad) = told(steps, &|_| 1.0);
        let wave = |frame: usize| TAU * frame as f64 / steps as f64;
        let cases: [(&str, &dyn Fn(usize) -> f64); 5] = [
            ("fades", &|frame| 1.0 - 0.05 * frame as f64 / steps as f64),
            ("one exposure", &|frame| if frame == 3 { 1.04 } else { 1.0 }),
            ("every other exposure", &|frame| 1.0 - 0.03 * (frame % 2) as f64),
            ("one wave", &|frame| 1.0 + 0.02 * cos(wave(frame) + 1.0)),
            ("two waves", &|frame| 1.0 + 0.02 * cos(2.0 * wave(frame))),
        ];
        for (name, light) in cases {
            let (found_rad, off_rad) = told(steps, light);
            let case = format!(
                "{name}, {steps} steps: {off_rad} of {still_rad} rad, sigma {found_rad} of {sigma_rad}"
            );
            // Less light leaves more noise in a phase. Left in the frames, the change would make sigma 1.4 times as large.
            assert!((off_rad / still_rad - 1.0).abs() < 0.03, "{case}");
            assert!((0.8..1.2).contains(&(found_rad / sigma_rad)), "{case}");
        }
    }
}

/// Light of the room that changes adds to the frames. What of it looks like a fringe leaves nothing in a pixel, and shifts no phase all the same: of large
/// parts and small ones, and of parts whose colours it lights alike.
#[test]
fn a_changing_light_of_the_room_that_looks_like_a_fringe_shifts_no_phase() {
    let dyed = |column: usize| if (120..240).contains(&column) { 0.4 } else { 1.0 };
    let parts = [
        ("large", AT_REST),
        ("small", Shown { part: [64, 60], ..AT_REST }),
        ("dyed", Shown { colour: &dyed, ..AT_REST }),
    ];
    for (steps, (part, shown)) in [3, 4, 5, 10].into_iter().flat_map(|steps| parts.map(|part| (steps, part)))
    {
        let wave = |frame: usize| TAU * frame as f64 / steps as f64;
        let cases: [(&str, &dyn Fn(usize) -> f64); 4] = [
            ("steady", &|_| 3.0),
            ("one wave", &|frame| cos(wave(frame) + 1.0)),
            ("gets brighter", &|frame| 2.0 * frame as f64 / steps as f64),
            ("one frame", &|frame| if frame == 1 { 2.0 } else { 0.0 }),
        ];
        let told = |room: &dyn Fn(usize) -> f64| {
            let (report, off_rad) = Shown { steps, room, ..shown }.decoded().unwrap();
            assert!(report.findings.is_empty(), "{steps}: {:?}", report.findings);
            off_rad
        };
        let still_rad = told(&|_| 0.0);
        for (name, room) in cases {
            let off_rad = told(room);
            // Left in the phases, one wave of ten frames would make 1.4 of it, and the least of these 1.08.
            assert!(
                (off_rad / still_rad - 1.0).abs() < 0.04,
                "{name}, {steps}, {part}: {off_rad} of {still_rad} rad"
            );
        }
    }
}

/// A step is not extrapolated, and frames that stand anywhere make no drift.
#[test]
fn a_step_is_as_large_as_it_is_and_scattered_frames_do_not_drift() {
    for (from, size) in [(2, 0.02), (5, -0.05), (8, 0.04)] {
        let step = reported(|frame| if (from..STEPS).contains(&frame) { size } else { 0.0 }, |l| l, |_| 1.0);
        assert!(
            (step.drift_rad - size).abs() < 4.0 * step.u_drift_rad && step.u_drift_rad < 0.01,
            "{step:?}"
        );
        assert!(step.moved, "{step:?}");
    }
    let off = |frame: usize| if frame == 4 || frame == 9 { -0.04 } else { 0.0 };
    let scattered = reported(off, |l| l, |_| 1.0);
    assert!(scattered.drift_rad.abs() < 5.0 * scattered.u_drift_rad, "{scattered:?}");
    assert!(
        scattered.moved && (0.6..1.05).contains(&(scattered.rms_rad / deviation(off, STEPS))),
        "{scattered:?}"
    );
}

/// A response that is not linear makes a large motion larger than it is, which its uncertainty holds.
#[test]
fn a_motion_under_a_gamma_is_within_its_uncertainty() {
    let shift = |frame: usize| if (5..STEPS).contains(&frame) { 0.3 } else { 0.0 };
    for gamma in [1.0, 1.2, 1.5] {
        let response = |level: f64| pow(level.max(1e-9), gamma);
        let (report, _) = Shown { shift: &shift, response: &response, ..AT_REST }.decoded().unwrap();
        let motion = report.motion.unwrap();
        assert!(motion.moved, "{gamma}: {motion:?}");
        assert!((motion.drift_rad - 0.3).abs() < 2.0 * motion.u_drift_rad, "{gamma}: {motion:?}");
    }
}
