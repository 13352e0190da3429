//! What `unwrap` prints and writes.

use super::input::Item;
use anyhow::{Context, Result};
use files::atomic;
use files::npy::{self, Raster};
use fringe::unwrap::{Component, UnwrapReport, Unwrapped};
use report::picture;
use serde::Serialize;
use std::f64::consts::TAU;
use std::fmt;
use std::path::Path;

/// Components listed in the result of a program, largest first; noise alone can make a million of single pixels.
const MOST_LISTED: usize = 100;

/// What unwrapping one view gave.
#[derive(Serialize)]
pub struct Line {
    name: String,
    width_px: u32,
    height_px: u32,
    valid: usize,
    components: usize,
    absolute_components: usize,
    largest: Vec<Component>,
    discontinuities: usize,
    #[serde(skip_serializing_if = "Option::is_none")]
    residues: Option<fringe::unwrap::Residues>,
    #[serde(skip_serializing_if = "Option::is_none")]
    convergence: Option<fringe::unwrap::Convergence>,
    /// Pixels with an order from both the code and the neighbours, and those of them where the two differ.
    #[serde(skip_serializing_if = "Option::is_none")]
    against_code: Option<AgainstCode>,
}

/// Spatial against temporal order.
#[derive(Clone, Copy, Serialize)]
pub struct AgainstCode {
    compared: usize,
    different: usize,
}

impl Line {
    /// Collects the figures of one map.
    pub fn new(item: &Item, done: &Unwrapped) -> Self {
        let UnwrapReport { valid, components, discontinuities, residues, convergence } = &done.report;
        let mut largest = components.clone();
        largest.sort_by_key(|c| std::cmp::Reverse(c.pixels));
        largest.truncate(MOST_LISTED);
        Self {
            name: item.name.clone(),
            width_px: item.map.info.width_px,
            height_px: item.map.info.height_px,
            valid: *valid,
            components: components.len(),
            absolute_components: components.iter().filter(|c| c.is_absolute()).count(),
            largest,
            discontinuities: *discontinuities,
            residues: *residues,
            convergence: *convergence,
            against_code: item.coded.as_ref().map(|coded| against(&coded.phase_rad, &done.phase_rad)),
        }
    }
}

fn against(coded: &[f32], spatial: &[f32]) -> AgainstCode {
    let both = coded.iter().zip(spatial).filter(|(a, b)| a.is_finite() && b.is_finite());
    let off = both.map(|(a, b)| ((f64::from(*a) - f64::from(*b)) / TAU).round() != 0.0);
    let (compared, different) = off.fold((0, 0), |(n, wrong), off| (n + 1, wrong + usize::from(off)));
    AgainstCode { compared, different }
}

impl fmt::Display for Line {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let total = self.width_px as usize * self.height_px as usize;
        write!(
            f,
            "{}: {} of {total} px in {} components ({} absolute), the largest {} px; {} pairs of neighbours more than half a \
             turn apart",
            self.name,
            self.valid,
            self.components,
            self.absolute_components,
            self.largest.first().map_or(0, |c| c.pixels),
            self.discontinuities
        )?;
        if let Some(r) = self.residues {
            write!(
                f,
                "; residues {} positive, {} negative, {} charged holes, {} edges cut",
                r.positive, r.negative, r.charged_holes, r.cut_edges
            )?;
        }
        if let Some(c) = self.convergence {
            let how = if c.converged { "converged" } else { "NOT CONVERGED" };
            write!(f, "; {how} after {} steps, residual {:.1e}", c.iterations, c.residual)?;
        }
        if let Some(a) = self.against_code {
            write!(f, "; against the code {} of {} px have another order", a.different, a.compared)?;
        }
        Ok(())
    }
}

/// Writes `<name>-wrapped.npy`, `<name>-unwrapped.npy` and `<name>-unwrapped.png`.
pub fn write(folder: &Path, item: &Item, done: &Unwrapped) -> Result<()> {
    atomic::create_dir(folder)?;
    let info = item.map.info;
    let raster = |values: Vec<f32>| Raster { width_px: info.width_px, height_px: info.height_px, values };
    let wrapped =
        item.map.phase_rad.iter().zip(&item.map.valid).map(|(p, v)| if *v == 1 { *p } else { f32::NAN });
    npy::write(&folder.join(format!("{}-wrapped.npy", item.name)), &raster(wrapped.collect()))?;
    npy::write(&folder.join(format!("{}-unwrapped.npy", item.name)), &raster(done.phase_rad.clone()))?;
    let mut map = item.map.clone();
    map.phase_rad.clone_from(&done.phase_rad);
    let path = folder.join(format!("{}-unwrapped.png", item.name));
    let png = picture::phase_png(&map.view()).with_context(|| path.display().to_string())?;
    Ok(atomic::write(&path, &png)?)
}
