//! The only room that speaks to iceoryx2.
//!
//! A topic is a publish–subscribe service of bytes behind a typed header. A bell is an event service that wakes one
//! process. iceoryx2's ports may not leave their thread, so a stage keeps all of them on its main thread.

mod bell;
mod message;

pub use bell::{Bell, Ringer};
pub use message::{Loan, Publisher, Received, Subscriber, loans};

use crate::cell::CellName;
use crate::error::IpcError;
use crate::header::Header;
use iceoryx2::node::Node as IoxNode;
use iceoryx2::port::BackpressureAction;
use iceoryx2::prelude::*;
use std::time::Duration;

/// How often a sender that waits for room looks again. It sleeps in between: the receiver may need this very core.
const ROOM_POLL: Duration = Duration::from_micros(200);

/// Processes that may have a service open at once: all stages of a large cell, twice, while they are being restarted.
const MAX_NODES: usize = 128;

/// How a topic is laid out.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct TopicSize {
    /// Processes that may send at once, dead ones that were not cleaned up yet included.
    pub publishers: usize,
    /// Processes that may receive at once, likewise.
    pub subscribers: usize,
    /// Messages that wait in front of one receiver.
    pub buffer: usize,
    /// Messages that one receiver may hold.
    pub borrowed: usize,
}

/// A process in the cell's shared memory.
#[derive(Debug)]
pub struct Node {
    node: IoxNode<ipc::Service>,
}

