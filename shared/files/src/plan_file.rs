//! Inspection plans, `fringecell-plan/1`.

use crate::document::{Document, read_bytes};
use crate::error::{FileError, Problem};
use crate::hash::sha256_hex;
use crate::step_file;
use crate::surface_file::{self, Surface};
use metrology::inspection::{CadParts, PLAN_FORMAT, Plan, PlanError, RawPlan, SurfaceFile, Surfaces};
use metrology::spatial::TriangleMesh;
use std::collections::btree_map::Entry;
use std::path::Path;

/// Largest file of nominal geometry.
const LARGEST_BYTES: u64 = 1 << 32;

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
    let (surfaces, cad) = nominals(document, &raw)?;
    Plan::with_nominals(raw, &surfaces, &cad).map_err(|error| {
        let unknown = match &error {
            PlanError::Reference { name, known, .. } => Some((name.as_str(), known.as_str())),
            _ => None,
        };
        document.fault_at(error.place(), unknown, Problem::Plan(error.clone()))
    })
}

/// The meshes and CAD faces that a plan names, from the folder of the plan.
fn nominals(document: &Document, raw: &RawPlan) -> Result<(Surfaces, CadParts), FileError> {
    let folder = document.path.parent().unwrap_or(Path::new(""));
    let (mut read, mut cad) = (Surfaces::new(), CadParts::new());
    for SurfaceFile { element, file, sha256, by_face } in raw.surface_files() {
        let path = folder.join(&file);
        if let Some(stated) = sha256 {
            let found = sha256_hex(&read_bytes(&path, LARGEST_BYTES)?);
            if stated != found {
                let message = format!(
                    "sha256 = \"{stated}\", but {file} has {found}: it is not the file that was meant"
                );
                let error = PlanError::Part { place: format!("element \"{element}\""), message };
                return Err(document.fault_at(error.place(), None, Problem::Plan(error.clone())));
            }
        }
        if by_face {
            if let Entry::Vacant(place) = cad.entry(file) {
                place.insert(step_file::read_part(&path, None)?.features());
            }
            continue;
        }
        if read.contains_key(&file) {
            continue;
        }
        let Surface::Mesh(triangles) = surface_file::read(&path)? else {
            let problem = Problem::Unsupported("is a cloud, but a plan's nominal surface is a mesh".into());
            return Err(FileError::new(
                &path,
                problem,
                "export the surface as STEP, STL, PLY with faces or OBJ",
            ));
        };
        let mesh = TriangleMesh::new(&triangles).map_err(|error| {
            FileError::new(&path, Problem::Unsupported(error.to_string()), "export the surface again")
        })?;
        read.insert(file, mesh);
    }
    Ok((read, cad))
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

    /// A plan whose surface is a file beside it.
    #[test]
    fn the_nominal_surface_comes_from_the_file_that_was_meant() {
        let folder = tempfile::tempdir().unwrap();
        let write = |name: &str, text: &str| std::fs::write(folder.path().join(name), text).unwrap();
        let obj = "v 0 0 0\nv 9 0 0\nv 9 9 1\nf 1 2 3\n";
        write("skin.obj", obj);
        write(
            "cloud.ply",
            "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\nproperty float z\n\
            end_header\n0 0 0\n",
        );
        let plan = |more: &str| {
            let text = format!(
                "format = \"fringecell-plan/1\"\nname = \"p\"\n[[element]]\nkind = \"surface\"\nname = \"skin\"\n{more}\n\
                 margin_mm = 1.0\nmin_points = 100\n[[feature]]\nkind = \"surface-profile\"\nname = \"form\"\n\
                 element = \"skin\"\nlimit_mm = 0.1\n"
            );
            parse_plan(&Document { path: folder.path().join("plan.toml"), text })
                .map_err(|error| error.to_string())
        };
        let sha256 = sha256_hex(obj.as_bytes());
        assert_eq!(plan("file = \"skin.obj\"").unwrap().elements[0].geometry.kind(), "surface");
        assert!(plan(&format!("file = \"skin.obj\"\nsha256 = \"{sha256}\"")).is_ok());
        for (more, words) in [
            ("file = \"skin.obj\"\nsha256 = \"00\"", "it is not the file that was meant"),
            ("file = \"none.stl\"", "none.stl"),
            ("file = \"cloud.ply\"", "is a cloud"),
            ("file = \"skin.obj\"\nmax_reject_fraction = 0.1", "every point"),
        ] {
            let error = plan(more).unwrap_err();
            assert!(error.contains(words) && !error.contains('\n'), "{more}: {error}");
        }
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
            (
                "min_points = 100",
                "min_points = \"x\"",
                ["a.toml:9: element[0].min_points", "\"x\"", "expected usize"],
            ),
        ] {
            let error = refused(from, to);
            assert!(words.iter().all(|word| error.contains(word)) && !error.contains('\n'), "{to}: {error}");
        }
    }
}
