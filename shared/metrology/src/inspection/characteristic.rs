//! Geometrical characteristics of a plan: what is measured of which elements, in which datum system.

use nalgebra::Vector3;

use super::criterion::Criterion;

/// What of an element a geometrical tolerance limits.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, serde::Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Extracted {
    /// All points of the element, as ISO 1101 has it.
    #[default]
    Points,
    /// The associated element alone, without its form.
    Fit,
}

/// Maximum material requirement of a position (ISO 2692).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MaximumMaterial {
    /// Size at which there is most material, mm.
    pub size_mm: f64,
    /// The other limit of the size, mm: the tolerance grows no further.
    pub least_mm: f64,
    /// Whether the feature is a hole or slot.
    pub internal: bool,
    /// Which of the element's sizes it is.
    pub index: usize,
}

impl MaximumMaterial {
    /// What the tolerance gains at an actual size, mm, and by how much it changes with that size.
    pub fn bonus_mm(&self, size_mm: f64) -> (f64, f64) {
        let sign = if self.internal { 1.0 } else { -1.0 };
        let most = (self.least_mm - self.size_mm).abs();
        let departed = sign * (size_mm - self.size_mm);
        if departed <= 0.0 {
            (0.0, 0.0)
        } else if departed >= most {
            (most, 0.0)
        } else {
            (departed, sign)
        }
    }
}

/// What a characteristic measures.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Kind {
    /// A size of the element: 0 or 1.
    Size(usize),
    /// Half angle of a cone, deg.
    HalfAngle,
    /// Distance of two elements, or its component along a direction of the part frame.
    Distance(Option<Vector3<f64>>),
    /// Angle of two elements' directions, deg.
    Angle,
    /// Straightness, flatness, roundness, cylindricity: range of the points about the element of a criterion.
    Form(Criterion),
    /// Parallelism, perpendicularity, angularity: width of the zone in the nominal direction.
    Orientation(Extracted),
    /// Position, coaxiality, concentricity, symmetry: twice the largest deviation from the nominal place.
    Position(Option<MaximumMaterial>),
    /// Profile of a line or surface: twice the largest distance of a point from the nominal surface.
    Profile,
    /// Run-out: range of the distances from the datum axis in each section of this width, mm; in all together without.
    Runout(Option<f64>),
}

/// A characteristic with its elements.
#[derive(Debug, Clone, PartialEq)]
pub struct Characteristic {
    /// As the plan names it.
    pub name: &'static str,
    /// What it measures, with its settings.
    pub kind: Kind,
    /// Elements: measured ones by their index, constructed ones after them.
    pub elements: Vec<usize>,
    /// Index of the datum system.
    pub datums: Option<usize>,
    /// Edge of the cells whose means are taken instead of single points, mm.
    pub filter_mm: Option<f64>,
    /// Direction of a zone between two planes; `None`: the zone is round, or follows the element.
    pub zone_direction: Option<Vector3<f64>>,
}

impl Characteristic {
    /// Symbol and standard, for reports.
    pub fn symbol(&self) -> &'static str {
        match self.name {
            "size" => "size (ISO 14405-1)",
            "half-angle" => "half angle (ISO 14405-3)",
            "distance" => "distance (ISO 14405-2)",
            "angle" => "angle (ISO 14405-3)",
            "straightness" => "⏤ straightness (ISO 1101)",
            "flatness" => "⏥ flatness (ISO 1101)",
            "roundness" => "○ roundness (ISO 1101)",
            "cylindricity" => "⌭ cylindricity (ISO 1101)",
            "parallelism" => "∥ parallelism (ISO 1101)",
            "perpendicularity" => "⊥ perpendicularity (ISO 1101)",
            "angularity" => "∠ angularity (ISO 1101)",
            "position" => "⌖ position (ISO 1101)",
            "coaxiality" => "◎ coaxiality (ISO 1101)",
            "concentricity" => "◎ concentricity (ISO 1101)",
            "symmetry" => "⌯ symmetry (ISO 1101)",
            "line-profile" => "⌒ profile of a line (ISO 1101)",
            "surface-profile" => "⌓ profile of a surface (ISO 1101)",
            "circular-runout" => "↗ circular run-out (ISO 1101)",
            "total-runout" => "⌰ total run-out (ISO 1101)",
            other => other,
        }
    }
}
