//! The channel of a colour picture that is the frame.

use crate::error::{FileError, Problem};
use std::path::Path;

/// Which part of a colour picture is the frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, serde::Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Channel {
    /// The picture is grey: its channels, if there are several, are equal.
    #[default]
    Grey,
    /// The first of three channels.
    Red,
    /// The second of three channels.
    Green,
    /// The third of three channels.
    Blue,
    /// 0.299 red + 0.587 green + 0.114 blue (Rec. 601), for a camera of colours in white light.
    Luminance,
}

impl Channel {
    /// All, with their names in a layout and on a command line.
    pub const NAMES: [(&'static str, Self); 5] = [
        ("grey", Self::Grey),
        ("red", Self::Red),
        ("green", Self::Green),
        ("blue", Self::Blue),
        ("luminance", Self::Luminance),
    ];

    /// The channel of a name.
    pub fn by_name(name: &str) -> Option<Self> {
        Self::NAMES.iter().find(|(known, _)| *known == name).map(|(_, channel)| *channel)
    }
}

/// The frame among the channels of a picture, which may have `colour` and opacity (`alpha`); of a grey picture always its only one.
///
/// # Errors
/// A coloured picture where a grey one is expected.
pub(crate) fn plane<T: PartialEq + Copy + Into<u32> + TryFrom<u32>>(
    path: &Path,
    values: Vec<T>,
    (colour, alpha): (bool, bool),
    channel: Channel,
) -> Result<Vec<T>, FileError> {
    let stride = if colour { 3 } else { 1 } + usize::from(alpha);
    if stride == 1 {
        return Ok(values);
    }
    let pixels = values.chunks_exact(stride);
    if !colour {
        return Ok(pixels.map(|pixel| pixel[0]).collect());
    }
    let one = |index: usize| values.chunks_exact(stride).map(|pixel| pixel[index]).collect();
    match channel {
        Channel::Red => Ok(one(0)),
        Channel::Green => Ok(one(1)),
        Channel::Blue => Ok(one(2)),
        Channel::Luminance => {
            // A mean of values of T is one of its values.
            let mean = |p: &[T]| (299 * p[0].into() + 587 * p[1].into() + 114 * p[2].into() + 500) / 1000;
            Ok(pixels.map(|p| T::try_from(mean(p)).unwrap_or(p[1])).collect())
        }
        Channel::Grey if pixels.clone().all(|p| p[0] == p[1] && p[1] == p[2]) => Ok(one(0)),
        Channel::Grey => {
            let problem = Problem::Unsupported("is a colour image".into());
            let remedy = "record with a monochrome camera, or import it with channel = \"green\" (or red, blue, luminance)";
            Err(FileError::new(path, problem, remedy))
        }
    }
}
