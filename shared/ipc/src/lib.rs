//! Shared-memory transport: the only crate that speaks to iceoryx2.
