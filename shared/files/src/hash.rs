//! SHA-256 as files name it.

use crate::document::read_bytes;
use crate::error::FileError;
use hmac::{Hmac, KeyInit, Mac};
use sha2::{Digest, Sha256};
use std::fmt::Write as _;
use std::path::Path;

/// Largest cloud that is hashed, bytes.
const CLOUD_LIMIT_BYTES: u64 = 1 << 34;

/// SHA-256 of bytes, 64 lower-case hexadecimal digits.
pub fn sha256_hex(bytes: &[u8]) -> String {
    hex(&Sha256::digest(bytes))
}

/// SHA-256 of the file of a cloud or of what it is compared with.
///
/// # Errors
/// Absent, not a file, or longer than 16 GiB.
pub fn cloud_sha256_hex(path: &Path) -> Result<String, FileError> {
    Ok(sha256_hex(&read_bytes(path, CLOUD_LIMIT_BYTES)?))
}

/// HMAC with SHA-256 (RFC 2104) of bytes under a key, 64 lower-case hexadecimal digits.
pub fn hmac_sha256_hex(key: &[u8], bytes: &[u8]) -> String {
    // HMAC takes keys of any length; the error type is there for other codes.
    Hmac::<Sha256>::new_from_slice(key).map_or_else(
        |_| String::new(),
        |mut code| {
            code.update(bytes);
            hex(&code.finalize().into_bytes())
        },
    )
}

fn hex(bytes: &[u8]) -> String {
    bytes.iter().fold(String::with_capacity(2 * bytes.len()), |mut text, byte| {
        let _ = write!(text, "{byte:02x}");
        text
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_published_test_vectors() {
        // RFC 4231, test case 2.
        assert_eq!(
            hmac_sha256_hex(b"Jefe", b"what do ya want for nothing?"),
            "5bdcc146bf60754e6a042426089575c75a003f089d2739839dec58b964ec3843"
        );
        assert_eq!(sha256_hex(b"abc"), "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad");
    }
}
