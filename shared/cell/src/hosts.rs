//! Which part of a cell a computer runs, where the cell runs on several: a pair lies on one host with its cameras and its light.
//!
//! Indices of cameras, projectors and pairs are the same on all hosts: each plans the whole graph and runs its part of it.

use crate::graph::Graph;

impl Graph {
    /// Whether this computer matches a pair.
    pub fn has_pair(&self, pair: usize) -> bool {
        self.here.is_none_or(|here| self.hosts[here].pairs.contains(&pair))
    }

    /// Whether a camera is connected to this computer.
    pub fn has_camera(&self, camera: usize) -> bool {
        let takes = |(number, pair): (usize, &crate::graph::PairNode)| {
            self.has_pair(number) && pair.cameras().contains(&camera)
        };
        self.here.is_none() || self.pairs.iter().enumerate().any(takes)
    }

    /// Whether a projector is connected to this computer.
    pub fn has_projector(&self, projector: usize) -> bool {
        let cameras = &self.projectors[projector].cameras;
        self.here.is_none() || cameras.iter().any(|&camera| self.has_camera(camera))
    }

    /// Whether this computer fuses and inspects: it runs the whole cell, or leads the others.
    pub fn leads(&self) -> bool {
        self.here.is_none_or(|here| self.hosts[here].leads)
    }

    /// Indices of the hosts that this computer leads, in the order of the configuration.
    pub fn led(&self) -> Vec<usize> {
        match self.here.filter(|&here| self.hosts[here].leads) {
            Some(here) => (0..self.hosts.len()).filter(|&host| host != here).collect(),
            None => Vec::new(),
        }
    }

    /// Name of a host, for messages.
    pub fn host_name(&self, host: usize) -> &str {
        self.hosts.get(host).map_or("unknown", |h| &h.name)
    }

    /// Bytes of the frames that a host takes in a cycle; `bytes_per_px` tells how deep a camera's frames under a projector are.
    pub fn frame_bytes(&self, host: usize, bytes_per_px: impl Fn(usize, usize) -> u64) -> u64 {
        let mut bytes = 0;
        for (number, projector) in self.projectors.iter().enumerate() {
            for &camera in projector.cameras.iter().filter(|&&camera| self.is_camera_of(camera, host)) {
                let node = &self.cameras[camera];
                let pixels = u64::from(node.width_px) * u64::from(node.height_px);
                bytes += projector.frames as u64 * pixels * bytes_per_px(number, camera);
            }
        }
        bytes
    }

    /// Bytes of the clouds of a host, were every pixel of the left camera a point.
    pub fn cloud_bytes(&self, host: usize) -> u64 {
        let points = |&pair: &usize| {
            let node = &self.cameras[self.pairs[pair].left];
            u64::from(node.width_px) * u64::from(node.height_px)
        };
        self.hosts[host].pairs.iter().map(points).sum::<u64>() * size_of::<fringe::cloud::Point>() as u64
    }

    /// Whether a camera is connected to a host.
    pub fn is_camera_of(&self, camera: usize, host: usize) -> bool {
        self.hosts[host].pairs.iter().any(|&pair| self.pairs[pair].cameras().contains(&camera))
    }
}
