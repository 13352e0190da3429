//! Wrong frames of a code: found from the fringes, named, and made up for where what is left determines them.

use super::*;

/// A surface, fringes and a code; [`Coded::new`] makes a wavy one with a step.
#[derive(Clone)]
pub(super) struct Coded {
    pub scene: Scene,
    pub sequence: Vec<PatternSet>,
    pub frames: Vec<Frame>,
    /// First frame of the code.
    pub first: usize,
}

const BITS: u32 = 6;

impl Coded {
    fn new(steps: u32, stripe: f64, inverse: bool, levels: bool) -> Self {
        let mut scene = Scene::ramp(320, 200, 0.71, 0.05, 304).eight_bits();
        scene.noise = (1.0, 0.02);
        for (i, x) in scene.coordinates_px.iter_mut().enumerate() {
            let (row, column) = (i / 320, i % 320);
            *x += 3.0 * crate::math::sin(row as f64 / 15.0) + 2.0 * crate::math::cos(column as f64 / 40.0);
            // A step in depth.
            *x += if column > 150 && row > 80 { 24.5 } else { 0.0 };
        }
        let mut sequence = vec![sine(Axis::X, 16.0, steps), gray(Axis::X, BITS, stripe * 16.0)];
        if inverse {
            let PatternSet::Gray { axis, bits, stripe_px, shift_px, code, threshold, .. } =
                sequence[1].clone()
            else {
                unreachable!()
            };
            sequence.push(PatternSet::Gray {
                axis,
                bits,
                stripe_px,
                shift_px,
                invert: true,
                code,
                threshold,
            });
        }
        if levels {
            sequence.extend([PatternSet::White {}, PatternSet::Black {}]);
        }
        let frames = scene.frames(&sequence);
        Self { scene, sequence, frames, first: steps as usize }
    }

    /// A code without fringes, with white and black.
    pub fn alone(inverse: bool) -> Self {
        let mut coded = Self::new(4, 0.5, inverse, true);
        coded.sequence.remove(0);
        coded.frames = coded.scene.frames(&coded.sequence);
        coded.first = 0;
        coded
    }

    pub fn values(&self, frame: usize) -> Vec<f64> {
        let view = self.frames[frame].view();
        (0..view.pixels.len()).map(|i| f64::from(view.pixels.get(i))).collect()
    }

    pub fn put(&mut self, frame: usize, new: impl Fn(usize) -> f64) {
        if let PixelBuffer::Mono8(values) = &mut self.frames[frame].pixels {
            values.iter_mut().enumerate().for_each(|(i, v)| *v = new(i).round().clamp(0.0, 255.0) as u8);
        }
    }

    fn spoil(&mut self, kind: &str, bit: usize) {
        let frame = self.first + bit;
        let old = self.values(frame);
        match kind {
            "black" => self.put(frame, |_| 2.0),
            "blurred" => self.put(frame, |i| 0.35 * old[i] + 0.65 * 75.0),
            "shifted" => {
                let mut scene = self.scene.clone();
                scene.coordinates_px.iter_mut().for_each(|x| *x += 7.0);
                self.frames[frame] = scene.frames(&self.sequence).swap_remove(frame);
            }
            "twice" => self.frames[frame] = self.frames[frame - 1].clone(),
            "swapped" => self.frames.swap(frame, frame - 1),
            "inverse" => self.put(frame, |i| 200.0 - old[i]),
            "brighter" => self.put(frame, |i| old[i] + 45.0),
            "dimmer" => self.put(frame, |i| 0.5 * old[i]),
            other => panic!("{other}"),
        }
    }

    /// Findings, wrong orders, and valid pixels.
    pub fn decode(&self) -> Result<(Vec<Finding>, usize, usize), DecodeError> {
        let mut decoder = self.scene.decoder(&self.sequence, &DecodeSettings::default()).unwrap();
        for (index, frame) in self.frames.iter().enumerate() {
            decoder.push(index, &frame.view()).unwrap();
        }
        let mut map = PhaseMap::new(decoder.info(Axis::X).unwrap());
        let report = decoder.finish(Axis::X, &mut map.view_mut())?;
        let again = decoder.finish(Axis::X, &mut map.view_mut())?;
        assert_eq!(report, again);
        let scale = map.info.period_px / std::f64::consts::TAU;
        let valid = || (0..map.valid.len()).filter(|i| map.valid[*i] == 1);
        let wrong = valid().filter(|i| {
            (f64::from(map.phase_rad[*i]) * scale - self.scene.coordinates_px[*i]).abs()
                > 0.5 * map.info.period_px
        });
        Ok((report.findings, wrong.count(), valid().count()))
    }
}

#[test]
fn clean_codes_have_no_fault() {
    for (stripe, inverse, levels) in
        [(0.5, false, true), (0.5, false, false), (1.0, true, false), (0.5, true, true), (1.0, false, true)]
    {
        let clean = Coded::new(4, stripe, inverse, levels);
        let (findings, wrong, valid) = clean.decode().unwrap();
        assert!(wrong == 0 && valid == 64_000, "{stripe} {inverse} {levels}: {wrong} wrong of {valid}");
        assert!(findings.is_empty(), "{stripe} {inverse} {levels}: {findings:?}");
    }
}

