//! Messages: loaned, written in place, sent, received.
#![allow(unsafe_code)]

use super::bell::Ringer;
use crate::error::{IpcError, MessageError};
use crate::header::Header;
use crate::payload;
use iceoryx2::port::SendError;
use iceoryx2::port::publisher::Publisher as IoxPublisher;
use iceoryx2::port::subscriber::Subscriber as IoxSubscriber;
use iceoryx2::port::update_connections::UpdateConnections;
use iceoryx2::prelude::ipc;
use iceoryx2::sample::Sample;
use iceoryx2::sample_mut::SampleMut;
use std::marker::PhantomData;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

/// Loans of this process since its start.
static LOANS: AtomicU64 = AtomicU64::new(0);

/// Messages that this process has begun to send since its start. iceoryx2 0.10 allocates the state of each loan on the heap
/// (`ChunkMutSharedState::new`, 48 bytes, given back by sending) and offers no way around it: it is the one allocation
/// of a warm stage, so a build that counts allocations counts these beside them.
pub fn loans() -> u64 {
    LOANS.load(Ordering::Relaxed)
}

/// Sends messages of one kind.
#[derive(Debug)]
pub struct Publisher<H: Header> {
    pub(super) topic: String,
    pub(super) patience: Duration,
    pub(super) buffer: usize,
    pub(super) port: IoxPublisher<ipc::Service, [u8], H>,
    /// How many there must be.
    pub(super) receivers: usize,
    /// Of those that are woken by sending.
    pub(super) bells: Vec<Ringer>,
}

impl<H: Header> Publisher<H> {
    /// Rings nobody by itself: somebody rings the receivers once they may take what was sent. Waking them before that costs
    /// two changes of context and nothing comes of it.
    #[must_use]
    pub fn silent(mut self) -> Self {
        self.bells.clear();
        self
    }

    /// Memory for the payload that belongs to `header`, shared from the first byte.
    ///
    /// # Errors
    /// A header without possible payload, or no free slot of that size.
    pub fn loan(&self, header: H) -> Result<Loan<'_, H>, IpcError> {
        let bytes = header.payload_bytes().map_err(|source| self.message_error(source))?;
        LOANS.fetch_add(1, Ordering::Relaxed);
        let mut sample = self
            .port
            .loan_slice_uninit(bytes)
            .map_err(|e| IpcError::service("loaning from", &self.topic, e))?;
        *sample.user_header_mut() = header;
        // SAFETY: the payload lies in a mapping of tmpfs, whose bytes always have a value (zero, or those of an earlier
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
        let room = loan.payload_mut();
        let n = room.len().min(bytes.len());
        room[..n].copy_from_slice(&bytes[..n]);
        room[n..].fill(0);
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

/// A payload to be written in place. Dropping it gives the memory back unsent.
#[derive(Debug)]
pub struct Loan<'a, H: Header> {
    publisher: &'a Publisher<H>,
    sample: SampleMut<ipc::Service, [u8], H>,
}

impl<H: Header> Loan<'_, H> {
    /// The payload; aligned to 64 bytes. Holds bytes of an earlier message until written.
    pub fn payload_mut(&mut self) -> &mut [u8] {
        self.sample.payload_mut()
    }

    /// The payload as written so far.
    pub fn payload(&self) -> &[u8] {
        self.sample.payload()
    }

    /// The header, to be completed. Its sizes must keep matching the payload.
    pub fn header_mut(&mut self) -> &mut H {
        self.sample.user_header_mut()
    }

    /// Hands it to all receivers and rings their bells.
    ///
    /// # Errors
    /// [`IpcError::Full`] after the patience, [`IpcError::NotReached`] when a receiver of the topology is missing,
    /// [`IpcError::Message`] when the header no longer fits.
    pub fn send(self) -> Result<(), IpcError> {
        payload::check(self.sample.user_header(), self.sample.payload())
            .map_err(|source| self.publisher.message_error(source))?;
        self.send_unchecked()
    }

    /// Sends whatever the header says. For tests, which have to lie to find out whether receivers believe it.
    ///
    /// # Errors
    /// As [`Self::send`], but for the header.
    #[doc(hidden)]
    pub fn send_unchecked(self) -> Result<(), IpcError> {
        let result = self.sample.send();
        for bell in &self.publisher.bells {
            bell.ring();
        }
        self.publisher.check(result)
    }
}

/// Receives messages of one kind.
#[derive(Debug)]
pub struct Subscriber<H: Header> {
    pub(super) topic: String,
    pub(super) subscriber: IoxSubscriber<ipc::Service, [u8], H>,
}

impl<H: Header> Subscriber<H> {
    /// The next message, if one waits. Its header was checked against its payload.
    ///
    /// # Errors
    /// [`IpcError::Message`] for a header that lies, [`IpcError::Service`] when too many messages are held.
    pub fn receive(&self) -> Result<Option<Received<H>>, IpcError> {
        let Some(sample) =
            self.subscriber.receive().map_err(|e| IpcError::service("receiving from", &self.topic, e))?
        else {
            return Ok(None);
        };
        payload::check(sample.user_header(), sample.payload())
            .map_err(|source| IpcError::Message { topic: self.topic.clone(), source })?;
        Ok(Some(Received { sample, header: PhantomData }))
    }

    /// Connects to senders that have come since. Before that, a sender whose buffer is full cannot know that anybody
    /// will ever empty it and does not wait.
    ///
    /// # Errors
    /// [`IpcError::Service`].
    pub fn connect(&self) -> Result<(), IpcError> {
        self.subscriber.update_connections().map_err(|e| IpcError::service("connecting to", &self.topic, e))
    }

    /// The topic.
    pub fn topic(&self) -> &str {
        &self.topic
    }
}

/// A message that stays readable in shared memory while this lives.
#[derive(Debug)]
pub struct Received<H: Header> {
    sample: Sample<ipc::Service, [u8], H>,
    header: PhantomData<H>,
}

impl<H: Header> Received<H> {
    /// The header.
    pub fn header(&self) -> &H {
        self.sample.user_header()
    }

    /// The payload; aligned to 64 bytes.
    pub fn payload(&self) -> &[u8] {
        self.sample.payload()
    }
}
