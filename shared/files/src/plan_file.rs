//! Inspection plans, `fringecell-plan/1`.

use crate::document::Document;
use crate::error::{FileError, Problem};
use metrology::inspection::{PLAN_FORMAT, Plan, PlanError, RawPlan};
use std::path::Path;

/// Reads and checks a plan; also gives its text.
///
/// # Errors
/// A file that cannot be read, or as [`parse_plan`].
pub fn read_plan(path: &Path) -> Result<(Plan, Document), FileError> {
    let document = Document::read(path)?;
    Ok((parse_plan(&document)?, document))
}

/// Checks a plan that was read.
///
/// # Errors
/// Not TOML, another format, unknown or missing keys, numbers out of range, names that do not fit together.
pub fn parse_plan(document: &Document) -> Result<Plan, FileError> {
    let raw: RawPlan = document.parse(PLAN_FORMAT)?;
    Plan::new(raw).map_err(|error| {
        let unknown = match &error {
            PlanError::Reference { name, known, .. } => Some((name.as_str(), known.as_str())),
            _ => None,
        };
        document.fault_at(error.place(), unknown, Problem::Plan(error.clone()))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    const PLAN: &str = "format = \"fringecell-plan/1\"\nname = \"p\"\n[[element]]\nkind = \"sphere\"\nname = \"ball\"\n\
        center_mm = [0.0, 0.0, 0.0]\ndiameter_mm = 20.0\nmargin_mm = 1.0\nmin_points = 100\n\
        [[feature]]\nkind = \"sphere-diameter\"\nname = \"d\"\nelement = \"ball\"\nnominal_mm = 20.0\n\
        tolerance_mm = [-0.1, 0.1]\n";

    fn refused(from: &str, to: &str) -> String {
        assert!(PLAN.contains(from), "{from}");
        let document = Document { path: "a.toml".into(), text: PLAN.replacen(from, to, 1) };
        parse_plan(&document).expect_err(to).to_string()
    }

    #[test]
    fn a_fault_is_told_with_line_key_value_limit_and_remedy() {
        parse_plan(&Document { path: "a.toml".into(), text: PLAN.into() }).unwrap();
        for (from, to, words) in [
            ("plan/1", "plan/2", ["a.toml:1: format", "fringecell-plan/2", "fringecell-plan/1"]),
            ("format = \"fringecell-plan/1\"\n", "", ["format", "add the line", "fringecell-plan/1"]),
            ("margin_mm", "margn_mm", ["a.toml:", "margn_mm", "did you mean \"margin_mm\"?"]),
            (
                "diameter_mm = 20.0",
                "diameter_mm = -2.0",
                ["a.toml:7: element[0].diameter_mm", "-2", "positive"],
            ),
            (
                "element = \"ball\"",
                "element = \"bal\"",
                ["a.toml:13: feature[0].element", "\"bal\"", "did you mean \"ball\"?"],
            ),
            ("[[element]]", "[[element", ["a.toml:3", "", ""]),
            ("min_points = 100", "min_points = \"x\"", ["a.toml:3", "\"x\"", "expected usize"]),
        ] {
            let error = refused(from, to);
            assert!(words.iter().all(|word| error.contains(word)) && !error.contains('\n'), "{to}: {error}");
        }
    }
}
