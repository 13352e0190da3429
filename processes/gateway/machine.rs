//! The state machines of the specification: which transitions there are, what causes them, and the way from one state of the
//! cell to the next.

use super::nodeset::Builder;
use crate::control::State;
use opcua::types::{NodeId, ObjectTypeId, ReferenceTypeId};
use std::collections::VecDeque;

/// Numbers of the state machine types in the nodeset: of the vision system, and of its automatic mode.
const MACHINES: [u32; 2] = [1017, 1021];

/// Numbers of the states in the nodeset.
pub mod state {
    /// Not usable yet: the stages start.
    pub const PREOPERATIONAL: u32 = 5028;
    /// Stopped on purpose, until reset.
    pub const HALTED: u32 = 5029;
    /// Not usable until the cause is removed.
    pub const ERROR: u32 = 5030;
    /// In automatic mode, whose states follow.
    pub const OPERATIONAL: u32 = 5031;
    /// No recipe is prepared.
    pub const INITIALIZED: u32 = 5056;
    /// Waits for a job.
    pub const READY: u32 = 5057;
    /// Works on one part.
    pub const SINGLE_EXECUTION: u32 = 5058;
    /// Works on part after part.
    pub const CONTINUOUS_EXECUTION: u32 = 5059;
}

/// A transition of the nodeset.
#[derive(Debug, Clone, PartialEq)]
pub struct Transition {
    /// The node of the transition.
    pub id: NodeId,
    /// Browse name of the node.
    pub name: String,
    /// Number of the state that is left.
    pub from: u32,
    /// Number of the state that is entered.
    pub to: u32,
    /// Methods that cause it; none: it happens by itself.
    pub causes: Vec<String>,
    /// Numbers of the event types that it causes.
    pub effects: Vec<u32>,
}

/// State of the vision system and, while it is operational, of the automatic mode.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Position {
    /// Number of the state of the vision system.
    pub system: u32,
    /// Number of the state of the automatic mode.
    pub automatic: Option<u32>,
}

impl Position {
    /// Of a state of the cell.
    pub fn of(state: State) -> Self {
        let (system, automatic) = match state {
            State::Preoperational => (state::PREOPERATIONAL, None),
            State::Halted => (state::HALTED, None),
            State::Error => (state::ERROR, None),
            State::Initialized => (state::OPERATIONAL, Some(state::INITIALIZED)),
            State::Ready => (state::OPERATIONAL, Some(state::READY)),
            State::SingleExecution => (state::OPERATIONAL, Some(state::SINGLE_EXECUTION)),
            State::ContinuousExecution => (state::OPERATIONAL, Some(state::CONTINUOUS_EXECUTION)),
        };
        Self { system, automatic }
    }
}

/// The transitions of both machines.
#[derive(Debug, Clone, Default)]
pub struct Transitions(Vec<Transition>);

impl Transitions {
    /// Those of the nodeset.
    pub fn read(builder: &Builder) -> Self {
        let number = |id: &NodeId| id.as_u32().unwrap_or(0);
        let mut all = Vec::new();
        for machine in MACHINES {
            for id in builder.targets(&builder.node(machine), ReferenceTypeId::HasComponent) {
                let type_ids = builder.targets(&id, ReferenceTypeId::HasTypeDefinition);
                if !type_ids.contains(&ObjectTypeId::TransitionType.into()) {
                    continue;
                }
                let ends = |kind| builder.targets(&id, kind).first().map_or(0, number);
                let causes = builder.targets(&id, ReferenceTypeId::HasCause);
                let effects = builder.targets(&id, ReferenceTypeId::HasEffect);
                all.push(Transition {
                    name: builder.name(&id),
                    from: ends(ReferenceTypeId::FromState),
                    to: ends(ReferenceTypeId::ToState),
                    causes: causes.iter().map(|cause| builder.name(cause)).collect(),
                    effects: effects.iter().map(number).collect(),
                    id,
                });
            }
        }
        Self(all)
    }

    /// Whether a method causes a transition out of a position.
    pub fn permit(&self, position: Position, method: &str) -> bool {
        let leaves = |t: &&Transition| t.from == position.system || Some(t.from) == position.automatic;
        self.0.iter().filter(leaves).any(|t| t.causes.iter().any(|cause| cause == method))
    }

    /// The transitions from one position to another, first the one that a method caused.
    pub fn way(&self, from: Position, to: Position, cause: Option<&str>) -> Vec<&Transition> {
        let caused = |at: u32| {
            let explains = |t: &&Transition| cause.is_some_and(|cause| t.causes.iter().any(|c| c == cause));
            self.0.iter().filter(|t| t.from == at).find(explains)
        };
        let mut way = Vec::new();
        let mut begin = from.automatic;
        let first = caused(from.system);
        if first.is_some() || from.system != to.system {
            way.extend(first);
            way.extend(self.shortest(first.map_or(from.system, |first| first.to), to.system));
            // Automatic mode begins with nothing prepared.
            begin = Some(state::INITIALIZED);
        }
        if let (Some(begin), Some(end)) = (begin, to.automatic) {
            let first = caused(begin).filter(|_| begin != end);
            way.extend(first);
            way.extend(self.shortest(first.map_or(begin, |first| first.to), end));
        }
        way
    }

    /// Breadth first, over transitions that happen by themselves.
    fn shortest(&self, from: u32, to: u32) -> Vec<&Transition> {
        let mut ways = VecDeque::from([(from, Vec::new())]);
        let mut seen = vec![from];
        while let Some((at, way)) = ways.pop_front() {
            if at == to {
                return way;
            }
            let mut next: Vec<&Transition> =
                self.0.iter().filter(|t| t.from == at && t.causes.is_empty()).collect();
            next.sort_by_key(|t| t.to);
            for transition in next {
                if !seen.contains(&transition.to) {
                    seen.push(transition.to);
                    let mut way = way.clone();
                    way.push(transition);
                    ways.push_back((transition.to, way));
                }
            }
        }
        Vec::new()
    }
}
