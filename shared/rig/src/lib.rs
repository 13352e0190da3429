//! Files of the cell: the only crate that touches disk and environment.
