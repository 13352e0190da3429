//! What hosts tell each other, as JSON. Pure.

use serde::{Deserialize, Serialize};

/// Who a host is, and what it runs.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Identity {
    /// Version and commit of the program.
    pub software: String,
    /// Name of the host.
    pub host: String,
    /// The files of the configuration: name and shortened hash of each.
    pub files: Vec<[String; 2]>,
}

impl Identity {
    /// The first difference that keeps two hosts from working together, seen from `self`.
    pub fn difference(&self, other: &Self) -> Option<String> {
        if self.software != other.software {
            return Some(format!(
                "host \"{}\" runs version {}, host \"{}\" {}; install the same version on both",
                other.host, other.software, self.host, self.software
            ));
        }
        let remedy = "copy the same files to all hosts and start the cell again";
        if self.files.len() != other.files.len() {
            let (there, here) = (other.files.len(), self.files.len());
            let (one, two) = (&other.host, &self.host);
            return Some(format!(
                "the configuration of host \"{one}\" has {there} files, that of host \"{two}\" {here}; {remedy}"
            ));
        }
        let differs = self.files.iter().zip(&other.files).find(|([_, here], [_, there])| here != there);
        differs.map(|([name, here], [_, there])| {
            format!(
                "{name} is another file on host \"{}\" ({there}) than on host \"{}\" ({here}); {remedy}",
                other.host, self.host
            )
        })
    }
}

/// State of the host that leads, as one of the others hears it.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct LeaderState {
    /// The host that leads.
    pub identity: Identity,
    /// The cycle that is wanted, from 1.
    pub wanted: Option<u64>,
    /// The last cycle whose clouds all came, from 1; 0 before the first.
    pub received: u64,
    /// Chunks that are wanted next.
    pub fetch: Option<Fetch>,
    /// Why the receiver is not accepted as a host of the cell.
    pub refused: Option<String>,
}

/// Chunks that the host that leads asks for.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Fetch {
    /// Counts the requests: each is answered once.
    pub number: u64,
    /// Index of the pair.
    pub pair: u32,
    /// Numbers of the chunks.
    pub chunks: Vec<u32>,
}

/// State of a host that is led.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct HostState {
    /// Which host it is.
    pub identity: Identity,
    /// What it is doing.
    pub phase: Phase,
    /// The cycle that the phase is of, from 1; 0 before the first.
    pub cycle: u64,
    /// The clouds of that cycle, once all are matched.
    pub clouds: Vec<Offer>,
    /// Why it does not do what the receiver wants.
    pub problem: Option<String>,
}

/// What a host is doing.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Phase {
    /// Its stages are starting.
    #[default]
    Starting,
    /// It waits for a cycle.
    Ready,
    /// Its light is on, or will be.
    Begun,
    /// All frames are taken, its light is off.
    Acquired,
    /// All clouds are there.
    Matched,
    /// The cycle ended here without a cloud.
    Failed,
}

/// A cloud that a host has.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Offer {
    /// Index of the pair.
    pub pair: u32,
    /// Number of its points.
    pub points: u32,
    /// Length of the points, bytes.
    pub bytes: u64,
    /// Hash of the points (xxh3, 128 bits), hexadecimal.
    pub hash: String,
}

/// Offers and chunks that are out of the ordinary, for the report on a cloud.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize)]
pub struct Counts {
    /// Chunks of the cloud.
    pub chunks: u64,
    /// Chunks that were asked for again.
    pub repeated: u64,
    /// Chunks that came more than once.
    pub doubled: u64,
    /// Messages that are not of this cycle, session or cloud.
    pub strange: u64,
}

#[cfg(test)]
mod tests {
    use super::*;

    fn host(name: &str) -> Identity {
        let file = |name: &str, hash: &str| [name.to_owned(), hash.to_owned()];
        Identity {
            software: "0.1.0 abc".into(),
            host: name.into(),
            files: vec![file("cell.toml", "11"), file("rig.toml", "22")],
        }
    }

    #[test]
    fn a_difference_is_told_by_name_and_equal_hosts_have_none() {
        let (left, right) = (host("left"), host("right"));
        assert_eq!(left.difference(&right), None);
        let mut other = right.clone();
        other.files[1][1] = "33".into();
        let told = left.difference(&other).unwrap();
        for part in ["rig.toml", "\"right\" (33)", "\"left\" (22)"] {
            assert!(told.contains(part), "{told} lacks {part}");
        }
        other.files.pop();
        assert!(left.difference(&other).unwrap().contains("has 1 files"));
        let told = left.difference(&Identity { software: "0.2.0 abc".into(), ..right }).unwrap();
        assert!(told.contains("\"right\" runs version 0.2.0 abc"), "{told}");
    }
}
