//! What tests of projectors share: a cell of two cameras on the network under one projector, and the light of the twin that they see.

use crate::gige::{SEQUENCE, network};
use crate::support::{SMALL_PX, root};
use devices::LoadedCell;
use std::net::UdpSocket;
use std::path::{Path, PathBuf};
use std::time::Duration;
use tempfile::TempDir;

/// A folder with a rig whose projector has this size, the configuration of its twin, and one of the same cell with cameras on the
/// network and `driver` as keys of its projector.
pub fn cell(
    test: u8,
    [width, height]: [u32; 2],
    driver: &str,
    exposure_us: f64,
) -> (TempDir, String, String) {
    let folder = TempDir::new().unwrap();
    let mut rig = twin::thesis::rig(SMALL_PX.0, SMALL_PX.1);
    rig.cameras.truncate(2);
    rig.projectors.truncate(1);
    rig.pairs.truncate(1);
    let light = &mut rig.projectors[0].camera;
    let scale = [width as f64 / light.width_px as f64, height as f64 / light.height_px as f64];
    let lens = light.focal_px.iter_mut().zip(&mut light.principal_point_px);
    for ((focal, principal), scale) in lens.zip(scale) {
        *focal *= scale;
        *principal = (*principal + 0.5) * scale - 0.5;
    }
    (light.width_px, light.height_px) = (width, height);
    files::rig_file::write_rig(&folder.path().join("rig.toml"), &rig, &toml::Table::new(), None).unwrap();
    // Fringes as wide on the part as those of the small projector.
    let stripe_px = (8.0 * scale[0] * 2.0_f64).round() / 2.0;
    let sequence =
        SEQUENCE.replace("16.0", &format!("{:?}", 2.0 * stripe_px)).replace("8.0", &format!("{stripe_px:?}"));
    let scene = root().join("configs/complex-artefact.scene.toml").display().to_string();
    let [a, b, c] = network(test);
    let eye = |live: bool, number: u8| {
        let driver = if live {
            format!(
                "driver = \"genicam\"\naddress = \"{a}.{b}.{c}.{}\"\nexposure_us = {exposure_us}",
                10 + number
            )
        } else {
            "driver = \"twin\"".to_owned()
        };
        format!("[[camera]]\nname = \"cam{number}\"\n{driver}\n")
    };
    let write = |name: &str, live: bool, driver: &str, rest: &str| {
        let text = format!(
            "format = \"fringecell-config/1\"\nname = \"lights\"\nrig = \"rig.toml\"\n\
             [limits]\nstage_budget_ms = 20000\ncycle_deadline_ms = 60000\n\
             [[projector]]\nname = \"proj1\"\n{driver}\nwidth_px = {width}\nheight_px = {height}\n\
             cameras = [\"cam1\", \"cam2\"]\nsequence = [\n  {sequence}\n]\n{}{}{rest}",
            eye(live, 1),
            eye(live, 2)
        );
        let path = folder.path().join(name);
        std::fs::write(&path, text).unwrap();
        path.to_str().unwrap().to_owned()
    };
    let twin = write("twin.toml", false, "driver = \"twin\"", &format!("[twin]\nscene = {scene:?}\n"));
    let live = write("live.toml", true, driver, "");
    (folder, twin, live)
}

/// Reads and plans a configuration.
pub fn load(config: &str) -> LoadedCell {
    devices::load(&PathBuf::from(config), &cell::Options::default()).unwrap()
}

/// The images of the first projector's sequence.
pub fn images(cell: &LoadedCell) -> Vec<Vec<u8>> {
    let projector = &cell.config.projectors[0];
    (0..projector.frames()).map(|frame| projector.image_u8(frame).unwrap().unwrap()).collect()
}

/// Tells the served twin what its projector shows, as an eye in front of it would see it.
pub struct Witness {
    light: UdpSocket,
    images: Vec<Vec<u8>>,
    shown: Option<usize>,
    cycles: u64,
    number: u64,
}

impl Witness {
    /// Of the projector of a cell whose twin is served under the number of this test.
    pub fn new(test: u8, images: Vec<Vec<u8>>) -> Self {
        let [a, b, c] = network(test);
        let light = UdpSocket::bind(format!("{a}.{b}.{c}.1:0")).unwrap();
        light.connect(format!("{a}.{b}.{c}.1:3957")).unwrap();
        light.set_read_timeout(Some(Duration::from_secs(10))).unwrap();
        Self { light, images, shown: None, cycles: 0, number: 1000 }
    }

    /// The projector shows this; a cycle begins with the first pattern of the sequence.
    pub fn sees(&mut self, picture: &[u8]) {
        let Some(frame) = self.images.iter().position(|image| image == picture) else { return };
        // A dark projector looks like a black frame.
        if self.shown == Some(frame) || (self.cycles == 0 && frame != 0) {
            return;
        }
        if frame == 0 {
            self.tell(&format!("begin {}", self.cycles));
            self.cycles += 1;
        }
        self.tell(&format!("show proj1 {frame}"));
        self.shown = Some(frame);
    }

    /// The projector runs its whole sequence by itself.
    pub fn runs(&mut self, frames: usize, period_us: u32) {
        self.tell(&format!("begin {}", self.cycles));
        self.cycles += 1;
        self.tell(&format!("run proj1 {frames} {period_us}"));
    }

    fn tell(&mut self, command: &str) {
        self.number += 1;
        self.light.send(format!("{} {command}", self.number).as_bytes()).unwrap();
        let mut answer = [0; 512];
        let length = self.light.recv(&mut answer).unwrap();
        let answer = String::from_utf8_lossy(&answer[..length]).into_owned();
        assert_eq!(answer, format!("{} ok", self.number), "{command}");
    }
}

/// The points of the cloud that a run wrote, without the header with its dates.
pub fn points(folder: &Path, out: &str) -> Vec<u8> {
    let bytes = std::fs::read(folder.join(out).join("cloud.ply")).unwrap();
    let end = bytes.windows(11).position(|w| w == b"end_header\n").unwrap() + 11;
    bytes[end..].to_vec()
}
