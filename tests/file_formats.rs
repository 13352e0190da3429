//! `docs/formats.md` against the parsers, through the programs: every key that a parser knows stands on the page, every key on
//! the page is known, and each complete example is read.

use crate::support::{Ran, Small, fringecell_in, fringetool_in, root};
use std::collections::BTreeSet;
use std::path::Path;
use tempfile::TempDir;
use toml::{Table, Value};

/// A key that no format has.
const STRANGER: &str = "zz_stranger";

/// Tables whose keys the parser does not list: `limits.SD` may also be a number, so any other table is refused as a whole.
const NOT_LISTED: [&str; 1] = ["limits.SD"];

/// How a section's file is read: its name, and the program with its arguments.
struct Reader {
    section: &'static str,
    file: &'static str,
    arguments: &'static [&'static str],
    /// What the program states of the complete example: nothing for exit code 0, else the file that a reader would have and the
    /// test has not.
    absent: Option<&'static str>,
}

const READERS: [Reader; 15] = [
    Reader {
        section: "Configuration",
        file: "cell.toml",
        arguments: &["schedule", "cell.toml"],
        absent: None,
    },
    Reader {
        section: "Rig",
        file: "rig.toml",
        arguments: &["export", "--rig", "rig.toml", "--out", "pairs.yml"],
        absent: None,
    },
    Reader {
        section: "Recording",
        file: "rec/recording.toml",
        arguments: &["decode", "rec"],
        absent: Some("frames/proj1/cam1"),
    },
    Reader {
        section: "Layout",
        file: "layout.toml",
        arguments: &["import", "layout.toml", "--from", ".", "--out", "imported"],
        absent: Some("L/1.png"),
    },
    Reader {
        section: "Target",
        file: "target.toml",
        arguments: &[
            "calibrate",
            "--target",
            "target.toml",
            "--out",
            "new.toml",
            "--images",
            "cam1=none*.png",
        ],
        absent: Some("none*.png"),
    },
    Reader {
        section: "Target with faces",
        file: "target.toml",
        arguments: &[
            "calibrate",
            "--target",
            "target.toml",
            "--out",
            "new.toml",
            "--images",
            "cam1=none*.png",
        ],
        absent: Some("none*.png"),
    },
    Reader {
        section: "Inspection plan",
        file: "plan.toml",
        arguments: &["cmm-plan", "part", "plan.toml", "--points", "25", "--out", "points.csv"],
        absent: None,
    },
    Reader {
        section: "Acceptance plan",
        file: "test.toml",
        arguments: &["vdi2634", "test.toml"],
        absent: Some("ball.ply"),
    },
    Reader {
        section: "Rule set",
        file: "rules.toml",
        arguments: &["vdi2634", "with-rules.toml"],
        absent: Some("ball.ply"),
    },
    Reader {
        section: "Budget",
        file: "budget.toml",
        arguments: &["uncertainty", "budget.toml"],
        absent: None,
    },
    Reader {
        section: "Scene",
        file: "scene.toml",
        arguments: &["simulate", "small.toml", "--scene", "scene.toml", "--out", "scene"],
        absent: None,
    },
    Reader {
        section: "Point lists",
        file: "points.toml",
        arguments: &["calibrate", "--points", "points.toml", "--out", "new.toml"],
        absent: Some("board.txt"),
    },
    Reader {
        section: "Pattern correction",
        file: "gamma.toml",
        arguments: &["simulate", "small.toml", "--pattern-correction", "gamma.toml", "--out", "corrected"],
        absent: None,
    },
    Reader {
        section: "Rotation stage",
        file: "stage.toml",
        arguments: &[
            "rotation-stage",
            "merge",
            "--stage",
            "stage.toml",
            "--view",
            "0=ball.ply",
            "--out",
            "all.ply",
        ],
        absent: Some("ball.ply"),
    },
    Reader {
        section: "Reference plane",
        file: "planes/reference-plane.toml",
        arguments: &["reference-plane", "measure", "small", "--calibration", "planes", "--out", "z.npy"],
        absent: Some("reference.npy"),
    },
];

/// One table of keys on the page.
#[derive(Debug)]
struct KeyTable {
    section: String,
    /// As in its heading: `projector[].sequence[]`, or "top level".
    path: String,
    /// `set = "sine"` of the heading, where tables of one path differ in their keys.
    variant: Option<(String, String)>,
    keys: BTreeSet<String>,
}

