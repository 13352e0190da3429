//! Frames that are lent instead of copied.

use super::code_dirt::Coded;
use super::*;
use crate::frame::SharedFrame;

/// The phase map of some frames, copied or lent.
fn map_of(decoder: &mut Decoder, frames: &[SharedFrame], lent: bool) -> PhaseMap {
    decoder.begin();
    for (index, frame) in frames.iter().enumerate() {
        let taken = if lent { decoder.push_shared(index, frame) } else { decoder.push(index, &frame.view()) };
        taken.unwrap();
    }
    let mut map = PhaseMap::new(decoder.info(Axis::X).unwrap());
    decoder.finish(Axis::X, &mut map.view_mut()).unwrap();
    map
}

/// Also where both ways take turns, where a frame is too wide or too narrow to be held, and where a wrong frame is mended.
#[test]
fn lent_frames_give_the_same_bytes_and_never_change() {
    let coded = Coded::alone(true);
    let mut mended = coded.clone();
    let old = mended.values(2);
    mended.put(2, |i| 200.0 - old[i]);
    let narrow = |scene: &Scene, frame: &Frame| {
        let values = (0..scene.coordinates_px.len()).map(|i| frame.view().pixels.get(i) as u16);
        Frame { pixels: PixelBuffer::Mono16(values.collect()), ..frame.clone() }
    };
    let wide: Vec<Frame> = coded.frames.iter().map(|frame| narrow(&coded.scene, frame)).collect();
    let mut sixteen = coded.scene.clone();
    sixteen.full_scale_dn = 1023;
    let sixteen_bits = |frame: &Frame| Frame { full_scale_dn: 1023, ..frame.clone() };
    for (name, scene, frames) in [
        ("bytes", &coded.scene, coded.frames.clone()),
        ("a wrong frame", &coded.scene, mended.frames.clone()),
        ("words to bytes", &coded.scene, wide.clone()),
        ("words", &sixteen, wide.iter().map(sixteen_bits).collect()),
        ("bytes to words", &sixteen, coded.frames.iter().map(sixteen_bits).collect()),
    ] {
        let frames: Vec<SharedFrame> = frames.into_iter().map(SharedFrame::from).collect();
        let before: Vec<Frame> = frames.iter().map(|frame| Frame::from(frame.view())).collect();
        let mut decoder = scene.decoder(&coded.sequence, &DecodeSettings::default()).unwrap();
        let copied = map_of(&mut decoder, &frames, false);
        assert!(copied.valid.iter().map(|valid| usize::from(*valid)).sum::<usize>() > 60_000, "{name}");
        for lent in [true, true, false, true] {
            let map = map_of(&mut decoder, &frames, lent);
            assert_eq!(
                bytemuck::cast_slice::<_, u32>(&map.phase_rad),
                bytemuck::cast_slice::<_, u32>(&copied.phase_rad),
                "{name}"
            );
            assert_eq!(map.valid, copied.valid, "{name}");
        }
        // What comes later goes elsewhere.
        let black: Vec<SharedFrame> =
            coded.frames.iter().map(|frame| scene.frame(vec![0; frame.view().pixels.len()]).into()).collect();
        decoder.begin();
        black.iter().enumerate().for_each(|(index, frame)| decoder.push(index, &frame.view()).unwrap());
        for (frame, before) in frames.iter().zip(&before) {
            assert_eq!(Frame::from(frame.view()), *before, "{name}");
        }
    }
}
