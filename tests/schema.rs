//! Checks JSON against the schemas of `docs/schemas`, as far as they use JSON Schema (draft 2020-12).
//!
//! The maintained validators of crates.io bring some fifty further crates, Unicode tables among them, for a test. The keywords
//! that the schemas use are few; [`unknown_keywords`] refuses any other, so that none is passed over in silence.

use crate::support::root;
use serde_json::Value;
use std::path::Path;

/// Keywords that [`faults`] checks.
const CHECKED: [&str; 12] = [
    "type",
    "anyOf",
    "enum",
    "required",
    "properties",
    "additionalProperties",
    "items",
    "minItems",
    "maxItems",
    "minLength",
    "maxLength",
    "format",
];

/// Keywords that only explain.
const EXPLAINING: [&str; 3] = ["$schema", "title", "description"];

/// The schema of a command such as `fit-sphere`.
pub fn schema(command: &str) -> Option<Value> {
    let path = root().join(format!("docs/schemas/{command}.schema.json"));
    let text = std::fs::read_to_string(path).ok()?;
    Some(serde_json::from_str(&text).unwrap_or_else(|error| panic!("schema of {command}: {error}")))
}

/// Fails the test where a file is not what its schema states.
pub fn assert_valid(command: &str, file: &Path) {
    let text = std::fs::read_to_string(file).unwrap_or_else(|error| panic!("{}: {error}", file.display()));
    let value = serde_json::from_str(&text).unwrap_or_else(|error| panic!("{}: {error}", file.display()));
    let schema = schema(command).unwrap_or_else(|| panic!("docs/schemas has no schema of {command}"));
    let found = faults(&schema, &value);
    assert!(found.is_empty(), "{command}: {}\n{}", file.display(), found.join("\n"));
}

/// The command whose schema the output of these arguments follows; `None` where it has none (benchmarks).
pub fn command_of(arguments: &[&str]) -> Option<String> {
    match arguments {
        ["bench", ..] | [] => None,
        [group @ ("fit" | "rotation-stage" | "reference-plane"), name, ..] => Some(format!("{group}-{name}")),
        [command, ..] => Some((*command).to_owned()),
    }
}

/// What is wrong with a value, a line for each fault.
pub fn faults(schema: &Value, value: &Value) -> Vec<String> {
    let mut found = Vec::new();
    check(schema, value, "$", &mut found);
    found
}

fn check(schema: &Value, value: &Value, place: &str, found: &mut Vec<String>) {
    let allowed = |kind: &Value| kind.as_str().is_some_and(|kind| is_of(kind, value));
    let typed = match &schema["type"] {
        Value::Null => true,
        Value::Array(kinds) => kinds.iter().any(allowed),
        kind => allowed(kind),
    };
    if !typed {
        return found.push(format!("{place}: {value} is not of type {}", schema["type"]));
    }
    if schema["enum"].as_array().is_some_and(|values| !values.contains(value)) {
        found.push(format!("{place}: {value} is none of {}", schema["enum"]));
    }
    if let Some(ways) = schema["anyOf"].as_array()
        && !ways.iter().any(|way| faults(way, value).is_empty())
    {
        found.push(format!("{place}: none of the alternatives {} holds", schema["anyOf"]));
    }
    match value {
        Value::Object(object) => {
            for key in schema["required"].as_array().into_iter().flatten().filter_map(Value::as_str) {
                if !object.contains_key(key) {
                    found.push(format!("{place}: the key {key} is missing"));
                }
            }
            for (key, member) in object {
                let own = schema["properties"].get(key).or_else(|| schema.get("additionalProperties"));
                if let Some(own) = own {
                    check(own, member, &format!("{place}.{key}"), found);
                }
            }
        }
        Value::Array(items) => {
            limits(schema, ["minItems", "maxItems"], items.len(), place, found);
            if let Some(own) = schema.get("items") {
                for (index, item) in items.iter().enumerate() {
                    check(own, item, &format!("{place}[{index}]"), found);
                }
            }
        }
        Value::String(text) => {
            limits(schema, ["minLength", "maxLength"], text.chars().count(), place, found);
            if schema["format"] == "date-time" && !is_date_time(text) {
                found.push(format!("{place}: {text:?} is no date and time"));
            }
        }
        _ => {}
    }
}

fn limits(schema: &Value, keys: [&str; 2], length: usize, place: &str, found: &mut Vec<String>) {
    let [least, most] = keys.map(|key| schema[key].as_u64());
    if least.is_some_and(|least| (length as u64) < least) || most.is_some_and(|most| (length as u64) > most) {
        found.push(format!("{place}: length {length}, allowed {least:?} to {most:?}"));
    }
}

fn is_of(kind: &str, value: &Value) -> bool {
    match kind {
        "null" => value.is_null(),
        "boolean" => value.is_boolean(),
        "integer" => value.is_i64() || value.is_u64() || value.as_f64().is_some_and(|v| v.fract() == 0.0),
        "number" => value.is_number(),
        "string" => value.is_string(),
        "array" => value.is_array(),
        "object" => value.is_object(),
        other => panic!("{other} is no type of JSON Schema"),
    }
}

/// Whether a text has the form `2026-01-31T08:00:00Z`.
fn is_date_time(text: &str) -> bool {
    let shape = "0000-00-00T00:00:00Z";
    text.len() == shape.len()
        && text.chars().zip(shape.chars()).all(|(c, s)| if s == '0' { c.is_ascii_digit() } else { c == s })
}

/// Keywords of a schema that nothing here checks.
pub fn unknown_keywords(schema: &Value) -> Vec<String> {
    let Some(object) = schema.as_object() else { return vec![format!("{schema} is no schema")] };
    let mut unknown = Vec::new();
    for (key, part) in object {
        match key.as_str() {
            "properties" => {
                unknown.extend(part.as_object().into_iter().flatten().flat_map(|(_, s)| unknown_keywords(s)));
            }
            "items" | "additionalProperties" => unknown.extend(unknown_keywords(part)),
            "anyOf" => unknown.extend(part.as_array().into_iter().flatten().flat_map(unknown_keywords)),
            key if CHECKED.contains(&key) || EXPLAINING.contains(&key) => {}
            other => unknown.push(other.to_owned()),
        }
    }
    unknown
}
