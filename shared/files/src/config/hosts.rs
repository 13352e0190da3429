//! The tables `[[host]]`: which computer runs which pairs.

use super::raw::RawConfig;
use super::values::value;
use crate::document::Document;
use crate::error::{FileError, Problem, did_you_mean, list};
use crate::name::duplicate;
use cell::configuration::{Configuration, HostConfig};
use fringe::text::{CELL_NAME, is_cell_name};
use std::net::SocketAddr;

/// Most hosts of a cell: one for each pair of the largest rigs.
const MAX_HOSTS: usize = 16;

/// The hosts as they are written: names and addresses are checked.
pub(super) fn hosts(document: &Document, raw: &RawConfig) -> Result<Vec<HostConfig>, FileError> {
    if let Some((index, name)) = duplicate(raw.host.iter().map(|host| host.name.as_str())) {
        let problem = Problem::Duplicate { kind: "host", name: name.to_owned() };
        return Err(document.fault(&format!("host[{index}].name"), problem, "rename or remove one of them"));
    }
    if raw.host.len() == 1 || raw.host.len() > MAX_HOSTS {
        let problem = value(raw.host.len(), format!("2 … {MAX_HOSTS} tables [[host]]"));
        return Err(document.fault("host", problem, "leave them out for a cell on one computer"));
    }
    let host = |(index, host): (usize, &super::raw::RawHost)| {
        // Together with the name of the cell it names the runtime folder of the host.
        if !is_cell_name(&host.name) || !is_cell_name(&format!("{}-{}", raw.name, host.name)) {
            let problem = value(format!("{:?}", host.name), CELL_NAME);
            let remedy = "with the name of the cell and \"-\" before it, it becomes the name of a folder: shorten one of them";
            return Err(document.fault(&format!("host[{index}].name"), problem, remedy));
        }
        let listen = host.listen.as_deref().map(|text| address(document, index, text)).transpose()?;
        Ok(HostConfig { name: host.name.clone(), pairs: host.pairs.clone(), listen })
    };
    raw.host.iter().enumerate().map(host).collect()
}

fn address(document: &Document, index: usize, text: &str) -> Result<SocketAddr, FileError> {
    let parsed = text.parse::<SocketAddr>().ok();
    parsed.filter(|a| a.port() != 0 && !a.ip().is_unspecified()).ok_or_else(|| {
        let problem = value(format!("{text:?}"), "an IP address and a port, as \"192.168.1.10:7447\"");
        document.fault(&format!("host[{index}].listen"), problem, "the other hosts connect to it")
    })
}

/// One host leads, each pair lies on one host, and so do its cameras and its light.
pub(super) fn check_hosts(document: &Document, cell: &Configuration) -> Result<(), FileError> {
    if cell.hosts.is_empty() {
        return Ok(());
    }
    let leaders: Vec<usize> = (0..cell.hosts.len()).filter(|&h| cell.hosts[h].listen.is_some()).collect();
    match leaders[..] {
        [_] => {}
        [] => {
            let problem = Problem::Missing("`listen` of the host that leads".into());
            return Err(document.fault("host[0]", problem, "add listen = \"ADDRESS:PORT\" to one [[host]]"));
        }
        [first, second, ..] => {
            let problem = Problem::Disagreement {
                what: "the host that leads",
                here: format!("host \"{}\" has `listen`", cell.hosts[second].name),
                there: format!("host \"{}\" has it, too", cell.hosts[first].name),
            };
            return Err(document.fault(
                &format!("host[{second}].listen"),
                problem,
                "one host leads: remove one",
            ));
        }
    }
    check_pairs(document, cell)?;
    check_devices(document, cell)?;
    // Their light would have to come at the same moment on several computers.
    let host_of = |projector: usize| {
        let name = &cell.projectors[projector].name;
        let pairs = cell.rig.pairs.iter().filter(|pair| pair.projector == *name);
        pairs.map(|pair| cell.hosts.iter().position(|host| host.pairs.contains(&pair.name))).next().flatten()
    };
    for group in &cell.together {
        let first = group.first().map(|&projector| host_of(projector));
        if group.iter().any(|&projector| Some(host_of(projector)) != first) {
            let problem = Problem::Disagreement {
                what: "the host of a group",
                here: "projectors of several hosts show together".into(),
                there: "each host shows at its own time".into(),
            };
            return Err(document.fault(
                "schedule.together",
                problem,
                "name projectors of one host in a group",
            ));
        }
    }
    if cell.schedule.cycles_in_flight > 1 {
        let problem = value(cell.schedule.cycles_in_flight, "1 in a cell with [[host]]");
        return Err(document.fault("schedule.cycles_in_flight", problem, "leave it out"));
    }
    Ok(())
}

