//! Picture files by a pattern with `*`.

use anyhow::{Context, Result, bail};
use std::path::{Path, PathBuf};

/// Files whose names fit a pattern, in the order of the numbers in their names; a pattern that is itself a file is that file.
pub fn expand(pattern: &str) -> Result<Vec<PathBuf>> {
    let path = Path::new(pattern);
    if path.is_file() {
        return Ok(vec![path.to_owned()]);
    }
    let name = path.file_name().and_then(|n| n.to_str()).unwrap_or_default();
    let folder = path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let entries = std::fs::read_dir(folder).with_context(|| folder.display().to_string())?;
    let mut files: Vec<PathBuf> = entries
        .filter_map(|entry| Some(entry.ok()?.path()))
        .filter(|file| file.file_name().and_then(|n| n.to_str()).is_some_and(|n| matches(name, n)))
        .collect();
    if files.is_empty() {
        bail!("no file matches in {}", folder.display());
    }
    files.sort_by_cached_key(|file| natural(&file.to_string_lossy()));
    Ok(files)
}

/// Whether a name matches a pattern in which `*` matches any text.
fn matches(pattern: &str, name: &str) -> bool {
    let mut parts = pattern.split('*');
    let Some(mut rest) = name.strip_prefix(parts.next().unwrap_or_default()) else { return false };
    let mut last = None;
    for part in parts {
        last = Some(part);
        let Some(at) = rest.find(part) else { return false };
        rest = &rest[at + part.len()..];
    }
    match last {
        None => rest.is_empty(),
        Some(end) => name.ends_with(end),
    }
}

/// Key that puts `left2` before `left10`: text and numbers in turn.
pub fn natural(name: &str) -> Vec<(String, u64)> {
    let mut key = vec![(String::new(), 0_u64)];
    let mut in_number = false;
    for letter in name.chars() {
        if let Some(digit) = letter.to_digit(10) {
            in_number = true;
            if let Some(last) = key.last_mut() {
                last.1 = last.1.saturating_mul(10).saturating_add(u64::from(digit));
            }
        } else {
            if in_number {
                key.push((String::new(), 0));
                in_number = false;
            }
            if let Some(last) = key.last_mut() {
                last.0.push(letter);
            }
        }
    }
    key
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_star_stands_for_anything() {
        assert!(matches("left*.png", "left01.png") && matches("*", "x") && matches("a*b*c", "a1b2c"));
        assert!(!matches("left*.png", "right01.png") && !matches("left*.png", "left01.jpg"));
        assert!(matches("one.png", "one.png") && !matches("one.png", "one.png.bak"));
    }

    #[test]
    fn numbers_sort_as_numbers() {
        let mut names = ["left10.png", "left2.png", "left1.png"];
        names.sort_by_cached_key(|n| natural(n));
        assert_eq!(names, ["left1.png", "left2.png", "left10.png"]);
    }
}
