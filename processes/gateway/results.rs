//! The results that a client may ask for, in the structures of the specification.

use super::names::{
    Identity, JobNames, external_recipe, internal_recipe, job_id, named, names_of, structure,
};
use super::types::{PartId, ProcessingTimes, ResultData, ResultId};
use files::result::CycleResult;
use opcua::types::{DateTime, Variant};
use std::collections::{BTreeMap, VecDeque};

/// Results that are kept for clients.
const KEPT: usize = 1000;

/// Results that have nodes in the folder of results.
pub const SHOWN: usize = 50;

/// States of a result (OPC 40100-1, 12.7).
pub mod result_state {
    /// All was measured and evaluated.
    pub const COMPLETED: i32 = 1;
    /// Ended by a command.
    pub const ABORTED: i32 = 3;
    /// Ended for another reason.
    pub const FAILED: i32 = 4;
}

/// The last results, the oldest first.
#[derive(Debug, Default)]
pub struct Results(VecDeque<ResultData>);

impl Results {
    /// Adds the newest of the results.
    pub fn add(&mut self, result: ResultData) {
        if self.0.len() == KEPT {
            self.0.pop_front();
        }
        self.0.push_back(result);
    }

    /// The result of an identification.
    pub fn find(&self, id: &str) -> Option<&ResultData> {
        self.0.iter().find(|result| result.result_id.id.as_ref() == id)
    }

    /// All, the newest first.
    pub fn newest_first(&self) -> impl Iterator<Item = &ResultData> {
        self.0.iter().rev()
    }
}

/// The result of a cycle of a job as the specification has it; `run` is the run of the cell that made it.
pub fn data(
    (identity, run): (&Identity, &str),
    (job, names): (u64, &JobNames),
    result: &CycleResult,
) -> ResultData {
    let (meas_id, part_id, product_id) = names_of(names);
    let part = result.part.as_deref().map(|part| PartId { id: part.into(), description: None });
    let end = DateTime::parse_from_rfc3339(&result.date).unwrap_or_else(|_| DateTime::now());
    let recipe = result.recipe.clone().unwrap_or_default();
    let milliseconds = |ns: u64| ns as f64 / 1e6;
    let times = result.duration_ns.map(|duration_ns| ProcessingTimes {
        start_time: (end.as_chrono() - std::time::Duration::from_nanos(duration_ns)).into(),
        end_time: end,
        acquisition_duration: result
            .latency_ns
            .map(|latency| milliseconds(duration_ns.saturating_sub(latency))),
        processing_duration: result.latency_ns.map(milliseconds),
    });
    ResultData {
        result_id: ResultId { id: format!("{}-{}", run, result.number).into() },
        has_transferable_data_on_file: Some(false),
        is_partial: false,
        is_simulated: Some(identity.simulated),
        result_state: state_of(result),
        meas_id,
        part_id: part.or(part_id),
        external_recipe_id: Some(external_recipe(&recipe)),
        internal_recipe_id: internal_recipe(&recipe),
        product_id,
        external_configuration_id: None,
        internal_configuration_id: identity.configuration.clone(),
        job_id: job_id(run, job),
        creation_time: end,
        processing_times: times,
        result_content: Some(Some(content(result))),
    }
}

fn state_of(result: &CycleResult) -> i32 {
    if result.is_ok() {
        result_state::COMPLETED
    } else if result.outcome.ends_with("by the operator") {
        result_state::ABORTED
    } else {
        result_state::FAILED
    }
}

/// Verdict, outcome, and the whole result as JSON.
fn content(result: &CycleResult) -> Vec<Variant> {
    let verdict = result.verdict.map_or("", metrology::verdict::Verdict::key);
    let json = serde_json::to_string(result).unwrap_or_default();
    vec![verdict.into(), result.outcome.as_str().into(), json.as_str().into()]
}

/// The fields of a result by their names in the specification; those that are absent are left out.
pub fn fields(data: &ResultData) -> BTreeMap<String, Variant> {
    let mut fields = named([
        ("ResultId", structure(data.result_id.clone())),
        ("IsPartial", data.is_partial.into()),
        ("ResultState", data.result_state.into()),
        ("InternalRecipeId", structure(data.internal_recipe_id.clone())),
        ("InternalConfigurationId", structure(data.internal_configuration_id.clone())),
        ("JobId", structure(data.job_id.clone())),
        ("CreationTime", data.creation_time.into()),
    ]);
    let mut add = |name: &str, value: Option<Variant>| {
        if let Some(value) = value {
            fields.insert(name.to_owned(), value);
        }
    };
    add("IsSimulated", data.is_simulated.map(Variant::from));
    add("MeasId", data.meas_id.clone().map(structure));
    add("PartId", data.part_id.clone().map(structure));
    add("ExternalRecipeId", data.external_recipe_id.clone().map(structure));
    add("ProductId", data.product_id.clone().map(structure));
    add("ProcessingTimes", data.processing_times.clone().map(structure));
    add("ResultContent", data.result_content.clone().flatten().map(variants));
    fields
}

/// An array of values of any type.
pub fn variants(values: Vec<Variant>) -> Variant {
    let wrapped: Vec<Variant> = values.into_iter().map(|value| Variant::Variant(Box::new(value))).collect();
    Variant::from((opcua::types::VariantScalarTypeId::Variant, wrapped))
}
