//! The thread that reads what the supervisor tells. Work on clouds happens here, so that no viewer waits for it.

use super::model::Model;
use super::view;
use crate::feed::{self, Message};
use crate::panic_drill::panic_if_requested;
use crate::supervisor::MONITOR;
use anyhow::{Context, Result};
use std::io::BufReader;
use std::os::unix::net::UnixStream;
use std::sync::Arc;
use tokio::sync::oneshot;

/// Capacity of the reader, bytes: clouds are large.
const BUFFER: usize = 256 * 1024;

/// Starts the thread; the receiver hears the end of the run.
///
/// # Errors
/// The system has no thread.
pub fn listen(model: &Arc<Model>, stream: UnixStream) -> Result<oneshot::Receiver<()>> {
    let (end, ended) = oneshot::channel();
    let model = Arc::clone(model);
    let work = move || {
        if let Err(error) = read(&model, stream) {
            tracing::warn!("{error:#}");
        }
        model.publish("bye", "{}".to_owned());
        let _ = end.send(());
    };
    std::thread::Builder::new().name("updates".into()).spawn(work).context("starting a thread")?;
    Ok(ended)
}

fn read(model: &Model, stream: UnixStream) -> Result<()> {
    let mut stream = BufReader::with_capacity(BUFFER, stream);
    while let Some(message) = feed::receive(&mut stream)? {
        panic_if_requested(MONITOR);
        match message {
            Message::State(state) => {
                model.publish("state", serde_json::to_string(&state)?);
                model.known().state = Some(state);
            }
            Message::Ended(ended) => {
                let ended = Arc::from(ended);
                model.add(Arc::clone(&ended));
                if model.viewers() > 0 {
                    model.publish("ended", view::ended(&model.cell, &ended).to_string());
                }
            }
            Message::Scan(header) => {
                model.show(feed::receive_scan(&mut stream, header.clone())?);
                model.publish("scan", view::scan(&model.cell, &header).to_string());
            }
        }
    }
    Ok(())
}
