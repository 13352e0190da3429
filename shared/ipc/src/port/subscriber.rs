//! Receiving: a message is read where it lies, until it is dropped.

use crate::error::IpcError;
use crate::header::Header;
use crate::payload;
use iceoryx2::port::subscriber::Subscriber as IoxSubscriber;
use iceoryx2::port::update_connections::UpdateConnections;
use iceoryx2::prelude::ipc;
use iceoryx2::sample::Sample;
use std::marker::PhantomData;

/// Receives messages of one type from one topic.
#[derive(Debug)]
pub struct Subscriber<H: Header> {
    pub(super) topic: String,
    pub(super) subscriber: IoxSubscriber<ipc::Service, [u8], H>,
}

impl<H: Header> Subscriber<H> {
    /// The next queued message, if any. Its header is checked against its payload.
    ///
    /// # Errors
    /// [`IpcError::Message`] for an invalid header, [`IpcError::Service`] if too many messages are held.
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

    /// Connects to publishers that joined since the last call. A publisher that is not connected yet does not wait for this
    /// subscriber when the buffer is full.
    ///
    /// # Errors
    /// [`IpcError::Service`].
    pub fn connect(&self) -> Result<(), IpcError> {
        self.subscriber.update_connections().map_err(|e| IpcError::service("connecting to", &self.topic, e))
    }

    /// Name of the topic.
    pub fn topic(&self) -> &str {
        &self.topic
    }
}

/// A message in shared memory, readable until dropped.
#[derive(Debug)]
pub struct Received<H: Header> {
    sample: Sample<ipc::Service, [u8], H>,
    header: PhantomData<H>,
}

impl<H: Header> Received<H> {
    /// The header of the message.
    pub fn header(&self) -> &H {
        self.sample.user_header()
    }

    /// The payload, aligned to 64 bytes.
    pub fn payload(&self) -> &[u8] {
        self.sample.payload()
    }
}
