//! The hosts of a cell as its configuration names them.

use crate::configuration::Configuration;
use crate::error::ScheduleError;

/// A host of the graph.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct HostNode {
    /// Name of the host.
    pub name: String,
    /// Indices of its pairs.
    pub pairs: Vec<usize>,
    /// Whether it leads: it starts the cycles, fuses and inspects.
    pub leads: bool,
}

/// The hosts of a configuration, and the index of the one that this computer is.
pub(crate) fn hosts(
    config: &Configuration,
    wanted: Option<&str>,
) -> Result<(Vec<HostNode>, Option<usize>), ScheduleError> {
    let number = |name: &String| config.rig.pairs.iter().position(|pair| pair.name == *name);
    let nodes: Vec<HostNode> = config
        .hosts
        .iter()
        .map(|host| HostNode {
            name: host.name.clone(),
            pairs: host.pairs.iter().filter_map(number).collect(),
            leads: host.listen.is_some(),
        })
        .collect();
    let Some(wanted) = wanted else { return Ok((nodes, None)) };
    let here = nodes.iter().position(|host| host.name == wanted);
    let known = || nodes.iter().map(|host| host.name.as_str()).collect::<Vec<_>>().join(", ");
    let here = here.ok_or_else(|| ScheduleError::NoHost { host: wanted.to_owned(), known: known() })?;
    Ok((nodes, Some(here)))
}
