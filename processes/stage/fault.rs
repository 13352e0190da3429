//! Why a stage cannot go on, and how it says so.

use ipc::IpcError;

/// Why a stage cannot go on.
#[derive(Debug)]
pub enum Fault {
    /// This cycle is lost, the stage is well.
    Cycle(String),
    /// The stage has to end.
    Fatal(anyhow::Error),
}

impl From<IpcError> for Fault {
    fn from(error: IpcError) -> Self {
        match error {
            IpcError::Full { .. } | IpcError::NotReached { .. } | IpcError::Message { .. } => {
                Self::Cycle(chain(&error))
            }
            _ => Self::Fatal(error.into()),
        }
    }
}

/// An error with all its sources in one line.
pub fn chain(error: &dyn std::error::Error) -> String {
    let mut text = error.to_string();
    let mut source = error.source();
    while let Some(inner) = source {
        let said = inner.to_string();
        if !text.contains(&said) {
            text.push_str(": ");
            text.push_str(&said);
        }
        source = inner.source();
    }
    text
}

/// The cycle is lost because of an error.
pub fn lost(error: &dyn std::error::Error) -> Fault {
    Fault::Cycle(chain(error))
}
