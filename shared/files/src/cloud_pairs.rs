//! The pairs of a cloud by name, as a comment of its PLY file: points name their pair by its number among those that were matched, which need not be
//! all pairs of the rig file.

use crate::ply::Cloud;
use fringe::geometry::rig::Pair;

/// Name of the comment; its value is a JSON list of names.
pub const COMMENT: &str = "pairs";

/// The value of the comment.
pub fn comment(pairs: &[Pair]) -> String {
    serde_json::json!(names(pairs)).to_string()
}

fn names(pairs: &[Pair]) -> Vec<String> {
    pairs.iter().map(|pair| pair.name.clone()).collect()
}

/// Numbers the pairs of the points as the rig file does and gives the names of the pairs of the cloud, in the order of the rig file. A
/// cloud without the comment was made of all pairs.
///
/// # Errors
/// What is wrong, and what helps: a comment that is no list of the rig's pairs, or points that do not tell their pair.
pub fn number_by_rig(cloud: &mut Cloud, rig: &[Pair]) -> Result<Vec<String>, String> {
    if !cloud.columns.pair && rig.len() > 1 {
        return Err(
            "does not say which pair saw each point; take the cloud as `reconstruct` or a cell wrote it"
                .into(),
        );
    }
    let held = match cloud.comment(COMMENT) {
        Some(text) => serde_json::from_str::<Vec<String>>(text).map_err(|error| {
            format!("comment {COMMENT} is no list of names ({error}); reconstruct the cloud again")
        })?,
        None => names(rig),
    };
    let number = |name: &String| {
        let number = rig.iter().position(|pair| pair.name == *name);
        number.map(|number| number as u32).ok_or_else(|| {
            let all = names(rig).join(", ");
            format!("was made of pair \"{name}\", the rig file has {all}: take the rig file that it was made with, and pairs of two cameras")
        })
    };
    let numbers = held.iter().map(number).collect::<Result<Vec<u32>, String>>()?;
    for point in &mut cloud.points {
        let Some(number) = numbers.get(point.pair as usize) else {
            let count = numbers.len();
            return Err(format!(
                "has points of pair {}, and {count} pairs: it is another rig's cloud",
                point.pair + 1
            ));
        };
        point.pair = *number;
    }
    Ok(names(rig).into_iter().filter(|name| held.contains(name)).collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ply::Columns;
    use fringe::cloud::Point;

    fn cloud(pairs: &[u32], comment: Option<&str>) -> Cloud {
        let point = |pair: &u32| Point { pair: *pair, ..bytemuck::Zeroable::zeroed() };
        Cloud {
            points: pairs.iter().map(point).collect(),
            columns: Columns { pair: true, ..Columns::default() },
            comments: comment.map(|text| format!("{COMMENT}: {text}")).into_iter().collect(),
            ..Cloud::default()
        }
    }

    fn rig() -> Vec<Pair> {
        let pair = |name: &str| Pair {
            name: name.into(),
            left: "a".into(),
            right: "b".into(),
            projector: "p".into(),
        };
        ["one", "two", "three"].map(pair).into()
    }

    #[test]
    fn points_are_numbered_by_the_names_of_their_pairs() {
        let numbered = |mut cloud: Cloud| {
            let names = number_by_rig(&mut cloud, &rig())?;
            Ok::<_, String>((
                cloud.points.iter().map(|point| point.pair).collect::<Vec<_>>(),
                names.join(" "),
            ))
        };
        let [one, _, three] = rig().try_into().unwrap();
        let written = comment(&[three, one]);
        assert_eq!(numbered(cloud(&[0, 1, 0], Some(&written))).unwrap(), (vec![2, 0, 2], "one three".into()));
        assert_eq!(numbered(cloud(&[2, 1], None)).unwrap(), (vec![2, 1], "one two three".into()));
        let untold = Cloud { columns: Columns::default(), ..cloud(&[0], None) };
        for (cloud, words) in [
            (untold, "does not say which pair"),
            (cloud(&[3], None), "points of pair 4, and 3 pairs"),
            (cloud(&[1], Some("[\"two\"]")), "points of pair 2, and 1 pairs"),
            (cloud(&[0], Some("[\"four\"]")), "was made of pair \"four\", the rig file has one, two, three"),
            (cloud(&[0], Some("{")), "is no list of names"),
        ] {
            let error = numbered(cloud).unwrap_err();
            assert!(error.contains(words), "{error}");
        }
        let alone = &mut Cloud { columns: Columns::default(), ..cloud(&[0], None) };
        assert_eq!(number_by_rig(alone, &rig()[..1]).unwrap(), ["one"]);
    }
}