/// The page: its key tables, and the complete example of each section.
fn page() -> (Vec<KeyTable>, Vec<(String, Table)>) {
    let text = std::fs::read_to_string(root().join("docs/formats.md")).unwrap();
    let (mut tables, mut examples): (Vec<KeyTable>, Vec<(String, Table)>) = (Vec::new(), Vec::new());
    let (mut section, mut toml): (String, Option<String>) = (String::new(), None);
    for line in text.lines() {
        match (&mut toml, line) {
            (Some(_), "```") => {
                let text = toml.take().unwrap();
                examples.push((section.clone(), text.parse().unwrap_or_else(|e| panic!("{section}: {e}"))));
            }
            (Some(text), line) => text.extend([line, "\n"]),
            (None, "```toml") => toml = Some(String::new()),
            (None, line) => {
                if let Some(title) = line.strip_prefix("## ") {
                    title.clone_into(&mut section);
                } else if let Some(title) = line.strip_prefix("### ") {
                    tables.push(heading(&section, title));
                } else if let (Some(row), Some(table)) =
                    (line.strip_prefix("| ").filter(|row| row.starts_with('`')), tables.last_mut())
                    && table.section == section
                {
                    // The first cell has the key, and the other names that it may have.
                    let cell = row.split(" |").next().unwrap();
                    table.keys.extend(cell.split('`').skip(1).step_by(2).map(str::to_owned));
                }
            }
        }
    }
    (tables, examples)
}

fn heading(section: &str, title: &str) -> KeyTable {
    let mut quoted = title.split('`').skip(1).step_by(2);
    let path = quoted.next().unwrap_or(title).to_owned();
    let variant = quoted.next().and_then(|v| v.split_once(" = "));
    let variant = variant.map(|(key, value)| (key.to_owned(), value.trim_matches('"').to_owned()));
    KeyTable { section: section.to_owned(), path, variant, keys: BTreeSet::new() }
}

/// The tables of a document at a path.
fn at<'a>(table: &'a mut Table, path: &str) -> Vec<&'a mut Table> {
    let (step, rest) = path.split_once('.').map_or((path, None), |(step, rest)| (step, Some(rest)));
    let name = step.trim_end_matches("[]");
    let here: Vec<&mut Table> = match table.get_mut(name) {
        Some(Value::Table(inner)) => vec![inner],
        Some(Value::Array(items)) => items.iter_mut().filter_map(Value::as_table_mut).collect(),
        _ => Vec::new(),
    };
    match rest {
        Some(rest) => here.into_iter().flat_map(|inner| at(inner, rest)).collect(),
        None => here,
    }
}

/// The example with a key that no parser knows, in the table that the heading names.
fn with_stranger(table: &KeyTable, example: &Table) -> Option<String> {
    let mut document = example.clone();
    if table.path == "top level" {
        document.insert(STRANGER.into(), 1.into());
    } else {
        let fits = |inner: &&mut Table| {
            let is = |(key, value): &(String, String)| inner.get(key).and_then(Value::as_str) == Some(value);
            table.variant.as_ref().is_none_or(is)
        };
        at(&mut document, &table.path).into_iter().find(fits)?.insert(STRANGER.into(), 1.into());
    }
    Some(document.to_string())
}

/// The keys that a message about an unknown key lists.
fn known_keys(message: &str) -> Option<BTreeSet<String>> {
    let list = |rest: &str| {
        rest.split(", ").map(str::trim).filter(|key| !key.is_empty()).map(str::to_owned).collect()
    };
    if let Some((_, rest)) = message.split_once("known here: ") {
        return Some(list(rest.split(['\n', ';']).next()?));
    }
    let (_, rest) = message.split_once(&format!("unknown field `{STRANGER}`, "))?;
    let rest = rest.lines().next()?;
    Some(rest.split('`').skip(1).step_by(2).map(str::to_owned).collect())
}

/// A folder with the files that examples name.
fn folder() -> TempDir {
    let folder = TempDir::new().unwrap();
    let path = |name: &str| folder.path().join(name);
    for name in ["demo-rig.toml", "complex-artefact.plan.toml", "complex-artefact.scene.toml"] {
        std::fs::copy(root().join("configs").join(name), path(name)).unwrap();
    }
    std::fs::copy(root().join("configs/bracket/bracket.stl"), path("bracket.stl")).unwrap();
    std::fs::copy(root().join("tests/step/turned.step"), path("turned.step")).unwrap();
    let small = Small::new();
    let cell = std::fs::read_to_string(small.path("cell.toml")).unwrap();
    std::fs::write(path("small.toml"), cell.replace("rig = \"rig.toml\"", "rig = \"small-rig.toml\""))
        .unwrap();
    std::fs::copy(small.path("rig.toml"), path("small-rig.toml")).unwrap();
    std::os::unix::fs::symlink(small.folder.keep().join("rec"), path("small")).unwrap();
    for name in ["rec", "planes"] {
        std::fs::create_dir(path(name)).unwrap();
    }
    folder
}

