//! The shared memory of a cell, for the command that shows its schedule.

use anyhow::Result;
use cell::{Cell, Options};
use serde::Serialize;
use std::fmt;
use std::path::Path;

/// The shared memory that a run needs at most; with `--out` the supervisor receives frames, phase maps and cloud as well.
#[derive(Debug, Clone, Copy, Serialize)]
pub struct Memory {
    /// Of a run without `--out`.
    run_bytes: u64,
    /// Of a run with `--out`.
    run_out_bytes: u64,
}

impl Memory {
    /// Plans the cell of a configuration with `--out`, too.
    ///
    /// # Errors
    /// A configuration that does not load.
    pub fn of(config: &Path, cell: &Cell) -> Result<Self> {
        let host = cell.graph.here.map(|here| cell.graph.host_name(here).to_owned());
        // A host that is led watches nothing.
        let with_out =
            devices::load(config, &Options { watch: cell.graph.leads(), host, ..Options::default() })?;
        let run_out_bytes = with_out.schedule.memory_bytes();
        Ok(Self { run_bytes: cell.schedule.memory_bytes(), run_out_bytes })
    }
}

impl fmt::Display for Memory {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mb = |bytes: u64| bytes.div_ceil(1_000_000);
        let (run, run_out) = (mb(self.run_bytes), mb(self.run_out_bytes));
        writeln!(f, "\nshared memory at most {run} MB, with `run --out` {run_out} MB")
    }
}
