//! The cameras of the digital twin as GigE Vision cameras on the network, and its projectors behind one address.

use crate::device::Camera;
use crate::error::DeviceError;
use crate::gige_simulator::{Faults, FrameSource, Identity, Line, NoFrame, Pattern, Responder, Server};
use crate::load::LoadedCell;
use crate::network_projector::{ProjectorCommand, ProjectorServer};
use crate::storm::{self, Calamity};
use cell::configuration::Driver;
use std::io;
use std::net::{Ipv4Addr, SocketAddr};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// So long a camera that vanished answers nothing: longer than a client keeps control without a sign of life.
const SILENCE: Duration = Duration::from_secs(5);

/// What the projectors show at the moment.
#[derive(Debug, Clone, Copy, Default)]
struct Shown {
    /// Cycle that was begun, and for which the views are traced.
    cycle: Option<u64>,
    /// Projector and frame of its sequence.
    pattern: Option<Pattern>,
    /// Number of the sequence that runs in its own time; another one, or a new cycle, ends it.
    run: u64,
}

struct Scene {
    shown: Shown,
    cameras: Vec<Box<dyn Camera>>,
}

/// A camera of the scene as the network sees it.
struct Seen {
    scene: Arc<Mutex<Scene>>,
    camera: usize,
    bytes: usize,
    row_bytes: usize,
    /// What goes wrong with it.
    faults: Faults,
    /// Frames of each projector.
    frames: Vec<usize>,
    /// The first pattern that lights this camera.
    first: Pattern,
}

/// A projector of the scene.
struct Lamp {
    name: String,
    /// Cables to the cameras that look at it.
    lines: Vec<Line>,
}

fn lock(scene: &Mutex<Scene>) -> MutexGuard<'_, Scene> {
    scene.lock().unwrap_or_else(PoisonError::into_inner)
}

impl FrameSource for Seen {
    fn expose(
        &mut self,
        exposure_us: f32,
        fired: Option<Pattern>,
        pixels: &mut Vec<u8>,
    ) -> Result<(), NoFrame> {
        let nothing = |e: DeviceError| NoFrame::Nothing(e.to_string());
        let mut scene = lock(&self.scene);
        if scene.shown.cycle.is_none() {
            // A client that looks before any cycle sees the first part under the first pattern.
            scene.shown.pattern = Some(self.first);
        }
        let dark = || NoFrame::Nothing("no pattern is shown".to_owned());
        let (projector, due) = fired.or(scene.shown.pattern).ok_or_else(dark)?;
        let frames = self.frames[projector].max(1);
        let cycle = scene.shown.cycle.unwrap_or_default();
        let calamity = match (self.faults.order, self.faults.storm) {
            (Some(event), _) => Some(Calamity::Order(event)),
            (None, seed) => seed.and_then(|seed| storm::draw(seed, self.camera, cycle, frames)),
        };
        let shown = match calamity {
            Some(Calamity::Never(frame)) if frame == due => {
                return Err(NoFrame::Nothing("a storm took it".to_owned()));
            }
            Some(Calamity::Silent(frame)) if frame == due => return Err(NoFrame::Silent(SILENCE)),
            // Beyond the last pattern the first one comes again.
            Some(Calamity::Order(event)) => event.shown(due).unwrap_or(0) % frames,
            _ => due,
        };
        pixels.resize(self.bytes, 0);
        let camera = &mut scene.cameras[self.camera];
        camera.set_exposure_us(exposure_us.into()).map_err(nothing)?;
        camera.expose(projector, shown, pixels).map_err(nothing)?;
        if calamity == Some(Calamity::Short(due)) {
            pixels.truncate(self.bytes - self.row_bytes);
        }
        Ok(())
    }
}

/// The cameras and the light of a twin on the network, until dropped.
pub struct ServedTwin {
    cameras: Vec<(String, Server)>,
    light: ProjectorServer,
    /// Fewer where another program answers searches on this network.
    responders: Vec<Responder>,
}

