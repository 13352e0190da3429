//! The cameras of the digital twin as GigE Vision cameras on the network, and its projectors behind one address.

use crate::device::Camera;
use crate::error::DeviceError;
use crate::gige_simulator::{Faults, FrameSource, Identity, Responder, Server};
use crate::load::LoadedCell;
use crate::network_projector::{ProjectorCommand, ProjectorServer};
use cell::configuration::Driver;
use std::net::{Ipv4Addr, SocketAddr};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// What the projectors show at the moment.
#[derive(Debug, Clone, Copy, Default)]
struct Shown {
    /// Cycle that was begun, and for which the views are traced.
    cycle: Option<u64>,
    /// Projector and frame of its sequence.
    pattern: Option<(usize, usize)>,
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
}

fn lock(scene: &Mutex<Scene>) -> MutexGuard<'_, Scene> {
    scene.lock().unwrap_or_else(PoisonError::into_inner)
}

impl FrameSource for Seen {
    fn expose(&mut self, _exposure_us: f32, pixels: &mut Vec<u8>) -> Result<(), String> {
        let mut scene = lock(&self.scene);
        let (projector, frame) = scene.shown.pattern.ok_or("no pattern is shown")?;
        pixels.resize(self.bytes, 0);
        scene.cameras[self.camera].expose(projector, frame, pixels).map_err(|e| e.to_string())
    }
}

/// The cameras and the light of a twin on the network, until dropped.
pub struct ServedTwin {
    cameras: Vec<(String, Server)>,
    light: ProjectorServer,
    /// Absent where another program answers searches on this network.
    responder: Option<Responder>,
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
        let cameras = numbers.clone().map(|number| crate::camera(cell, number)).collect::<Result<_, _>>()?;
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
            let source = Seen { scene: scene.clone(), camera, bytes: identity.frame_bytes() };
            identities.push(identity.clone());
            let server = Server::start(identity, Box::new(source), faults)
                .map_err(|source| DeviceError::Network { address: (address, 3956).into(), source })?;
            served.push((config.name.clone(), server));
        }
        let names: Vec<String> = cell.config.projectors.iter().map(|p| p.name.clone()).collect();
        let light = ProjectorServer::start(light, move |command| show(&scene, &names, command))
            .map_err(|source| DeviceError::Network { address: light, source })?;
        let [network, ..] = first.octets();
        // Of an address of class A, as all of this computer are.
        let responder = Responder::start(Ipv4Addr::new(network, 255, 255, 255), &identities).ok();
        Ok(Self { cameras: served, light, responder })
    }

    /// Names and addresses of the cameras.
    pub fn cameras(&self) -> impl Iterator<Item = (&str, SocketAddr)> {
        self.cameras.iter().map(|(name, server)| (name.as_str(), server.address()))
    }

    /// Whether a search of the network finds the cameras.
    pub fn is_searchable(&self) -> bool {
        self.responder.is_some()
    }

    /// Address of the projectors.
    pub fn light(&self) -> SocketAddr {
        self.light.address()
    }
}

fn show(scene: &Mutex<Scene>, names: &[String], command: ProjectorCommand) -> Result<(), String> {
    let mut scene = lock(scene);
    match command {
        ProjectorCommand::Begin(cycle) => {
            scene.shown = Shown { cycle: Some(cycle), pattern: None };
            scene.cameras.iter_mut().try_for_each(|camera| camera.begin(cycle)).map_err(|e| e.to_string())
        }
        ProjectorCommand::Show { projector, frame } => {
            let number = names.iter().position(|name| *name == projector);
            let number = number.ok_or_else(|| format!("there is no projector \"{projector}\""))?;
            if scene.shown.cycle.is_none() {
                return Err("no cycle has begun".to_owned());
            }
            scene.shown.pattern = Some((number, frame));
            Ok(())
        }
    }
}
