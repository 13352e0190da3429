//! Where surfaces end in both pictures.

use super::Phases;
use crate::sensor::Footprint;
use crate::surface::{OTHER, OWN, mark_limbs, mark_missing, mark_rims, reach_px};

/// Marks of the pixels of both views, and the memory behind them.
#[derive(Debug, Clone)]
pub(super) struct Ends {
    widths: [usize; 2],
    /// How far a limb shifts points in the left and in the right picture, px.
    reach_px: [f64; 2],
    /// [`OWN`] where the left surface ends within the reach of a limb.
    pub left: Vec<u8>,
    /// [`crate::surface::RIM`] where the right surface ends within `surface.edge_px`, [`OTHER`] where within the reach of a limb.
    pub right: Vec<u8>,
    /// Scratch: what is missing in a picture, and its borders.
    missing: Vec<u8>,
    borders: Vec<u8>,
}

impl Ends {
    /// Room for pictures of these columns and rows; the cameras have the usual footprints.
    pub fn new([left, right]: [[u32; 2]; 2]) -> Self {
        let pixels = |[width, height]: [u32; 2]| width as usize * height as usize;
        let most = pixels(left).max(pixels(right));
        Self {
            widths: [left[0] as usize, right[0] as usize],
            reach_px: [reach_px(None); 2],
            left: vec![0; pixels(left)],
            right: vec![0; pixels(right)],
            missing: vec![0; most],
            borders: vec![0; most],
        }
    }

    /// Takes the footprints of both cameras, where they are known.
    pub fn set_footprints(&mut self, footprints: [Option<Footprint>; 2]) {
        self.reach_px = footprints.map(reach_px);
    }

    /// Marks both pictures. Rims of the right one are `edge` pixels wide; limbs are not looked for where `keep_limbs`.
    pub fn mark(&mut self, phases: Phases, edge: usize, keep_limbs: bool, max_step: f32) {
        let Self { missing, borders, .. } = self;
        self.left.fill(0);
        let views = [(phases.left, &mut self.left, OWN), (phases.right, &mut self.right, OTHER)];
        for (side, (phase, marks, mark)) in views.into_iter().enumerate() {
            let (raster, count) = ((self.widths[side], phase), phase.len());
            if side == 0 && keep_limbs {
                continue;
            }
            mark_missing(raster, max_step, &mut missing[..count]);
            if side == 1 {
                mark_rims(raster.0, edge, &missing[..count], marks);
            }
            if !keep_limbs {
                let reach = (self.reach_px[side], max_step);
                mark_limbs(raster, reach, &missing[..count], &mut borders[..count], (mark, marks));
            }
        }
    }
}
