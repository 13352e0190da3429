//! Where surfaces end in both pictures.

use super::Phases;
use crate::sensor::Footprint;
use crate::surface::{OTHER, OWN, Reach, SurfaceBuilder, mark_limbs, mark_missing, mark_rims, reach_px};

/// Marks of the pixels of both views, and the memory behind them.
#[derive(Debug, Clone)]
pub(super) struct Ends {
    widths: [usize; 2],
    /// How far a limb shifts points in the left and in the right picture, px.
    reach_px: [f64; 2],
    /// [`OWN`] where the left surface ends within the reach of a limb; shifted where it bends.
    pub left: Vec<u8>,
    /// [`crate::surface::RIM`] where the right surface ends within `surface.edge_px`, [`OTHER`] where within the reach of a limb.
    pub right: Vec<u8>,
    /// Scratch, where what is lent is not enough.
    spare: Vec<u8>,
}

impl Ends {
    /// Room for pictures of these columns and rows; the cameras have the usual footprints.
    pub fn new([left, right]: [[u32; 2]; 2]) -> Self {
        let pixels = |[width, height]: [u32; 2]| width as usize * height as usize;
        let (needed, lent) =
            (2 * pixels(left).max(pixels(right)), SurfaceBuilder::scratch_bytes(pixels(left)));
        Self {
            widths: [left[0] as usize, right[0] as usize],
            reach_px: [reach_px(None); 2],
            left: vec![0; pixels(left)],
            right: vec![0; pixels(right)],
            spare: vec![0; if needed > lent { needed } else { 0 }],
        }
    }

    /// Takes the footprints of both cameras, where they are known.
    pub fn set_footprints(&mut self, footprints: [Option<Footprint>; 2]) {
        self.reach_px = footprints.map(reach_px);
    }

    /// Marks both pictures, whose phases have these uncertainties; rims are `edge` pixels wide. `lent`: the scratch memory of the surface builder.
    pub fn mark(
        &mut self,
        phases: Phases,
        sigmas: [&[f32]; 2],
        (edge, max_step): (usize, f32),
        lent: &mut [u8],
    ) {
        let Self { widths, reach_px, left, right, spare } = self;
        // What is missing in a picture, and its borders.
        let scratch = if spare.is_empty() { lent } else { spare };
        let (missing, borders) = scratch.split_at_mut(scratch.len() / 2);
        let reach = reach_px.map(|limb| Reach { limb, rim: edge });
        let (raster, count) = ((widths[0], phases.left), left.len());
        let (missing_left, borders_left) = (&mut missing[..count], &mut borders[..count]);
        left.fill(0);
        mark_missing(raster, max_step, missing_left);
        let seen = (widths[0], phases.left, sigmas[0]);
        mark_limbs(seen, (reach[0], max_step), missing_left, borders_left, (OWN, left));
        let (raster, count) = ((widths[1], phases.right), right.len());
        let (missing, borders) = (&mut missing[..count], &mut borders[..count]);
        mark_missing(raster, max_step, missing);
        mark_rims(widths[1], edge, missing, right);
        let seen = (widths[1], phases.right, sigmas[1]);
        mark_limbs(seen, (reach[1], max_step), missing, borders, (OTHER, right));
    }

    /// Marks nothing, so that all points stay.
    pub fn clear(&mut self) {
        self.left.fill(0);
        self.right.fill(0);
    }
}
