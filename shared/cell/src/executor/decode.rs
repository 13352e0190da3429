//! From the frames of a camera to its absolute phase.

use crate::cell::Cell;
use crate::error::CellError;
use fringe::decode::Decoder;

/// The decoder of a camera under a projector.
///
/// # Errors
/// A sequence that tells no absolute phase, or settings out of range.
pub fn decoder(cell: &Cell, projector: usize, camera: usize) -> Result<Decoder, CellError> {
    let (light, node) = (&cell.config.projectors[projector], &cell.graph.cameras[camera]);
    let full_scale_dn = cell.format(projector, camera)?.full_scale_dn;
    let extent_px = [light.width_px, light.height_px];
    let settings = &cell.config.settings.decode;
    Decoder::new(&light.sequence, node.width_px, node.height_px, full_scale_dn, extent_px, settings)
        .map_err(|source| CellError::Decode { projector: light.name.clone(), source })
}