/// A service that stays while this lives.
pub struct Held(#[allow(dead_code)] Box<dyn std::any::Any>);

impl Node {
    /// Joins a cell under a name.
    ///
    /// # Errors
    /// [`IpcError::Service`].
    pub fn join(cell: &CellName, name: &str) -> Result<Self, IpcError> {
        // iceoryx2 speaks of what we handle and report ourselves; only what it cannot survive may reach the person.
        set_log_level(LogLevel::Fatal);
        let fail =
            |reason: String| IpcError::Service { what: "joining the cell as", name: name.to_owned(), reason };
        let mut config = Config::default();
        let root = cell.folder();
        let root = root.to_str().ok_or_else(|| fail("the folder is not UTF-8".into()))?;
        config.global.set_root_path(&Path::new(root.as_bytes()).map_err(|e| fail(format!("{e:?}")))?);
        config.global.prefix = FileName::new(cell.prefix().as_bytes()).map_err(|e| fail(format!("{e:?}")))?;
        let node = NodeBuilder::new()
            .name(&NodeName::new(name).map_err(|e| fail(format!("{e:?}")))?)
            .config(&config)
            // Otherwise iceoryx2 takes SIGTERM for itself and our own handler never runs.
            .signal_handling_mode(SignalHandlingMode::Disabled)
            .create::<ipc::Service>()
            .map_err(|e| fail(format!("{e:?}")))?;
        Ok(Self { node })
    }

    /// Creates a topic; the supervisor does it once, before any stage starts.
    ///
    /// # Errors
    /// [`IpcError::Service`].
    pub fn create_topic<H: Header>(&self, topic: &str, size: TopicSize) -> Result<Held, IpcError> {
        let service = self
            .node
            .service_builder(&service_name(topic)?)
            .publish_subscribe::<[u8]>()
            .user_header::<H>()
            .max_publishers(size.publishers)
            .max_subscribers(size.subscribers)
            .subscriber_max_buffer_size(size.buffer)
            .subscriber_max_borrowed_samples(size.borrowed)
            .history_size(0)
            .enable_safe_overflow(false)
            .max_nodes(MAX_NODES)
            .create()
            .map_err(|e| IpcError::service("creating topic", topic, e))?;
        Ok(Held(Box::new(service)))
    }

    /// Creates a bell.
    ///
    /// # Errors
    /// [`IpcError::Service`].
    pub fn create_bell(&self, owner: &str) -> Result<Held, IpcError> {
        let service = self
            .node
            .service_builder(&service_name(&bell_name(owner))?)
            .event()
            .max_listeners(2)
            .max_notifiers(MAX_NODES)
            .max_nodes(MAX_NODES)
            .create()
            .map_err(|e| IpcError::service("creating bell", owner, e))?;
        Ok(Held(Box::new(service)))
    }

    /// The bell that wakes this process.
    ///
    /// # Errors
    /// [`IpcError::Service`].
    pub fn bell(&self, owner: &str) -> Result<Bell, IpcError> {
        let service = self.open_bell(owner)?;
        let listener = service
            .listener_builder()
            .create()
            .map_err(|e| IpcError::service("listening to bell", owner, e))?;
        Ok(Bell { owner: owner.to_owned(), listener })
    }

    /// Rings the bell of another process.
    ///
    /// # Errors
    /// [`IpcError::Service`].
    pub fn ringer(&self, owner: &str) -> Result<Ringer, IpcError> {
        let service = self.open_bell(owner)?;
        let notifier = service.notifier_builder().create();
        Ok(Ringer { notifier: notifier.map_err(|e| IpcError::service("ringing bell", owner, e))? })
    }

    fn open_bell(&self, owner: &str) -> Result<EventService, IpcError> {
        self.node
            .service_builder(&service_name(&bell_name(owner))?)
            .event()
            .open()
            .map_err(|e| IpcError::service("opening bell", owner, e))
    }

    fn open_topic<H: Header>(&self, topic: &str) -> Result<TopicService<H>, IpcError> {
        self.node
            .service_builder(&service_name(topic)?)
            .publish_subscribe::<[u8]>()
            .user_header::<H>()
            .open()
            .map_err(|e| IpcError::service("opening topic", topic, e))
    }

    /// A sender of messages up to `max_bytes`, which rings the bells of `consumers` and waits `patience` for room.
    ///
    /// # Errors
    /// [`IpcError::Service`].
    pub fn publisher<H: Header>(
        &self,
        topic: &str,
        max_bytes: usize,
        consumers: &[String],
        patience: Duration,
    ) -> Result<Publisher<H>, IpcError> {
        let service = self.open_topic::<H>(topic)?;
        let buffer = service.static_config().subscriber_max_buffer_size();
        let publisher = service
            .publisher_builder()
            .initial_max_slice_len(max_bytes.max(1))
            .max_loaned_samples(1)
            .allocation_strategy(AllocationStrategy::Static)
            .set_backpressure_handler(move |info| {
                if info.elapsed_time < patience {
                    std::thread::sleep(ROOM_POLL);
                    BackpressureAction::Retry
                } else {
                    BackpressureAction::DiscardDataAndFail
                }
            })
            .create()
            .map_err(|e| IpcError::service("sending on", topic, e))?;
        let bells = consumers.iter().map(|owner| self.ringer(owner));
        Ok(Publisher {
            topic: topic.to_owned(),
            patience,
            buffer,
            port: publisher,
            receivers: consumers.len(),
            bells: bells.collect::<Result<_, IpcError>>()?,
        })
    }

    /// A receiver.
    ///
    /// # Errors
    /// [`IpcError::Service`].
    pub fn subscriber<H: Header>(&self, topic: &str) -> Result<Subscriber<H>, IpcError> {
        let service = self.open_topic::<H>(topic)?;
        let subscriber =
            service.subscriber_builder().create().map_err(|e| IpcError::service("receiving", topic, e))?;
        Ok(Subscriber { topic: topic.to_owned(), subscriber })
    }

    /// Frees what dead processes held. To be called after each one was reaped, since iceoryx2 only then sees it dead.
    pub fn clean_up_dead(&self) {
        let _state = self.node.try_cleanup_dead_nodes();
    }
}

type EventService = iceoryx2::service::port_factory::event::PortFactory<ipc::Service>;
type TopicService<H> = iceoryx2::service::port_factory::publish_subscribe::PortFactory<ipc::Service, [u8], H>;

fn bell_name(owner: &str) -> String {
    format!("bell/{owner}")
}

fn service_name(name: &str) -> Result<ServiceName, IpcError> {
    ServiceName::new(name).map_err(|e| IpcError::service("naming", name, e))
}
