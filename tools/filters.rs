//! Filters of the phase, as commands that decode take them.

use crate::pipeline::DecodedView;
use anyhow::Result;
use fringe::filter::{Filter, FilterReport};
use serde::Serialize;
use std::fmt;
use std::str::FromStr;

/// The filters that were asked for.
#[derive(Debug, Clone, Default, clap::Args)]
pub struct Filters {
    /// Filter the phase: `spikes[:RAD]` (Sobel), `gaussian:SIGMA_PX`, `median[:RADIUS_PX]`; repeated, in this order. None by
    /// default: smoothing correlates neighbours and rounds what is small.
    #[arg(long = "filter", value_name = "NAME[:VALUE]")]
    filters: Vec<Named>,
}

/// A filter as it was typed.
#[derive(Debug, Clone)]
struct Named {
    text: String,
    filter: Filter,
}

impl FromStr for Named {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let (name, value) = text.split_once(':').map_or((text, None), |(name, value)| (name, Some(value)));
        let number =
            || value.map(|v| v.parse::<f64>().map_err(|_| format!("\"{v}\" is no number"))).transpose();
        let filter = match name {
            "spikes" => number()?.map_or(Filter::SPIKES, |height_rad| Filter::Spikes { height_rad }),
            "gaussian" => Filter::gaussian(number()?.unwrap_or(1.0)),
            "median" => match number()?.unwrap_or(1.0) {
                radius if radius.fract() == 0.0 && (0.0..=1e6).contains(&radius) => {
                    Filter::Median { radius_px: radius as u32 }
                }
                radius => return Err(format!("radius_px = {radius} must be a whole number")),
            },
            _ => return Err(format!("no filter \"{name}\"; there are spikes, gaussian and median")),
        };
        filter.check().map_err(|error| error.to_string())?;
        Ok(Self { text: text.to_owned(), filter })
    }
}

/// What a filter did to a view.
#[derive(Debug, Serialize)]
pub struct FilterLine {
    view: String,
    filter: String,
    #[serde(flatten)]
    report: FilterReport,
}

impl fmt::Display for FilterLine {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let FilterReport { valid, corrected, masked, smoothed } = self.report;
        write!(
            f,
            "{}: filter {}: of {valid} px {corrected} corrected, {masked} masked, {smoothed} smoothed",
            self.view, self.filter
        )
    }
}

impl Filters {
    /// Filters all maps, in the order of the command line.
    pub fn apply(&self, views: &mut [DecodedView]) -> Result<Vec<FilterLine>> {
        let mut lines = Vec::new();
        for view in views {
            for decoded in &mut view.maps {
                let map = &mut decoded.map;
                for named in &self.filters {
                    let report = named.filter.apply(map)?;
                    let name = format!("{} / {} axis {:?}", view.projector, view.camera, map.info.axis);
                    lines.push(FilterLine { view: name, filter: named.text.clone(), report });
                }
            }
        }
        Ok(lines)
    }
}
