//! The arguments of a method call: their number and types are checked, and each wrong one is named in the answer.

use opcua::types::{StatusCode, Variant};

/// Arguments that are read one after the other.
pub struct Arguments<'a> {
    left: std::slice::Iter<'a, Variant>,
    results: Vec<StatusCode>,
}

impl<'a> Arguments<'a> {
    /// Of a call of a method with so many arguments.
    ///
    /// # Errors
    /// There are fewer or more.
    pub fn new(all: &'a [Variant], count: usize) -> Result<Self, StatusCode> {
        match all.len() {
            given if given < count => Err(StatusCode::BadArgumentsMissing),
            given if given > count => Err(StatusCode::BadTooManyArguments),
            _ => Ok(Self { left: all.iter(), results: Vec::new() }),
        }
    }

    fn take<T>(&mut self, read: impl FnOnce(&Variant) -> Option<T>) -> Option<T> {
        let value = self.left.next().and_then(read);
        self.results.push(if value.is_some() { StatusCode::Good } else { StatusCode::BadTypeMismatch });
        value
    }

    /// A structure; the empty one where a client sends none.
    pub fn structure<T: Clone + Default + Send + Sync + 'static>(&mut self) -> T {
        let read = |value: &Variant| match value {
            Variant::Empty => Some(T::default()),
            Variant::ExtensionObject(object) if object.is_null() => Some(T::default()),
            Variant::ExtensionObject(object) => object.inner_as::<T>().cloned(),
            _ => None,
        };
        self.take(read).unwrap_or_default()
    }

    /// A number with sign.
    pub fn int32(&mut self) -> i32 {
        let read = |value: &Variant| match value {
            Variant::Int32(value) => Some(*value),
            _ => None,
        };
        self.take(read).unwrap_or_default()
    }

    /// A number without sign.
    pub fn uint32(&mut self) -> u32 {
        let read = |value: &Variant| match value {
            Variant::UInt32(value) => Some(*value),
            _ => None,
        };
        self.take(read).unwrap_or_default()
    }

    /// A text; empty where a client sends none.
    pub fn text(&mut self) -> String {
        let read = |value: &Variant| match value {
            Variant::Empty => Some(String::new()),
            Variant::String(text) => Some(text.as_ref().to_owned()),
            _ => None,
        };
        self.take(read).unwrap_or_default()
    }

    /// How many values an array of any type has; none where a client sends none.
    pub fn array_length(&mut self) -> usize {
        let read = |value: &Variant| match value {
            Variant::Empty => Some(0),
            Variant::Array(array) => Some(array.values.len()),
            _ => None,
        };
        self.take(read).unwrap_or_default()
    }

    /// Whether all were of their types.
    ///
    /// # Errors
    /// A status for each argument.
    pub fn check(self) -> Result<(), Vec<StatusCode>> {
        if self.results.iter().all(StatusCode::is_good) { Ok(()) } else { Err(self.results) }
    }
}
