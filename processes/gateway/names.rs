//! Names and identifications as the specification has them.

use super::types::{ConfigurationId, JobId, MeasId, PartId, ProductId, RecipeIdExternal, RecipeIdInternal};
use opcua::types::{ExtensionObject, NodeId, UAString, Variant};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// What the client of a job called it.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct JobNames {
    /// Identification of the measurement.
    pub meas: String,
    /// Identification of the part.
    pub part: String,
    /// Identification of the product.
    pub product: String,
}

/// Who is told: indices of namespaces, the source of events, and what every result has.
#[derive(Debug, Clone)]
pub struct Identity {
    /// Index of the namespace of the specification.
    pub standard: u16,
    /// The vision system, source of all events.
    pub system: NodeId,
    /// Name of the cell.
    pub cell: String,
    /// The configuration that the cell runs with.
    pub configuration: ConfigurationId,
    /// Whether all cameras are simulated.
    pub simulated: bool,
}

/// Identification of a job of a run of the cell.
pub fn job_id(run: &str, job: u64) -> JobId {
    JobId { id: format!("{run}-{job}").into() }
}

/// Fields by their names.
pub fn named<const N: usize>(fields: [(&str, Variant); N]) -> BTreeMap<String, Variant> {
    fields.into_iter().map(|(name, value)| (name.to_owned(), value)).collect()
}

/// A structure as a value.
pub fn structure<T>(value: T) -> Variant
where
    T: opcua::types::DynEncodable,
{
    Variant::from(ExtensionObject::new(value))
}

/// A recipe as the cell names it.
pub fn internal_recipe(name: &str) -> RecipeIdInternal {
    RecipeIdInternal { id: name.into(), ..RecipeIdInternal::default() }
}

/// A recipe as a client names it: the same.
pub fn external_recipe(name: &str) -> RecipeIdExternal {
    RecipeIdExternal { id: name.into(), ..RecipeIdExternal::default() }
}

/// Names that a client gave; none for an empty one.
pub fn names_of(names: &JobNames) -> (Option<MeasId>, Option<PartId>, Option<ProductId>) {
    let text = |text: &str| Some(UAString::from(text)).filter(|text| !text.is_empty());
    (
        text(&names.meas).map(|id| MeasId { id, description: None }),
        text(&names.part).map(|id| PartId { id, description: None }),
        text(&names.product).map(|id| ProductId { id, description: None }),
    )
}
