//! Typed views of payload bytes in shared memory, as `fringe` takes them. No copies.
//!
//! A phase payload holds four planes one after another: phase f32, sigma f32, modulation f32, validity u8. A frame or a
//! cloud is one array. Payloads start at a multiple of 64 bytes, so the casts succeed for every valid message.

use crate::error::MessageError;
use crate::header::{Cloud, Frame, Header, Phase};
use crate::output_hash;
use fringe::cloud::Point;
use fringe::frame::{FrameView, Pixels};
use fringe::phase::{PhaseView, PhaseViewMut};

/// Checks that a payload has the length that its header states.
///
/// # Errors
/// [`MessageError::Length`], or the invalid value of the header.
pub fn check<H: Header>(header: &H, payload: &[u8]) -> Result<(), MessageError> {
    let announced = header.payload_bytes()?;
    if announced == payload.len() {
        Ok(())
    } else {
        Err(MessageError::Length { announced, present: payload.len() })
    }
}

/// A frame for the decoder.
///
/// # Errors
/// A header that contradicts its payload.
pub fn frame<'a>(header: &Frame, payload: &'a [u8]) -> Result<FrameView<'a>, MessageError> {
    check(header, payload)?;
    let pixels =
        if header.bytes_per_px == 1 { Pixels::Mono8(payload) } else { Pixels::Mono16(cast(payload)?) };
    Ok(FrameView {
        width_px: header.width_px,
        height_px: header.height_px,
        full_scale_dn: header.full_scale_dn as u16,
        pixels,
    })
}

/// Checks that the pixels are those that the camera gave: nothing has changed them in shared memory.
///
/// # Errors
/// [`MessageError::Changed`].
pub fn check_pixels(header: &Frame, payload: &[u8]) -> Result<(), MessageError> {
    let hash = output_hash(payload);
    if (header.hash_high, header.hash_low) == ((hash >> 64) as u64, hash as u64) {
        Ok(())
    } else {
        Err(MessageError::Changed)
    }
}

/// A phase map for the matcher.
///
/// # Errors
/// A header that contradicts its payload.
pub fn phase<'a>(header: &Phase, payload: &'a [u8]) -> Result<PhaseView<'a>, MessageError> {
    check(header, payload)?;
    PhaseView::from_bytes(header.info()?, payload).ok_or(MessageError::Alignment)
}

/// A phase map for the decoder to write.
///
/// # Errors
/// A header that contradicts its payload.
pub fn phase_mut<'a>(header: &Phase, payload: &'a mut [u8]) -> Result<PhaseViewMut<'a>, MessageError> {
    check(header, payload)?;
    PhaseViewMut::from_bytes(header.info()?, payload).ok_or(MessageError::Alignment)
}

/// The points of a cloud message.
///
/// # Errors
/// A header that contradicts its payload.
pub fn points<'a>(header: &Cloud, payload: &'a [u8]) -> Result<&'a [Point], MessageError> {
    check(header, payload)?;
    Ok(&cast::<Point>(payload)?[..header.points as usize])
}

/// The text of an event or a result.
///
/// # Errors
/// [`MessageError::Count`] for a text longer than its payload, [`MessageError::Text`] for bytes that are not UTF-8.
pub fn text(text_bytes: u32, payload: &[u8]) -> Result<&str, MessageError> {
    let bytes = payload
        .get(..text_bytes as usize)
        .ok_or(MessageError::Count { used: text_bytes.into(), capacity: payload.len() as u64 })?;
    std::str::from_utf8(bytes).map_err(|_| MessageError::Text)
}

/// The whole capacity of a cloud payload, to be written.
///
/// # Errors
/// [`MessageError::Alignment`] if the bytes are not a whole number of points.
pub fn points_mut(payload: &mut [u8]) -> Result<&mut [Point], MessageError> {
    cast_mut(payload)
}

fn cast<T: bytemuck::AnyBitPattern>(bytes: &[u8]) -> Result<&[T], MessageError> {
    bytemuck::try_cast_slice(bytes).map_err(|_| MessageError::Alignment)
}