#[test]
fn wrong_frames_of_a_code_are_named_and_made_up_for() {
    for (stripe, inverse, levels) in [(0.5, false, true), (0.5, false, false), (1.0, true, false)] {
        // To draw the frames takes as long as to decode them.
        let clean = Coded::new(4, stripe, inverse, levels);
        let (_, _, valid) = clean.decode().unwrap();
        for kind in ["black", "blurred", "shifted", "twice", "swapped", "inverse", "brighter", "dimmer"] {
            for bit in 2..BITS as usize {
                let name = format!("{kind} {bit}, stripe {stripe}, inverse {inverse}, levels {levels}");
                let mut coded = clean.clone();
                coded.spoil(kind, bit);
                let (findings, wrong, left) =
                    coded.decode().unwrap_or_else(|error| panic!("{name}: {error}"));
                assert!(wrong * 1000 <= left, "{name}: {wrong} wrong of {left}, {findings:?}");
                assert!(left * 100 > valid * 93, "{name}: {left} of {valid}, {findings:?}");
                // An inverse tells the bit whatever stands beside it by less than half a period.
                // Narrow stripes that are blurred still show their bits.
                let narrow = stripe * f64::from(1 << (BITS as usize - 1 - bit)) <= 1.5;
                if (kind == "shifted" && inverse) || (kind == "blurred" && narrow) {
                    continue;
                }
                let of_bit = findings.iter().find(|found| (found.set, found.step) == (1, Some(bit)));
                let fault = of_bit.unwrap_or_else(|| panic!("{name}: not named: {findings:?}")).fault;
                let named = match kind {
                    "black" => fault == Fault::Black,
                    "blurred" => matches!(fault, Fault::Blurred(share) if (share - 0.35).abs() < 0.05),
                    "shifted" => matches!(fault, Fault::Shifted(px) if (px - 7.0).abs() < 2.5),
                    "twice" | "swapped" => {
                        // Where a coarse bit is dark all over, its frame in another's place is black.
                        matches!(fault, Fault::Shows(1, step) if step + 1 == bit)
                            || (bit == 2 && fault == Fault::Black)
                    }
                    "inverse" => fault == Fault::Inverse,
                    "brighter" => matches!(fault, Fault::Level(share) if (share - 0.25).abs() < 0.05),
                    _ => matches!(fault, Fault::Level(share) if (share + 0.3).abs() < 0.05),
                };
                assert!(named, "{name}: {findings:?}");
            }
        }
    }
}

/// A disc before a plane, one fringe beside it at a stretch of its rim: both are one region there, in which the turns of one are counted wrong. A
/// frame that is lost is not made up for by them.
#[test]
fn a_surface_that_meets_another_by_chance_is_no_part_of_it() {
    let mut clean = Coded::new(4, 0.5, false, true);
    for (i, x) in clean.scene.coordinates_px.iter_mut().enumerate() {
        let (row, column) = ((i / 320) as f64, (i % 320) as f64);
        *x = 20.0 + 0.71 * column + 0.05 * row;
        if (row - 100.0).powi(2) + (column - 170.0).powi(2) < 4900.0 {
            *x += 16.0 + 0.2 * (row - 40.0);
        }
    }
    clean.frames = clean.scene.frames(&clean.sequence);
    let (findings, wrong, valid) = clean.decode().unwrap();
    assert!(findings.is_empty() && wrong == 0, "{findings:?} {wrong}");
    for (kind, bit) in ["black", "twice"].into_iter().flat_map(|kind| (2..6).map(move |bit| (kind, bit))) {
        let mut coded = clean.clone();
        coded.spoil(kind, bit);
        let (findings, wrong, left) = coded.decode().unwrap();
        let name = format!("{kind} {bit}: {wrong} wrong, {left} of {valid}, {findings:?}");
        assert!(findings.iter().any(|found| found.step == Some(bit)), "{name}");
        assert!(wrong * 1000 <= left && left * 10 > valid * 7, "{name}");
    }
}

/// A white frame that stayed black, and a bit that shows a hand: the fringes stand for them.
#[test]
fn a_wrong_white_and_a_hand_over_a_bit_are_made_up_for() {
    let mut coded = Coded::new(4, 0.5, false, true);
    coded.put(coded.first + BITS as usize, |_| 2.0);
    let (findings, wrong, left) = coded.decode().unwrap();
    assert!(matches!(findings[..], [Finding { set: 2, fault: Fault::Black, .. }]), "{findings:?}");
    assert!(wrong == 0 && left > 60_000, "{wrong} {left}");
    let mut coded = Coded::new(4, 0.5, false, true);
    let old = coded.values(coded.first + 4);
    coded.put(coded.first + 4, |i| if i % 320 < 140 { 60.0 } else { old[i] });
    let (findings, wrong, left) = coded.decode().unwrap();
    assert!(matches!(findings[..], [Finding { set: 1, step: Some(4), .. }]), "{findings:?}");
    assert!(wrong * 1000 <= left && left > 57_000, "{wrong} {left}: {findings:?}");
}

