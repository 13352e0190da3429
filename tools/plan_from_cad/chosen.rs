//! Which elements of a part come into its plan, under which names.

use anyhow::{Result, bail};
use files::step_file::StepPart;
use metrology::cad::CadFeature;
use metrology::inspection::Geometry;
use std::collections::{BTreeMap, BTreeSet};
use std::f64::consts::PI;

/// A part of a surface of less than this share of the whole tells no size well: fillets are a quarter.
const LEAST_SHARE: f64 = 0.4;

/// Characters of a name of the CAD that a plan takes.
const LONGEST_NAME: usize = 40;

/// An element of the part, and whether the plan has it.
pub struct Chosen {
    /// Name in the plan.
    pub name: String,
    /// The element with its faces.
    pub feature: CadFeature,
    /// Index of the solid that it belongs to.
    pub solid: usize,
    /// Why the plan does not have it.
    pub left_out: Option<String>,
}

impl Chosen {
    /// The faces as a plan names them, and their names where they have some.
    pub fn origin(&self) -> String {
        let instance = self.feature.instance.map(|count| format!("@{count}")).unwrap_or_default();
        let faces: Vec<String> = self.feature.faces.iter().map(|id| format!("#{id}{instance}")).collect();
        let names = self.feature.names.join(", ");
        let shown: String = names.chars().filter(|c| !c.is_control()).take(80).collect();
        if shown.is_empty() { faces.join(" ") } else { format!("{} \"{shown}\"", faces.join(" ")) }
    }

    /// The size in a word, for the table.
    pub fn size(&self) -> String {
        match &self.feature.geometry {
            Geometry::Plane { half_size_mm: [a, b], .. } => format!("{:.1} × {:.1}", 2.0 * a, 2.0 * b),
            Geometry::Cylinder { radius_mm, .. }
            | Geometry::Cone { radius_mm, .. }
            | Geometry::Sphere { radius_mm, .. } => format!("⌀ {:.4}", 2.0 * radius_mm),
            Geometry::Torus { tube_radius_mm, .. } => format!("R {tube_radius_mm:.4}"),
            _ => String::new(),
        }
    }
}

/// All elements of a part, in the order of its solids and faces.
pub fn elements(part: &StepPart, least_area_mm2: f64) -> Vec<Chosen> {
    let mut chosen = Vec::new();
    for (solid, one) in part.solids.iter().enumerate() {
        for feature in one.features.clone() {
            let left_out = reason(&feature, least_area_mm2);
            chosen.push(Chosen { name: String::new(), feature, solid, left_out });
        }
    }
    name(&mut chosen);
    chosen
}

/// Leaves out the elements of these names.
///
/// # Errors
/// A name that no element has.
pub fn leave_out(chosen: &mut [Chosen], names: &[String]) -> Result<()> {
    for name in names {
        let Some(one) = chosen.iter_mut().find(|one| one.name == *name) else {
            let known: Vec<&str> = chosen.iter().map(|one| one.name.as_str()).collect();
            bail!("--without {name}: no element has this name; known are {}", known.join(", "));
        };
        one.left_out.get_or_insert_with(|| "named by --without".to_owned());
    }
    Ok(())
}

/// Why an element does not come into a plan.
fn reason(feature: &CadFeature, least_area_mm2: f64) -> Option<String> {
    let share = share(feature);
    if feature.area_mm2 < least_area_mm2 {
        return Some(format!("less than {least_area_mm2} mm²"));
    }
    (share < LEAST_SHARE).then(|| format!("{:.0} % of its surface: a fillet or a corner", 100.0 * share))
}

/// How much of the surface between its ends there is; of a sphere of all of it.
fn share(feature: &CadFeature) -> f64 {
    let whole = match &feature.geometry {
        Geometry::Cylinder { radius_mm, half_length_mm, .. } => 4.0 * PI * radius_mm * half_length_mm,
        Geometry::Cone { radius_mm, half_angle_rad, half_length_mm, .. } => {
            4.0 * PI * radius_mm * half_length_mm / fringe::math::cos(*half_angle_rad)
        }
        // A third of a sphere tells its diameter.
        Geometry::Sphere { radius_mm, .. } => 0.5 * 4.0 * PI * radius_mm * radius_mm,
        Geometry::Torus { ring_radius_mm, tube_radius_mm, .. } => {
            4.0 * PI * PI * ring_radius_mm * tube_radius_mm
        }
        _ => return 1.0,
    };
    feature.area_mm2 / whole
}

/// Names: that of the CAD where it is one's own, else kind and number, counted from 1.
fn name(chosen: &mut [Chosen]) {
    let mut counts: BTreeMap<&'static str, usize> = BTreeMap::new();
    let mut taken = BTreeSet::new();
    for one in chosen {
        let kind = one.feature.geometry.kind();
        let count = counts.entry(kind).or_default();
        *count += 1;
        let given = one.feature.names.first().map(|n| plain(n)).filter(|n| !n.is_empty());
        let numbered = format!("{kind}{count}");
        one.name = match given {
            Some(given) if !taken.contains(&given) => given,
            _ => numbered,
        };
        while !taken.insert(one.name.clone()) {
            one.name.push('_');
        }
    }
}

/// A name with the characters that all programs take.
fn plain(name: &str) -> String {
    let kept = |c: char| if c.is_alphanumeric() || "-_.".contains(c) { c } else { '_' };
    let text: String = name.trim().chars().take(LONGEST_NAME).map(kept).collect();
    // Some systems write "NONE" for a face without a name.
    if text.chars().all(|c| c == '_') || text.eq_ignore_ascii_case("none") { String::new() } else { text }
}
