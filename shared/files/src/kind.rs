//! What kind of file something is, by its content.

use crate::error::FileError;
use std::fmt;
use std::fs::File;
use std::io::Read;
use std::path::Path;

/// Most bytes that are looked at: the head identifies all but JSON, whose keys have to be found.
const LOOK_BYTES: u64 = 4 << 20;

/// A kind of file. Those of one language are distinguished by their `format`.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Kind {
    /// A file without any bytes.
    Empty,
    /// A point cloud without faces.
    Cloud,
    /// A mesh in PLY format.
    Mesh,
    /// JSON of any kind.
    Json,
    /// JSON, by its `format`, or by its other keys.
    JsonOf(String),
    /// TOML of any kind.
    Toml,
    /// TOML, by its `format` without version.
    TomlOf(String),
    /// XML, by its root element, SVG and HTML included.
    Xml(String),
    /// Text, by its first line (the header of a table).
    Text(String),
    /// Any text that is a table or a list.
    Table,
    /// By a signature: PNG, TIFF, PDF, NumPy …
    Binary(&'static str),
    /// Content that is not recognised.
    Unknown,
}

/// How files begin that are no text.
const SIGNATURES: [(&[u8], &str); 13] = [
    (b"\x89PNG\r\n", "a PNG image"),
    (b"II*\0", "a TIFF image"),
    (b"MM\0*", "a TIFF image"),
    (b"\xff\xd8\xff", "a JPEG image"),
    (b"BM", "a BMP image"),
    (b"%PDF", "a PDF file"),
    (b"\x93NUMPY", "an NPY raster"),
    (b"fringecycles", "a cycle record"),
    (b"ASTM-E57", "an E57 cloud"),
    (b"PK\x03\x04", "a ZIP archive"),
    (b"\x1f\x8b", "a gzip archive"),
    (b"solid ", "an STL mesh"),
    (b"STL by fringecell", "an STL mesh"),
];

impl Kind {
    /// Of a file that is there.
    ///
    /// # Errors
    /// It cannot be read.
    pub fn of_file(path: &Path) -> Result<Self, FileError> {
        let mut bytes = Vec::new();
        File::open(path)
            .and_then(|file| file.take(LOOK_BYTES).read_to_end(&mut bytes))
            .map_err(|source| FileError::io(path, "read what is there", source))?;
        Ok(Self::of(&bytes))
    }

    /// What a file of this name holds, as far as its extension shows.
    pub fn of_name(path: &Path) -> Option<Self> {
        let extension = path.extension()?.to_str()?.to_ascii_lowercase();
        Some(match extension.as_str() {
            "json" => Self::Json,
            "ply" => Self::Cloud,
            "toml" => Self::Toml,
            "html" | "htm" => Self::Xml("html".into()),
            "svg" => Self::Xml("svg".into()),
            "png" => Self::Binary("a PNG image"),
            "pdf" => Self::Binary("a PDF file"),
            "npy" => Self::Binary("an NPY raster"),
            "csv" => Self::Table,
            _ => return None,
        })
    }

    pub(crate) fn of(bytes: &[u8]) -> Self {
        if bytes.is_empty() {
            return Self::Empty;
        }
        if let Some((_, name)) = SIGNATURES.iter().find(|(start, _)| bytes.starts_with(start)) {
            return Self::Binary(name);
        }
        if bytes.starts_with(b"ply\n") || bytes.starts_with(b"ply\r") {
            return ply(bytes);
        }
        // The look may have ended within a character.
        let text = match std::str::from_utf8(bytes) {
            Ok(text) => text,
            Err(error) if error.error_len().is_none() => {
                std::str::from_utf8(&bytes[..error.valid_up_to()]).unwrap_or("")
            }
            Err(_) => return Self::Unknown,
        };
        let text = text.trim_start_matches('\u{feff}').trim_start();
        match text.chars().next() {
            None => Self::Empty,
            Some('<') => xml(text),
            Some('{' | '[') if !text.starts_with("[[") && !is_toml(text) => json(text),
            _ if is_toml(text) => toml(text),
            _ => Self::Text(first_line(text)),
        }
    }

