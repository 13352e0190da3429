//! Every file format of the cell: the only crate that reads and writes them.
//!
//! Every reader checks what it reads and names file, line, key, value, limit and remedy ([`error::FileError`]); every
//! writer leaves a complete file or none ([`atomic`]).

pub mod acceptance_file;
pub mod atomic;
pub mod budget;
pub mod bundled;
pub mod calibration_shares;
pub mod clock;
pub mod cloud_pairs;
pub mod cmm;
pub mod config;
pub mod correction;
pub mod csv_table;
mod culprit;
pub mod cycle_record;
pub mod document;
pub mod e57_file;
pub mod error;
mod float_tiff;
pub mod footprints_off;
pub mod foreign_rig;
pub mod guard;
pub mod hash;
mod image_channel;
pub mod image_file;
pub mod import;
pub mod kind;
pub mod memory;
pub mod mesh_file;
pub mod mosaic;
pub mod name;
pub mod npy;
pub mod opencv;
pub mod output_check;
pub mod part_store;
pub mod pattern_files;
pub mod plan_file;
pub mod plane_file;
pub mod ply;
pub mod point_lists;
pub mod provenance;
pub mod raw_image;
pub mod recording;
pub mod result;
pub mod rig_file;
pub mod rims_left_out;
pub mod scene_file;
pub mod sealed;
mod sequence;
pub mod stage_file;
pub mod step_file;
pub mod surface_file;
mod surplus;
pub mod target_file;
#[cfg(test)]
mod testing;
pub mod trace;
pub mod trend;
pub mod viewpoints;