/// Each pair of the cell lies on one host.
fn check_pairs(document: &Document, cell: &Configuration) -> Result<(), FileError> {
    let mut places: Vec<Option<usize>> = vec![None; cell.rig.pairs.len()];
    let known = || cell.rig.pairs.iter().map(|pair| pair.name.as_str());
    for (index, host) in cell.hosts.iter().enumerate() {
        if host.pairs.is_empty() {
            let problem = Problem::Missing(format!("a pair of host \"{}\"", host.name));
            return Err(document.fault(
                &format!("host[{index}].pairs"),
                problem,
                "name one, or remove the host",
            ));
        }
        for (place, name) in host.pairs.iter().enumerate() {
            let key = format!("host[{index}].pairs[{place}]");
            let Some(pair) = cell.rig.pairs.iter().position(|pair| pair.name == *name) else {
                let problem = Problem::UnknownName { kind: "pair", name: name.clone(), known: list(known()) };
                return Err(document.fault(
                    &key,
                    problem,
                    did_you_mean(name, known(), "name a pair of the cell"),
                ));
            };
            if let Some(other) = places[pair].replace(index) {
                return Err(document.fault(
                    &key,
                    twice("pair", name, cell, other, index),
                    "a pair runs on one host",
                ));
            }
        }
    }
    if let Some(pair) = places.iter().position(Option::is_none) {
        let problem = Problem::Missing(format!("the host of pair \"{}\"", cell.rig.pairs[pair].name));
        return Err(document.fault("host", problem, "add it to the `pairs` of a [[host]]"));
    }
    Ok(())
}

/// Cameras and projectors are connected to one host.
fn check_devices(document: &Document, cell: &Configuration) -> Result<(), FileError> {
    let of_camera = |name: &str| {
        let hosts = cell.hosts.iter().enumerate();
        hosts.filter(|(_, host)| has_view(cell, host, name)).map(|(index, _)| index).collect::<Vec<_>>()
    };
    let remedy = "frames stay on the host that takes them: put pairs that share a device on one host";
    for camera in &cell.cameras {
        if let [first, second, ..] = of_camera(&camera.name)[..] {
            let problem = twice("camera", &camera.name, cell, first, second);
            return Err(document.fault(&format!("host[{second}].pairs"), problem, remedy));
        }
    }
    for projector in &cell.projectors {
        let mut hosts: Vec<usize> = projector.cameras.iter().flat_map(|name| of_camera(name)).collect();
        hosts.sort_unstable();
        hosts.dedup();
        if let [first, second, ..] = hosts[..] {
            let problem = twice("projector", &projector.name, cell, first, second);
            return Err(document.fault(&format!("host[{second}].pairs"), problem, remedy));
        }
    }
    Ok(())
}

fn has_view(cell: &Configuration, host: &HostConfig, name: &str) -> bool {
    let pairs = cell.rig.pairs.iter().filter(|pair| host.pairs.contains(&pair.name));
    pairs.into_iter().any(|pair| pair.left == name || pair.right == name)
}

fn twice(kind: &str, name: &str, cell: &Configuration, first: usize, second: usize) -> Problem {
    Problem::Disagreement {
        what: "the host of a device or pair",
        here: format!("{kind} \"{name}\" belongs to host \"{}\"", cell.hosts[second].name),
        there: format!("it belongs to host \"{}\", too", cell.hosts[first].name),
    }
}
