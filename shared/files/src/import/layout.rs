//! The file that describes a foreign folder of frames.
//!
//! A layout states which file is which frame:
//! ```toml
//! format = "fringecell-layout/1"
//! [[projector]]                        # as in recording.toml, but for the cameras
//! name = "proj1"
//! width_px = 1280
//! height_px = 720
//! sequence = [{ set = "sine", axis = "x", period_px = 28.0, steps = 12 }]
//! [[projector.camera]]
//! name = "left"
//! files = "L/{n}.png"                  # {n}: the frame's number; {nn}, {nnn}: with at least two, three digits
//! first = 1                            # the number of the first frame; default 0
//! every = 2                            # frames of several views take turns in one series: each second number; default 1
//! # or: files = "{s}_{ii}.png"         # {s}: number of the set, {i}: of the frame in its set, from first_set and first_step (0)
//! channel = "green"                    # of colour pictures: red, green, blue or luminance; default grey; a list: one per frame
//! mosaic = "rggb"                      # the files are raw pictures behind a mosaic of colour filters
//! # raw = { width_px = 1280, height_px = 1024, pixel_format = "Mono12p" }   # files without a header
//! # or: list = ["a.bmp", "b.bmp", …]   # one file per frame, in order of projection
//! [rig]                                # optional
//! opencv = "stereo_params.yaml"
//! view = [
//!   { name = "left", width_px = 1280, height_px = 1024, matrix = "Kl", distortion = "Dl" },
//!   { name = "right", width_px = 1280, height_px = 1024, matrix = "Kr", distortion = "Dr", rotation = "R", translation = "T" },
//! ]
//! pair = [{ name = "pair1", left = "left", right = "right", projector = "proj1" }]
//! ```
//! Paths are relative to the source folder. A view without pose is the world frame; the others have
//! X_view = R X_world + T. Grey PNG and TIFF frames are taken as they are; BMP, JPEG, PGM and channels of
//! colour pictures become PNG.

use crate::image_file::Channel;
use crate::mosaic::Mosaic;
use crate::opencv::ViewKeys;
use crate::raw_image::RawImage;
use fringe::pattern::PatternSet;
use serde::Deserialize;

/// Value of `format` in a layout.
pub const LAYOUT_FORMAT: &str = "fringecell-layout/1";

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RawLayout {
    #[serde(rename = "format")]
    _format: String,
    #[serde(default)]
    pub projector: Vec<RawProjector>,
    pub rig: Option<RawRig>,
    #[serde(default)]
    pub provenance: toml::Table,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RawProjector {
    pub name: String,
    pub width_px: u32,
    pub height_px: u32,
    pub sequence: Vec<PatternSet>,
    pub camera: Vec<RawCamera>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RawCamera {
    pub name: String,
    pub files: Option<String>,
    pub first: Option<usize>,
    pub list: Option<Vec<String>>,
    pub full_scale_dn: Option<u16>,
    #[serde(default)]
    pub channel: Channels,
    pub mosaic: Option<Mosaic>,
    pub every: Option<usize>,
    pub first_set: Option<usize>,
    pub first_step: Option<usize>,
    pub raw: Option<RawImage>,
}

/// One channel of all frames, or one of each.
#[derive(Debug, Deserialize)]
#[serde(untagged)]
pub enum Channels {
    All(Channel),
    Each(Vec<Channel>),
}

impl Default for Channels {
    fn default() -> Self {
        Self::All(Channel::default())
    }
}

impl Channels {
    /// The channel of a frame, by its number in the series.
    pub fn of(&self, frame: usize) -> Channel {
        match self {
            Self::All(channel) => *channel,
            Self::Each(list) => list.get(frame).copied().unwrap_or_default(),
        }
    }
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RawRig {
    pub opencv: String,
    pub view: Vec<ViewKeys>,
    #[serde(default)]
    pub pair: Vec<RawPair>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RawPair {
    pub name: String,
    pub left: String,
    pub right: String,
    #[serde(default)]
    pub projector: String,
}
