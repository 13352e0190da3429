//! The server: its nodes, who may do what, and the limits of clients.

use super::events::{Deliveries, Sessions};
use super::machine::Transitions;
use super::methods::{Methods, Reply};
use super::names::Identity;
use super::nodeset::{Builder, Import, Name, Parent};
use super::types::NAMESPACE;
use super::vision::Vision;
use async_trait::async_trait;
use opcua::nodes::{EventNotifier, NodeType};
use opcua::server::address_space::AddressSpace;
use opcua::server::diagnostics::NamespaceMetadata;
use opcua::server::node_manager::memory::{InMemoryNodeManager, InMemoryNodeManagerImpl};
use opcua::server::node_manager::{MethodCall, RequestContext, ServerContext};
use opcua::sync::RwLock;
use opcua::types::{LocalizedText, NodeId, ObjectId, QualifiedName, ReferenceTypeId, StatusCode};
use std::path::PathBuf;
use std::sync::Arc;

/// Path of the vision system; all nodes of the cell begin with it.
pub const SYSTEM: &str = "VisionSystem";

/// Data types of the nodeset that are structures.
const STRUCTURES: std::ops::RangeInclusive<u32> = 3002..=3024;

/// Optional members of the types that a cell has.
const OPTIONAL: [&str; 12] = [
    "AutomaticModeStateMachine",
    "ConfigurationManagement",
    "Configurations",
    "RecipeManagement",
    "Recipes",
    "ReleaseConfigurationHandle",
    "ReleaseRecipeHandle",
    "ReleaseResultHandle",
    "ResultManagement",
    "Results",
    "SelectModeAutomatic",
    "SystemState",
];

/// The nodes of the specification and of the cell.
pub struct Nodes {
    namespaces: Vec<NamespaceMetadata>,
    /// Index of the namespace of the cell.
    pub own: u16,
    /// What the methods do.
    pub methods: Arc<Methods>,
}

/// The part of the server that has these nodes.
pub type Manager = InMemoryNodeManager<Nodes>;

/// What the nodes are made of.
pub struct Plan {
    /// The nodeset, read from the program.
    pub import: Import,
    /// What every result has; the namespaces are filled in.
    pub identity: Identity,
    /// Command socket of the cell.
    pub socket: PathBuf,
    /// Sessions that have subscriptions.
    pub sessions: Arc<Sessions>,
}

impl Plan {
    /// Namespace of the nodes of the cell.
    fn own_namespace(&self) -> String {
        format!("urn:fringecell:{}:nodes", self.identity.cell)
    }

    /// Makes the nodes of both namespaces.
    pub fn build(self, context: &ServerContext, space: &mut AddressSpace) -> Nodes {
        let own_namespace = self.own_namespace();
        let (standard, own) = {
            let mut tree = context.type_tree.write();
            space.import_node_set(&self.import, tree.namespaces_mut());
            let own = tree.namespaces_mut().add_namespace(&own_namespace);
            (tree.namespaces().get_index(NAMESPACE).unwrap_or_default(), own)
        };
        space.add_namespace(&own_namespace, own);
        let tree = context.type_tree.read();
        let mut builder = Builder::new(space, &tree, standard, own);
        builder.name_encodings(STRUCTURES);
        let system = builder.path(SYSTEM);
        let name = Name {
            browse: QualifiedName::new(own, self.identity.cell.as_str()),
            display: LocalizedText::new("", &self.identity.cell),
        };
        let parent = Parent { id: ObjectId::ObjectsFolder.into(), reference: ReferenceTypeId::Organizes };
        builder.instance(1003, SYSTEM, &name, &parent, &OPTIONAL);
        if let Some(NodeType::Object(object)) = builder.space.find_mut(&system) {
            object.set_event_notifier(EventNotifier::SUBSCRIBE_TO_EVENTS);
        }
        builder.space.insert_reference(&ObjectId::Server.into(), &system, ReferenceTypeId::HasNotifier);
        let transitions = Transitions::read(&builder);
        let identity = Identity { standard, system: system.clone(), ..self.identity };
        let vision = Vision::new(identity, transitions, Deliveries::new(self.sessions, system));
        let namespace = |uri: &str, index| NamespaceMetadata {
            namespace_uri: uri.to_owned(),
            namespace_index: index,
            ..NamespaceMetadata::default()
        };
        Nodes {
            namespaces: vec![namespace(NAMESPACE, standard), namespace(&own_namespace, own)],
            own,
            methods: Arc::new(Methods::new(vision, self.socket)),
        }
    }
}

impl Nodes {
    /// A node of the cell by its path below the vision system.
    pub fn id(&self, path: &str) -> NodeId {
        NodeId::new(self.own, format!("{SYSTEM}/{path}"))
    }
}

#[async_trait]
impl InMemoryNodeManagerImpl for Nodes {
    async fn init(&self, _space: &mut AddressSpace, _context: ServerContext) {}

    fn name(&self) -> &'static str {
        "vision"
    }

    fn namespaces(&self) -> Vec<NamespaceMetadata> {
        self.namespaces.clone()
    }

    #[allow(clippy::mut_mut, reason = "the trait has it so")]
    async fn call(
        &self,
        _context: &RequestContext,
        _space: &RwLock<AddressSpace>,
        calls: &mut [&mut &mut MethodCall],
    ) -> Result<(), StatusCode> {
        for call in calls {
            let path = call.method_id().identifier.to_string();
            let path = path.strip_prefix("s=").unwrap_or(&path).to_owned();
            match self.methods.call(&path, call.arguments()).await {
                Reply::Done(outputs) => {
                    call.set_outputs(outputs);
                    call.set_status(StatusCode::Good);
                }
                Reply::Bad(status) => call.set_status(status),
                Reply::Wrong(results) => call.set_argument_error(results),
            }
        }
        Ok(())
    }
}
