//! The nodeset of the companion specification as it was published, and the instances that are made of its types.

use super::types::NAMESPACE;
use anyhow::{Context as _, Result};
use opcua::nodes::DefaultTypeTree;
use opcua::nodes::{
    Base, HasNodeId as _, ImportedItem, Method, NodeSet2Import, NodeSetImport, NodeSetNamespaceMapper,
    NodeType, Object, Variable,
};
use opcua::server::address_space::AddressSpace;
use opcua::types::{
    BrowseDirection, DataTypeDefinition, DataValue, NodeClass, NodeId, NumericRange, ObjectId,
    ReferenceTypeId, TimestampsToReturn,
};

/// As the OPC Foundation publishes it, with its licence.
const XML: &str = include_str!("nodeset/Opc.Ua.MachineVision.NodeSet2.xml");

/// The nodeset for the address space. The library's own import prints to standard output when it registers namespaces.
pub struct Import(NodeSet2Import);

impl Import {
    /// Reads the nodeset, which is part of the program.
    ///
    /// # Errors
    /// It is no nodeset, which a test rules out.
    pub fn new() -> Result<Self> {
        NodeSet2Import::new_str("", &without_breaks(XML), Vec::new())
            .map(Self)
            .context("the nodeset of the companion specification")
    }
}

/// The nodeset with its byte strings on single lines, as the library wants them.
fn without_breaks(xml: &str) -> String {
    const BEGIN: &str = "<uax:ByteString ";
    let mut text = String::with_capacity(xml.len());
    for (number, piece) in xml.split(BEGIN).enumerate() {
        let (bytes, rest) = match piece.split_once('<') {
            Some((bytes, rest)) if number > 0 => (bytes, rest),
            _ => ("", piece),
        };
        if number > 0 {
            let (attributes, value) = bytes.split_once('>').unwrap_or((bytes, ""));
            text.extend([BEGIN, attributes, ">"]);
            text.extend(value.chars().filter(|c| !c.is_whitespace()));
            text.push('<');
        }
        text.push_str(rest);
    }
    text
}

impl NodeSetImport for Import {
    fn register_namespaces(&self, namespaces: &mut NodeSetNamespaceMapper) {
        namespaces.add_namespace(NAMESPACE, 1);
    }

    fn get_own_namespaces(&self) -> Vec<String> {
        vec![NAMESPACE.to_owned()]
    }

    fn load<'a>(
        &'a self,
        namespaces: &'a NodeSetNamespaceMapper,
    ) -> Box<dyn Iterator<Item = ImportedItem> + 'a> {
        self.0.load(namespaces)
    }
}

/// An address space while it is built.
pub struct Builder<'a> {
    /// The nodes so far.
    pub space: &'a mut AddressSpace,
    tree: &'a DefaultTypeTree,
    /// Index of the namespace of the companion specification.
    pub standard: u16,
    /// Index of the namespace of the cell.
    pub own: u16,
}

impl<'a> Builder<'a> {
    /// For a space that has the nodeset.
    pub fn new(space: &'a mut AddressSpace, tree: &'a DefaultTypeTree, standard: u16, own: u16) -> Self {
        Self { space, tree, standard, own }
    }

    /// A node of the specification by its number.
    pub fn node(&self, number: u32) -> NodeId {
        NodeId::new(self.standard, number)
    }

    /// A node of the cell by its path.
    pub fn path(&self, path: &str) -> NodeId {
        NodeId::new(self.own, path)
    }

    /// What a node refers to.
    pub fn targets(&self, of: &NodeId, kind: ReferenceTypeId) -> Vec<NodeId> {
        let kind = NodeId::from(kind);
        let all = self.space.find_references(of, None::<(NodeId, bool)>, self.tree, BrowseDirection::Forward);
        let mut found: Vec<NodeId> =
            all.filter(|r| *r.reference_type == kind).map(|r| r.target_node.clone()).collect();
        // The library keeps references in a hash set.
        found.sort_by_key(ToString::to_string);
        found
    }

    /// Browse name of a node, without its namespace; empty for one that is not here.
    pub fn name(&self, id: &NodeId) -> String {
        self.space.find(id).map(|node| node.as_node().browse_name().name.to_string()).unwrap_or_default()
    }

    /// Names the binary encoding of each structure in its definition: the library finds it in namespace 1 only.
    pub fn name_encodings(&mut self, data_types: impl Iterator<Item = u32>) {
        for number in data_types {
            let id = self.node(number);
            let encodings = self.targets(&id, ReferenceTypeId::HasEncoding);
            let binary = encodings.into_iter().find(|encoding| self.name(encoding) == "Default Binary");
            let (Some(binary), Some(NodeType::DataType(node))) = (binary, self.space.find_mut(&id)) else {
                continue;
            };
            if let Some(DataTypeDefinition::Structure(definition)) = node.data_type_definition() {
                let mut definition = definition.clone();
                definition.default_encoding_id = binary;
                node.set_data_type_definition(Some(DataTypeDefinition::Structure(definition)));
            }
        }
    }

