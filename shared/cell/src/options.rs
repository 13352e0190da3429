//! What a command adds to the configuration.

use crate::retention::Retention;

/// What a command adds to the configuration.
#[derive(Debug, Clone, Default)]
pub struct Options {
    /// Another name, to run one configuration several times at once.
    pub cell: Option<String>,
    /// Whether the supervisor watches frames, phases and the fused cloud.
    pub watch: bool,
    /// Whether a recording is written.
    pub record: bool,
    /// Which bytes a cycle record keeps.
    pub retention: Retention,
    /// The host that this computer is; absent: it runs the whole cell.
    pub host: Option<String>,
}
