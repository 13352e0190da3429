//! Frames that are lent instead of copied.

use super::code_dirt::Coded;
use super::*;
use crate::frame::SharedFrame;

/// The phase map of some frames, copied or lent, and whether a frame was mended.
fn map_of(decoder: &mut Decoder, frames: &[SharedFrame], lent: bool) -> (PhaseMap, bool) {
    decoder.begin();
    for (index, frame) in frames.iter().enumerate() {
        let taken = if lent { decoder.push_shared(index, frame) } else { decoder.push(index, &frame.view()) };
        taken.unwrap();
    }
    let mut map = PhaseMap::new(decoder.info(Axis::X).unwrap());
    let report = decoder.finish(Axis::X, &mut map.view_mut()).unwrap();
    (map, !report.findings.is_empty())
}

/// Also where both ways take turns, where a frame is too wide or too narrow to be held, and where a wrong frame is mended.
#[test]
fn lent_frames_give_the_same_bytes_and_never_change() {
    let coded = Coded::alone(true);
    let mut wrong = coded.clone();
    let old = wrong.values(2);
    wrong.put(2, |i| 200.0 - old[i]);
    let in_words = |scene: &Scene, frame: &Frame| {
        let values = (0..scene.coordinates_px.len()).map(|i| frame.view().pixels.get(i) as u16);
        Frame { pixels: PixelBuffer::Mono16(values.collect()), ..frame.clone() }
    };
    let wide: Vec<Frame> = coded.frames.iter().map(|frame| in_words(&coded.scene, frame)).collect();
    let mut sixteen = coded.scene.clone();
    sixteen.full_scale_dn = 1023;
    let sixteen_bits = |frame: &Frame| Frame { full_scale_dn: 1023, ..frame.clone() };
    for (name, scene, frames) in [
        ("bytes", &coded.scene, coded.frames.clone()),
        ("a wrong frame", &coded.scene, wrong.frames.clone()),
        ("words to bytes", &coded.scene, wide.clone()),
        ("words", &sixteen, wide.iter().map(sixteen_bits).collect()),
        ("bytes to words", &sixteen, coded.frames.iter().map(sixteen_bits).collect()),
    ] {
        let frames: Vec<SharedFrame> = frames.into_iter().map(SharedFrame::from).collect();
        let before: Vec<Frame> = frames.iter().map(|frame| Frame::from(frame.view())).collect();
        let mut decoder = scene.decoder(&coded.sequence, &DecodeSettings::default()).unwrap();
        let (copied, mended) = map_of(&mut decoder, &frames, false);
        assert_eq!(mended, name == "a wrong frame", "{name}");
        assert!(copied.valid.iter().map(|valid| usize::from(*valid)).sum::<usize>() > 60_000, "{name}");
        for lent in [true, true, false, true] {
            let (map, mended_too) = map_of(&mut decoder, &frames, lent);
            assert_eq!(mended_too, mended, "{name}");
            assert_eq!(
                bytemuck::cast_slice::<_, u32>(&map.phase_rad),
                bytemuck::cast_slice::<_, u32>(&copied.phase_rad),
                "{name}"
            );
            assert_eq!(map.valid, copied.valid, "{name}");
        }
        // What comes later goes elsewhere.
        let black = scene.frame(vec![0; frames[0].view().pixels.len()]);
        decoder.begin();
        (0..frames.len()).for_each(|index| decoder.push(index, &black.view()).unwrap());
        for (frame, before) in frames.iter().zip(&before) {
            assert_eq!(Frame::from(frame.view()), *before, "{name}");
        }
    }
}
