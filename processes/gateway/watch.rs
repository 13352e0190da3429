//! Follows the cell: every change is applied, shown in the nodes, and delivered as events.

use super::link::Link;
use super::mark::{Mark, MarkFile};
use super::server::Manager;
use super::shown::Shown;
use super::vision::Vision;
use crate::supervisor::protocol::{Answer, Watched};
use anyhow::{Result, bail};
use ipc::cell::CellName;
use ipc::os;
use opcua::server::ServerHandle;
use std::collections::VecDeque;
use std::path::PathBuf;
use std::time::{Duration, Instant};

/// Pause between two attempts to reach the cell.
const RETRY_PAUSE: Duration = Duration::from_millis(250);

/// How often events are handed to clients.
const DELIVERY_INTERVAL: Duration = Duration::from_millis(50);

/// Events that were handed out count as delivered after this time: a gateway that is killed before gives them once more.
const SETTLING: Duration = Duration::from_secs(3);

/// Follows the cell until a termination signal.
pub async fn watch(name: &CellName, handle: &ServerHandle, manager: &Manager) {
    tokio::select! {
        () = follow(name, handle, manager) => {}
        () = deliver(name, handle, manager) => {}
    }
}

async fn follow(name: &CellName, handle: &ServerHandle, manager: &Manager) {
    let mut shown = Shown::default();
    let mut marks = MarkFile::new(name);
    loop {
        let error = follow_once(&name.socket(), &mut marks, &mut shown, handle, manager).await;
        tracing::debug!("{error:?}");
        manager.inner().methods.vision.lock().connected = false;
        shown.update(handle, manager);
        tokio::time::sleep(RETRY_PAUSE).await;
    }
}

/// Follows one connection until it breaks.
async fn follow_once(
    socket: &PathBuf,
    marks: &mut MarkFile,
    shown: &mut Shown,
    handle: &ServerHandle,
    manager: &Manager,
) -> Result<()> {
    let mut link = Link::open(socket).await?;
    loop {
        let request = manager.inner().methods.vision.lock().news(true);
        match link.ask(&request).await? {
            Answer::Watched(watched) => {
                apply(&mut manager.inner().methods.vision.lock(), marks, *watched);
                shown.update(handle, manager);
                let mut vision = manager.inner().methods.vision.lock();
                vision.shown = vision.known;
            }
            other => bail!("{other:?}"),
        }
    }
}

fn apply(vision: &mut Vision, marks: &mut MarkFile, watched: Watched) {
    vision.connected = true;
    if vision.run != watched.run {
        let left = marks.read(&watched.run).unwrap_or(Mark { change: watched.newest, ..Mark::default() });
        vision.begin(&watched.run, left.change);
        vision.jobs = left.jobs;
    }
    if watched.oldest > vision.known + 1 && vision.known > 0 {
        tracing::warn!("changes {} to {} of the cell are lost", vision.known + 1, watched.oldest - 1);
    }
    for change in watched.changes {
        vision.apply(change);
    }
}

async fn deliver(name: &CellName, handle: &ServerHandle, manager: &Manager) {
    let mut marks = MarkFile::new(name);
    let mut settling: VecDeque<(Instant, u64)> = VecDeque::new();
    let (mut run, mut settled) = (String::new(), 0);
    while !os::is_terminated() {
        tokio::time::sleep(DELIVERY_INTERVAL).await;
        let tree = handle.type_tree().read();
        let mut vision = manager.inner().methods.vision.lock();
        vision.deliveries.deliver(handle.subscriptions(), &*tree);
        drop(tree);
        if run != vision.run {
            run.clone_from(&vision.run);
            settling.clear();
            settled = 0;
        }
        if let Some(taken) = vision.deliveries.taken_change()
            && settling.back().is_none_or(|(_, last)| *last < taken)
        {
            settling.push_back((Instant::now(), taken));
        }
        while settling.front().is_some_and(|(since, _)| since.elapsed() > SETTLING) {
            settled = settling.pop_front().map_or(settled, |(_, change)| change);
        }
        let change = vision.mark.max(settled);
        marks.write(Mark { run: vision.run.clone(), change, jobs: vision.jobs.clone() });
    }
}
