//! Names from files that become paths and service names.

use crate::error::Problem;

/// Longest name, bytes: a path of three of them stays far below the limits of every file system.
const NAME_LIMIT_BYTES: usize = 64;

/// Checks a name of a camera, projector or pair: it becomes a folder and must not lead out of its parent.
///
/// # Errors
/// Empty, too long, starting with a dot, or holding a path separator or a control character.
pub fn check_name(name: &str) -> Result<(), Problem> {
    let bad = |c: char| c == '/' || c == '\\' || c == ':';
    let fits = !name.is_empty()
        && name.len() <= NAME_LIMIT_BYTES
        && !name.starts_with('.')
        && name.trim() == name
        && !name.contains(bad)
        && fringe::text::is_printable(name);
    if fits {
        return Ok(());
    }
    Err(Problem::Value {
        value: format!("{name:?}"),
        limit: format!(
            "a name has 1 to {NAME_LIMIT_BYTES} bytes, no '/', '\\', ':' or control character, no dot in front and \
             no space at its ends"
        ),
    })
}

/// The first name that occurs twice.
pub(crate) fn duplicate<'a>(names: impl IntoIterator<Item = &'a str>) -> Option<(usize, &'a str)> {
    let mut seen = std::collections::BTreeSet::new();
    names.into_iter().enumerate().find(|(_, name)| !seen.insert(*name))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_that_lead_out_of_a_folder_are_refused() {
        for bad in
            ["", ".", "..", "../x", "a/b", "a\\b", "/a", "a\0b", "a\nb", " a", ".hidden", &"x".repeat(65)]
        {
            assert!(check_name(bad).is_err(), "{bad:?}");
        }
        for good in ["cam1", "left-2", "Kamera_ä", "a.b", "a..b"] {
            assert!(check_name(good).is_ok(), "{good:?}");
        }
    }

    #[test]
    fn the_second_of_two_equal_names_is_found() {
        assert_eq!(duplicate(["a", "b", "a"]), Some((2, "a")));
        assert_eq!(duplicate(["a", "b"]), None);
    }
}