    /// Whether a file of this kind may be what a name or an option (`of_name`) speaks of.
    pub fn is_like(&self, expected: &Self) -> bool {
        match (self, expected) {
            (Self::Empty, _)
            | (Self::JsonOf(_), Self::Json)
            | (Self::TomlOf(_), Self::Toml)
            | (Self::Text(_), Self::Table) => true,
            // Something that calls itself TOML or HTML and is another text is classified when the new file is known.
            _ => self == expected,
        }
    }

    /// Whether a new file of another kind may take its place.
    pub fn gives_way_to(&self, new: &Self) -> bool {
        match self {
            Self::Empty => true,
            Self::Unknown => false,
            _ => self == new,
        }
    }
}

fn ply(bytes: &[u8]) -> Kind {
    let head = &bytes[..bytes.len().min(1 << 16)];
    let head = String::from_utf8_lossy(head);
    let head = head.split("end_header").next().unwrap_or("");
    let faces = head.lines().find_map(|line| line.strip_prefix("element face "));
    match faces.map(str::trim) {
        None | Some("0") => Kind::Cloud,
        Some(_) => Kind::Mesh,
    }
}

fn xml(text: &str) -> Kind {
    let lower: String = text.chars().take(4096).map(|c| c.to_ascii_lowercase()).collect();
    let mut rest = lower.as_str();
    // Past declarations and comments to the root element.
    while let Some(at) = rest.find('<') {
        rest = &rest[at + 1..];
        if let Some(after) = rest.strip_prefix("!--") {
            rest = after.split_once("-->").map_or("", |(_, after)| after);
        } else if rest.starts_with("!doctype html") {
            return Kind::Xml("html".into());
        } else if !rest.starts_with(['?', '!']) {
            let name = rest.split(|c: char| !c.is_ascii_alphanumeric() && c != '_' && c != ':').next();
            return Kind::Xml(name.unwrap_or("").to_owned());
        }
    }
    Kind::Xml(String::new())
}

/// The kind that a JSON text states; one that is longer than what is looked at is recognised by its first keys.
fn json(text: &str) -> Kind {
    let known = |name: &str| Kind::JsonOf(name.to_owned());
    let value: serde_json::Value = match text.lines().next().map(serde_json::from_str) {
        // One value per line (a trend), sealed or not.
        Some(Ok(value)) => value,
        _ => match serde_json::from_str(text) {
            Ok(value) => value,
            Err(_) if text.contains("\"traceEvents\"") => return known("traceEvents"),
            Err(_) => match text.split_once("\"format\"").and_then(|(_, rest)| rest.split('"').nth(1)) {
                Some(format) => return known(family(format)),
                None => return Kind::Text(first_line(text)),
            },
        },
    };
    let first = value.as_array().and_then(|all| all.first()).unwrap_or(&value);
    let Some(object) = first.as_object() else { return known("values") };
    let text_of = |key: &str| object.get(key).and_then(serde_json::Value::as_str);
    if let Some(format) = text_of("format") {
        return known(family(format));
    }
    if object.contains_key("traceEvents") {
        return known("traceEvents");
    }
    if object.contains_key("outcome") && object.contains_key("latency_ns") {
        return known("result of a cycle");
    }
    if object.get("provenance").and_then(|p| p.get("software")).is_some() {
        return known("result of fringetool");
    }
    let keys: Vec<&str> = object.keys().map(String::as_str).collect();
    if keys.is_empty() {
        return known("an empty object");
    }
    known(&format!("an object with \"{}\"", keys.join(", ")))
}

/// A first line that is a table header, a key or a comment before one of them.
fn is_toml(text: &str) -> bool {
    let line = text.lines().map(str::trim).find(|line| !line.is_empty() && !line.starts_with('#'));
    let Some(line) = line else { return false };
    let key =
        |text: &str| !text.is_empty() && text.chars().all(|c| c.is_alphanumeric() || "_-. \"'".contains(c));
    match line.strip_prefix('[') {
        Some(rest) => rest.trim_start_matches('[').split_once(']').is_some_and(|(name, _)| key(name)),
        None => line.split_once('=').is_some_and(|(name, _)| key(name.trim())),
    }
}

