//! A simulated camera that speaks GigE Vision: any GenICam client finds it, sets it, triggers it and receives its frames.
//!
//! AIA, GigE Vision specification, versions 1.2 and 2.0; EMVA, GenICam Standard Features Naming Convention.

mod description;
mod device;
mod gvcp;
mod gvsp;
mod identity;
mod region;
pub(crate) mod registers;
mod server;

pub use identity::{Identity, Quirks};
pub use server::{Faults, FrameSource, Line, NoFrame, Pattern, Responder, Server};
