//! Methods that are answered from what the gateway knows: lists and single ones of recipes, results and configurations.

use super::arguments::Arguments;
use super::methods::{Called, Methods, Reply, error};
use super::names::{internal_recipe, structure};
use super::results::variants;
use super::types::{
    Configuration, ConfigurationId, JobId, MeasId, PartId, ProductId, RecipeIdExternal, RecipeIdInternal,
    ResultData, ResultId,
};
use opcua::types::{DateTime, StatusCode, Variant};
use std::sync::atomic::Ordering;

/// Handles that a client may release; the oldest are forgotten.
const KEPT_HANDLES: usize = 1000;

/// Results of one list.
const LISTED: usize = 100;

impl Methods {
    pub(super) fn recipes(&self, arguments: &[Variant]) -> Called {
        let mut read = Arguments::new(arguments, 6)?;
        let (external, _product): (RecipeIdExternal, ProductId) = (read.structure(), read.structure());
        let (prepared, most, first, _timeout) = (read.int32(), read.uint32(), read.uint32(), read.int32());
        read.check()?;
        let vision = self.vision.lock();
        let report = vision.reached().ok_or(Reply::Bad(StatusCode::BadNoCommunication))?;
        let matches = report.recipes.iter().filter(|recipe| {
            let name = external.id.is_empty() || external.id.as_ref() == recipe.name;
            name && (!(0..=1).contains(&prepared) || recipe.prepared == (prepared == 1))
        });
        let found: Vec<Variant> = matches.map(|recipe| structure(internal_recipe(&recipe.name))).collect();
        Ok(self.list(found, most, first))
    }

    pub(super) fn results(&self, arguments: &[Variant]) -> Called {
        let mut read = Arguments::new(arguments, 12)?;
        let result_state = read.int32();
        let (meas, part): (MeasId, PartId) = (read.structure(), read.structure());
        let (external, internal): (RecipeIdExternal, RecipeIdInternal) = (read.structure(), read.structure());
        let (_, configuration): (ConfigurationId, ConfigurationId) = (read.structure(), read.structure());
        let (product, job): (ProductId, JobId) = (read.structure(), read.structure());
        let (most, first, _timeout) = (read.uint32(), read.uint32(), read.int32());
        read.check()?;
        let vision = self.vision.lock();
        let same = |wanted: &str, value: &str| wanted.is_empty() || wanted == value;
        let matches = vision.results.newest_first().filter(|result| {
            let text = |id: Option<&opcua::types::UAString>| id.map_or("", |id| id.as_ref()).to_owned();
            (result_state == 0 || result_state == result.result_state)
                && same(meas.id.as_ref(), &text(result.meas_id.as_ref().map(|id| &id.id)))
                && same(part.id.as_ref(), &text(result.part_id.as_ref().map(|id| &id.id)))
                && same(external.id.as_ref(), result.internal_recipe_id.id.as_ref())
                && same(internal.id.as_ref(), result.internal_recipe_id.id.as_ref())
                && same(configuration.id.as_ref(), result.internal_configuration_id.id.as_ref())
                && same(product.id.as_ref(), &text(result.product_id.as_ref().map(|id| &id.id)))
                && same(job.id.as_ref(), result.job_id.id.as_ref())
        });
        let found: Vec<Variant> = matches.map(|result| structure(result.clone())).collect();
        Ok(self.list(found, most, first))
    }

    /// A piece of a list, as all methods with lists return it.
    fn list(&self, found: Vec<Variant>, most: u32, first: u32) -> Vec<Variant> {
        let most = if most == 0 { LISTED } else { LISTED.min(most as usize) };
        let complete = found.len() <= (first as usize).saturating_add(most);
        let piece: Vec<Variant> = found.into_iter().skip(first as usize).take(most).collect();
        let count = piece.len() as u32;
        let list = Variant::from((opcua::types::VariantScalarTypeId::ExtensionObject, piece));
        vec![complete.into(), count.into(), self.handle().into(), list, 0.into()]
    }

