//! Structures of OPC UA for Machine Vision (OPC 40100-1, chapter 12) as they go over the wire.

use opcua::types::{
    BinaryDecodable, BinaryEncodable, ByteString, Context, DateTime, DynEncodable, Error,
    ExpandedMessageInfo, ExpandedNodeId, LocalizedText, NodeId, TypeLoader, TypeLoaderInstance,
    TypeLoaderPriority, UAString, UaNullable, Variant, XmlDecodable, XmlEncodable, XmlType,
};
use std::sync::LazyLock;

/// Namespace of the companion specification.
pub const NAMESPACE: &str = "http://opcfoundation.org/UA/MachineVision";

/// Defines structures as the nodeset does, in its order of fields; structures of the same fields share them.
macro_rules! structures {
    ($($(#[$doc:meta] $name:ident, $data_type:literal, $encoding:literal)+ = $fields:tt)*) => {
        $($(structures! { @one #[$doc] $name, $data_type, $encoding, $fields })+)*

        static TYPES: LazyLock<TypeLoaderInstance> = LazyLock::new(|| {
            let mut types = TypeLoaderInstance::new();
            $($(types.add_binary_type($data_type, $encoding, opcua::types::binary_decode_to_enc::<$name>);)+)*
            types
        });
    };
    (@one #[$doc:meta] $name:ident, $data_type:literal, $encoding:literal, { $($fields:tt)* }) => {
        #[$doc]
        #[derive(Debug, Clone, Default, PartialEq, BinaryEncodable, BinaryDecodable, UaNullable)]
        #[derive(XmlEncodable, XmlDecodable, XmlType)]
        #[allow(missing_docs)] // the fields are those of the specification
        pub struct $name { $($fields)* }

        impl ExpandedMessageInfo for $name {
            fn full_type_id(&self) -> ExpandedNodeId {
                named($encoding)
            }
            fn full_json_type_id(&self) -> ExpandedNodeId {
                named($data_type)
            }
            fn full_xml_type_id(&self) -> ExpandedNodeId {
                named($data_type)
            }
            fn full_data_type_id(&self) -> ExpandedNodeId {
                named($data_type)
            }
        }
    };
}

fn named(number: u32) -> ExpandedNodeId {
    ExpandedNodeId { node_id: NodeId::new(0, number), namespace_uri: NAMESPACE.into(), server_index: 0 }
}

structures! {
    /// A configuration: everything that a measurement depends on beside the recipe.
    ConfigurationId, 3008, 5090
    /// A recipe as its user names it.
    RecipeIdExternal, 3002, 5002
    /// A recipe as the cell names it.
    RecipeIdInternal, 3013, 5268 = {
        pub id: UAString,
        #[opcua(optional)]
        pub version: Option<UAString>,
        #[opcua(optional)]
        pub hash: Option<ByteString>,
        #[opcua(optional)]
        pub hash_algorithm: Option<UAString>,
        #[opcua(optional)]
        pub description: Option<LocalizedText>,
    }
    /// A configuration with its state.
    Configuration, 3007, 5088 = {
        #[opcua(optional)]
        pub has_transferable_data_on_file: Option<bool>,
        #[opcua(optional)]
        pub external_id: Option<ConfigurationId>,
        pub internal_id: ConfigurationId,
        pub last_modified: DateTime,
    }
    /// A measurement as the client names it.
    MeasId, 3015, 5006
    /// A part as the client names it.
    PartId, 3004, 5013
    /// A product as the client names it.
    ProductId, 3003, 5224 = {
        pub id: UAString,
        #[opcua(optional)]
        pub description: Option<LocalizedText>,
    }
    /// When a result was made, and how long that took, ms.
    ProcessingTimes, 3005, 5016 = {
        pub start_time: DateTime,
        pub end_time: DateTime,
        #[opcua(optional)]
        pub acquisition_duration: Option<f64>,
        #[opcua(optional)]
        pub processing_duration: Option<f64>,
    }
    /// A job of the cell.
    JobId, 3016, 5008
    /// A result of the cell.
    ResultId, 3021, 5274 = {
        pub id: UAString,
    }
    /// A result with all that belongs to it.
    ResultData, 3006, 5018 = {
        pub result_id: ResultId,
        #[opcua(optional)]
        pub has_transferable_data_on_file: Option<bool>,
        pub is_partial: bool,
        #[opcua(optional)]
        pub is_simulated: Option<bool>,
        pub result_state: i32,
        #[opcua(optional)]
        pub meas_id: Option<MeasId>,
        #[opcua(optional)]
        pub part_id: Option<PartId>,
        #[opcua(optional)]
        pub external_recipe_id: Option<RecipeIdExternal>,
        pub internal_recipe_id: RecipeIdInternal,
        #[opcua(optional)]
        pub product_id: Option<ProductId>,
        #[opcua(optional)]
        pub external_configuration_id: Option<ConfigurationId>,
        pub internal_configuration_id: ConfigurationId,
        pub job_id: JobId,
        pub creation_time: DateTime,
        #[opcua(optional)]
        pub processing_times: Option<ProcessingTimes>,
        #[opcua(optional)]
        #[allow(clippy::option_option, reason = "the field may be absent, and an array may be null")]
        pub result_content: Option<Option<Vec<Variant>>>,
    }
    /// State of the system as SEMI E10 has it.
    SystemStateDescription, 3024, 5278 = {
        pub state: i32,
        #[opcua(optional)]
        pub state_description: Option<UAString>,
    }
}

/// Decodes the structures that clients send.
#[derive(Debug, Clone, Copy)]
pub struct Types;

impl TypeLoader for Types {
    fn load_from_binary(
        &self,
        id: &NodeId,
        stream: &mut dyn std::io::Read,
        context: &Context<'_>,
        _length: Option<usize>,
    ) -> Option<Result<Box<dyn DynEncodable>, Error>> {
        if context.namespaces().get_index(NAMESPACE)? != id.namespace {
            return None;
        }
        TYPES.decode_binary(id.as_u32()?, stream, context)
    }

    fn load_from_xml(
        &self,
        _id: &NodeId,
        _stream: &mut opcua::types::xml::XmlStreamReader<&mut dyn std::io::Read>,
        _context: &Context<'_>,
        _name: &str,
    ) -> Option<Result<Box<dyn DynEncodable>, Error>> {
        None
    }

    fn priority(&self) -> TypeLoaderPriority {
        TypeLoaderPriority::Generated
    }
}
