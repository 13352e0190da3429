//! Results of a coordinate measuring machine as CSV, and tables and sampling plans for it.
//!
//! Read: a header row with `name`, `value`, `unit` and one of `u` (standard uncertainty) or `U` (expanded, k = 2), in any
//! order, further columns ignored; lines that begin with `#` are comments. Parted by commas, or by semicolons with
//! either decimal sign, as spreadsheets in half of Europe write it.

use crate::atomic;
use crate::document::read_text;
use crate::error::{FileError, Problem};
use csv::{ReaderBuilder, StringRecord, Trim, WriterBuilder};
use std::path::Path;

/// A value that the machine measured.
#[derive(Debug, Clone, PartialEq)]
pub struct CmmValue {
    /// As in the inspection plan.
    pub name: String,
    /// The measured value, in `unit`.
    pub value: f64,
    /// Unit of the value: `mm` or `deg`.
    pub unit: String,
    /// Expanded uncertainty, k = 2, in `unit`.
    pub expanded_uncertainty: f64,
}

/// Coverage factor of `U`.
pub const COVERAGE_FACTOR: f64 = 2.0;

/// Where the columns stand.
struct Columns {
    name: usize,
    value: usize,
    unit: usize,
    uncertainty: usize,
    /// Whether the uncertainty is a standard one.
    standard: bool,
}

/// Reads results.
///
/// # Errors
/// Not such a table, a name twice or empty, a value that is no number, a negative uncertainty, another unit.
pub fn read_values(path: &Path) -> Result<Vec<CmmValue>, FileError> {
    let text = read_text(path)?;
    let header = text.lines().find(|line| !line.starts_with('#') && !line.trim().is_empty()).unwrap_or("");
    let semicolons = header.contains(';');
    let mut reader = ReaderBuilder::new()
        .delimiter(if semicolons { b';' } else { b',' })
        .comment(Some(b'#'))
        .trim(Trim::All)
        .from_reader(text.as_bytes());
    let columns = columns(path, reader.headers().map_err(|error| malformed(path, &error))?)?;
    let mut values: Vec<CmmValue> = Vec::new();
    for record in reader.records() {
        let record = record.map_err(|error| malformed(path, &error))?;
        let line = record.position().map(|position| position.line() as usize);
        let found = value(&columns, &record, semicolons).and_then(|found| {
            let twice = values.iter().any(|earlier| earlier.name == found.name);
            if twice {
                let limit = "each name occurs once".into();
                return Err((Problem::Value { value: found.name, limit }, "name"));
            }
            Ok(found)
        });
        values.push(found.map_err(|(problem, key)| {
            let mut error = FileError::new(path, problem, "correct the line").at(key);
            error.line = line;
            error
        })?);
    }
    if values.is_empty() {
        let problem = Problem::Missing("a line with a value".into());
        return Err(FileError::new(path, problem, "write lines such as: sphere1_diameter,22.462,mm,0.022"));
    }
    Ok(values)
}

fn malformed(path: &Path, error: &csv::Error) -> FileError {
    let mut fault =
        FileError::new(path, Problem::Syntax(error.to_string().replace('\n', " ")), "correct the table");
    fault.line = error.position().map(|position| position.line() as usize);
    fault
}

fn columns(path: &Path, header: &StringRecord) -> Result<Columns, FileError> {
    let place = |name: &str| header.iter().position(|column| column.trim_start_matches('\u{feff}') == name);
    let need = |name: &str| {
        place(name).ok_or_else(|| {
            let problem = Problem::Missing(format!("the column \"{name}\""));
            FileError::new(path, problem, "begin with a header such as: name,value,unit,U")
        })
    };
    let (uncertainty, standard) = match (place("u"), place("U")) {
        (Some(place), None) => (place, true),
        (None, Some(place)) => (place, false),
        (Some(_), Some(_)) => {
            let limit = "either u (standard) or U (k = 2)".into();
            let problem = Problem::Value { value: "both columns u and U".into(), limit };
            return Err(FileError::new(path, problem, "leave one out"));
        }
        (None, None) => {
            let problem = Problem::Missing("the column \"u\" (standard uncertainty) or \"U\" (k = 2)".into());
            return Err(FileError::new(path, problem, "begin with a header such as: name,value,unit,U"));
        }
    };
    Ok(Columns { name: need("name")?, value: need("value")?, unit: need("unit")?, uncertainty, standard })
}