/// The next sequence is decoded as if nothing had happened.
#[test]
fn a_wrong_frame_of_a_code_does_not_reach_the_next_sequence() {
    let (clean, mut coded) = (Coded::new(4, 0.5, false, true), Coded::new(4, 0.5, false, true));
    coded.spoil("black", 4);
    let mut decoder = clean.scene.decoder(&clean.sequence, &DecodeSettings::default()).unwrap();
    let mut map = PhaseMap::new(decoder.info(Axis::X).unwrap());
    let mut found = Vec::new();
    for frames in [&coded.frames, &clean.frames] {
        decoder.begin();
        for (index, frame) in frames.iter().enumerate() {
            decoder.push(index, &frame.view()).unwrap();
        }
        found.push(decoder.finish(Axis::X, &mut map.view_mut()).unwrap().findings.len());
    }
    assert_eq!(found, [1, 0]);
}

/// A code alone: an inverse stands for its frame, exchanged frames are put back, and what nothing tells is named.
#[test]
fn wrong_frames_of_a_code_without_fringes_are_made_up_for_or_named() {
    let clean = [true, false].map(|inverse| {
        let coded = Coded::alone(inverse);
        let (findings, before, valid) = coded.decode().unwrap();
        assert!(findings.is_empty(), "{findings:?}");
        (coded, before, valid)
    });
    for kind in ["black", "inverse", "swapped", "twice"] {
        for bit in 3..5 {
            let (mut coded, before, valid) = clean[0].clone();
            coded.spoil(kind, bit);
            let (findings, wrong, left) =
                coded.decode().unwrap_or_else(|error| panic!("{kind} {bit}: {error}"));
            assert!(
                findings.iter().any(|found| (found.set, found.step) == (0, Some(bit))),
                "{kind} {bit}: {findings:?}"
            );
            assert!(
                wrong <= before + 64 && left * 100 > valid * 95,
                "{kind} {bit}: {wrong} ({before}), {left} of {valid}"
            );
            let (mut coded, before, _) = clean[1].clone();
            coded.spoil(kind, bit);
            match coded.decode() {
                // Exchanged frames are put back, an inverse is turned.
                Ok((findings, wrong, _)) => assert!(
                    matches!(kind, "swapped" | "inverse")
                        && wrong <= before + 64
                        && findings.iter().any(|found| found.step == Some(bit)),
                    "{kind} {bit}: {findings:?} {wrong}"
                ),
                Err(error) => assert!(
                    error.to_string().contains(&format!("frame {} of set 1", bit + 1)),
                    "{kind} {bit}: {error}"
                ),
            }
        }
    }
}

/// Without fringes too, a frame that was shifted is moved back, whether or not inverses stand beside it.
#[test]
fn a_shifted_frame_of_a_code_without_fringes_is_moved_back() {
    for inverse in [false, true] {
        let mut clean = Coded::new(4, 0.5, inverse, !inverse);
        clean.sequence.remove(0);
        clean.frames = clean.scene.frames(&clean.sequence);
        let (findings, before, valid) = clean.decode().unwrap();
        assert!(findings.is_empty(), "{findings:?}");
        for (bit, by) in [(1, [14, 0]), (2, [-12, 6]), (3, [19, -8])] {
            let mut coded = clean.clone();
            let old = coded.values(bit);
            coded.put(bit, |i| {
                let (row, column) = ((i / 320) as i32 - by[1], (i % 320) as i32 - by[0]);
                old[(row.clamp(0, 199) * 320 + column.clamp(0, 319)) as usize]
            });
            let (findings, wrong, left) = coded.decode().unwrap();
            let name = format!("{bit} {by:?} {inverse}: {findings:?}, {wrong} wrong ({before}) of {left}");
            match findings
                .iter()
                .find(|found| found.step == Some(bit))
                .map(|found| (found.fault, found.remedy))
            {
                Some((Fault::Displaced(right, _), _)) => {
                    assert!((i32::from(right) - by[0]).abs() <= 3, "{name}");
                }
                // Where the inverse contradicts in many places it stands for the frame.
                Some((_, Remedy::Inverse)) if inverse => {}
                _ => panic!("not named: {name}"),
            }
            // What came from beyond the picture is not known.
            let beyond = by[0].unsigned_abs() as usize * 200 + by[1].unsigned_abs() as usize * 320;
            assert!(wrong <= before + beyond / 4 && left * 100 > valid * 95, "{name}");
        }
    }
}

/// A wide stripe has more contrast than a narrow one, unless its frame is blurred.
#[test]
fn a_blurred_frame_of_a_code_without_fringes_is_named() {
    let mut coded = Coded::alone(false);
    coded.spoil("blurred", 2);
    let (findings, _, _) = coded.decode().unwrap();
    assert!(
        findings.iter().any(|found| found.step == Some(2)
            && matches!(found.fault, Fault::Blurred(share) if (share - 0.35).abs() < 0.05)),
        "{findings:?}"
    );
}
