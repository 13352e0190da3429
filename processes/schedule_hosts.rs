//! What each host of a cell takes, keeps and sends in a cycle.

use cell::Cell;
use serde::Serialize;
use std::fmt::Write as _;

/// Bits that a network of 1 Gbit/s carries in a second; protocol and frames around the data take some percent of them.
const GIGABIT: f64 = 1e9;

/// A host of a cell.
#[derive(Debug, Serialize)]
pub struct HostRow {
    /// Name of the host.
    name: String,
    /// Whether it starts the cycles, fuses and inspects.
    leads: bool,
    /// Whether this plan is that of the host.
    here: bool,
    /// Pairs, cameras and projectors that are connected to it.
    pairs: Vec<String>,
    cameras: Vec<String>,
    projectors: Vec<String>,
    /// Frames of a cycle, which stay on the host, bytes.
    frame_bytes: u64,
    /// Clouds of a cycle, were every pixel of the left cameras a point, bytes.
    cloud_bytes: u64,
    /// The most that goes over the network to the host that leads in a cycle, bytes.
    sent_bytes: u64,
}

/// The hosts of a cell, in the order of the configuration.
pub fn host_rows(cell: &Cell) -> Vec<HostRow> {
    let graph = &cell.graph;
    let depth = |projector: usize, camera: usize| {
        cell.format(projector, camera).map_or(2, |format| u64::from(format.bytes_per_px))
    };
    let row = |(number, host): (usize, &cell::graph::HostNode)| {
        let is_here = |camera: &usize| graph.is_camera_of(*camera, number);
        let cloud_bytes = graph.cloud_bytes(number);
        HostRow {
            name: host.name.clone(),
            leads: host.leads,
            here: graph.here == Some(number),
            pairs: host.pairs.iter().map(|&pair| graph.pair_name(pair).to_owned()).collect(),
            cameras: (0..graph.cameras.len())
                .filter(is_here)
                .map(|camera| graph.camera_name(camera).to_owned())
                .collect(),
            projectors: graph
                .projectors
                .iter()
                .filter(|projector| projector.cameras.iter().any(is_here))
                .map(|projector| projector.name.clone())
                .collect(),
            frame_bytes: graph.frame_bytes(number, depth),
            cloud_bytes,
            sent_bytes: if host.leads { 0 } else { cloud_bytes },
        }
    };
    graph.hosts.iter().enumerate().map(row).collect()
}

/// The hosts as a table; nothing for a cell on one computer.
pub fn hosts_table(cell: &Cell) -> String {
    let rows = host_rows(cell);
    if rows.is_empty() {
        return String::new();
    }
    let mut text = format!(
        "\n{:<12} {:<7} {:<24} {:<30} {:>14} {:>16} {:>12}\n",
        "host", "", "pairs", "cameras", "frames, stay", "clouds, at most", "1 Gbit/s"
    );
    let mb = |bytes: u64| format!("{:.1} MB", bytes as f64 / 1e6);
    for row in rows {
        let role = match (row.leads, row.here) {
            (true, _) => "leads",
            (false, true) => "here",
            (false, false) => "",
        };
        let time = match row.sent_bytes {
            0 => "stay".to_owned(),
            bytes => format!("{:.2} s", bytes as f64 * 8.0 / GIGABIT),
        };
        let _ = writeln!(
            text,
            "{:<12} {role:<7} {:<24} {:<30} {:>14} {:>16} {time:>12}",
            row.name,
            row.pairs.join(" "),
            row.cameras.join(" "),
            mb(row.frame_bytes),
            mb(row.cloud_bytes)
        );
    }
    text
}
