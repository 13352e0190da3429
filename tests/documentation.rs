//! README and pages: their lengths, their links, and the commands and options that they name.

use crate::support::{fringecell_in, fringetool_in, root};
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

/// README and every page of `docs/`.
pub fn pages() -> Vec<PathBuf> {
    let mut pages = vec![root().join("README.md"), root().join("CONTRIBUTING.md")];
    let folder = std::fs::read_dir(root().join("docs")).unwrap();
    let mut docs: Vec<PathBuf> = folder.map(|entry| entry.unwrap().path()).collect();
    docs.retain(|path| path.extension().is_some_and(|e| e == "md"));
    docs.sort();
    pages.extend(docs);
    pages
}

fn text(path: &Path) -> String {
    std::fs::read_to_string(path).unwrap()
}

#[test]
fn the_readme_fits_one_page() {
    let readme = text(&root().join("README.md"));
    assert!(readme.lines().count() <= 120, "{} lines", readme.lines().count());
    let long: Vec<&str> = readme.lines().filter(|line| line.chars().count() > 110).collect();
    assert!(long.is_empty(), "longer than 110 characters: {long:#?}");
    for picture in std::fs::read_dir(root().join("docs/pictures")).unwrap() {
        let picture = picture.unwrap();
        assert!(picture.metadata().unwrap().len() < 200_000, "{:?}", picture.path());
    }
}

/// Targets of `[…](target)` outside of code.
fn links(text: &str) -> Vec<String> {
    let mut code = false;
    let prose = text.lines().filter(|line| {
        code ^= line.starts_with("```");
        !code
    });
    prose
        .flat_map(|line| line.split("](").skip(1).filter_map(|rest| rest.split(')').next()))
        .map(str::to_owned)
        .collect()
}

/// The anchor that a heading gets.
fn anchor(heading: &str) -> String {
    let kept = heading.trim_start_matches('#').trim().chars();
    let kept = kept.filter(|c| c.is_alphanumeric() || matches!(c, ' ' | '-' | '_'));
    kept.collect::<String>().to_lowercase().replace(' ', "-")
}

#[test]
fn every_link_leads_somewhere() {
    let mut dead = Vec::new();
    for page in pages() {
        for link in links(&text(&page)) {
            if link.contains("://") {
                continue;
            }
            let (file, place) = link.split_once('#').map_or((link.as_str(), None), |(f, p)| (f, Some(p)));
            let target = if file.is_empty() { page.clone() } else { page.parent().unwrap().join(file) };
            let there = target.exists()
                && place.is_none_or(|place| {
                    text(&target).lines().any(|l| l.starts_with('#') && anchor(l) == place)
                });
            if !there {
                dead.push(format!("{}: {link}", page.display()));
            }
        }
    }
    assert!(dead.is_empty(), "{dead:#?}");
}

/// A path of a file of this repository in backticks, such as `shared/fringe/src/lib.rs`, must exist.
#[test]
fn every_named_source_file_exists() {
    let folders = ["shared/", "processes/", "tools/", "tests/", "configs/", "examples/"];
    let mut absent = Vec::new();
    for page in pages() {
        let text = text(&page);
        for path in text.split('`').filter(|path| folders.iter().any(|folder| path.starts_with(folder))) {
            let plain = path.chars().all(|c| c.is_ascii_alphanumeric() || "/_-.".contains(c));
            if plain && !root().join(path).exists() {
                absent.push(format!("{}: {path}", page.display()));
            }
        }
    }
    assert!(absent.is_empty(), "{absent:#?}");
}

#[test]
fn the_index_names_every_page() {
    let index = text(&root().join("docs/README.md"));
    let named: BTreeSet<String> = links(&index).into_iter().collect();
    for page in pages().into_iter().skip(2) {
        let name = page.file_name().unwrap().to_str().unwrap().to_owned();
        assert!(name == "README.md" || named.contains(&name), "docs/README.md does not name {name}");
    }
}

/// The words of a help text that are subcommands: the first of each line under "Commands:".
fn subcommands(help: &str) -> Vec<String> {
    let list = help.lines().skip_while(|line| !line.starts_with("Commands:")).skip(1);
    let list = list.take_while(|line| line.starts_with("  "));
    // Longer lines are continuations, with more spaces in front.
    let names = list
        .filter(|l| l.chars().nth(2).is_some_and(|c| c != ' '))
        .filter_map(|l| l.split_whitespace().next());
    names.filter(|name| *name != "help").map(str::to_owned).collect()
}

/// The long options of a help text.
fn options(help: &str) -> BTreeSet<String> {
    let long = help.lines().filter_map(|line| {
        let line = line.trim_start();
        line.strip_prefix("--").or_else(|| line.strip_prefix('-')?.split_once(", --").map(|(_, long)| long))
    });
    let name =
        |rest: &str| rest.chars().take_while(|c| c.is_ascii_alphanumeric() || *c == '-').collect::<String>();
    long.map(name).filter(|name| !["help", "version", ""].contains(&name.as_str())).collect()
}

/// Every command of a program with its options, subcommands of subcommands included.
fn commands(program: &str, run: impl Fn(&[&str]) -> String) -> Vec<(String, BTreeSet<String>)> {
    let mut all = Vec::new();
    for name in subcommands(&run(&["--help"])) {
        let help = run(&[&name, "--help"]);
        let inner = subcommands(&help);
        if inner.is_empty() {
            all.push((format!("{program} {name}"), options(&help)));
        }
        for second in inner {
            all.push((format!("{program} {name} {second}"), options(&run(&[&name, &second, "--help"]))));
        }
    }
    all
}

/// The page has a table of the options that every command takes, then a heading `### program command` for each command, and
/// below it a table of its own options.
#[test]
fn the_command_reference_has_every_command_and_option_and_no_other() {
    let page = text(&root().join("docs/commands.md"));
    let mut on_page: Vec<(String, BTreeSet<String>)> = Vec::new();
    let mut everywhere = BTreeSet::new();
    for line in page.lines() {
        if let Some(name) = line.strip_prefix("### ") {
            on_page.push((name.trim_matches('`').to_owned(), BTreeSet::new()));
        } else if let Some(row) = line.strip_prefix("| `--") {
            let options = on_page.last_mut().map_or(&mut everywhere, |(_, options)| options);
            options.insert(row.split(['`', ' ', '=', '[']).next().unwrap().to_owned());
        }
    }
    assert!(everywhere.contains("quiet") && everywhere.contains("verbose"), "{everywhere:?}");
    for (_, options) in &mut on_page {
        options.extend(everywhere.iter().cloned());
    }
    let mut real = commands("fringecell", |arguments| fringecell_in(root(), arguments).stdout);
    real.extend(commands("fringetool", |arguments| fringetool_in(root(), arguments).stdout));
    assert!(real.len() > 40, "{real:?}");
    let mut faults = Vec::new();
    for (name, options) in &real {
        match on_page.iter().find(|(there, _)| there == name) {
            None => faults.push(format!("{name}: not on the page")),
            Some((_, there)) if there != options => {
                let (missing, unknown) = (options.difference(there), there.difference(options));
                let (missing, unknown): (Vec<_>, Vec<_>) = (missing.collect(), unknown.collect());
                faults.push(format!("{name}: not on the page {missing:?}, not in the program {unknown:?}"));
            }
            Some(_) => {}
        }
    }
    let gone = on_page.iter().filter(|(name, _)| !real.iter().any(|(there, _)| there == name));
    faults.extend(gone.map(|(name, _)| format!("{name}: no such command")));
    assert!(faults.is_empty(), "{}", faults.join("\n"));
}