fn cast_mut<T: bytemuck::Pod>(bytes: &mut [u8]) -> Result<&mut [T], MessageError> {
    bytemuck::try_cast_slice_mut(bytes).map_err(|_| MessageError::Alignment)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::header::Event;
    use fringe::phase::PHASE_BYTES_PER_PX;

    /// Memory aligned like a loan.
    fn aligned(words: usize) -> Vec<u64> {
        vec![0; words]
    }

    #[test]
    fn a_frame_is_accepted_only_when_header_and_payload_agree() {
        let valid =
            Frame { width_px: 4, height_px: 2, bytes_per_px: 2, full_scale_dn: 4095, ..Frame::default() };
        let memory = aligned(4);
        let bytes: &[u8] = bytemuck::cast_slice(&memory);
        assert_eq!(frame(&valid, &bytes[..16]).unwrap().pixels.len(), 8);
        assert_eq!(frame(&valid, &bytes[..15]), Err(MessageError::Length { announced: 16, present: 15 }));
        for invalid in [
            Frame { bytes_per_px: 3, ..valid },
            Frame { bytes_per_px: 0, ..valid },
            Frame { full_scale_dn: 0, ..valid },
            Frame { full_scale_dn: 70_000, ..valid },
            Frame { full_scale_dn: 256, bytes_per_px: 1, height_px: 4, ..valid },
            Frame { width_px: u32::MAX, height_px: u32::MAX, ..valid },
            Frame { width_px: 0, ..valid },
        ] {
            assert!(frame(&invalid, &bytes[..16]).is_err(), "{invalid:?}");
        }
    }

    #[test]
    fn one_changed_bit_of_a_frame_is_found() {
        let mut pixels: Vec<u8> = (0..=255).collect();
        let mut header =
            Frame { width_px: 16, height_px: 16, bytes_per_px: 1, full_scale_dn: 255, ..Frame::default() };
        header.set_hash(output_hash(&pixels));
        check_pixels(&header, &pixels).unwrap();
        for bit in 0..8 * pixels.len() {
            pixels[bit / 8] ^= 1 << (bit % 8);
            assert_eq!(check_pixels(&header, &pixels), Err(MessageError::Changed), "{bit}");
            pixels[bit / 8] ^= 1 << (bit % 8);
        }
    }

    #[test]
    #[ignore = "prints a time: cargo test --release -p fringe-ipc time_of_the_check -- --ignored --nocapture"]
    fn time_of_the_check_of_a_frame() {
        let pixels = vec![7_u8; 5_000_000];
        let mut header = Frame::default();
        header.set_hash(output_hash(&pixels));
        let mut times: Vec<_> = (0..101)
            .map(|_| {
                let begin = std::time::Instant::now();
                check_pixels(&header, std::hint::black_box(&pixels)).unwrap();
                begin.elapsed()
            })
            .collect();
        times.sort();
        println!("5 MB: median {:?}, minimum {:?}", times[50], times[0]);
    }

    #[test]
    fn the_planes_of_a_phase_map_do_not_overlap_and_read_back_as_written() {
        let header = Phase { width_px: 3, height_px: 1, period_px: 16.0, axis: 1, ..Phase::default() };
        let mut memory = aligned(5);
        let bytes: &mut [u8] = &mut bytemuck::cast_slice_mut(&mut memory)[..3 * PHASE_BYTES_PER_PX];
        let map = phase_mut(&header, bytes).unwrap();
        map.phase_rad.copy_from_slice(&[1.0, 2.0, 3.0]);
        map.sigma_rad.copy_from_slice(&[4.0, 5.0, 6.0]);
        map.modulation.copy_from_slice(&[7.0, 8.0, 9.0]);
        map.valid.copy_from_slice(&[1, 0, 1]);
        let view = phase(&header, bytes).unwrap();
        assert_eq!(view.phase_rad, [1.0, 2.0, 3.0]);
        assert_eq!(view.sigma_rad, [4.0, 5.0, 6.0]);
        assert_eq!(view.modulation, [7.0, 8.0, 9.0]);
        assert_eq!(view.valid, [1, 0, 1]);
        assert!(phase(&Phase { axis: 2, ..header }, bytes).is_err());
        assert!(phase(&Phase { width_px: 4, ..header }, bytes).is_err());
    }

    #[test]
    fn a_cloud_with_more_points_than_its_capacity_is_refused() {
        let memory = aligned(2 * size_of::<Point>() / 8);
        let bytes: &[u8] = bytemuck::cast_slice(&memory);
        let header = Cloud { capacity: 2, points: 1, ..Cloud::default() };
        assert_eq!(points(&header, bytes).unwrap().len(), 1);
        assert_eq!(
            points(&Cloud { points: 3, ..header }, bytes),
            Err(MessageError::Count { used: 3, capacity: 2 })
        );
        assert!(points(&Cloud { capacity: 3, ..header }, bytes).is_err());
    }

    #[test]
    fn unknown_commands_and_kinds_are_refused() {
        assert!(crate::header::Control { cycle: 1, command: 9, recipe: 0 }.command().is_err());
        assert!(Event { kind: 9, ..Event::default() }.kind().is_err());
        assert!(Event { text_bytes: u32::MAX, ..Event::default() }.payload_bytes().is_err());
    }
}
