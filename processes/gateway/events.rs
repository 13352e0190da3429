//! Events, and who gets which: every event item of every client has its own place in the list, so that a slow client, or one that
//! asks for a queue of one, loses nothing and keeps nobody waiting.

use opcua::nodes::{BaseEventType, Event, TypeTree};
use opcua::server::node_manager::{
    RequestContext, TypeTreeForUser, TypeTreeForUserStatic, TypeTreeReadContext,
};
use opcua::server::{MonitoredItem, Subscription, SubscriptionCache};
use opcua::sync::Mutex;
use opcua::types::event_field::EventField;
use opcua::types::{AttributeId, NodeId, NumericRange, ObjectId, QualifiedName, Variant};
use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Events that wait for clients. What is older can be asked for by the results' numbers.
const KEPT: usize = 8192;

/// How long after its start a gateway gives each new event item what was missed.
const GRACE: Duration = Duration::from_secs(60);

/// An event of the specification.
#[derive(Debug)]
pub struct VisionEvent {
    /// What every event has.
    pub base: BaseEventType,
    /// Index of the namespace of the specification.
    pub standard: u16,
    /// Fields by name; those of the base model have a path in it, such as `FromState/Id`.
    pub fields: BTreeMap<String, Variant>,
    /// Number of the change of the cell that it tells.
    pub change: u64,
}

impl EventField for VisionEvent {
    fn get_value(&self, attribute: AttributeId, range: &NumericRange, path: &[QualifiedName]) -> Variant {
        if attribute != AttributeId::Value {
            return Variant::Empty;
        }
        if path.is_empty() {
            return super::filters::number(&self.base.event_type).into();
        }
        let key = path.iter().map(|name| name.name.as_ref()).collect::<Vec<_>>().join("/");
        let known = path.iter().all(|name| [0, self.standard].contains(&name.namespace_index));
        match self.fields.get(&key) {
            Some(value) if known => value.get_value(attribute, range, &[]),
            _ => self.base.get_value(attribute, range, path),
        }
    }
}

impl Event for VisionEvent {
    fn get_field(
        &self,
        _type_definition: &NodeId,
        attribute: AttributeId,
        range: &NumericRange,
        path: &[QualifiedName],
    ) -> Variant {
        self.get_value(attribute, range, path)
    }

    fn time(&self) -> &opcua::types::DateTime {
        &self.base.time
    }

    fn event_type_id(&self) -> &NodeId {
        &self.base.event_type
    }
}

/// The numbers of the sessions with subscriptions: the library tells them here and nowhere else.
#[derive(Debug, Default)]
pub struct Sessions(Mutex<BTreeSet<u32>>);

impl TypeTreeForUser for Sessions {
    fn get_type_tree_for_user<'a>(
        &'a self,
        context: &'a RequestContext,
    ) -> Box<dyn TypeTreeReadContext + 'a> {
        Box::new(context.type_tree.read())
    }

    fn get_type_tree_static(&self, context: &RequestContext) -> Arc<dyn TypeTreeForUserStatic> {
        self.0.lock().insert(context.session_id);
        context.type_tree.clone()
    }
}

/// Where an event item is in the list.
#[derive(Debug, Clone, Copy)]
struct Place {
    /// Number of the next event.
    next: u64,
}

/// The events that were not yet taken by all.
pub struct Deliveries {
    sessions: Arc<Sessions>,
    /// Notifier of the events beside the server itself.
    source: NodeId,
    events: VecDeque<VisionEvent>,
    /// Number of the first of `events`.
    first: u64,
    /// Event after the last one that some client has taken.
    taken: u64,
    /// First event of the current run of the cell.
    run: u64,
    started: Instant,
    /// By subscription and item.
    places: BTreeMap<(u32, u32), Place>,
}

impl Deliveries {
    /// Without events yet; `source` notifies of all.
    pub fn new(sessions: Arc<Sessions>, source: NodeId) -> Self {
        Self {
            sessions,
            source,
            events: VecDeque::new(),
            first: 0,
            taken: 0,
            run: 0,
            started: Instant::now(),
            places: BTreeMap::new(),
        }
    }

    /// Events after this one belong to another run of the cell.
    pub fn begin_run(&mut self) {
        self.run = self.first + self.events.len() as u64;
    }

    /// Adds an event for everybody.
    pub fn push(&mut self, event: VisionEvent) {
        if self.events.len() == KEPT {
            self.events.pop_front();
            self.first += 1;
        }
        self.events.push_back(event);
    }

    /// Hands to each item as many events as it has room for.
    pub fn deliver(&mut self, subscriptions: &SubscriptionCache, tree: &dyn TypeTree) {
        let mut present = BTreeSet::new();
        let sessions: Vec<u32> = self.sessions.0.lock().iter().copied().collect();
        for session in sessions {
            let Some(of_session) = subscriptions.get_session_subscriptions(session) else {
                self.sessions.0.lock().remove(&session);
                continue;
            };
            let mut of_session = of_session.lock();
            for id in of_session.subscription_ids() {
                if let Some(subscription) = of_session.get_mut(id) {
                    self.serve(subscription, tree, &mut present);
                }
            }
        }
        self.places.retain(|key, _| present.contains(key));
    }

    fn serve(
        &mut self,
        subscription: &mut Subscription,
        tree: &dyn TypeTree,
        present: &mut BTreeSet<(u32, u32)>,
    ) {
        let listens = |item: &&MonitoredItem| {
            let target = item.item_to_monitor();
            target.attribute_id == AttributeId::EventNotifier
                && (target.node_id == self.source || target.node_id == ObjectId::Server)
        };
        let state = |item: &MonitoredItem| (item.id(), item.queue_size(), item.has_notifications());
        let items: Vec<(u32, usize, bool)> = subscription.items().filter(listens).map(state).collect();
        for (item, room, waits) in items {
            let key = (subscription.id(), item);
            present.insert(key);
            // Clients come back one after the other when the gateway was started again: each gets what was missed.
            let begin = if self.started.elapsed() < GRACE { self.first } else { self.taken };
            let place = self.places.entry(key).or_insert(Place { next: begin });
            if waits {
                continue;
            }
            self.taken = self.taken.max(place.next);
            let begin = place.next.max(self.first);
            let end = (self.first + self.events.len() as u64).min(begin + room as u64);
            for event in self.events.range((begin - self.first) as usize..(end - self.first) as usize) {
                subscription.notify_event(&item, event, tree);
            }
            place.next = end;
        }
    }

    /// Number of the newest change of this run of which a client has taken all events.
    pub fn taken_change(&self) -> Option<u64> {
        let number = |event: u64| {
            let index = event.checked_sub(self.first)?;
            self.events.get(index as usize).map(|event| event.change)
        };
        let last = number(self.taken.checked_sub(1).filter(|last| *last >= self.run)?)?;
        if number(self.taken) == Some(last) { last.checked_sub(1) } else { Some(last) }
    }
}
