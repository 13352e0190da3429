//! Elements whose nominal geometry is a face of a CAD file.

use std::collections::BTreeMap;

use super::geometry::{Exclusion, ExclusionShape, Geometry};
use super::plan::PlanError;
use super::raw_elements::RawCadFace;
use super::within::Within;
use crate::cad::CadFeature;

/// Elements of the CAD files that a plan names, by the path as it writes them.
pub type CadParts = BTreeMap<String, Vec<CadFeature>>;

/// Elements that a message lists.
const MOST_LISTED: usize = 12;

/// What an element names: the number (`#123`) or the name of a face, and which instance of its solid (`#123@2`), counted from 1.
struct Wanted<'a> {
    number: Option<u64>,
    name: &'a str,
    instance: Option<usize>,
}

impl<'a> Wanted<'a> {
    fn of(face: &'a str, features: &[CadFeature]) -> Self {
        // A name may have an at sign itself.
        let is_name = features.iter().any(|f| f.names.iter().any(|n| n == face));
        let split = face.rsplit_once('@').filter(|_| !is_name);
        let counted = split.and_then(|(name, count)| count.parse().ok().map(|count| (name, Some(count))));
        let (name, instance) = counted.unwrap_or((face, None));
        Self { number: name.strip_prefix('#').and_then(|digits| digits.parse().ok()), name, instance }
    }

    fn fits(&self, feature: &CadFeature) -> bool {
        let face = match self.number {
            Some(id) => feature.faces.contains(&id),
            None => feature.names.iter().any(|name| name == self.name),
        };
        face && self.instance.is_none_or(|count| feature.instance.unwrap_or(1) == count)
    }
}

/// The number of an element's first face, and its instance where there are several.
fn label(feature: &CadFeature) -> String {
    let instance = feature.instance.map(|count| format!("@{count}")).unwrap_or_default();
    format!("#{}{instance}", feature.faces[0])
}

/// The geometry of the face that an element names, by its number (`#123`) or its name; of an instance by `@2` after it.
pub(super) fn cad_face(raw: &RawCadFace, cad: &CadParts, place: &Within) -> Result<Geometry, PlanError> {
    let features = cad.get(&raw.file).ok_or_else(|| {
        place.refuse(format!(
            "file = \"{}\" was not read: nominal geometry comes from the file beside a plan",
            raw.file
        ))
    })?;
    let wanted = Wanted::of(&raw.face, features);
    let mut found = features.iter().filter(|feature| wanted.fits(feature));
    match (found.next(), found.next()) {
        (Some(feature), None) => inset(&feature.geometry, raw.inset_mm, place),
        (Some(one), Some(two)) => Err(place.refuse(format!(
            "face = \"{}\" stands for several elements of {}, such as {} and {}: give the one that is meant",
            raw.face,
            raw.file,
            label(one),
            label(two)
        ))),
        (None, _) => Err(place.refuse(format!(
            "face = \"{}\" is no plane, cylinder, cone, sphere or torus of {}; it has {}",
            raw.face,
            raw.file,
            listed(features)
        ))),
    }
}

/// What a file has, for a message.
fn listed(features: &[CadFeature]) -> String {
    let one = |feature: &CadFeature| {
        let name = feature.names.first().map(|n| format!(" \"{n}\"")).unwrap_or_default();
        format!("{}{name} ({})", label(feature), feature.geometry.kind())
    };
    let first: Vec<String> = features.iter().take(MOST_LISTED).map(one).collect();
    match features.len().saturating_sub(MOST_LISTED) {
        _ if first.is_empty() => "none".into(),
        0 => first.join(", "),
        more => format!("{} and {more} more: fringetool plan-from-cad lists them", first.join(", ")),
    }
}

