//! Writes the results of cycles in a thread of its own: a disk that hangs stops neither control nor monitoring.

use crate::part_files::PartOutput;
use anyhow::{Context, Result, bail};
use crossbeam::channel::{Receiver, Sender, TrySendError, bounded, unbounded};
use files::result::CycleResult;
use std::time::{Duration, Instant};

/// Results that may wait for the disk; further ones are not written.
const QUEUE_LIMIT: usize = 64;

/// Results that may wait before no more clouds are written.
const CLOUD_LIMIT: usize = 4;

/// A result that the thread is done with.
#[derive(Debug)]
pub struct Written {
    /// Cycle, counted from 0.
    pub cycle: u64,
    /// Ok, or why the result is not on the disk.
    pub result: Result<()>,
}

/// The thread with its queue.
#[derive(Debug)]
pub struct ResultWriter {
    queue: Option<Sender<Box<(CycleResult, PartOutput)>>>,
    written: Receiver<Written>,
}

impl ResultWriter {
    /// Starts the thread; `write` writes one result.
    ///
    /// # Errors
    /// The system has no thread.
    pub fn start(
        mut write: impl FnMut(&CycleResult, &PartOutput) -> Result<()> + Send + 'static,
    ) -> Result<Self> {
        let (queue, results) = bounded::<Box<(CycleResult, PartOutput)>>(QUEUE_LIMIT);
        let (done, written) = unbounded();
        let work = move || {
            for item in results {
                let (result, output) = &*item;
                // The supervisor may have ended already.
                let _ = done.send(Written { cycle: result.cycle, result: write(result, output) });
            }
        };
        let thread = std::thread::Builder::new().name("results".into());
        thread.spawn(work).context("starting the thread that writes results")?;
        Ok(Self { queue: Some(queue), written })
    }

    /// Queues a result.
    ///
    /// # Errors
    /// The queue is full, since the disk does not answer, or the thread has ended.
    pub fn queue(&self, result: &CycleResult, output: PartOutput) -> Result<()> {
        match self.queue.as_ref().map(|queue| queue.try_send(Box::new((result.clone(), output)))) {
            Some(Ok(())) => Ok(()),
            Some(Err(TrySendError::Full(_))) => {
                bail!("--out: the disk does not answer, and {QUEUE_LIMIT} results wait for it already")
            }
            Some(Err(TrySendError::Disconnected(_))) | None => {
                bail!("--out: the thread that writes results has ended")
            }
        }
    }

    /// Whether one more cloud may wait: clouds are large.
    pub fn has_room(&self) -> bool {
        self.queue.as_ref().is_some_and(|queue| queue.len() < CLOUD_LIMIT)
    }

    /// The results that the thread finished since the last call.
    pub fn written(&self) -> impl Iterator<Item = Written> {
        self.written.try_iter()
    }

    /// Ends the queue and waits for the rest, up to a limit.
    pub fn finish(&mut self, timeout: Duration) -> Vec<Written> {
        self.queue = None;
        let deadline = Instant::now() + timeout;
        std::iter::from_fn(|| self.written.recv_deadline(deadline).ok()).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn result(cycle: u64) -> CycleResult {
        CycleResult { cycle, outcome: "ok".into(), ..CycleResult::default() }
    }

    /// Proves: a disk that hangs blocks no other part of the supervisor, its queue is bounded, and once it answers everything queued is written.
    #[test]
    fn a_hung_disk_blocks_nobody_and_loses_only_what_does_not_fit() {
        let (disk, hung) = bounded::<()>(0);
        let mut writer = ResultWriter::start(move |_, _| {
            let _ = hung.recv();
            Ok(())
        })
        .unwrap();
        // One is being written, the others wait.
        writer.queue(&result(0), PartOutput::ResultOnly).unwrap();
        while !writer.queue.as_ref().unwrap().is_empty() {
            std::thread::yield_now();
        }
        let queued = (1..200)
            .take_while(|&cycle| writer.queue(&result(cycle), PartOutput::ResultOnly).is_ok())
            .count();
        assert_eq!((queued, writer.written().count()), (QUEUE_LIMIT, 0));
        assert!(
            writer
                .queue(&result(200), PartOutput::ResultOnly)
                .unwrap_err()
                .to_string()
                .contains("64 results wait")
        );
        assert_eq!(writer.finish(Duration::from_millis(20)).len(), 0);
        drop(disk);
        let cycles: Vec<u64> = writer.finish(Duration::from_secs(60)).iter().map(|w| w.cycle).collect();
        assert_eq!(cycles, (0..=QUEUE_LIMIT as u64).collect::<Vec<_>>());
    }

    #[test]
    fn a_result_that_cannot_be_written_is_reported_with_its_cycle() {
        let mut writer = ResultWriter::start(|_, _| bail!("no space")).unwrap();
        writer.queue(&result(7), PartOutput::ResultOnly).unwrap();
        let written = writer.finish(Duration::from_secs(60));
        assert!(matches!(&written[..], [Written { cycle: 7, result: Err(_) }]), "{written:?}");
    }
}
