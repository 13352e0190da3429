//! The nodes that show the cell: states, recipes and the last results.

use super::lists::active;
use super::machine::{Position, state};
use super::names::{external_recipe, internal_recipe, structure};
use super::nodeset::{Builder, Name, Parent};
use super::results::{self, SHOWN};
use super::server::{Manager, SYSTEM};
use super::types::{ResultData, SystemStateDescription};
use super::vision::state_name;
use opcua::server::ServerHandle;
use opcua::types::{
    DataValue, DateTime, LocalizedText, NodeId, NumericRange, QualifiedName, ReferenceTypeId, StatusCode,
    Variant,
};
use std::collections::VecDeque;

/// Number of the type of recipes in the nodeset.
const RECIPE_TYPE: u32 = 1002;

/// Number of the type of results in the nodeset.
const RESULT_TYPE: u32 = 2002;

/// Members of a result that are shown where it has them.
const RESULT_MEMBERS: [&str; 7] =
    ["ExternalRecipeId", "IsSimulated", "MeasId", "PartId", "ProcessingTimes", "ProductId", "ResultContent"];

/// States of a system by SEMI E10, as the nodeset numbers them.
mod e10 {
    pub const PRODUCTIVE: i32 = 1;
    pub const STANDBY: i32 = 2;
    pub const ENGINEERING: i32 = 3;
    pub const UNSCHEDULED_DOWNTIME: i32 = 5;
}

/// What the nodes show.
#[derive(Debug, Default)]
pub struct Shown {
    run: String,
    recipes: Vec<String>,
    /// Identifications of the results that have nodes, the oldest first.
    results: VecDeque<String>,
}

impl Shown {
    /// Shows what is new.
    pub fn update(&mut self, handle: &ServerHandle, manager: &Manager) {
        let vision = manager.inner().methods.vision.lock();
        let connected = vision.connected;
        let mut values = states(vision.position(), connected, vision.identity.standard);
        let configuration = active(&vision.identity.configuration);
        values
            .push(("ConfigurationManagement/ActiveConfiguration".to_owned(), good(structure(configuration))));
        let recipes = vision.report.as_ref().map(|report| report.recipes.clone()).unwrap_or_default();
        let newest: Vec<ResultData> = vision.results.newest_first().take(SHOWN).cloned().collect();
        let (run, standard) = (vision.run.clone(), vision.identity.standard);
        drop(vision);
        {
            let mut space = manager.address_space().write();
            let tree = handle.type_tree().read();
            let mut builder = Builder::new(&mut space, &tree, standard, manager.inner().own);
            if self.run != run {
                self.run = run;
                self.forget(&mut builder);
            }
            let names: Vec<String> = recipes.iter().map(|recipe| recipe.name.clone()).collect();
            if self.recipes != names {
                names.iter().enumerate().for_each(|(index, name)| add_recipe(&mut builder, index, name));
                self.recipes = names;
            }
            for result in newest.iter().rev() {
                let id = result.result_id.id.to_string();
                if !self.results.contains(&id) {
                    add_result(&mut builder, &id);
                    values.extend(result_values(&id, result));
                    self.results.push_back(id);
                }
            }
            while self.results.len() > SHOWN {
                let oldest = self.results.pop_front().unwrap_or_default();
                builder.remove(&builder.path(&format!("{SYSTEM}/ResultManagement/Results/{oldest}")));
            }
        }
        for (index, recipe) in recipes.iter().enumerate() {
            let path = |member: &str| format!("RecipeManagement/Recipes/{index}/{member}");
            values.push((path("InternalId"), good(structure(internal_recipe(&recipe.name)))));
            values.push((path("ExternalId"), good(structure(external_recipe(&recipe.name)))));
            values.push((path("IsPrepared"), reached(recipe.prepared.into(), connected)));
            values.push((path("LastModified"), good(DateTime::null().into())));
        }
        set(handle, manager, values);
    }

    /// Removes the nodes of another run of the cell.
    fn forget(&mut self, builder: &mut Builder) {
        for id in std::mem::take(&mut self.results) {
            builder.remove(&builder.path(&format!("{SYSTEM}/ResultManagement/Results/{id}")));
        }
        for index in 0..std::mem::take(&mut self.recipes).len() {
            builder.remove(&builder.path(&format!("{SYSTEM}/RecipeManagement/Recipes/{index}")));
        }
    }
}

