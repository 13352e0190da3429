//! A run of phase within a rectified row, and the walk through it.

/// A continuous, monotone stretch of a row: a bracket lies between any two of its neighbouring cells.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Run {
    /// Smallest phase of the run, rad.
    pub low: f32,
    /// Largest phase of the run, rad.
    pub high: f32,
    /// Largest `high` of this and all earlier runs of the sorted row: ends the search.
    pub high_so_far: f32,
    /// First cell of the run.
    pub start: u32,
    /// Last cell of the run.
    pub end: u32,
    /// Where the last walk ended.
    pub cursor: u32,
    /// Whether the phase grows with the column.
    pub rising: bool,
    /// Whether no two neighbours change places.
    pub monotone: bool,
    /// Cells per rad, in the mean.
    pub cells_per_rad: f64,
}

impl Run {
    /// Walks from the cursor, or from a column within the run, to the bracket of a phase and interpolates in it; `None` where only
    /// the noise of the ends reaches that far.
    #[inline(always)]
    pub fn walk(&mut self, phase: &[f32], wanted: f32, near: Option<f64>) -> Option<f64> {
        if let Some(near) = near
            && near >= f64::from(self.start)
            && near <= f64::from(self.end)
        {
            self.cursor = near as u32;
        }
        let (first, last) = (self.start as usize, self.end as usize - 1);
        let below = |cell: usize| if self.rising { phase[cell] < wanted } else { phase[cell] > wanted };
        let mut cell = (self.cursor as usize).clamp(first, last);
        while cell < last && below(cell + 1) {
            cell += 1;
        }
        while cell > first && !below(cell) && phase[cell] != wanted {
            cell -= 1;
        }
        self.cursor = cell as u32;
        let (from, to) = (f64::from(phase[cell]), f64::from(phase[cell + 1]));
        let wanted = f64::from(wanted);
        let inside = (from <= wanted && wanted <= to) || (to <= wanted && wanted <= from);
        // Neighbouring cells may show the same native pixel: any place between them is as good.
        let fraction = if from == to { 0.5 } else { (wanted - from) / (to - from) };
        inside.then_some(cell as f64 + fraction)
    }
}
