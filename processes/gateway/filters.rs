//! Filters of events by their types: clients list the types that they want, and the library compares numbers only. So types become
//! numbers where a filter is decoded, and where an event is asked for its type.

use opcua::types::{
    AttributeId, BinaryDecodable as _, Context, DynEncodable, Error, EventFilter, ExtensionObject,
    LiteralOperand, NodeId, ObjectId, ObjectTypeId, SimpleAttributeOperand, TypeLoader, TypeLoaderCollection,
    TypeLoaderPriority, Variant,
};
use opcua::types::{ContentFilterElement, FilterOperator};

/// Puts the decoder of filters before those of the library.
pub fn install(loaders: &mut TypeLoaderCollection) {
    let known: Vec<_> = loaders.iter().cloned().collect();
    *loaders = TypeLoaderCollection::new_empty();
    loaders.add_type_loader(Filters);
    for loader in known {
        loaders.add(loader);
    }
}

/// An identification as a number; all that are not numeric share one that no event type has.
pub fn number(id: &NodeId) -> u64 {
    id.as_u32().map_or(u64::MAX, |number| (u64::from(id.namespace) << 32) | u64::from(number))
}

/// Decodes the filters of event items.
struct Filters;

impl TypeLoader for Filters {
    fn load_from_binary(
        &self,
        id: &NodeId,
        stream: &mut dyn std::io::Read,
        context: &Context<'_>,
        _length: Option<usize>,
    ) -> Option<Result<Box<dyn DynEncodable>, Error>> {
        if *id != ObjectId::EventFilter_Encoding_DefaultBinary {
            return None;
        }
        let decoded = EventFilter::decode(stream, context);
        Some(decoded.map(|mut filter| -> Box<dyn DynEncodable> {
            filter.where_clause.elements.iter_mut().flatten().for_each(compare_numbers);
            Box::new(filter)
        }))
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
        TypeLoaderPriority::Core
    }
}

/// Replaces the type of the event and the types that it is compared with.
fn compare_numbers(element: &mut ContentFilterElement) {
    let compares = matches!(element.filter_operator, FilterOperator::InList | FilterOperator::Equals);
    let operands = element.filter_operands.get_or_insert_default();
    if !compares || !operands.iter().any(is_event_type) {
        return;
    }
    for operand in operands {
        if is_event_type(operand) {
            // Without a path: the event itself.
            *operand = ExtensionObject::new(SimpleAttributeOperand {
                type_definition_id: ObjectTypeId::BaseEventType.into(),
                browse_path: Some(Vec::new()),
                attribute_id: AttributeId::Value as u32,
                index_range: opcua::types::NumericRange::None,
            });
        } else if let Some(Variant::NodeId(id)) =
            operand.inner_as::<LiteralOperand>().map(|literal| &literal.value)
        {
            let value = Variant::from(number(id));
            *operand = ExtensionObject::new(LiteralOperand { value });
        }
    }
}

fn is_event_type(operand: &ExtensionObject) -> bool {
    operand.inner_as::<SimpleAttributeOperand>().is_some_and(|attribute| {
        let path = attribute.browse_path.as_deref().unwrap_or_default();
        attribute.attribute_id == AttributeId::Value as u32
            && matches!(path, [name] if name.namespace_index == 0 && name.name.as_ref() == "EventType")
    })
}