    fn find(&self, arguments: &[Variant]) -> Result<Option<ResultData>, Reply> {
        let mut read = Arguments::new(arguments, 2)?;
        let (id, _timeout): (ResultId, i32) = (read.structure(), read.int32());
        read.check()?;
        Ok(self.vision.lock().results.find(id.id.as_ref()).cloned())
    }

    pub(super) fn result(&self, arguments: &[Variant]) -> Called {
        Ok(match self.find(arguments)? {
            Some(result) => vec![self.handle().into(), structure(result), 0.into()],
            None => vec![0_u32.into(), structure(ResultData::default()), error::UNKNOWN_RESULT.into()],
        })
    }

    pub(super) fn components(&self, arguments: &[Variant]) -> Called {
        let found = self.find(arguments)?;
        let (handle, error) = if found.is_some() { (self.handle(), 0) } else { (0, error::UNKNOWN_RESULT) };
        let result = found.unwrap_or_default();
        Ok(vec![
            result.has_transferable_data_on_file.unwrap_or_default().into(),
            handle.into(),
            result.is_partial.into(),
            result.is_simulated.unwrap_or_default().into(),
            result.result_state.into(),
            structure(result.meas_id.unwrap_or_default()),
            structure(result.part_id.unwrap_or_default()),
            structure(result.external_recipe_id.unwrap_or_default()),
            structure(result.internal_recipe_id),
            structure(result.product_id.unwrap_or_default()),
            structure(result.external_configuration_id.unwrap_or_default()),
            structure(result.internal_configuration_id),
            structure(result.job_id),
            result.creation_time.into(),
            structure(result.processing_times.unwrap_or_default()),
            variants(result.result_content.flatten().unwrap_or_default()),
            error.into(),
        ])
    }

    pub(super) fn configuration(&self, arguments: &[Variant]) -> Called {
        let mut read = Arguments::new(arguments, 2)?;
        let (id, _timeout): (ConfigurationId, i32) = (read.structure(), read.int32());
        read.check()?;
        let known = self.vision.lock().identity.configuration.clone();
        Ok(if id.id == known.id {
            vec![self.handle().into(), structure(active(&known)), 0.into()]
        } else {
            vec![0_u32.into(), structure(Configuration::default()), error::UNKNOWN_CONFIGURATION.into()]
        })
    }

    pub(super) fn configurations(&self, arguments: &[Variant]) -> Called {
        let mut read = Arguments::new(arguments, 3)?;
        let (most, first, _timeout) = (read.uint32(), read.uint32(), read.int32());
        read.check()?;
        let known = self.vision.lock().identity.configuration.clone();
        Ok(self.list(vec![structure(active(&known))], most, first))
    }

    /// A cell has one configuration, which is active.
    pub(super) fn activate(&self, arguments: &[Variant]) -> Called {
        let mut read = Arguments::new(arguments, 1)?;
        let id: ConfigurationId = read.structure();
        read.check()?;
        let known = id.id == self.vision.lock().identity.configuration.id;
        Ok(vec![if known { 0.into() } else { error::UNKNOWN_CONFIGURATION.into() }])
    }

    fn handle(&self) -> u32 {
        let handle = self.next_handle.fetch_add(1, Ordering::Relaxed).max(1);
        let mut handles = self.handles.lock();
        if handles.len() == KEPT_HANDLES {
            handles.pop_front();
        }
        handles.push_back(handle);
        handle
    }

    pub(super) fn release(&self, arguments: &[Variant]) -> Called {
        let mut read = Arguments::new(arguments, 1)?;
        let handle = read.uint32();
        read.check()?;
        let mut handles = self.handles.lock();
        let place = handles.iter().position(|known| *known == handle);
        let known = place.and_then(|place| handles.remove(place));
        Ok(vec![if known.is_some() { 0.into() } else { error::UNKNOWN_HANDLE.into() }])
    }
}

/// The active configuration with its state.
pub fn active(id: &ConfigurationId) -> Configuration {
    Configuration {
        has_transferable_data_on_file: Some(false),
        external_id: None,
        internal_id: id.clone(),
        last_modified: DateTime::null(),
    }
}
