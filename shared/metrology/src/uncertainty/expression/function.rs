//! Functions that formulas may call.

use crate::uncertainty::function::{FUNCTIONS, Function};

/// A function of several arguments.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Builtin {
    Atan2,
    Distance,
    DirectionCosine,
    PlaneAngle,
    LengthAt20,
}

const BUILTINS: [(&str, Builtin); 5] = [
    ("atan2", Builtin::Atan2),
    ("distance", Builtin::Distance),
    ("direction_cosine", Builtin::DirectionCosine),
    ("plane_angle", Builtin::PlaneAngle),
    ("length_at_20", Builtin::LengthAt20),
];

impl Builtin {
    /// Most arguments that one takes.
    pub const MAX_ARITY: usize = 6;

    /// Number of arguments of the function.
    pub fn arity(self) -> usize {
        match self {
            Self::Atan2 => 2,
            Self::LengthAt20 => 3,
            Self::Distance | Self::DirectionCosine | Self::PlaneAngle => 6,
        }
    }
}

/// What a name before a parenthesis calls.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Callable {
    One(Function),
    Several(Builtin),
}

impl Callable {
    pub fn arity(self) -> usize {
        match self {
            Self::One(_) => 1,
            Self::Several(builtin) => builtin.arity(),
        }
    }
}

/// The function of a name.
pub fn callable(name: &str) -> Option<Callable> {
    let one = FUNCTIONS.iter().find(|(known, _)| *known == name).map(|(_, f)| Callable::One(*f));
    one.or_else(|| BUILTINS.iter().find(|(known, _)| *known == name).map(|(_, b)| Callable::Several(*b)))
}

/// Whether a name is a function's.
pub fn known(name: &str) -> bool {
    callable(name).is_some()
}

/// All names, for a message.
pub fn names() -> String {
    let all: Vec<&str> = FUNCTIONS.iter().map(|(n, _)| *n).chain(BUILTINS.iter().map(|(n, _)| *n)).collect();
    all.join(", ")
}
