//! Results of a coordinate measuring machine as CSV, and tables and sampling plans for it.
//!
//! Read: a [table](crate::csv_table) with `name`, `value`, `unit` and one of `u` (standard uncertainty) or `U` (expanded,
//! k = 2), in any order, further columns ignored.

use crate::atomic;
use crate::csv_table::{CsvRow, CsvTable};
use crate::error::{FileError, Problem};
use csv::WriterBuilder;
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

/// Reads results.
///
/// # Errors
/// Not such a table, a name twice or empty, a value that is no number, a negative uncertainty, another unit.
pub fn read_values(path: &Path) -> Result<Vec<CmmValue>, FileError> {
    let table = CsvTable::read(path)?;
    let uncertainty = uncertainty_column(path, &table)?;
    let mut values: Vec<CmmValue> = Vec::new();
    for row in &table.rows {
        let found = value(&table, row, uncertainty)?;
        if values.iter().any(|earlier| earlier.name == found.name) {
            let problem = Problem::Value { value: found.name, limit: "each name occurs once".into() };
            return Err(table.fault(row, "name", problem));
        }
        values.push(found);
    }
    if values.is_empty() {
        let problem = Problem::Missing("a line with a value".into());
        return Err(FileError::new(path, problem, "write lines such as: sphere1_diameter,22.462,mm,0.022"));
    }
    Ok(values)
}

/// The column of the uncertainty, `u` or `U`; the other columns are there too.
fn uncertainty_column(path: &Path, table: &CsvTable) -> Result<&'static str, FileError> {
    let missing = |what: &str| {
        let problem = Problem::Missing(format!("the column {what}"));
        Err(FileError::new(path, problem, "begin with a header such as: name,value,unit,U"))
    };
    let has = |name: &str| table.column(name).is_some();
    let column = match (has("u"), has("U")) {
        (true, false) => "u",
        (false, true) => "U",
        (true, true) => {
            let problem = Problem::Unsupported("has both columns u (standard) and U (k = 2)".into());
            return Err(FileError::new(path, problem, "leave one of them out"));
        }
        (false, false) => return missing("\"u\" (standard uncertainty) or \"U\" (k = 2)"),
    };
    match ["name", "value", "unit"].into_iter().find(|name| !has(name)) {
        Some(absent) => missing(&format!("\"{absent}\"")),
        None => Ok(column),
    }
}

/// The value of a row.
fn value(table: &CsvTable, row: &CsvRow, uncertainty: &str) -> Result<CmmValue, FileError> {
    let Some(name) = table.text(row, "name") else {
        return Err(table.fault(row, "name", Problem::Missing("the name".into())));
    };
    let unit = table.text(row, "unit").unwrap_or_default();
    if !["mm", "deg"].contains(&unit) {
        let problem = Problem::Value { value: format!("\"{unit}\""), limit: "mm or deg".into() };
        return Err(table.fault(row, "unit", problem));
    }
    let number = |column: &str| {
        let empty = || {
            let limit = "a finite number".into();
            table.fault(row, column, Problem::Value { value: "\"\"".into(), limit })
        };
        table.number(row, column)?.ok_or_else(empty)
    };
    let u = number(uncertainty)?;
    if u < 0.0 {
        let problem = Problem::Value { value: u.to_string(), limit: "zero or more".into() };
        return Err(table.fault(row, uncertainty, problem));
    }
    let factor = if uncertainty == "u" { COVERAGE_FACTOR } else { 1.0 };
    Ok(CmmValue {
        name: name.to_owned(),
        value: number("value")?,
        unit: unit.to_owned(),
        expanded_uncertainty: factor * u,
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
            ("", "has no header row"),
            ("name,value,unit\n", "the column \"u\""),
            ("name,value,u\n", "the column \"unit\""),
            ("name,value,unit,u,U\n", "has both columns u (standard) and U (k = 2); leave one of them out"),
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
