//! Several ways to search one image, and the most informative refusal when all fail.

use super::detection::Detection;
use super::error::TargetError;
use super::settings::TargetSettings;
use super::spec::TargetSpec;

/// What one look at the image gave.
#[derive(Debug)]
pub(crate) struct Sighting<T> {
    /// Grids of the declared extent, with their number of points.
    pub found: Vec<(T, usize)>,
    /// Extents of the other grids.
    pub refused: Vec<[u32; 2]>,
    /// Single points that look like one of a target.
    pub candidates: usize,
}

impl<T> Sighting<T> {
    /// The only grid with enough points.
    pub fn only(
        mut self,
        what: &'static str,
        spec: &TargetSpec,
        settings: &TargetSettings,
    ) -> Result<T, TargetError> {
        let count = spec.count();
        let needed = (settings.min_visible_fraction * count as f64).ceil() as usize;
        let most = self.found.iter().map(|(_, points)| *points).max();
        self.found.retain(|(_, points)| *points >= needed);
        match (self.found.len(), most) {
            (0, Some(found)) => Err(TargetError::Hidden { found, count, needed }),
            (0, None) if self.refused.is_empty() => {
                Err(TargetError::NoTarget { what, candidates: self.candidates })
            }
            (0, None) => Err(other_size(spec, &self.refused)),
            (1, _) => self
                .found
                .pop()
                .map_or(Err(TargetError::NoTarget { what, candidates: 0 }), |(grid, _)| Ok(grid)),
            (several, _) => {
                Err(TargetError::Several { count: several, columns: spec.columns, rows: spec.rows })
            }
        }
    }
}

/// The sizes found, each with its longer side where the declared one has it.
fn other_size(spec: &TargetSpec, refused: &[[u32; 2]]) -> TargetError {
    let (columns, rows) = (spec.columns, spec.rows);
    let found = refused.iter().map(|[a, b]| {
        let (long, short) = (*a.max(b), *a.min(b));
        if columns >= rows { (long, short) } else { (short, long) }
    });
    TargetError::OtherSize { points: spec.kind.points(), columns, rows, found: found.collect() }
}

/// The first attempt that finds `enough` points of the target, or sees several targets; else the one that finds most; else the
/// most informative refusal.
pub(crate) fn first<A>(
    attempts: impl IntoIterator<Item = A>,
    what: &'static str,
    enough: usize,
    look: impl Fn(A) -> Result<Detection, TargetError>,
) -> Result<Detection, TargetError> {
    let mut best = TargetError::NoTarget { what, candidates: 0 };
    let mut most: Option<Detection> = None;
    for attempt in attempts {
        match look(attempt) {
            Ok(found) if found.points.len() >= enough => return Ok(found),
            Ok(found) => most = Some(most.filter(|m| m.points.len() >= found.points.len()).unwrap_or(found)),
            Err(several @ TargetError::Several { .. }) => return Err(several),
            Err(error) if rank(&error) > rank(&best) => best = error,
            Err(_) => {}
        }
    }
    most.ok_or(best)
}

/// Rank of a refusal: whether the extent was right, then the number of points found.
pub(crate) fn rank(error: &TargetError) -> (u8, usize) {
    match error {
        TargetError::Endless { columns, rows, .. } => (3, *columns as usize * *rows as usize),
        TargetError::Hidden { found, .. } => (2, *found),
        TargetError::OtherSize { found, .. } => {
            (1, found.iter().map(|(a, b)| *a as usize * *b as usize).max().unwrap_or(0))
        }
        TargetError::Unmarked { corners, .. } => (1, *corners),
        TargetError::NoTarget { candidates, .. } => (0, *candidates),
        _ => (0, 0),
    }
}
