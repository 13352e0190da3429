//! Which key of a document is refused, where serde names only the first table of its list: it keeps no places within tables of several kinds.

use serde::de::DeserializeOwned;
use toml::{Table, Value};

/// What `T` refuses of a document, by the strictest reader at hand: TOML's own leaves out what a list has too much without a word.
pub fn refusal<T: DeserializeOwned>(table: &Table) -> Option<String> {
    let error = T::deserialize(json(Value::Table(table.clone()))).err()?;
    Some(error.to_string())
}

/// The same in JSON, which knows no infinity: any number may stand for it, since types and lengths are what is asked.
fn json(value: Value) -> serde_json::Value {
    match value {
        Value::String(text) => text.into(),
        Value::Integer(number) => number.into(),
        Value::Float(number) => if number.is_finite() { number } else { 0.0 }.into(),
        Value::Boolean(yes) => yes.into(),
        Value::Datetime(date) => date.to_string().into(),
        Value::Array(values) => values.into_iter().map(json).collect(),
        Value::Table(table) => table.into_iter().map(|(key, value)| (key, json(value))).collect(),
    }
}

/// The key that `T` refuses, such as `element[2].min_points`, or the table `element[2]` in which one is missing; `None` where no table of a list
/// is to blame.
pub fn culprit<T: DeserializeOwned>(text: &str) -> Option<String> {
    blamed(&text.parse().ok()?, &refusal::<T>)
}

/// The same, once for all types. `refused`: what is refused of a document.
pub fn blamed(document: &Table, refused: &dyn Fn(&Table) -> Option<String>) -> Option<String> {
    let message = refused(document)?;
    // Each table by itself, so that long lists are not read again for each of their keys.
    let mut alone = document.clone();
    alone.retain(|_, value| tables(value).is_none());
    if refused(&alone).as_ref() == Some(&message) {
        return None;
    }
    for (list, item, index) in document.iter().flat_map(|(list, value)| items(list, value)) {
        let refused_with = |item: Table| {
            let mut one = alone.clone();
            one.insert(list.to_owned(), Value::Array(vec![Value::Table(item)]));
            refused(&one)
        };
        if refused_with(item.clone()).as_ref() != Some(&message) {
            continue;
        }
        let place = format!("{list}[{index}]");
        let explains = |key: &&String| {
            let mut without = item.clone();
            without.remove(*key);
            refused_with(without).as_ref() != Some(&message)
        };
        // Without the key that names the kind of a table nothing else is read, which explains every message.
        let names_the_kind = |key: &str| {
            let mut other = item.clone();
            other.insert(key.to_owned(), Value::String("?".into()));
            refused_with(other).is_some_and(|message| message.starts_with("unknown variant"))
        };
        let missing = message.starts_with("missing field");
        let keys: Vec<&String> = item.keys().filter(|_| !missing).filter(explains).collect();
        let key = keys.iter().find(|key| !names_the_kind(key)).or(keys.first());
        return Some(key.map_or(place.clone(), |key| format!("{place}.{key}")));
    }
    None
}

/// The tables of a list.
fn tables(value: &Value) -> Option<&[Value]> {
    value.as_array().map(Vec::as_slice).filter(|all| all.iter().any(Value::is_table))
}

fn items<'a>(list: &'a str, value: &'a Value) -> impl Iterator<Item = (&'a str, &'a Table, usize)> {
    let all = tables(value).unwrap_or_default().iter().enumerate();
    all.filter_map(move |(index, item)| Some((list, item.as_table()?, index)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde::Deserialize;

    #[derive(Deserialize)]
    #[serde(deny_unknown_fields)]
    #[allow(dead_code, reason = "only whether they can be read is asked")]
    struct Plan {
        name: String,
        #[serde(default)]
        element: Vec<Element>,
    }

    #[derive(Deserialize)]
    #[serde(tag = "kind", rename_all = "kebab-case", deny_unknown_fields)]
    #[allow(dead_code, reason = "only whether they can be read is asked")]
    enum Element {
        Ball { size: f64, count: Option<usize> },
        Face { normal: [f64; 3] },
    }

    #[test]
    fn the_key_is_found_in_its_table() {
        let of = |more: &str| {
            culprit::<Plan>(&format!(
                "name = \"p\"\n[[element]]\nkind = \"face\"\nnormal = [0.0, 0.0, 1.0]\n[[element]]\n{more}"
            ))
        };
        let found = |key: &str| Some(format!("element[1]{key}"));
        assert_eq!(of("kind = \"ball\"\nsize = 1.0\ncount = 2e3"), found(".count"));
        assert_eq!(of("kind = \"ball\"\nsize = \"20\"\ncount = 3"), found(".size"));
        assert_eq!(of("kind = \"face\"\nnormal = [0.0, 1.0]"), found(".normal"));
        assert_eq!(of("kind = \"face\"\nnormal = [0.0, 1.0, 0.0]\nlarge = true"), found(".large"));
        assert_eq!(of("kind = \"cube\""), found(".kind"));
        assert_eq!(of("kind = \"ball\"\ncount = 3"), found(""));
        assert_eq!(of("kind = \"ball\"\nsize = 1.0"), None);
    }

    #[test]
    fn what_lies_in_no_list_is_left_to_the_message() {
        assert_eq!(culprit::<Plan>("name = 3\n[[element]]\nkind = \"ball\"\nsize = 1.0"), None);
        assert_eq!(culprit::<Plan>("name = "), None);
    }
}