/// A line, or what is wrong with it and in which column.
fn value(
    columns: &Columns,
    record: &StringRecord,
    semicolons: bool,
) -> Result<CmmValue, (Problem, &'static str)> {
    let cell = |place: usize| record.get(place).unwrap_or("");
    let number = |place: usize, key: &'static str| {
        let text = cell(place);
        let plain = if semicolons { text.replace(',', ".") } else { text.to_owned() };
        plain.parse::<f64>().ok().filter(|v| v.is_finite()).ok_or_else(|| {
            (Problem::Value { value: format!("\"{text}\""), limit: "a finite number".into() }, key)
        })
    };
    let (name, unit) = (cell(columns.name).to_owned(), cell(columns.unit).to_owned());
    if name.is_empty() {
        return Err((Problem::Missing("the name".into()), "name"));
    }
    if !["mm", "deg"].contains(&unit.as_str()) {
        return Err((Problem::Value { value: format!("\"{unit}\""), limit: "mm or deg".into() }, "unit"));
    }
    let key = if columns.standard { "u" } else { "U" };
    let uncertainty = number(columns.uncertainty, key)?;
    if uncertainty < 0.0 {
        return Err((Problem::Value { value: uncertainty.to_string(), limit: "zero or more".into() }, key));
    }
    let factor = if columns.standard { COVERAGE_FACTOR } else { 1.0 };
    Ok(CmmValue {
        name,
        value: number(columns.value, "value")?,
        unit,
        expanded_uncertainty: factor * uncertainty,
    })
}

/// Writes a table, complete or not at all.
///
/// # Errors
/// A place that cannot be written.
pub fn write_table(path: &Path, header: &[&str], rows: &[Vec<String>]) -> Result<(), FileError> {
    let mut writer = WriterBuilder::new().from_writer(Vec::new());
    let broken = |error: csv::Error| FileError::new(path, Problem::Syntax(error.to_string()), "");
    writer.write_record(header).map_err(broken)?;
    for row in rows {
        writer.write_record(row).map_err(broken)?;
    }
    let bytes =
        writer.into_inner().map_err(|error| FileError::new(path, Problem::Syntax(error.to_string()), ""))?;
    atomic::write(path, &bytes)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str) -> Result<Vec<CmmValue>, String> {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("cmm.csv");
        std::fs::write(&path, text).unwrap();
        read_values(&path).map_err(|error| error.to_string())
    }

    #[test]
    fn both_uncertainties_and_both_ways_of_writing_are_read() {
        let expanded = read("# CMM\nname,value,unit,U\nd1, 22.462, mm, 0.022\na,44.964,deg,0.034\n").unwrap();
        assert_eq!((expanded[0].value, expanded[0].expanded_uncertainty), (22.462, 0.022));
        assert_eq!((expanded[1].name.as_str(), expanded[1].unit.as_str()), ("a", "deg"));
        let standard = read("operator;unit;u;value;name\nX;mm;0,011;22,462;d1\n").unwrap();
        assert_eq!(standard[0], expanded[0]);
    }

    #[test]
    fn what_is_wrong_is_named_with_its_line() {
        for (text, words) in [
            ("", "the column \"u\""),
            ("name,value,unit\n", "the column \"u\""),
            ("name,value,u\n", "the column \"unit\""),
            ("name,value,unit,u,U\n", "both columns"),
            ("name,value,unit,U\n", "a line with a value"),
            ("name,value,unit,U\na,x,mm,1\n", ":2: value: value \"x\""),
            ("name,value,unit,U\na,nan,mm,1\n", "a finite number"),
            ("name,value,unit,U\na,1,mm,-1\n", "U: value -1"),
            ("name,value,unit,U\n,1,mm,1\n", "the name is missing"),
            ("name,value,unit,U\na,1,m,1\n", "\"m\" is not allowed: mm or deg"),
            ("name,value,unit,U\na,1,mm,1\na,1,mm,1\n", ":3: name: value a"),
            ("name,value,unit,U\na,1,mm\n", ":2: "),
        ] {
            let error = read(text).unwrap_err();
            assert!(error.contains(words), "{text:?}: {error}");
            assert!(!error.contains('\n'), "{error}");
        }
    }

    #[test]
    fn tables_quote_what_needs_it() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("t.csv");
        write_table(&path, &["a", "b"], &[vec!["x, y".into(), "1".into()]]).unwrap();
        assert_eq!(std::fs::read_to_string(path).unwrap(), "a,b\n\"x, y\",1\n");
    }
}
