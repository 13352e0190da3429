//! How many pixels a cloud leaves out at the rims of faces, as a comment of its PLY file: whoever writes the cloud states it, and outlines are measured
//! as much further out ([`metrology::inspection::Plan::with_rims_left_out`]).

use crate::ply::Cloud;
use std::num::ParseIntError;

/// Name of the comment; its value is `matching.surface.edge_px` of the reconstruction.
pub const COMMENT: &str = "edge_px";

/// What the comment of a cloud says, px; `None` where there is none, as in a cloud of other programs.
///
/// # Errors
/// A comment that is no number of pixels.
pub fn of_cloud(cloud: &Cloud) -> Result<Option<u32>, ParseIntError> {
    // No reconstruction leaves out more than a byte counts.
    cloud.comment(COMMENT).map(|text| text.trim().parse::<u8>().map(u32::from)).transpose()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_pixels_come_back_from_the_comment() {
        let said = |text: &str| Cloud { comments: vec![format!("{COMMENT}: {text}")], ..Cloud::default() };
        for pixels in [0, 2, 8] {
            assert_eq!(of_cloud(&said(&pixels.to_string())), Ok(Some(pixels)));
        }
        assert_eq!(of_cloud(&Cloud::default()), Ok(None));
        for wrong in ["two", "-1", "1.5", "1e9", ""] {
            assert!(of_cloud(&said(wrong)).is_err(), "{wrong}");
        }
    }
}
