//! `status`, `restart`, `stop`: talking to a running cell.

use crate::supervisor::protocol::{Answer, Request, Spans, Status};
use crate::supervisor::socket::ask;
use anyhow::{Context, Result, bail};
use ipc::cell::{CellName, running_cells, running_pid};
use std::time::{Duration, Instant};

/// How long `stop` waits for the cell to be gone.
const STOP_PATIENCE: Duration = Duration::from_secs(30);

/// The cell that is meant: the named one, or the only one that runs.
fn find(name: Option<&str>) -> Result<CellName> {
    if let Some(name) = name {
        let name = CellName::new(name)?;
        if running_pid(&name).is_none() {
            bail!("no cell '{}' is running{}", name.as_str(), others());
        }
        return Ok(name);
    }
    match running_cells().as_slice() {
        [one] => Ok(one.clone()),
        [] => bail!("no cell is running"),
        _ => bail!("several cells are running; name one with --cell{}", others()),
    }
}

fn others() -> String {
    let cells: Vec<String> = running_cells().iter().map(|c| c.as_str().to_owned()).collect();
    if cells.is_empty() { String::new() } else { format!("; running: {}", cells.join(", ")) }
}

/// The cell of a name or of a configuration file; `None`: the only one that runs.
///
/// # Errors
/// A file that is no configuration.
pub fn named(which: Option<&str>) -> Result<Option<String>> {
    let Some(which) = which else { return Ok(None) };
    // A name has neither a dot nor a slash, a configuration file at least one of them.
    if !which.contains(['.', '/']) {
        return Ok(Some(which.to_owned()));
    }
    Ok(Some(files::config::Config::load(std::path::Path::new(which))?.name))
}

/// Asks a cell whatever it may answer.
///
/// # Errors
/// No such cell, or none that answers.
pub fn ask_cell(cell: Option<&str>, request: &Request) -> Result<Answer> {
    let name = find(cell)?;
    ask(&name.socket(), request)
        .with_context(|| format!("asking cell '{}' over {}", name.as_str(), name.socket().display()))
}

fn request(cell: Option<&str>, request: &Request) -> Result<(CellName, Answer)> {
    let name = find(cell)?;
    match ask_cell(Some(name.as_str()), request)? {
        Answer::Refused(reason) => bail!("cell '{}': {reason}", name.as_str()),
        answer => Ok((name, answer)),
    }
}

/// How a cell is.
///
/// # Errors
/// No such cell, or none that answers.
pub fn status(cell: Option<&str>) -> Result<Status> {
    match request(cell, &Request::Status {})?.1 {
        Answer::Status(status) => Ok(*status),
        _ => bail!("the cell gave no status"),
    }
}

/// What was done when in the last cycles.
///
/// # Errors
/// No such cell, or none that answers.
pub fn spans(cell: Option<&str>) -> Result<Spans> {
    match request(cell, &Request::Spans {})?.1 {
        Answer::Spans(spans) => Ok(spans),
        _ => bail!("the cell gave no spans"),
    }
}

/// Restarts a stage.
///
/// # Errors
/// No such cell or stage.
pub fn restart(cell: Option<&str>, stage: &str) -> Result<String> {
    match request(cell, &Request::Restart { stage: stage.to_owned() })?.1 {
        Answer::Done(text) => Ok(text),
        _ => bail!("the cell did not confirm"),
    }
}

/// Stops a cell and waits until it is gone.
///
/// # Errors
/// No such cell, or one that does not stop.
pub fn stop(cell: Option<&str>) -> Result<String> {
    let (name, _) = request(cell, &Request::Stop {})?;
    let begin = Instant::now();
    while running_pid(&name).is_some() {
        if begin.elapsed() > STOP_PATIENCE {
            bail!("cell '{}' did not stop within {} s", name.as_str(), STOP_PATIENCE.as_secs());
        }
        std::thread::sleep(Duration::from_millis(20));
    }
    Ok(format!("cell '{}' stopped", name.as_str()))
}
