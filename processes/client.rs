//! Client of the command socket, for the commands to a running cell.

use crate::supervisor::command_socket::ask;
use crate::supervisor::protocol::{Answer, Request, Spans, Status};
use anyhow::{Context, Result, bail};
use ipc::cell::{CellName, running_cells, running_pid};
use std::os::unix::net::UnixStream;
use std::time::{Duration, Instant};

/// Longest wait of `stop` for the end of the cell.
const STOP_TIMEOUT: Duration = Duration::from_secs(30);

/// The named cell, or the only running one.
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
        _ => bail!("several cells are running; choose one by its name{}", others()),
    }
}

/// Refuses the name of a cell that runs.
///
/// # Errors
/// A cell of this name runs.
pub fn refuse_running(name: &str) -> Result<()> {
    let name = CellName::new(name)?;
    match running_pid(&name) {
        None => Ok(()),
        Some(pid) => {
            Err(ipc::error::IpcError::Running { cell: name.as_str().to_owned(), pid: pid.to_string() }.into())
        }
    }
}

fn others() -> String {
    let cells: Vec<String> = running_cells().iter().map(|c| c.as_str().to_owned()).collect();
    if cells.is_empty() { String::new() } else { format!("; running: {}", cells.join(", ")) }
}

/// The name of a cell, given by name or by configuration file; `None`: the only running one.
///
/// # Errors
/// The file is not a configuration.
pub fn cell_name(which: Option<&str>) -> Result<Option<String>> {
    let Some(which) = which else { return Ok(None) };
    // A name has neither a dot nor a slash, a configuration file at least one of them.
    if !which.contains(['.', '/']) {
        return Ok(Some(which.to_owned()));
    }
    Ok(Some(files::config::Config::load(std::path::Path::new(which))?.cell.name))
}

/// Checks that a cell runs and accepts connections.
///
/// # Errors
/// It does not, or not yet.
pub fn reach(cell: Option<&str>) -> Result<()> {
    let name = find(cell)?;
    UnixStream::connect(name.socket()).with_context(|| name.socket().display().to_string())?;
    Ok(())
}

/// Sends a request to a cell.
///
/// # Errors
/// The cell does not exist or does not answer.
pub fn ask_cell(cell: Option<&str>, request: &Request) -> Result<Answer> {
    let name = find(cell)?;
    ask(&name.socket(), request)
        .with_context(|| format!("requesting from cell '{}' over {}", name.as_str(), name.socket().display()))
}

/// Sends a request; returns the cell and its answer.
///
/// # Errors
/// The cell does not exist, does not answer, or refuses.
pub fn request(cell: Option<&str>, request: &Request) -> Result<(CellName, Answer)> {
    let name = find(cell)?;
    match ask_cell(Some(name.as_str()), request)? {
        Answer::Refused(reason) => bail!("cell '{}': {reason}", name.as_str()),
        answer => Ok((name, answer)),
    }
}

/// The status of a cell.
///
/// # Errors
/// The cell does not exist or does not answer.
pub fn status(cell: Option<&str>) -> Result<Status> {
    match request(cell, &Request::Status {})?.1 {
        Answer::Status(status) => Ok(*status),
        _ => bail!("the cell sent an unexpected answer"),
    }
}

/// The times of the last cycles.
///
/// # Errors
/// The cell does not exist or does not answer.
pub fn spans(cell: Option<&str>) -> Result<Spans> {
    match request(cell, &Request::Spans {})?.1 {
        Answer::Spans(spans) => Ok(spans),
        _ => bail!("the cell sent an unexpected answer"),
    }
}

/// Stops a cell and waits for its end.
///
/// # Errors
/// The cell does not exist or does not stop.
pub fn stop(cell: Option<&str>) -> Result<(CellName, String)> {
    let (name, _) = request(cell, &Request::Stop {})?;
    let begin = Instant::now();
    while running_pid(&name).is_some() {
        if begin.elapsed() > STOP_TIMEOUT {
            bail!("cell '{}' did not stop within {} s", name.as_str(), STOP_TIMEOUT.as_secs());
        }
        std::thread::sleep(Duration::from_millis(20));
    }
    let text = format!("cell '{}' stopped", name.as_str());
    Ok((name, text))
}
