//! Features of geometrical characteristics and datum systems, as they are written.

use serde::Deserialize;

use super::characteristic::Extracted;
use super::criterion::Criterion;

/// A feature: its own keys, and those of all.
macro_rules! feature {
    ($name:ident { $($keys:tt)* }) => {
        #[derive(Deserialize)]
        #[serde(deny_unknown_fields)]
        pub(super) struct $name {
            pub name: String,
            $($keys)*
        }
    };
}

feature!(RawSize {
    pub element: String,
    pub size: Option<SizeName>,
    pub nominal_mm: Option<f64>,
    pub tolerance_mm: [f64; 2],
    #[serde(default)]
    pub u_system_mm: f64,
});

feature!(RawHalfAngle {
    pub element: String,
    pub nominal_deg: Option<f64>,
    pub tolerance_deg: [f64; 2],
    #[serde(default)]
    pub u_system_deg: f64,
});

feature!(RawDistance {
    pub elements: [String; 2],
    pub along: Option<[f64; 3]>,
    pub datums: Option<String>,
    pub nominal_mm: Option<f64>,
    pub tolerance_mm: [f64; 2],
    #[serde(default)]
    pub u_system_mm: f64,
});

feature!(RawAngle {
    pub elements: [String; 2],
    pub nominal_deg: Option<f64>,
    pub tolerance_deg: [f64; 2],
    #[serde(default)]
    pub u_system_deg: f64,
});

feature!(RawForm {
    pub element: String,
    pub limit_mm: f64,
    #[serde(default)]
    pub reference: Criterion,
    pub filter_mm: Option<f64>,
    #[serde(default)]
    pub u_system_mm: f64,
});

feature!(RawOrientation {
    pub element: String,
    pub datums: String,
    pub limit_mm: f64,
    #[serde(default)]
    pub of: Extracted,
    pub filter_mm: Option<f64>,
    pub zone_direction: Option<[f64; 3]>,
    #[serde(default)]
    pub u_system_mm: f64,
});

feature!(RawPosition {
    pub element: String,
    pub datums: String,
    pub limit_mm: f64,
    pub maximum_material: Option<String>,
    pub zone_direction: Option<[f64; 3]>,
    #[serde(default)]
    pub u_system_mm: f64,
});

feature!(RawLocation {
    pub element: String,
    pub datums: String,
    pub limit_mm: f64,
    #[serde(default)]
    pub u_system_mm: f64,
});

feature!(RawProfile {
    pub element: String,
    pub datums: Option<String>,
    pub limit_mm: f64,
    pub filter_mm: Option<f64>,
    #[serde(default)]
    pub u_system_mm: f64,
});

feature!(RawCircularRunout {
    pub element: String,
    pub datums: String,
    pub limit_mm: f64,
    pub section_mm: f64,
    pub filter_mm: Option<f64>,
    #[serde(default)]
    pub u_system_mm: f64,
});

feature!(RawTotalRunout {
    pub element: String,
    pub datums: String,
    pub limit_mm: f64,
    pub filter_mm: Option<f64>,
    #[serde(default)]
    pub u_system_mm: f64,
});

/// Which size of an element is meant.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(super) enum SizeName {
    Diameter,
    Length,
    Width,
    RingDiameter,
    TubeDiameter,
}

/// An ordered datum system.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct RawDatumSystem {
    pub name: String,
    pub datums: Vec<RawDatum>,
}

/// A datum: one element, or several together.
#[derive(Deserialize)]
#[serde(untagged)]
pub(super) enum RawDatum {
    One(String),
    Common(Vec<String>),
}
