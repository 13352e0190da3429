//! The only file that speaks to iceoryx2.
//!
//! A topic is a publish–subscribe service of bytes behind a typed header. A bell is an event service that wakes one
//! process. iceoryx2's ports may not leave their thread, so a stage keeps all of them on its main thread.
#![allow(unsafe_code)]

use crate::cell::CellName;
use crate::error::IpcError;
use crate::header::Header;
use crate::payload;
use iceoryx2::node::Node as IoxNode;
use iceoryx2::port::listener::Listener;
use iceoryx2::port::notifier::Notifier;
use iceoryx2::port::publisher::Publisher as IoxPublisher;
use iceoryx2::port::subscriber::Subscriber as IoxSubscriber;
use iceoryx2::port::update_connections::UpdateConnections;
use iceoryx2::port::{BackpressureAction, SendError};
use iceoryx2::prelude::*;
use iceoryx2::sample::Sample;
use iceoryx2::sample_mut::SampleMut;
use std::marker::PhantomData;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

/// How often a sender that waits for room looks again. It sleeps in between: the receiver may need this very core.
const ROOM_POLL: Duration = Duration::from_micros(200);

/// Processes that may have a service open at once: all stages of a large cell, twice, while they are being restarted.
const MAX_NODES: usize = 128;

/// Loans of this process since its start.
static LOANS: AtomicU64 = AtomicU64::new(0);

/// Messages that this process has begun to send since its start. iceoryx2 0.10 allocates the state of each loan on the heap
/// (`ChunkMutSharedState::new`, 48 bytes, given back by sending) and offers no way around it: it is the one allocation
/// of a warm stage, so a build that counts allocations counts these beside them.
pub fn loans() -> u64 {
    LOANS.load(Ordering::Relaxed)
}

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
            .map_err(|e| service_error("creating topic", topic, e))?;
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
            .map_err(|e| service_error("creating bell", owner, e))?;
        Ok(Held(Box::new(service)))
    }

    /// The bell that wakes this process.
    ///
    /// # Errors
    /// [`IpcError::Service`].
    pub fn bell(&self, owner: &str) -> Result<Bell, IpcError> {
        let service = self.open_bell(owner)?;
        let listener =
            service.listener_builder().create().map_err(|e| service_error("listening to bell", owner, e))?;
        Ok(Bell { owner: owner.to_owned(), listener })
    }

    /// Rings the bell of another process.
    ///
    /// # Errors
    /// [`IpcError::Service`].
    pub fn ringer(&self, owner: &str) -> Result<Ringer, IpcError> {
        let service = self.open_bell(owner)?;
        let notifier = service.notifier_builder().create();
        Ok(Ringer { notifier: notifier.map_err(|e| service_error("ringing bell", owner, e))? })
    }

    fn open_bell(&self, owner: &str) -> Result<EventService, IpcError> {
        self.node
            .service_builder(&service_name(&bell_name(owner))?)
            .event()
            .open()
            .map_err(|e| service_error("opening bell", owner, e))
    }

    fn open_topic<H: Header>(&self, topic: &str) -> Result<TopicService<H>, IpcError> {
        self.node
            .service_builder(&service_name(topic)?)
            .publish_subscribe::<[u8]>()
            .user_header::<H>()
            .open()
            .map_err(|e| service_error("opening topic", topic, e))
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
            .map_err(|e| service_error("sending on", topic, e))?;
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
            service.subscriber_builder().create().map_err(|e| service_error("receiving", topic, e))?;
        Ok(Subscriber { topic: topic.to_owned(), subscriber })
    }

    /// Frees what dead processes held. To be called after each one was reaped, since iceoryx2 only then sees it dead.
    pub fn clean_up_dead(&self) {
        let _state = self.node.try_cleanup_dead_nodes();
    }
}

type EventService = iceoryx2::service::port_factory::event::PortFactory<ipc::Service>;
type TopicService<H> = iceoryx2::service::port_factory::publish_subscribe::PortFactory<ipc::Service, [u8], H>;

/// Wakes its owner.
#[derive(Debug)]
pub struct Bell {
    owner: String,
    listener: Listener<ipc::Service>,
}

impl Bell {
    /// Sleeps until somebody rings, or has rung since the last call, or the time is over. Says whether it rang.
    ///
    /// # Errors
    /// [`IpcError::Service`].
    pub fn wait(&self, timeout: Duration) -> Result<bool, IpcError> {
        use iceoryx2::port::listener::ListenerWaitError;
        // A socket takes a timeout of zero as "for ever".
        let rang = if timeout.is_zero() {
            self.listener.try_wait(|_| {})
        } else {
            self.listener.timed_wait(|_| {}, timeout)
        };
        match rang {
            Ok(count) => Ok(count > 0),
            Err(ListenerWaitError::InterruptSignal) => Ok(false),
            Err(e) => Err(service_error("waiting for bell", &self.owner, e)),
        }
    }
}

/// Rings somebody's bell.
#[derive(Debug)]
pub struct Ringer {
    notifier: Notifier<ipc::Service>,
}

impl Ringer {
    /// Wakes the owner, or keeps him from falling asleep.
    pub fn ring(&self) {
        // A bell without listener belongs to a dead process; the supervisor sees that for itself.
        let _ = self.notifier.notify();
    }
}

/// Sends messages of one kind.
#[derive(Debug)]
pub struct Publisher<H: Header> {
    topic: String,
    patience: Duration,
    buffer: usize,
    port: IoxPublisher<ipc::Service, [u8], H>,
    /// How many there must be.
    receivers: usize,
    /// Of those that are woken by sending.
    bells: Vec<Ringer>,
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
        let mut sample =
            self.port.loan_slice_uninit(bytes).map_err(|e| service_error("loaning from", &self.topic, e))?;
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

    fn message_error(&self, source: crate::error::MessageError) -> IpcError {
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
            Err(e) => Err(service_error("sending on", &self.topic, e)),
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
    topic: String,
    subscriber: IoxSubscriber<ipc::Service, [u8], H>,
}

impl<H: Header> Subscriber<H> {
    /// The next message, if one waits. Its header was checked against its payload.
    ///
    /// # Errors
    /// [`IpcError::Message`] for a header that lies, [`IpcError::Service`] when too many messages are held.
    pub fn receive(&self) -> Result<Option<Received<H>>, IpcError> {
        let Some(sample) =
            self.subscriber.receive().map_err(|e| service_error("receiving from", &self.topic, e))?
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
        self.subscriber.update_connections().map_err(|e| service_error("connecting to", &self.topic, e))
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

fn bell_name(owner: &str) -> String {
    format!("bell/{owner}")
}

fn service_name(name: &str) -> Result<ServiceName, IpcError> {
    ServiceName::new(name).map_err(|e| service_error("naming", name, e))
}

fn service_error(what: &'static str, name: &str, reason: impl std::fmt::Debug) -> IpcError {
    IpcError::Service { what, name: name.to_owned(), reason: format!("{reason:?}") }
}