    /// Makes an instance of a type at a path, with what is mandatory in it and what is named.
    pub fn instance(
        &mut self,
        type_number: u32,
        path: &str,
        name: &Name,
        parent: &Parent,
        optional: &[&str],
    ) {
        let type_id = self.node(type_number);
        let id = self.path(path);
        let base = |class| {
            Base::new_full(id.clone(), class, name.browse.clone(), name.display.clone(), None, None, None)
        };
        let node: NodeType = match self.space.find(&type_id) {
            Some(NodeType::VariableType(of)) => {
                let (data_type, rank) = (of.data_type().clone(), of.value_rank());
                let access = opcua::nodes::AccessLevel::CURRENT_READ.bits();
                let value = DataValue::null();
                let base = base(NodeClass::Variable);
                Variable::new_full(base, data_type, false, rank, value, access, access, None, None).into()
            }
            _ => Object::new_full(base(NodeClass::Object), opcua::nodes::EventNotifier::empty()).into(),
        };
        self.insert(node, &type_id, parent);
        self.members(&type_id, path, optional);
    }

    /// Removes an instance with all below it.
    pub fn remove(&mut self, id: &NodeId) {
        for reference in [ReferenceTypeId::HasComponent, ReferenceTypeId::HasProperty] {
            for below in self.targets(id, reference) {
                self.remove(&below);
            }
        }
        self.space.delete(id, true);
    }

    fn insert(&mut self, node: NodeType, type_id: &NodeId, parent: &Parent) {
        let id = node.node_id().clone();
        self.space.insert::<_, NodeId>(node, None);
        self.space.insert_reference(&parent.id, &id, parent.reference);
        if !type_id.is_null() {
            self.space.insert_reference(&id, type_id, ReferenceTypeId::HasTypeDefinition);
        }
    }

    /// Copies what a type or one of its members declares.
    fn members(&mut self, of: &NodeId, path: &str, optional: &[&str]) {
        for reference in [ReferenceTypeId::HasComponent, ReferenceTypeId::HasProperty] {
            for declared in self.targets(of, reference) {
                let name = self.name(&declared);
                let rules = self.targets(&declared, ReferenceTypeId::HasModellingRule);
                let mandatory = rules.contains(&ObjectId::ModellingRule_Mandatory.into());
                let wanted = rules.contains(&ObjectId::ModellingRule_Optional.into())
                    && optional.contains(&name.as_str());
                if mandatory || wanted {
                    let parent = Parent { id: self.path(path), reference };
                    let path = format!("{path}/{name}");
                    if self.copy(&declared, &path, &parent) {
                        self.members(&declared, &path, optional);
                    }
                }
            }
        }
    }

    /// Copies a declared node to a path; false where it is there already.
    fn copy(&mut self, declared: &NodeId, path: &str, parent: &Parent) -> bool {
        let id = self.path(path);
        if self.space.node_exists(&id) {
            return false;
        }
        let type_id = self.targets(declared, ReferenceTypeId::HasTypeDefinition).pop().unwrap_or_default();
        let Some(node) = self.space.find(declared) else { return false };
        let plain = node.as_node();
        let (name, display) = (plain.browse_name().clone(), plain.display_name().clone());
        let description = plain.description().cloned();
        let base = Base::new_full(id, node.node_class(), name, display, description, None, None);
        let copy: NodeType = match node {
            NodeType::Object(object) => Object::new_full(base, object.event_notifier()).into(),
            NodeType::Method(method) => {
                Method::new_full(base, method.executable(), method.user_executable()).into()
            }
            NodeType::Variable(variable) => {
                let value = variable.value(
                    TimestampsToReturn::Both,
                    &NumericRange::None,
                    &opcua::types::DataEncoding::Binary,
                    0.0,
                );
                Variable::new_full(
                    base,
                    variable.data_type(),
                    false,
                    variable.value_rank(),
                    value,
                    opcua::nodes::AccessLevel::CURRENT_READ.bits(),
                    opcua::nodes::AccessLevel::CURRENT_READ.bits(),
                    variable.array_dimensions(),
                    None,
                )
                .into()
            }
            _ => return false,
        };
        self.insert(copy, &type_id, parent);
        true
    }
}

/// Names of an instance.
#[derive(Debug, Clone)]
pub struct Name {
    /// Unique below its parent.
    pub browse: opcua::types::QualifiedName,
    /// Shown to people instead.
    pub display: opcua::types::LocalizedText,
}

/// Where a node hangs.
pub struct Parent {
    /// The node right above it.
    pub id: NodeId,
    /// How that refers to this one.
    pub reference: ReferenceTypeId,
}
