//! How an output of the replay differs from the recorded one.

use files::cycle_record::{ActivationEntry, ActivationName};
use ipc::output_hash;
use serde::Serialize;
use std::fmt;

/// An output that differs.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Difference {
    /// Counter of the cycle, from 0; people see it from 1.
    pub cycle: u64,
    /// Name of the stage.
    pub stage: String,
    /// Label of the activation.
    pub activation: String,
    /// Topic of the output; absent when nothing leaves the stage.
    pub output: Option<String>,
    /// Bytes in the record.
    pub recorded_bytes: u64,
    /// Bytes now; absent when the step failed.
    pub replayed_bytes: Option<u64>,
    /// First byte that differs, from 0; absent when the record holds no bytes of it.
    pub first_byte: Option<u64>,
    /// That byte as recorded, and now; absent beyond an end.
    pub byte: Option<[Option<u8>; 2]>,
    /// Why the step failed.
    pub error: Option<String>,
}

/// The hash of an output, as stages report it.
pub fn hash(bytes: &[u8]) -> [u64; 2] {
    let hash = output_hash(bytes);
    [(hash >> 64) as u64, hash as u64]
}

impl Difference {
    /// The difference, if there is one. `kept`: the recorded bytes, where the record holds them.
    pub fn between(
        cycle: u64,
        name: &ActivationName,
        recorded: &ActivationEntry,
        kept: Option<&[u8]>,
        bytes: &[u8],
    ) -> Option<Self> {
        if hash(bytes) == recorded.hash && bytes.len() as u64 == recorded.bytes {
            return None;
        }
        let first = kept.map(|kept| {
            let equal = kept.iter().zip(bytes).take_while(|(a, b)| a == b).count();
            (equal, [kept.get(equal).copied(), bytes.get(equal).copied()])
        });
        Some(Self {
            cycle,
            stage: name.stage.clone(),
            activation: name.label.clone(),
            output: name.output.clone(),
            recorded_bytes: recorded.bytes,
            replayed_bytes: Some(bytes.len() as u64),
            first_byte: first.map(|(at, _)| at as u64),
            byte: first.map(|(_, pair)| pair),
            error: None,
        })
    }

    /// A step that gave something when it was recorded and fails now.
    pub fn failed(cycle: u64, name: &ActivationName, error: String) -> Self {
        Self {
            cycle,
            stage: name.stage.clone(),
            activation: name.label.clone(),
            output: name.output.clone(),
            recorded_bytes: 0,
            replayed_bytes: None,
            first_byte: None,
            byte: None,
            error: Some(error),
        }
    }
}

impl fmt::Display for Difference {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "cycle {}: stage {}, \"{}\": ", self.cycle + 1, self.stage, self.activation)?;
        if let Some(error) = &self.error {
            return write!(f, "fails now: {error}");
        }
        let replayed = self.replayed_bytes.unwrap_or_default();
        match (self.first_byte, self.byte) {
            (Some(at), Some([recorded, now])) => {
                let word = |byte: Option<u8>| byte.map_or("the end".to_owned(), |b| format!("{b:02x}"));
                write!(
                    f,
                    "byte {at} of {} is the first that differs: {} in the record, {} now",
                    self.recorded_bytes,
                    word(recorded),
                    word(now)
                )
            }
            _ if replayed == self.recorded_bytes => write!(f, "the hash of {replayed} bytes differs"),
            _ => write!(f, "{} bytes in the record, {replayed} now", self.recorded_bytes),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn entry(bytes: &[u8]) -> ActivationEntry {
        let (length, hash) = (bytes.len() as u64, hash(bytes));
        ActivationEntry { activation: 0, bytes: length, hash, count: 0, wait_ns: 0, start_ns: 0, end_ns: 0 }
    }

    fn between(recorded: &[u8], kept: bool, now: &[u8]) -> Option<String> {
        let name = ActivationName { stage: "s".into(), label: "work".into(), output: None };
        let kept = kept.then_some(recorded);
        Difference::between(4, &name, &entry(recorded), kept, now).map(|d| d.to_string())
    }

    #[test]
    fn equal_bytes_do_not_differ_and_others_name_the_first_byte() {
        assert_eq!(between(b"abc", true, b"abc"), None);
        let said = between(b"abc", true, b"aBC").unwrap();
        assert_eq!(
            said,
            "cycle 5: stage s, \"work\": byte 1 of 3 is the first that differs: 62 in the record, 42 now"
        );
        assert!(between(b"abc", true, b"ab").unwrap().contains("63 in the record, the end now"));
        assert!(between(b"abc", false, b"ab").unwrap().ends_with("3 bytes in the record, 2 now"));
        assert!(between(b"abc", false, b"abd").unwrap().ends_with("the hash of 3 bytes differs"));
    }
}
