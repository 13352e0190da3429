//! Messages of the current cycle: late ones are dropped, early ones wait.

use super::context::StageContext;
use super::cycle_filter::Admission;
use super::fault::Fault;
use anyhow::Result;
use cell::schedule::Carries;
use ipc::IpcError;
use ipc::error::MessageError;
use ipc::header::Header;
use ipc::port::{Received, Subscriber};

/// A receiver that returns only messages of the current cycle.
pub struct Inbox<H: Header> {
    subscriber: Subscriber<H>,
    early: Option<Received<H>>,
    /// Number of cycles that a valid sender may be ahead.
    ahead: u64,
}

impl<H: Header> Inbox<H> {
    /// An inbox for a topic of the schedule.
    pub fn subscribe(context: &StageContext, topic: &str) -> Result<Self> {
        let ahead = match context.plan(topic)?.carries {
            // The acquisition may be ahead of the evaluation.
            Carries::Phase => context.cell.schedule.in_flight as u64 - 1,
            _ => 0,
        };
        Ok(Self { subscriber: context.node.subscriber(topic)?, early: None, ahead })
    }

    /// The next message of the current cycle.
    pub fn take(&mut self, context: &mut StageContext) -> Result<Option<Received<H>>, IpcError> {
        loop {
            let next = match self.early.take() {
                Some(early) => Some(early),
                None => self.subscriber.receive()?,
            };
            let Some(message) = next else { return Ok(None) };
            match context.cycles.classify(message.header().cycle()) {
                Admission::Now => return Ok(Some(message)),
                Admission::Stale => {}
                Admission::Impossible => {
                    let value = message.header().cycle();
                    let allowed = "the current cycle and the sixteen after it";
                    let source = MessageError::Value { key: "cycle", value, allowed };
                    return Err(IpcError::Message { topic: self.subscriber.topic().to_owned(), source });
                }
                Admission::Early => {
                    self.early = Some(message);
                    return Ok(None);
                }
            }
        }
    }

    /// Fails if a message of a later cycle arrived before this cycle is complete.
    ///
    /// No stage sends one while this cycle is in progress: the message is invalid, or the cycle has ended and the command that
    /// ends it has not arrived yet.
    pub fn check_not_overtaken(&self, context: &StageContext) -> Result<(), Fault> {
        let allowed = context.cycle().saturating_add(self.ahead);
        match self.early.as_ref().filter(|early| early.header().cycle() > allowed) {
            Some(early) => Err(Fault::Cycle(format!(
                "a message of cycle {} arrived on {} before this cycle was complete",
                early.header().cycle(),
                self.subscriber.topic()
            ))),
            None => Ok(()),
        }
    }

    /// Connects to publishers that joined since the last call and lets go of those that ended. No cycle is in progress then, so
    /// what is queued is out of date; it would keep the memory of its sender.
    pub fn connect(&mut self) -> Result<(), IpcError> {
        self.early = None;
        loop {
            match self.subscriber.receive() {
                Ok(Some(_)) | Err(IpcError::Message { .. }) => {}
                Ok(None) => return self.subscriber.connect(),
                Err(error) => return Err(error),
            }
        }
    }
}
