//! Digital twin: scenes, ray casting, sensor and projector models.
