//! Doc comments, help texts and option names: said in standard words, and former names of options still accepted.

use crate::support::{fringecell_in, fringetool, root};
use std::path::{Path, PathBuf};

/// Words that this project replaces: by estimates, reports, evaluates, compared with, setting, buffer, image, valid.
const AVOIDED: [&str; 15] = [
    "tell", "tells", "told", "say", "says", "judge", "judged", "knob", "knobs", "room", "sight", "shot",
    "honest", "obey", "bury",
];

/// Words that no source file contains, because they are private language for standard terms.
const PRIVATE: [&str; 8] = ["ringer", "knob", "knobs", "keeper", "honest", "obeys", "buries", "liar"];

fn sources(folder: &Path, found: &mut Vec<PathBuf>) {
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            sources(&path, found);
        } else if path.extension().is_some_and(|e| e == "rs") {
            found.push(path);
        }
    }
}

/// All source files of the repository.
fn all_sources() -> Vec<PathBuf> {
    let mut found = Vec::new();
    for folder in ["shared", "processes", "tools", "tests", "examples"] {
        sources(&root().join(folder), &mut found);
    }
    found.sort();
    assert!(found.len() > 300, "{} files", found.len());
    found
}

fn words(text: &str) -> impl Iterator<Item = String> {
    text.split(|c: char| !c.is_alphanumeric()).filter(|word| !word.is_empty()).map(str::to_lowercase)
}

/// First line and text of each block of doc comments.
fn doc_comments(text: &str) -> Vec<(usize, String)> {
    let mut blocks: Vec<(usize, String)> = Vec::new();
    let mut open = false;
    for (number, line) in text.lines().enumerate() {
        match line.trim().strip_prefix("///") {
            Some(comment) if open => {
                let (_, block) = blocks.last_mut().unwrap();
                block.push(' ');
                block.push_str(comment);
            }
            Some(comment) => blocks.push((number + 1, comment.to_owned())),
            None => {}
        }
        open = line.trim().starts_with("///");
    }
    blocks
}

/// A comment of one or two words repeats the name of the item; unit, shape and meaning take more.
#[test]
fn doc_comments_have_four_words_or_more() {
    let mut short = Vec::new();
    for path in all_sources() {
        for (line, comment) in doc_comments(&std::fs::read_to_string(&path).unwrap()) {
            if comment.split_whitespace().count() < 4 {
                short.push(format!("{}:{line}: {comment}", path.display()));
            }
        }
    }
    assert!(short.is_empty(), "{} doc comments are too short:\n{}", short.len(), short.join("\n"));
}

#[test]
fn no_source_file_uses_private_words() {
    let mut found = Vec::new();
    for path in all_sources().into_iter().filter(|path| !path.ends_with("tests/words.rs")) {
        let text = std::fs::read_to_string(&path).unwrap();
        for word in words(&text).filter(|word| PRIVATE.contains(&word.as_str())) {
            found.push(format!("{}: {word}", path.display()));
        }
    }
    assert!(found.is_empty(), "{}", found.join("\n"));
}

/// `docs/commands.md` holds every help text; another test compares it with `--help`.
#[test]
fn help_texts_use_standard_words() {
    let page = std::fs::read_to_string(root().join("docs/commands.md")).unwrap();
    let (_, commands) = page.split_once("\n### ").unwrap();
    let mut found = Vec::new();
    for line in commands.lines().filter(|line| !line.starts_with('`')) {
        let explained = line.rsplit('|').nth(1).unwrap_or(line);
        if line.starts_with("| `") && words(explained).count() < 2 {
            found.push(format!("explains nothing: {line}"));
        }
        found.extend(
            words(explained).filter(|w| AVOIDED.contains(&w.as_str())).map(|w| format!("{w}: {line}")),
        );
    }
    assert!(found.is_empty(), "{}", found.join("\n"));
}

/// One option is one word: `--json` always takes a FILE, `--rig` a FILE, `--camera` a NAME.
#[test]
fn an_option_has_one_kind_of_value() {
    let page = std::fs::read_to_string(root().join("docs/commands.md")).unwrap();
    for (option, value) in
        [("json", "FILE"), ("rig", "FILE"), ("report", "FILE"), ("camera", "NAME"), ("seed", "N")]
    {
        let start = format!("| `--{option} ");
        let lines: Vec<&str> = page.lines().filter(|line| line.starts_with(&start)).collect();
        assert!(!lines.is_empty(), "--{option}");
        for line in lines {
            assert!(line.contains(value), "{line}");
        }
    }
}

#[test]
fn former_names_of_options_are_accepted() {
    for arguments in [
        "fit sphere absent.ply --reject 0.003",
        "reference-plane calibrate --plane 0=absent --plane 1=absent --reject 6 --out out",
        "flatness absent.ply --filter 2.5",
        "compare absent.ply absent.ply --registration 0",
        "decode --method three-step absent",
        "calibrate --target absent --out o --draw d --html h absent",
        "check-rig --rig absent --trend t --chart c absent",
        "import-rig absent --out o --projector",
    ] {
        let ran = fringetool(&arguments.split(' ').collect::<Vec<_>>());
        assert_eq!(ran.code, Some(2), "{arguments}: {}", ran.stderr);
        assert!(!ran.stderr.contains("unexpected argument"), "{arguments}: {}", ran.stderr);
    }
    let unknown = fringetool(&["fit", "sphere", "absent.ply", "--refuse", "0.003"]);
    assert!(unknown.stderr.contains("unexpected argument"), "{}", unknown.stderr);
    let run = ["run", "absent.toml", "--cycle-record", "r", "--keep", "frames"];
    let ran = fringecell_in(root(), &run);
    assert!(!ran.stderr.contains("unexpected argument"), "{}", ran.stderr);
}