impl ServedTwin {
    /// Serves every twin camera of a cell, the first one at `first`, the others at the addresses after it, and its
    /// projectors at `light`.
    ///
    /// # Errors
    /// A twin that cannot be built; an address that is taken or may not be opened.
    pub fn start(
        cell: &LoadedCell,
        first: Ipv4Addr,
        light: SocketAddr,
        faults: Faults,
    ) -> Result<Self, DeviceError> {
        let twin = cell.file.twin.as_ref().ok_or(DeviceError::Missing("twin"))?;
        let numbers = 0..cell.graph.cameras.len();
        let mut cameras: Vec<Box<dyn Camera>> =
            numbers.clone().map(|number| crate::camera(cell, number)).collect::<Result<_, _>>()?;
        // Tracing takes longer than a client waits for a sign of life.
        cameras.iter_mut().try_for_each(|camera| camera.begin(0))?;
        let scene = Arc::new(Mutex::new(Scene { shown: Shown::default(), cameras }));
        let (mut served, mut identities) = (Vec::new(), Vec::new());
        for camera in numbers {
            let config = &cell.config.cameras[camera];
            if config.driver != Driver::Twin {
                return Err(DeviceError::Frame(format!("camera \"{}\" is no twin", config.name)));
            }
            let address = Ipv4Addr::from(u32::from(first).wrapping_add(camera as u32));
            let identity = Identity {
                address,
                mac: [2, 0, 0, 0, (camera >> 8) as u8, camera as u8],
                serial: format!("TWIN-{:04}", camera + 1),
                user_name: config.name.chars().take(15).collect(),
                width_px: config.width_px,
                height_px: config.height_px,
                full_scale_dn: twin.settings.full_scale_dn(),
            };
            let source = Seen {
                scene: scene.clone(),
                camera,
                bytes: identity.frame_bytes(),
                row_bytes: identity.frame_bytes() / identity.height_px.max(1) as usize,
                faults,
                frames: cell.graph.projectors.iter().map(|p| p.frames).collect(),
                first: (
                    cell.graph.projectors.iter().position(|p| p.cameras.contains(&camera)).unwrap_or(0),
                    0,
                ),
            };
            identities.push(identity.clone());
            let server = Server::start(identity, Box::new(source), faults)
                .map_err(|source| DeviceError::Network { address: (address, 3956).into(), source })?;
            served.push((config.name.clone(), server));
        }
        let lamps = cell.graph.projectors.iter().map(|p| {
            let lines = p.cameras.iter().map(|camera| served[*camera].1.line()).collect::<io::Result<_>>()?;
            Ok(Arc::new(Lamp { name: p.name.clone(), lines }))
        });
        let failed = |source| DeviceError::Network { address: light, source };
        let lamps: Vec<Arc<Lamp>> = lamps.collect::<io::Result<_>>().map_err(failed)?;
        let light =
            ProjectorServer::start(light, move |command| show(&scene, &lamps, command)).map_err(failed)?;
        let [network, ..] = first.octets();
        // Of an address of class A, as all of this computer are.
        let own = Ipv4Addr::new(network, 255, 255, 255);
        // Some clients search all networks at once.
        let searched = [own, Ipv4Addr::BROADCAST];
        let responders = searched.iter().filter_map(|to| Responder::start(*to, &identities).ok()).collect();
        Ok(Self { cameras: served, light, responders })
    }

    /// Names and addresses of the cameras.
    pub fn cameras(&self) -> impl Iterator<Item = (&str, SocketAddr)> {
        self.cameras.iter().map(|(name, server)| (name.as_str(), server.address()))
    }

    /// Whether a search of the network finds the cameras.
    pub fn is_searchable(&self) -> bool {
        !self.responders.is_empty()
    }

    /// Address of the projectors.
    pub fn light(&self) -> SocketAddr {
        self.light.address()
    }
}

fn show(shared: &Arc<Mutex<Scene>>, lamps: &[Arc<Lamp>], command: ProjectorCommand) -> Result<(), String> {
    let number = |name: &str| {
        let number = lamps.iter().position(|lamp| lamp.name == *name);
        number.ok_or_else(|| format!("there is no projector \"{name}\""))
    };
    let mut scene = lock(shared);
    let run = scene.shown.run + 1;
    match command {
        ProjectorCommand::Begin(cycle) => {
            scene.shown = Shown { cycle: Some(cycle), pattern: None, run };
            scene.cameras.iter_mut().try_for_each(|camera| camera.begin(cycle)).map_err(|e| e.to_string())
        }
        ProjectorCommand::Show { projector, frame } => {
            let number = number(&projector)?;
            if scene.shown.cycle.is_none() {
                return Err("no cycle has begun".to_owned());
            }
            scene.shown.pattern = Some((number, frame));
            Ok(())
        }
        ProjectorCommand::Run { projector, frames, period_us } => {
            let number = number(&projector)?;
            if scene.shown.cycle.is_none() {
                return Err("no cycle has begun".to_owned());
            }
            scene.shown.run = run;
            let (shared, lamp) = (shared.clone(), lamps[number].clone());
            let sequence = Sequence { number, frames, period: Duration::from_micros(period_us), run };
            let started = std::thread::Builder::new().name("projector".into());
            started.spawn(move || sequence.show(&shared, &lamp)).map(|_| ()).map_err(|e| e.to_string())
        }
    }
}

/// A sequence that runs in its own time.
struct Sequence {
    /// Number of the projector.
    number: usize,
    frames: usize,
    period: Duration,
    run: u64,
}

impl Sequence {
    /// Shows frame after frame and fires the cameras, until the end or until something else is shown.
    fn show(&self, scene: &Mutex<Scene>, lamp: &Lamp) {
        let start = Instant::now();
        for frame in 0..self.frames {
            std::thread::sleep(
                (start + self.period * frame as u32).saturating_duration_since(Instant::now()),
            );
            {
                let mut scene = lock(scene);
                if scene.shown.run != self.run {
                    return;
                }
                scene.shown.pattern = Some((self.number, frame));
            }
            lamp.lines.iter().for_each(|line| line.fire((self.number, frame)));
        }
    }
}
