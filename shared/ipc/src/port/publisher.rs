//! Sending: a message is loaned from shared memory, written in place, and sent.
#![allow(unsafe_code)]

use super::notification::Notifier;
use crate::error::{IpcError, MessageError};
use crate::header::Header;
use crate::payload;
use iceoryx2::port::SendError;
use iceoryx2::port::publisher::Publisher as IoxPublisher;
use iceoryx2::prelude::ipc;
use iceoryx2::sample_mut::SampleMut;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

/// Number of loans of this process since its start.
static LOANS: AtomicU64 = AtomicU64::new(0);

/// Number of messages that this process loaned since its start. iceoryx2 0.10 allocates the state of each loan on the heap
/// (`ChunkMutSharedState::new`, 48 bytes, freed by sending) and offers no alternative. It is the only allocation of a warm
/// stage, so a build that counts allocations reports the loans beside them.
pub fn loans() -> u64 {
    LOANS.load(Ordering::Relaxed)
}

/// Publishes messages of one type on one topic.
#[derive(Debug)]
pub struct Publisher<H: Header> {
    pub(super) topic: String,
    pub(super) patience: Duration,
    pub(super) buffer: usize,
    pub(super) port: IoxPublisher<ipc::Service, [u8], H>,
    /// Number of receivers that each message must reach.
    pub(super) receivers: usize,
    /// Receivers to notify after each message.
    pub(super) notifiers: Vec<Notifier>,
}

impl<H: Header> Publisher<H> {
    /// Sends without notifying: the caller notifies the receivers once they may use the message. Waking them earlier costs
    /// two context switches for nothing.
    #[must_use]
    pub fn without_notification(mut self) -> Self {
        self.notifiers.clear();
        self
    }

    /// Borrows shared memory for the payload of `header`, to be written in place.
    ///
    /// # Errors
    /// A header with impossible sizes, or no free memory of that size.
    pub fn loan(&self, header: H) -> Result<Loan<'_, H>, IpcError> {
        let bytes = header.payload_bytes().map_err(|source| self.message_error(source))?;
        LOANS.fetch_add(1, Ordering::Relaxed);
        let mut sample = self
            .port
            .loan_slice_uninit(bytes)
            .map_err(|e| IpcError::service("loaning from", &self.topic, e))?;
        *sample.user_header_mut() = header;
        // SAFETY: the payload is in a tmpfs mapping, whose bytes are always initialised (zero, or those of an earlier
        // message), and every bit pattern is a valid u8.
        let sample = unsafe { sample.assume_init() };
        Ok(Loan { publisher: self, sample })
    }

    /// Sends a message whose payload is `bytes`.
    ///
    /// # Errors
    /// As [`Self::loan`] and [`Loan::send`].
    pub fn send(&self, header: H, bytes: &[u8]) -> Result<(), IpcError> {
        let mut loan = self.loan(header)?;
        let payload = loan.payload_mut();
        let n = payload.len().min(bytes.len());
        payload[..n].copy_from_slice(&bytes[..n]);
        payload[n..].fill(0);
        loan.send()
    }

    fn message_error(&self, source: MessageError) -> IpcError {
        IpcError::Message { topic: self.topic.clone(), source }
    }

    fn check(&self, result: Result<usize, SendError>) -> Result<(), IpcError> {
        match result {
            Ok(reached) if reached >= self.receivers => Ok(()),
            Ok(reached) => {
                Err(IpcError::NotReached { topic: self.topic.clone(), reached, expected: self.receivers })
            }
            Err(SendError::UnableToDeliver) => Err(IpcError::Full {
                topic: self.topic.clone(),
                buffer: self.buffer,
                waited_ms: self.patience.as_millis() as u64,
            }),
            Err(e) => Err(IpcError::service("sending on", &self.topic, e)),
        }
    }
}

/// A payload to be written in place. Dropping it returns the memory without sending.
#[derive(Debug)]
pub struct Loan<'a, H: Header> {
    publisher: &'a Publisher<H>,
    sample: SampleMut<ipc::Service, [u8], H>,
}

impl<H: Header> Loan<'_, H> {
    /// The payload, aligned to 64 bytes. It holds the bytes of an earlier message until written.
    pub fn payload_mut(&mut self) -> &mut [u8] {
        self.sample.payload_mut()
    }

    /// The payload in its current state.
    pub fn payload(&self) -> &[u8] {
        self.sample.payload()
    }

    /// The header, to be completed. Its sizes must still match the payload.
    pub fn header_mut(&mut self) -> &mut H {
        self.sample.user_header_mut()
    }

    /// Sends the message to all receivers and notifies them.
    ///
    /// # Errors
    /// [`IpcError::Full`] if a buffer stays full, [`IpcError::NotReached`] if a receiver is missing, [`IpcError::Message`] if
    /// the header no longer matches the payload.
    pub fn send(self) -> Result<(), IpcError> {
        payload::check(self.sample.user_header(), self.sample.payload())
            .map_err(|source| self.publisher.message_error(source))?;
        self.send_unchecked()
    }

    /// Sends without checking the header: lets tests send invalid messages.
    ///
    /// # Errors
    /// As [`Self::send`], except for the header.
    #[doc(hidden)]
    pub fn send_unchecked(self) -> Result<(), IpcError> {
        let result = self.sample.send();
        for notifier in &self.publisher.notifiers {
            notifier.notify();
        }
        self.publisher.check(result)
    }
}
