//! The only file that speaks to bincode.

use serde::Serialize;
use serde::de::DeserializeOwned;

/// Longest header or entry, bytes: a million activations fit. A damaged length cannot make the reader allocate more.
const LIMIT_BYTES: usize = 1 << 26;

fn config() -> bincode::config::Configuration<
    bincode::config::LittleEndian,
    bincode::config::Varint,
    bincode::config::Limit<LIMIT_BYTES>,
> {
    bincode::config::standard().with_limit::<LIMIT_BYTES>()
}

/// A value as bytes.
pub(super) fn encode<T: Serialize>(value: &T) -> Result<Vec<u8>, String> {
    bincode::serde::encode_to_vec(value, config()).map_err(|error| error.to_string())
}

/// A value from exactly these bytes.
pub(super) fn decode<T: DeserializeOwned>(bytes: &[u8]) -> Result<T, String> {
    let (value, used) = bincode::serde::decode_from_slice(bytes, config()).map_err(|e| e.to_string())?;
    if used == bytes.len() { Ok(value) } else { Err(format!("{} bytes are left over", bytes.len() - used)) }
}