fn read(folder: &Path, reader: &Reader, text: &str) -> Ran {
    std::fs::write(folder.join(reader.file), text).unwrap();
    match reader.arguments[0] {
        "schedule" => fringecell_in(folder, reader.arguments),
        _ => fringetool_in(folder, reader.arguments),
    }
}

#[test]
fn every_key_of_the_page_is_known_to_its_parser_and_the_other_way_round() {
    let (tables, examples) = page();
    let folder = folder();
    let example = |section: &str| &examples.iter().find(|(name, _)| name == section).unwrap().1;
    let mut with_rules = example("Acceptance plan").clone();
    with_rules.insert("rule_set".into(), "rules.toml".into());
    // Its own rules have no characteristic for a spacing.
    with_rules["limits"].as_table_mut().unwrap().remove("SD");
    std::fs::write(folder.path().join("with-rules.toml"), with_rules.to_string()).unwrap();
    let mut faults = Vec::new();
    for reader in &READERS {
        let example = example(reader.section);
        let ran = read(folder.path(), reader, &example.to_string());
        let read_it = match reader.absent {
            None => ran.code == Some(0),
            Some(absent) => ran.code == Some(2) && ran.stderr.contains(absent),
        };
        if !read_it {
            faults.push(format!("{}: the example is not read: {}{}", reader.section, ran.stdout, ran.stderr));
        }
        for table in tables.iter().filter(|table| table.section == reader.section) {
            faults.extend(compare(folder.path(), reader, table, example));
        }
    }
    assert!(faults.is_empty(), "{}", faults.join("\n"));
    let sections: BTreeSet<&str> =
        READERS.iter().map(|reader| reader.section).chain(["Pattern sets"]).collect();
    let strange: Vec<&KeyTable> = tables.iter().filter(|t| !sections.contains(t.section.as_str())).collect();
    assert!(strange.is_empty(), "no parser reads {strange:?}");
}

/// What differs between one table of the page and its parser.
fn compare(folder: &Path, reader: &Reader, table: &KeyTable, example: &Table) -> Option<String> {
    if NOT_LISTED.contains(&table.path.as_str()) {
        return None;
    }
    let place = format!("{}, {} {:?}", table.section, table.path, table.variant);
    let Some(text) = with_stranger(table, example) else {
        // A mesh names a file of its own: the example has none.
        return (table.variant.as_ref()?.1 != "mesh")
            .then(|| format!("{place}: the example has no such table"));
    };
    // Settings of the twin are read by those who simulate.
    let simulate = Reader { arguments: &["simulate", "cell.toml", "--out", "never"], ..*reader };
    let ran = read(folder, if table.path == "twin.settings" { &simulate } else { reader }, &text);
    let Some(mut known) = known_keys(&ran.stderr) else {
        return Some(format!("{place}: the parser lists no keys: code {:?}, {}", ran.code, ran.stderr));
    };
    // The key that selects the variant is read before the others.
    known.extend(table.variant.iter().map(|(key, _)| key.clone()));
    let missing: Vec<&String> = known.difference(&table.keys).collect();
    let unknown: Vec<&String> = table.keys.difference(&known).collect();
    (!missing.is_empty() || !unknown.is_empty())
        .then(|| format!("{place}: not on the page: {missing:?}; not known to the parser: {unknown:?}"))
}

#[test]
fn pattern_sets_have_the_keys_of_the_page() {
    let (tables, examples) = page();
    let folder = folder();
    let recording = &examples.iter().find(|(name, _)| name == "Recording").unwrap().1;
    let reader = READERS.iter().find(|reader| reader.section == "Recording").unwrap();
    let sets: Vec<&KeyTable> = tables.iter().filter(|table| table.section == "Pattern sets").collect();
    assert_eq!(sets.len(), 10);
    let faults: Vec<String> =
        sets.iter().filter_map(|table| compare(folder.path(), reader, table, recording)).collect();
    assert!(faults.is_empty(), "{}", faults.join("\n"));
}
