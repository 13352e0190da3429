//! Which bytes a cycle record keeps.

use serde::{Deserialize, Serialize};
use std::fmt;
use std::str::FromStr;

/// Which bytes a cycle record keeps beside the hashes.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum Retention {
    /// None: the driver can give the same frames again (a recording, the digital twin).
    #[default]
    Hashes,
    /// The bytes of all frames.
    Frames,
    /// All frames and all stage outputs.
    All,
}

impl fmt::Display for Retention {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Hashes => "hashes",
            Self::Frames => "frames",
            Self::All => "all",
        })
    }
}

impl FromStr for Retention {
    type Err = String;

    fn from_str(word: &str) -> Result<Self, String> {
        match word {
            "hashes" => Ok(Self::Hashes),
            "frames" => Ok(Self::Frames),
            "all" => Ok(Self::All),
            other => Err(format!("\"{other}\" is not one of hashes, frames, all")),
        }
    }
}
