//! The schemas of `docs/schemas` are those of what the programs write. Every other test that runs `fringetool … --json` checks
//! its output as well, see `support::fringetool`.

use crate::schema::{assert_valid, command_of, faults, schema, unknown_keywords};
use crate::support::{Small, fringetool, root};
use serde_json::{Value, json};
use std::path::Path;

/// All schemas by the name of their command.
fn all() -> Vec<(String, Value)> {
    let entries = std::fs::read_dir(root().join("docs/schemas")).unwrap();
    let names = entries.map(|entry| entry.unwrap().file_name().into_string().unwrap());
    let names = names.filter_map(|name| Some(name.strip_suffix(".schema.json")?.to_owned()));
    names.map(|name| (name.clone(), schema(&name).unwrap())).collect()
}

/// Subcommands that the help lists.
fn subcommands(of: &[&str]) -> Vec<String> {
    let help = fringetool(&[of, &["--help"]].concat()).expect_success().stdout;
    let Some((_, list)) = help.split_once("Commands:\n") else { return Vec::new() };
    let lines = list.lines().take_while(|line| !line.is_empty()).filter(|line| line.starts_with("  "));
    let name = |line: &str| line.split_whitespace().next().unwrap_or_default().to_owned();
    lines.filter(|line| !line.starts_with("   ")).map(name).filter(|name| name != "help").collect()
}

#[test]
fn every_command_that_writes_json_has_a_schema() {
    let mut commands = Vec::new();
    for name in subcommands(&[]) {
        let nested = subcommands(&[&name]);
        if nested.is_empty() {
            commands.push(vec![name]);
        } else {
            commands.extend(nested.into_iter().map(|inner| vec![name.clone(), inner]));
        }
    }
    assert!(commands.len() > 30, "{commands:?}");
    for command in commands {
        let words: Vec<&str> = command.iter().map(String::as_str).collect();
        let help = fringetool(&[&words[..], &["--help"]].concat()).stdout;
        if let (true, Some(name)) = (help.contains("--json"), command_of(&words)) {
            // The element of `fit` is an argument, not a command.
            let group = format!("{name}-");
            let known = all().iter().any(|(known, _)| *known == name || known.starts_with(&group));
            assert!(known, "docs/schemas has no schema of {name}");
        }
    }
}

/// A schema that allows everything would prove nothing.
#[test]
fn every_schema_says_what_it_means_and_only_what_is_checked() {
    for (name, schema) in all() {
        assert_eq!(unknown_keywords(&schema), Vec::<String>::new(), "{name}");
        assert_eq!(schema["$schema"], "https://json-schema.org/draft/2020-12/schema", "{name}");
        assert!(schema["required"].as_array().is_some_and(|keys| !keys.is_empty()), "{name}");
        for key in schema["required"].as_array().unwrap() {
            let own = &schema["properties"][key.as_str().unwrap()];
            assert!(own["description"].is_string(), "{name}: {key} is not described");
            assert!(!own["type"].is_null() || !own["enum"].is_null(), "{name}: {key} has no type");
        }
        assert!(!faults(&schema, &json!({})).is_empty(), "{name} accepts an empty object");
    }
}

/// Keys below `schema` that are not described in three words or more, or have no type.
fn undescribed(schema: &Value, place: &str, found: &mut Vec<String>) {
    for (key, own) in schema["properties"].as_object().into_iter().flatten() {
        let place = format!("{place}.{key}");
        if own["description"].as_str().is_none_or(|text| text.split_whitespace().count() < 3) {
            found.push(format!("{place}: description {}", own["description"]));
        }
        if own["type"].is_null() && own["enum"].is_null() {
            found.push(format!("{place}: no type"));
        }
        if own["type"] == "array" && own["items"].is_null() {
            found.push(format!("{place}: no type of its items"));
        }
        undescribed(own, &place, found);
    }
    for inner in [&schema["items"], &schema["additionalProperties"]] {
        if inner.is_object() {
            undescribed(inner, place, found);
        }
    }
}

#[test]
fn every_key_of_a_schema_has_a_description_and_a_type() {
    let mut found = Vec::new();
    for (name, schema) in all() {
        undescribed(&schema, &name, &mut found);
    }
    assert!(found.is_empty(), "{}", found.join("\n"));
}

/// Each required key taken away, and each value replaced by one of another type, must be noticed.
fn damage_is_noticed(name: &str, file: &Path) {
    assert_valid(name, file);
    let (schema, good) = (schema(name).unwrap(), std::fs::read_to_string(file).unwrap());
    let good: Value = serde_json::from_str(&good).unwrap();
    for key in schema["required"].as_array().unwrap().iter().map(|key| key.as_str().unwrap()) {
        let mut bad = good.clone();
        bad.as_object_mut().unwrap().remove(key);
        assert!(!faults(&schema, &bad).is_empty(), "{name} without {key} is accepted");
        bad[key] = if good[key].is_boolean() { json!("wrong") } else { json!(true) };
        assert!(!faults(&schema, &bad).is_empty(), "{name} with another {key} is accepted");
    }
}

#[test]
fn a_damaged_output_is_refused() {
    let small = Small::new();
    let (cloud, json) = (small.path("cloud.ply"), small.path("out.json"));
    small.reconstruct(&["--json", &json]).expect_success();
    damage_is_noticed("reconstruct", json.as_ref());
    let value: Value = serde_json::from_str(&std::fs::read_to_string(&json).unwrap()).unwrap();
    assert_eq!(value["provenance"]["software"], "fringetool");
    assert_eq!(value["provenance"]["rig_sha256"].as_str().map(str::len), Some(64), "{value}");
    let plan = root().join("configs/complex-artefact.plan.toml");
    // The small cloud need not pass; the result is written all the same.
    fringetool(&["measure", plan.to_str().unwrap(), &cloud, "--json", &json]);
    damage_is_noticed("measure", json.as_ref());
    let mut value: Value = serde_json::from_str(&std::fs::read_to_string(&json).unwrap()).unwrap();
    assert_eq!(value["provenance"]["plan_sha256"].as_str().map(str::len), Some(64), "{value}");
    let schema = schema("measure").unwrap();
    for (key, bad) in [("verdict", json!("perhaps")), ("unit", json!("inch")), ("value", json!("1.5"))] {
        let good = value["features"][0][key].take();
        value["features"][0][key] = bad;
        assert_eq!(faults(&schema, &value).len(), 1, "{key}");
        value["features"][0][key] = good;
    }
    value["provenance"]["date"] = json!("yesterday");
    assert_eq!(faults(&schema, &value).len(), 1);
}
