//! Tables as CSV: a header row, then a row for each record; lines that begin with `#` are comments.
//!
//! Parted by commas, or by semicolons with either decimal sign, as spreadsheets in half of Europe write it.

use crate::document::read_text;
use crate::error::{FileError, Problem};
use csv::{ReaderBuilder, StringRecord, Trim};
use std::path::{Path, PathBuf};

/// A table in memory.
#[derive(Debug)]
pub struct CsvTable {
    path: PathBuf,
    /// Names of the columns, in the file's order.
    pub names: Vec<String>,
    /// The rows of data, in the file's order.
    pub rows: Vec<CsvRow>,
    semicolons: bool,
}

/// A row of a table.
#[derive(Debug)]
pub struct CsvRow {
    /// Line of the file, from 1.
    pub line: usize,
    cells: StringRecord,
}

impl CsvTable {
    /// Reads a table.
    ///
    /// # Errors
    /// No UTF-8, no header, a column twice, a row with another number of cells than the header.
    pub fn read(path: &Path) -> Result<Self, FileError> {
        let text = read_text(path)?;
        let text = text.trim_start_matches('\u{feff}');
        let header = text.lines().find(|line| !line.starts_with('#') && !line.trim().is_empty());
        let Some(header) = header else {
            let problem = Problem::Unsupported("has no header row".into());
            return Err(FileError::new(path, problem, "begin with the names of the columns"));
        };
        let semicolons = header.contains(';');
        let mut reader = ReaderBuilder::new()
            .delimiter(if semicolons { b';' } else { b',' })
            .comment(Some(b'#'))
            .trim(Trim::All)
            .from_reader(text.as_bytes());
        let names: Vec<String> =
            reader.headers().map_err(|error| malformed(path, &error))?.iter().map(str::to_owned).collect();
        if let Some(twice) = names.iter().enumerate().find(|(at, name)| names[..*at].contains(name)) {
            let problem = Problem::Duplicate { kind: "the column", name: twice.1.clone() };
            return Err(FileError::new(path, problem, "rename one or leave it out"));
        }
        let row = |record: Result<StringRecord, csv::Error>| {
            let cells = record.map_err(|error| malformed(path, &error))?;
            Ok(CsvRow { line: cells.position().map_or(0, |position| position.line() as usize), cells })
        };
        let rows = reader.records().map(row).collect::<Result<_, FileError>>()?;
        Ok(Self { path: path.to_owned(), names, rows, semicolons })
    }

    /// Place of a column.
    pub fn column(&self, name: &str) -> Option<usize> {
        self.names.iter().position(|column| column == name)
    }

    /// Text of a cell; `None` where the column is absent or the cell is empty.
    pub fn text<'a>(&self, row: &'a CsvRow, column: &str) -> Option<&'a str> {
        row.cells.get(self.column(column)?).filter(|cell| !cell.is_empty())
    }

    /// Number of a cell; `None` where the column is absent or the cell is empty.
    ///
    /// # Errors
    /// A cell that is no finite number.
    pub fn number(&self, row: &CsvRow, column: &str) -> Result<Option<f64>, FileError> {
        let Some(text) = self.text(row, column) else { return Ok(None) };
        let plain = if self.semicolons { text.replace(',', ".") } else { text.to_owned() };
        if let Some(value) = plain.parse::<f64>().ok().filter(|value| value.is_finite()) {
            return Ok(Some(value));
        }
        let limit = "a finite number".into();
        Err(self.fault(row, column, Problem::Value { value: format!("\"{text}\""), limit }))
    }

    /// A fault in a cell, with its line and column.
    pub fn fault(&self, row: &CsvRow, column: &str, problem: Problem) -> FileError {
        let mut fault = FileError::new(&self.path, problem, "correct the line").at(column);
        fault.line = Some(row.line);
        fault
    }
}

fn malformed(path: &Path, error: &csv::Error) -> FileError {
    let mut fault =
        FileError::new(path, Problem::Syntax(error.to_string().replace('\n', " ")), "correct the table");
    fault.line = error.position().map(|position| position.line() as usize);
    fault
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str) -> Result<CsvTable, String> {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("table.csv");
        std::fs::write(&path, text).unwrap();
        CsvTable::read(&path).map_err(|error| error.to_string())
    }

    #[test]
    fn both_separators_quotes_comments_and_a_byte_order_mark_are_read() {
        for text in ["\u{feff}# made by hand\na,b\n\"x, y\", 1.5\n\n", "a;b\n# so\n\"x, y\";1,5\n"] {
            let table = read(text).unwrap();
            let row = &table.rows[0];
            assert_eq!(table.text(row, "a"), Some("x, y"));
            assert_eq!(table.number(row, "b").unwrap(), Some(1.5));
            assert_eq!(table.number(row, "c").unwrap(), None);
        }
    }

    #[test]
    fn what_is_wrong_is_named_with_its_line() {
        for (text, words) in [
            ("", "table.csv: has no header row; begin with the names of the columns"),
            ("a,a\n", "table.csv: the column \"a\" occurs twice; rename one or leave it out"),
            ("a,b\n1\n", "table.csv:2: "),
        ] {
            let error = read(text).unwrap_err();
            assert!(error.contains(words), "{text:?}: {error}");
            assert!(!error.contains('\n'), "{error}");
        }
        let table = read("a\n1\nnan\nmany\n").unwrap();
        for row in &table.rows[1..] {
            let error = table.number(row, "a").unwrap_err().to_string();
            assert!(error.contains("a finite number"), "{error}");
        }
    }
}
