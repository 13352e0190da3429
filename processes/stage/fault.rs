//! Errors of a stage.

use ipc::IpcError;

/// An error of a stage.
#[derive(Debug)]
pub enum Fault {
    /// The current cycle fails; the stage continues.
    Cycle(String),
    /// The stage must end.
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
        let message = inner.to_string();
        if !text.contains(&message) {
            text.push_str(": ");
            text.push_str(&message);
        }
        source = inner.source();
    }
    text
}

/// The fault that ends the current cycle, with an error as its reason.
pub fn cycle_fault(error: &dyn std::error::Error) -> Fault {
    Fault::Cycle(chain(error))
}