fn add_recipe(builder: &mut Builder, index: usize, name: &str) {
    let above = format!("{SYSTEM}/RecipeManagement/Recipes");
    let names = Name { browse: QualifiedName::new(builder.own, name), display: LocalizedText::new("", name) };
    let parent = Parent { id: builder.path(&above), reference: ReferenceTypeId::HasComponent };
    builder.instance(RECIPE_TYPE, &format!("{above}/{index}"), &names, &parent, &["ExternalId"]);
}

fn add_result(builder: &mut Builder, id: &str) {
    let above = format!("{SYSTEM}/ResultManagement/Results");
    let names = Name { browse: QualifiedName::new(builder.own, id), display: LocalizedText::new("", id) };
    let parent = Parent { id: builder.path(&above), reference: ReferenceTypeId::HasComponent };
    builder.instance(RESULT_TYPE, &format!("{above}/{id}"), &names, &parent, &RESULT_MEMBERS);
}

fn result_values(id: &str, result: &ResultData) -> Vec<(String, DataValue)> {
    let path = format!("ResultManagement/Results/{id}");
    let mut values = vec![(path.clone(), good(structure(result.clone())))];
    values.extend(
        results::fields(result).into_iter().map(|(name, value)| (format!("{path}/{name}"), good(value))),
    );
    values
}

/// Where the state machines are.
fn states(position: Option<Position>, connected: bool, standard: u16) -> Vec<(String, DataValue)> {
    let machine = "VisionStateMachine";
    let automatic = format!("{machine}/AutomaticModeStateMachine");
    let none = if connected { StatusCode::BadStateNotActive } else { StatusCode::BadNoCommunication };
    let mut values = Vec::new();
    for (path, number) in
        [(machine, position.map(|at| at.system)), (automatic.as_str(), position.and_then(|at| at.automatic))]
    {
        let (name, id) = match number {
            Some(number) => (good(LocalizedText::new("en", state_name(number)).into()), Some(number)),
            None => (bad(none), None),
        };
        values.push((format!("{path}/CurrentState"), name));
        values.push((
            format!("{path}/CurrentState/Id"),
            id.map_or_else(|| bad(none), |id| good(NodeId::new(standard, id).into())),
        ));
    }
    values.push((
        "SystemState".to_owned(),
        position.map_or_else(|| bad(none), |at| good(structure(e10_state(at)))),
    ));
    values
}

fn e10_state(at: Position) -> SystemStateDescription {
    let state = match (at.system, at.automatic) {
        (_, Some(state::SINGLE_EXECUTION | state::CONTINUOUS_EXECUTION)) => e10::PRODUCTIVE,
        (state::OPERATIONAL, _) => e10::STANDBY,
        (state::HALTED, _) => e10::ENGINEERING,
        _ => e10::UNSCHEDULED_DOWNTIME,
    };
    SystemStateDescription {
        state,
        state_description: Some(state_name(at.automatic.unwrap_or(at.system)).into()),
    }
}

fn good(value: Variant) -> DataValue {
    DataValue::new_now(value)
}

fn bad(status: StatusCode) -> DataValue {
    DataValue { status: Some(status), ..DataValue::new_now(Variant::Empty) }
}

fn reached(value: Variant, connected: bool) -> DataValue {
    if connected { good(value) } else { bad(StatusCode::BadNoCommunication) }
}

/// Sets values and tells who has subscribed to them. What stays as it was is left alone.
fn set(handle: &ServerHandle, manager: &Manager, values: Vec<(String, DataValue)>) {
    let values: Vec<(NodeId, DataValue)> =
        values.into_iter().map(|(path, value)| (manager.inner().id(&path), value)).collect();
    let items = values.iter().map(|(id, value)| (id, None::<&NumericRange>, value.clone()));
    if let Err(status) = manager.set_values(handle.subscriptions(), items) {
        tracing::error!("a value cannot be shown: {status}");
    }
}
