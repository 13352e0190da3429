//! Lists of a document that have more values than are read.

use crate::culprit::{blamed, refusal};
use serde::de::DeserializeOwned;
use toml::{Table, Value};

/// The list that has more values than `T` takes, and what is wrong with it.
pub fn surplus<T: DeserializeOwned>(text: &str) -> Option<(String, String)> {
    let document: Table = text.parse().ok()?;
    let message = refusal::<T>(&document).filter(|message| message.contains("fewer elements in array"))?;
    let key = blamed(&document, &refusal::<T>).or_else(|| outside_lists(&document, &refusal::<T>));
    Some((key.unwrap_or_default(), message))
}

/// The key that is `refused` where no table of a list is to blame.
fn outside_lists(document: &Table, refused: &dyn Fn(&Table) -> Option<String>) -> Option<String> {
    let message = refused(document);
    let explains = |key: &&String| {
        let mut without = document.clone();
        without.remove(*key);
        refused(&without) != message
    };
    let key = document.keys().find(explains)?;
    let Value::Table(inner) = &document[key] else { return Some(key.clone()) };
    let within = |table: &Table| {
        let mut other = document.clone();
        other.insert(key.clone(), Value::Table(table.clone()));
        refused(&other)
    };
    Some(outside_lists(inner, &within).map_or(key.clone(), |inner| format!("{key}.{inner}")))
}

#[cfg(test)]
mod tests {
    use crate::document::Document;
    use serde::Deserialize;

    /// Proves: a list with too many values is refused by name and line, at the top and in a table of a list; other lists are read.
    #[test]
    fn a_list_with_a_value_too_many_is_named() {
        #[derive(Debug, Deserialize)]
        struct Pairs {
            pair: [f64; 2],
            table: Table,
            one: Vec<One>,
        }
        #[derive(Debug, Deserialize)]
        struct Table {
            two: [u32; 2],
        }
        #[derive(Debug, Deserialize)]
        struct One {
            triple: [f64; 3],
            any: Vec<f64>,
        }
        let text = |pair: &str, two: &str, triple: &str| {
            format!(
                "pair = [{pair}]\ntable.two = [{two}]\n[[one]]\ntriple = [0, 0, 0]\nany = []\n[[one]]\ntriple = [{triple}]\nany = [1, inf, 3]\n"
            )
        };
        let read = |pair: &str, two: &str, triple: &str| {
            Document { path: "demo.toml".into(), text: text(pair, two, triple) }.parse_bare::<Pairs>("f/1")
        };
        let read_as = read("1, 2", "1, 2", "1, 2, 3").unwrap();
        assert_eq!(
            (read_as.pair, read_as.table.two, read_as.one[1].triple, read_as.one[1].any.len()),
            ([1.0, 2.0], [1, 2], [1.0, 2.0, 3.0], 3)
        );
        for (pair, two, triple, place) in [
            ("1, 2, 3", "1, 2", "1, 2, 3", "demo.toml:1: pair: "),
            ("1, 2", "1, 2, 3", "1, 2, 3", "demo.toml:2: table.two: "),
            ("1, 2", "1, 2", "1, 2, 3, 4", "demo.toml:7: one[1].triple: "),
        ] {
            let error = read(pair, two, triple).unwrap_err().to_string();
            assert!(error.starts_with(place) && error.contains("take out what is too much"), "{error}");
        }
    }
}
