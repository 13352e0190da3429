//! Every driver that can be run without its device, through the checks of `devices::conformance`; and the faults that they find.

use crate::lights::{cell, load};
use crate::support::Small;
use devices::{Camera, DeviceError, Light, conformance};
use std::time::Duration;

const LIMIT: Duration = Duration::from_secs(20);

fn expect_camera(config: &str) {
    let cell = load(config);
    let frames = cell.config.projectors[0].frames();
    let [width, height] = [cell.config.cameras[0].width_px, cell.config.cameras[0].height_px];
    let mut camera = devices::camera(&cell, 0).unwrap();
    conformance::check_camera(camera.as_mut(), 0, frames, (width * height) as usize, LIMIT).unwrap();
}

#[test]
fn cameras_of_the_twin_and_of_a_recording_do_their_duties() {
    let (_folder, twin, _) = cell(60, [608, 684], "driver = \"network\"\naddress = \"127.0.0.1:1\"", 10000.0);
    expect_camera(&twin);
    let small = Small::new();
    let text = "format = \"fringecell-config/1\"\nname = \"played\"\nrig = \"rig.toml\"\npairs = [\"pair1\"]\n\
        [[projector]]\nname = \"proj1\"\ndriver = \"recording\"\n\
        [[camera]]\nname = \"cam1\"\ndriver = \"recording\"\n[[camera]]\nname = \"cam2\"\ndriver = \"recording\"\n\
        [recording]\npath = \"rec\"\nloop = true\n";
    std::fs::write(small.path("played.toml"), text).unwrap();
    expect_camera(&small.path("played.toml"));
}

/// A projector of three frames that does one thing wrong.
struct Wrong(&'static str);

impl Light for Wrong {
    fn show(&mut self, frame: usize) -> Result<(), DeviceError> {
        match self.0 {
            "endless" if frame == 3 => return Ok(()),
            "slow" => std::thread::sleep(Duration::from_millis(30)),
            "forward" if frame == 0 => {
                self.0 = "no way back";
                return Ok(());
            }
            "no way back" if frame == 0 => return Err(DeviceError::Frame("already shown".into())),
            _ => {}
        }
        if frame < 3 { Ok(()) } else { Err(DeviceError::Frame("no such frame".into())) }
    }

    fn darken(&mut self) -> Result<(), DeviceError> {
        if self.0 == "bright" { Err(DeviceError::Frame("cannot".into())) } else { Ok(()) }
    }
}

/// A camera that does one thing wrong.
struct Blind(&'static str);

impl Camera for Blind {
    fn begin(&mut self, _cycle: u64) -> Result<(), DeviceError> {
        Ok(())
    }

    fn expose(&mut self, _projector: usize, _frame: usize, out: &mut [u8]) -> Result<(), DeviceError> {
        let end = if self.0 == "short" { out.len().saturating_sub(7) } else { out.len() };
        out[..end].fill(100);
        if self.0 == "any size" || out.len() == 64 {
            Ok(())
        } else {
            Err(DeviceError::Frame("another size".into()))
        }
    }
}

#[test]
fn drivers_that_fail_a_duty_are_found() {
    let limit = Duration::from_millis(20);
    assert_eq!(conformance::check_light(&mut Wrong(""), 3, limit), Ok(()));
    for (wrong, said) in [
        ("endless", "frame 4 is shown, but the sequence has 3"),
        ("slow", "frame 1 in order took"),
        ("forward", "frame 1 backwards: already shown"),
        ("bright", "dark at the start: cannot"),
    ] {
        let found = conformance::check_light(&mut Wrong(wrong), 3, limit).unwrap_err();
        assert!(found.contains(said), "{found} lacks {said}");
    }
    assert_eq!(conformance::check_camera(&mut Blind(""), 0, 2, 64, limit), Ok(()));
    for (wrong, said) in [
        ("short", "7 bytes of frame 1 are not written"),
        ("any size", "a frame of 64 bytes is written into 63"),
    ] {
        let found = conformance::check_camera(&mut Blind(wrong), 0, 2, 64, limit).unwrap_err();
        assert!(found.contains(said), "{found} lacks {said}");
    }
}
