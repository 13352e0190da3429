//! Elements as they are written, with the keys that all measured ones share.

use serde::Deserialize;

use super::criterion::Criterion;

/// What all measured elements share.
#[derive(Clone)]
pub(super) struct Common {
    pub name: String,
    pub margin_mm: f64,
    pub normal_tolerance_deg: Option<f64>,
    pub min_points: usize,
    pub max_reject_fraction: f64,
    pub criterion: Criterion,
}

/// A measured element: its own keys, and those of all.
macro_rules! measured {
    ($name:ident { $($keys:tt)* }) => {
        #[derive(Deserialize)]
        #[serde(deny_unknown_fields)]
        pub(super) struct $name {
            pub name: String,
            $($keys)*
            pub margin_mm: f64,
            pub normal_tolerance_deg: Option<f64>,
            pub min_points: usize,
            #[serde(default)]
            pub max_reject_fraction: f64,
            #[serde(default)]
            pub criterion: Criterion,
        }

        impl $name {
            pub fn common(&self) -> Common {
                Common {
                    name: self.name.clone(),
                    margin_mm: self.margin_mm,
                    normal_tolerance_deg: self.normal_tolerance_deg,
                    min_points: self.min_points,
                    max_reject_fraction: self.max_reject_fraction,
                    criterion: self.criterion,
                }
            }
        }
    };
}

measured!(RawCylinder {
    pub point_mm: [f64; 3],
    pub axis: [f64; 3],
    pub diameter_mm: f64,
    pub length_mm: f64,
    #[serde(default)]
    pub inset_mm: f64,
    #[serde(default)]
    pub internal: bool,
    pub direction: Option<[f64; 3]>,
    pub sector_deg: Option<f64>,
});

measured!(RawCone {
    pub point_mm: [f64; 3],
    pub axis: [f64; 3],
    pub diameter_mm: f64,
    pub half_angle_deg: f64,
    pub length_mm: f64,
    #[serde(default)]
    pub inset_mm: f64,
    #[serde(default)]
    pub internal: bool,
});

measured!(RawTorus {
    pub center_mm: [f64; 3],
    pub axis: [f64; 3],
    pub ring_diameter_mm: f64,
    pub tube_diameter_mm: f64,
});

measured!(RawCircle {
    pub center_mm: [f64; 3],
    pub normal: [f64; 3],
    pub diameter_mm: f64,
    #[serde(default = "yes")]
    pub internal: bool,
    pub band_mm: f64,
});

measured!(RawOblong {
    pub center_mm: [f64; 3],
    pub normal: [f64; 3],
    pub direction: [f64; 3],
    pub size_mm: [f64; 2],
    #[serde(default = "yes")]
    pub internal: bool,
    pub band_mm: f64,
    #[serde(default)]
    pub inset_mm: f64,
});

measured!(RawEdge {
    pub point_mm: [f64; 3],
    pub normal: [f64; 3],
    pub outward: [f64; 3],
    pub length_mm: f64,
    #[serde(default)]
    pub inset_mm: f64,
    pub band_mm: f64,
});

measured!(RawLine {
    pub point_mm: [f64; 3],
    pub normal: [f64; 3],
    pub direction: [f64; 3],
    pub length_mm: f64,
    pub width_mm: f64,
    #[serde(default)]
    pub inset_mm: f64,
});

measured!(RawPoint {
    pub point_mm: [f64; 3],
    pub normal: [f64; 3],
    pub radius_mm: f64,
});

measured!(RawSurface {
    pub file: String,
    pub sha256: Option<String>,
});

measured!(RawCadFace {
    pub file: String,
    pub face: String,
    pub sha256: Option<String>,
    #[serde(default)]
    pub inset_mm: f64,
});

/// An element that is made of others.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct RawMade {
    pub name: String,
    pub elements: Vec<String>,
}

fn yes() -> bool {
    true
}