fn toml(text: &str) -> Kind {
    let value = text.lines().find_map(|line| line.trim().strip_prefix("format")?.trim().strip_prefix('='));
    let format = value.and_then(|value| value.split('"').nth(1));
    match format {
        Some(format) => Kind::TomlOf(family(format).to_owned()),
        None => Kind::TomlOf(format!("a file with \"{}\"", first_line(text))),
    }
}

/// `fringecell-rig/1` is of the same kind as `fringecell-rig/2`.
fn family(format: &str) -> &str {
    format.split('/').next().unwrap_or(format)
}

/// Without digits, which are counts and dates.
fn first_line(text: &str) -> String {
    let line = text.lines().next().unwrap_or("").trim_end();
    line.chars().filter(|c| !c.is_ascii_digit()).take(60).collect()
}

impl fmt::Display for Kind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Empty => f.write_str("an empty file"),
            Self::Cloud => f.write_str("a point cloud (PLY)"),
            Self::Mesh => f.write_str("a mesh (PLY)"),
            Self::Json => f.write_str("JSON"),
            Self::JsonOf(name) => write!(f, "{name} (JSON)"),
            Self::Toml => f.write_str("TOML"),
            Self::TomlOf(name) => write!(f, "{name} (TOML)"),
            Self::Xml(root) => write!(f, "{root} (XML or HTML)"),
            Self::Text(line) => write!(f, "a text that begins with \"{line}\""),
            Self::Table => f.write_str("a table (CSV)"),
            Self::Binary(name) => f.write_str(name),
            Self::Unknown => f.write_str("of an unknown kind"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_are_told_apart_by_their_content() {
        let json = |name: &str| Kind::JsonOf(name.into());
        let toml = |name: &str| Kind::TomlOf(name.into());
        let table: [(&[u8], Kind); 16] = [
            (b"", Kind::Empty),
            (b" \n", Kind::Empty),
            (b"ply\nformat ascii 1.0\nelement vertex 3\nend_header\n", Kind::Cloud),
            (b"ply\nelement vertex 3\nelement face 1\nend_header\n", Kind::Mesh),
            (b"{\"format\": \"fringecell-covariance/1\"}", json("fringecell-covariance")),
            (b"{\"traceEvents\": [", json("traceEvents")),
            (b"{\"name\": \"x\", \"version\": \"1\"}", json("an object with \"name, version\"")),
            (b"{\"a\": 1, \"provenance\": {\"software\": \"fringetool\"}}", json("result of fringetool")),
            (b"# rig\nformat = \"fringecell-rig/1\"\n", toml("fringecell-rig")),
            (b"[package]\nname = \"x\"\n", toml("a file with \"[package]\"")),
            (b"<!DOCTYPE html>\n<html>", Kind::Xml("html".into())),
            (b"<?xml version=\"1.0\"?>\n<!-- <a> -->\n<svg xmlns=\"x\">", Kind::Xml("svg".into())),
            (b"name,value\na,1\n", Kind::Text("name,value".into())),
            (b"\x89PNG\r\n\x1a\n", Kind::Binary("a PNG image")),
            (b"fringecycles\x03\0\0\0", Kind::Binary("a cycle record")),
            (b"\xff\xfe\0", Kind::Unknown),
        ];
        for (bytes, expected) in table {
            assert_eq!(Kind::of(bytes), expected, "{}", String::from_utf8_lossy(bytes));
        }
    }

    #[test]
    fn a_file_gives_way_to_its_own_kind_only() {
        let a = Kind::of(b"{\"format\": \"a/1\"}");
        assert!(a.gives_way_to(&Kind::of(b"{\"format\": \"a/2\"}")));
        assert!(!a.gives_way_to(&Kind::of(b"{\"format\": \"b/1\"}")));
        assert!(Kind::Empty.gives_way_to(&a) && !a.gives_way_to(&Kind::Empty));
        assert!(!Kind::Unknown.gives_way_to(&Kind::Unknown));
        assert!(a.is_like(&Kind::Json) && !a.is_like(&Kind::Toml));
    }
}
