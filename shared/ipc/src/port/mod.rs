//! The only module that uses iceoryx2, beside the headers and the [link](crate::link) to other hosts.
//!
//! A topic is a publish–subscribe service of bytes behind a typed header. A notification is an event service that wakes one
//! process. The ports of iceoryx2 must stay on their thread, so a stage keeps all of them on its main thread.

mod notification;
mod publisher;
mod subscriber;

pub use notification::{Listener, Notifier};
pub use publisher::{Loan, Publisher, loans};
pub use subscriber::{Received, Subscriber};

use crate::cell::CellName;
use crate::error::IpcError;
use crate::header::Header;
use iceoryx2::node::Node as IoxNode;
use iceoryx2::port::BackpressureAction;
use iceoryx2::prelude::*;
use std::time::Duration;

/// Pause between two attempts of a sender whose receiver has a full buffer. It sleeps: the receiver may need the same core.
const BACKPRESSURE_PAUSE: Duration = Duration::from_micros(200);

/// Processes that may have a service open at once: all stages of the largest cell (256 pairs of 512 cameras), twice while
/// they are restarted. It costs some bytes for each in the management segment of a service.
const MAX_NODES: usize = 4096;

/// Capacity of a topic.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct TopicSize {
    /// Publishers at once, including dead ones that are not cleaned up yet.
    pub publishers: usize,
    /// Subscribers at once, including dead ones that are not cleaned up yet.
    pub subscribers: usize,
    /// Messages that one receiver may have queued.
    pub buffer: usize,
    /// Messages that one receiver may hold at once.
    pub borrowed: usize,
}

/// A participant in the shared memory of a cell.
#[derive(Debug)]
pub struct Node {
    node: IoxNode<ipc::Service>,
}

/// Keeps a service alive until dropped.
pub struct ServiceHandle(#[allow(dead_code)] Box<dyn std::any::Any>);

impl Node {
    /// Joins a cell under the name of a process.
    ///
    /// # Errors
    /// [`IpcError::Service`].
    pub fn join(cell: &CellName, name: &str) -> Result<Self, IpcError> {
        // Errors of iceoryx2 are handled and reported here; its own log shows only fatal ones.
        set_log_level(LogLevel::Fatal);
        let fail =
            |reason: String| IpcError::Service { what: "joining the cell as", name: name.to_owned(), reason };
        let mut config = Config::default();
        let root = cell.folder();
        let root = root.to_str().ok_or_else(|| fail("the folder is not UTF-8".into()))?;
        config.global.set_root_path(&Path::new(root.as_bytes()).map_err(|e| fail(format!("{e:?}")))?);
        config.global.prefix =
            FileName::new(cell.run_prefix()?.as_bytes()).map_err(|e| fail(format!("{e:?}")))?;
        let node = NodeBuilder::new()
            .name(&NodeName::new(name).map_err(|e| fail(format!("{e:?}")))?)
            .config(&config)
            // Otherwise iceoryx2 handles SIGTERM and our own handler never runs.
            .signal_handling_mode(SignalHandlingMode::Disabled)
            .create::<ipc::Service>()
            .map_err(|e| fail(format!("{e:?}")))?;
        Ok(Self { node })
    }

    /// Creates a topic. The supervisor does so once, before any stage starts.
    ///
    /// # Errors
    /// [`IpcError::Service`].
    pub fn create_topic<H: Header>(&self, topic: &str, size: TopicSize) -> Result<ServiceHandle, IpcError> {
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
        Ok(ServiceHandle(Box::new(service)))
    }

    /// Creates the notification service of a process. The supervisor does so once, before any stage starts.
    ///
    /// # Errors
    /// [`IpcError::Service`].
    pub fn create_notification(&self, owner: &str) -> Result<ServiceHandle, IpcError> {
        let service = self
            .node
            .service_builder(&service_name(&notification_name(owner))?)
            .event()
            .max_listeners(2)
            .max_notifiers(MAX_NODES)
            .max_nodes(MAX_NODES)
            .create()
            .map_err(|e| IpcError::service("creating the notification of", owner, e))?;
        Ok(ServiceHandle(Box::new(service)))
    }

    /// Listens to the notifications for `owner`, which is this process.
    ///
    /// # Errors
    /// [`IpcError::Service`].
    pub fn listener(&self, owner: &str) -> Result<Listener, IpcError> {
        let service = self.open_notification(owner)?;
        let listener = service
            .listener_builder()
            .create()
            .map_err(|e| IpcError::service("listening to the notifications of", owner, e))?;
        Ok(Listener { owner: owner.to_owned(), port: listener })
    }

    /// Notifies another process.
    ///
    /// # Errors
    /// [`IpcError::Service`].
    pub fn notifier(&self, owner: &str) -> Result<Notifier, IpcError> {
        let service = self.open_notification(owner)?;
        let notifier = service.notifier_builder().create();
        Ok(Notifier { port: notifier.map_err(|e| IpcError::service("notifying", owner, e))? })
    }

    fn open_notification(&self, owner: &str) -> Result<EventService, IpcError> {
        self.node
            .service_builder(&service_name(&notification_name(owner))?)
            .event()
            .open()
            .map_err(|e| IpcError::service("opening the notification of", owner, e))
    }

    fn open_topic<H: Header>(&self, topic: &str) -> Result<TopicService<H>, IpcError> {
        self.node
            .service_builder(&service_name(topic)?)
            .publish_subscribe::<[u8]>()
            .user_header::<H>()
            .open()
            .map_err(|e| IpcError::service("opening topic", topic, e))
    }

    /// A publisher of messages of at most `max_bytes`. It notifies `consumers` and waits up to `patience` while a buffer is full.
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
                    std::thread::sleep(BACKPRESSURE_PAUSE);
                    BackpressureAction::Retry
                } else {
                    BackpressureAction::DiscardDataAndFail
                }
            })
            .create()
            .map_err(|e| IpcError::service("sending on", topic, e))?;
        let notifiers = consumers.iter().map(|owner| self.notifier(owner));
        Ok(Publisher {
            topic: topic.to_owned(),
            patience,
            buffer,
            port: publisher,
            receivers: consumers.len(),
            notifiers: notifiers.collect::<Result<_, IpcError>>()?,
        })
    }

    /// A subscriber of a topic.
    ///
    /// # Errors
    /// [`IpcError::Service`].
    pub fn subscriber<H: Header>(&self, topic: &str) -> Result<Subscriber<H>, IpcError> {
        let service = self.open_topic::<H>(topic)?;
        let subscriber =
            service.subscriber_builder().create().map_err(|e| IpcError::service("receiving", topic, e))?;
        Ok(Subscriber { topic: topic.to_owned(), subscriber })
    }

    /// Releases the shared memory of dead processes. Call it after reaping one: only then iceoryx2 sees that it is dead.
    pub fn clean_up_dead(&self) {
        let _state = self.node.try_cleanup_dead_nodes();
    }
}

type EventService = iceoryx2::service::port_factory::event::PortFactory<ipc::Service>;
type TopicService<H> = iceoryx2::service::port_factory::publish_subscribe::PortFactory<ipc::Service, [u8], H>;

fn notification_name(owner: &str) -> String {
    format!("notification/{owner}")
}

fn service_name(name: &str) -> Result<ServiceName, IpcError> {
    ServiceName::new(name).map_err(|e| IpcError::service("naming", name, e))
}