/// The geometry less what its ends lose, mm.
fn inset(geometry: &Geometry, inset_mm: f64, place: &Within) -> Result<Geometry, PlanError> {
    place.not_negative("inset_mm", inset_mm)?;
    let left = |half: f64| place.positive("half of the size less inset_mm", half - inset_mm);
    let mut geometry = geometry.clone();
    match &mut geometry {
        Geometry::Plane { half_size_mm, exclusions, .. } => {
            *half_size_mm = [left(half_size_mm[0])?, left(half_size_mm[1])?];
            for Exclusion { shape, .. } in exclusions {
                match shape {
                    ExclusionShape::Disc(radius) => *radius += inset_mm,
                    ExclusionShape::Rectangle(half) => *half = half.map(|h| h + inset_mm),
                }
            }
        }
        Geometry::Cylinder { half_length_mm, .. } | Geometry::Cone { half_length_mm, .. } => {
            *half_length_mm = left(*half_length_mm)?;
        }
        _ if inset_mm > 0.0 => {
            return Err(place.refuse(format!(
                "inset_mm = {inset_mm}, but a {} of CAD has no ends: leave it out",
                geometry.kind()
            )));
        }
        _ => {}
    }
    Ok(geometry)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::inspection::{Plan, RawPlan, Surfaces};
    use nalgebra::{Point3, Vector3};

    fn parts() -> CadParts {
        let bore = Geometry::Cylinder {
            point_mm: Point3::new(5.0, 0.0, 5.0),
            axis: Vector3::z(),
            radius_mm: 6.0,
            half_length_mm: 5.0,
            internal: true,
            sector: None,
        };
        let face = |faces: &[u64], names: &[&str], geometry: &Geometry| CadFeature {
            faces: faces.to_vec(),
            names: names.iter().map(|n| (*n).to_owned()).collect(),
            geometry: geometry.clone(),
            area_mm2: 1.0,
            internal: true,
            triangles: Vec::new(),
            instance: None,
        };
        let ball = Geometry::Sphere {
            center_mm: Point3::origin(),
            radius_mm: 3.0,
            axis: Vector3::z(),
            cos_polar: [-1.0, 1.0],
        };
        CadParts::from([(
            "part.step".to_owned(),
            vec![face(&[20, 30], &["bore", "twice"], &bore), face(&[41], &["twice"], &ball)],
        )])
    }

    fn plan(more: &str) -> Result<Plan, String> {
        let text = format!(
            "format = \"fringecell-plan/1\"\nname = \"p\"\n[[element]]\nkind = \"cad-face\"\nname = \"e\"\n{more}\n\
             margin_mm = 0.5\nmin_points = 50\n[[feature]]\nkind = \"size\"\nname = \"d\"\nelement = \"e\"\n\
             tolerance_mm = [-0.1, 0.1]\n"
        );
        let raw: RawPlan = toml::from_str(&text).map_err(|e| e.to_string())?;
        Plan::with_nominals(raw, &Surfaces::new(), &parts()).map_err(|e| e.to_string())
    }

    #[test]
    fn a_face_is_found_by_number_and_by_name() {
        for face in ["#20", "#30", "bore"] {
            let plan = plan(&format!("file = \"part.step\"\nface = \"{face}\"\ninset_mm = 0.5")).unwrap();
            let Geometry::Cylinder { half_length_mm, internal, .. } = plan.elements[0].geometry else {
                panic!("{face}")
            };
            assert_eq!((half_length_mm, internal), (4.5, true));
            assert_eq!(plan.features[0].nominal, 12.0);
        }
        assert_eq!(plan("file = \"part.step\"\nface = \"#41\"").unwrap().features[0].nominal, 6.0);
    }

    #[test]
    fn what_is_not_there_is_told_with_what_is() {
        for (more, words) in [
            ("file = \"part.step\"\nface = \"#21\"", "#20 \"bore\" (cylinder), #41 \"twice\" (sphere)"),
            ("file = \"part.step\"\nface = \"20\"", "no plane"),
            ("file = \"part.step\"\nface = \"twice\"", "#20 and #41"),
            ("file = \"other.step\"\nface = \"#20\"", "was not read"),
            ("file = \"part.step\"\nface = \"#20\"\ninset_mm = 5.0", "less inset_mm"),
            ("file = \"part.step\"\nface = \"#20\"\ninset_mm = -1.0", "inset_mm = -1"),
            ("file = \"part.step\"\nface = \"#41\"\ninset_mm = 1.0", "has no ends"),
            ("file = \"part.step\"", "face"),
        ] {
            let error = plan(more).unwrap_err();
            assert!(error.contains(words), "{more}: {error}");
        }
    }
}
