//! What every driver has to do, as checks that any driver can be run through: against the device, or against what stands for it.

use crate::device::Camera;
use crate::light::Light;
use std::time::{Duration, Instant};

/// Runs a projector through its sequence forwards, in jumps and beyond its end; `limit` is the stage budget of the cell.
///
/// # Errors
/// The first duty that it fails, in words.
pub fn check_light(light: &mut dyn Light, frames: usize, limit: Duration) -> Result<(), String> {
    let show = |light: &mut dyn Light, frame: usize, when: &str| {
        let start = Instant::now();
        light.show(frame).map_err(|error| format!("frame {} {when}: {error}", frame + 1))?;
        match start.elapsed() {
            took if took > limit => Err(format!(
                "frame {} {when} took {} ms, the limit is {} ms",
                frame + 1,
                took.as_millis(),
                limit.as_millis()
            )),
            _ => Ok(()),
        }
    };
    let dark =
        |light: &mut dyn Light, when: &str| light.darken().map_err(|error| format!("dark {when}: {error}"));
    dark(light, "at the start")?;
    dark(light, "once more")?;
    (0..frames).try_for_each(|frame| show(light, frame, "in order"))?;
    (0..frames).rev().try_for_each(|frame| show(light, frame, "backwards"))?;
    show(light, 0, "a second time")?;
    if light.show(frames).is_ok() {
        return Err(format!("frame {} is shown, but the sequence has {frames}", frames + 1));
    }
    show(light, 0, "after a frame that does not exist")?;
    dark(light, "at the end")
}

/// Lets a camera take the first frames of a projector in two cycles; `bytes` is the size of a frame, `limit` the stage budget.
///
/// # Errors
/// The first duty that it fails, in words.
pub fn check_camera(
    camera: &mut dyn Camera,
    projector: usize,
    frames: usize,
    bytes: usize,
    limit: Duration,
) -> Result<(), String> {
    // What was there before differs from cycle to cycle: a byte that keeps it both times was not written.
    let before = [0xa5, 0x5a];
    let mut taken: Vec<Vec<Vec<u8>>> = Vec::new();
    for (cycle, filling) in before.iter().enumerate() {
        camera.begin(cycle as u64).map_err(|error| format!("cycle {}: {error}", cycle + 1))?;
        let mut images = Vec::new();
        for frame in 0..frames {
            let mut out = vec![*filling; bytes];
            let start = Instant::now();
            camera
                .expose(projector, frame, &mut out)
                .map_err(|error| format!("frame {}: {error}", frame + 1))?;
            let took = start.elapsed();
            if took > limit {
                return Err(format!(
                    "frame {} took {} ms, the limit is {} ms",
                    frame + 1,
                    took.as_millis(),
                    limit.as_millis()
                ));
            }
            images.push(out);
        }
        taken.push(images);
    }
    for (frame, (first, second)) in taken[0].iter().zip(&taken[1]).enumerate() {
        let kept = first.iter().zip(second).filter(|(a, b)| [**a, **b] == before).count();
        if kept > 0 {
            return Err(format!("{kept} bytes of frame {} are not written", frame + 1));
        }
    }
    for wrong in [bytes - 1, bytes + 1, 0] {
        let mut out = vec![0; wrong];
        if camera.expose(projector, 0, &mut out).is_ok() {
            return Err(format!("a frame of {bytes} bytes is written into {wrong}"));
        }
    }
    let mut out = vec![0; bytes];
    camera.begin(0).map_err(|error| format!("a cycle after a fault: {error}"))?;
    camera.expose(projector, 0, &mut out).map_err(|error| format!("a frame after a fault: {error}"))
}
