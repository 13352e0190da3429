//! Delivers the results of cycles: to the disk, then to the clients that wait for them.

use super::protocol::Answer;
use super::result_writer::{ResultWriter, Written};
use crate::part_files::PartOutput;
use crossbeam::channel::Sender;
use files::result::CycleResult;
use ipc::os::now_ns;
use std::collections::VecDeque;
use std::time::Duration;

/// Longest wait for the disk before a client gets its answer without the files, and at the end of a run.
const DISK_TIMEOUT: Duration = Duration::from_secs(10);

/// A result that is on its way to the disk.
struct Pending {
    job: u64,
    result: CycleResult,
    reply: Option<Sender<Answer>>,
    deadline_ns: u64,
}

/// Results and the clients that wait for them.
#[derive(Default)]
pub(super) struct ResultDelivery {
    writer: Option<ResultWriter>,
    pending: VecDeque<Pending>,
    /// Results that are written, or lost, and not taken yet, with the numbers of their jobs.
    settled: Vec<(u64, CycleResult)>,
    /// Results that are not on the disk, and the first error.
    lost: u64,
    error: Option<anyhow::Error>,
}

impl ResultDelivery {
    /// Without a writer, results are not written and clients are answered at once.
    pub(super) fn new(writer: Option<ResultWriter>) -> Self {
        Self { writer, ..Self::default() }
    }

    /// Whether the cloud of one more part may wait for the disk.
    pub(super) fn has_room(&self) -> bool {
        self.writer.as_ref().is_some_and(ResultWriter::has_room)
    }

    /// Writes a result and then answers the client that waits for it.
    pub(super) fn deliver(
        &mut self,
        job: u64,
        result: &CycleResult,
        output: PartOutput,
        reply: Option<Sender<Answer>>,
    ) {
        let deadline_ns = now_ns().saturating_add(DISK_TIMEOUT.as_nanos() as u64);
        let pending = Pending { job, result: result.clone(), reply, deadline_ns };
        let Some(writer) = &self.writer else { return self.answer(pending) };
        match writer.queue(result, output) {
            Ok(()) => self.pending.push_back(pending),
            Err(error) => self.lose(pending, error),
        }
    }

    /// The results that were written or lost since the last call, with the numbers of their jobs.
    pub(super) fn take_settled(&mut self) -> Vec<(u64, CycleResult)> {
        std::mem::take(&mut self.settled)
    }

    /// Answers the clients whose results are written, or whose disk does not answer in time.
    pub(super) fn update(&mut self) {
        let written: Vec<Written> = self.writer.iter().flat_map(ResultWriter::written).collect();
        self.settle(written);
        let now = now_ns();
        // Only the waiting clients are informed; the result stays queued, because a disk may come back.
        for late in self.pending.iter_mut().filter(|pending| pending.deadline_ns <= now) {
            if late.reply.is_some() {
                tracing::error!(
                    "cycle {}: --out: the disk did not answer within {} s; the cell continues",
                    late.result.number,
                    DISK_TIMEOUT.as_secs()
                );
                answer(late.reply.take(), not_kept(late.result.clone()));
            }
        }
    }

    /// Waits for the disk at the end of a run; returns why results are missing.
    pub(super) fn finish(&mut self) -> Option<anyhow::Error> {
        if let Some(writer) = &mut self.writer {
            let written = writer.finish(DISK_TIMEOUT);
            self.settle(written);
        }
        while let Some(pending) = self.pending.pop_front() {
            let seconds = DISK_TIMEOUT.as_secs();
            self.lose(pending, anyhow::anyhow!("--out: the disk did not answer within {seconds} s"));
        }
        let what = if self.lost == 1 { "1 result is".into() } else { format!("{} results are", self.lost) };
        self.error.take().map(|error| error.context(format!("{what} not written")))
    }

    fn settle(&mut self, written: Vec<Written>) {
        for Written { cycle, result } in written {
            let place = self.pending.iter().position(|pending| pending.result.cycle == cycle);
            let Some(pending) = place.and_then(|place| self.pending.remove(place)) else { continue };
            match result {
                Ok(()) => self.answer(pending),
                Err(error) => self.lose(pending, error),
            }
        }
    }

    fn lose(&mut self, mut pending: Pending, error: anyhow::Error) {
        self.lost += 1;
        if self.error.is_none() {
            tracing::error!("cycle {}: {error:#}; the cell continues", pending.result.number);
            self.error = Some(error);
        }
        pending.result = not_kept(pending.result);
        self.answer(pending);
    }

    fn answer(&mut self, pending: Pending) {
        self.settled.push((pending.job, pending.result.clone()));
        answer(pending.reply, pending.result);
    }
}

/// A result whose file is not on the disk.
fn not_kept(mut result: CycleResult) -> CycleResult {
    result.kept = Some("no, disk".to_owned());
    result
}

fn answer(reply: Option<Sender<Answer>>, result: CycleResult) {
    if let Some(reply) = reply {
        // The client may have disconnected.
        let _ = reply.send(Answer::Inspected(Box::new(result)));
    }
}
