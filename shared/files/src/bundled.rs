//! Files of `configs/` that are part of the programs: commands without a configuration work outside the repository.

/// Names and contents of the files of the demo cell, its configuration first.
pub const DEMO: [(&str, &str); 4] = [
    ("demo.toml", include_str!("../../../configs/demo.toml")),
    ("demo-rig.toml", include_str!("../../../configs/demo-rig.toml")),
    ("complex-artefact.plan.toml", include_str!("../../../configs/complex-artefact.plan.toml")),
    ("complex-artefact.scene.toml", include_str!("../../../configs/complex-artefact.scene.toml")),
];

/// Names and contents of further files that benchmarks use.
pub const FOR_BENCHMARKS: [(&str, &str); 4] = [
    ("single-view.toml", include_str!("../../../configs/single-view.toml")),
    ("single-view-rig.toml", include_str!("../../../configs/single-view-rig.toml")),
    ("single-view-plate.scene.toml", include_str!("../../../configs/single-view-plate.scene.toml")),
    ("plane.scene.toml", include_str!("../../../configs/plane.scene.toml")),
];

/// Identifiers and texts of the rule sets of acceptance tests.
pub const RULE_SETS: [(&str, &str); 4] = [
    ("vdi2634-1", include_str!("../../../configs/rules/vdi2634-1.toml")),
    ("vdi2634-2", include_str!("../../../configs/rules/vdi2634-2.toml")),
    ("vdi2634-3", include_str!("../../../configs/rules/vdi2634-3.toml")),
    ("iso10360-13", include_str!("../../../configs/rules/iso10360-13.toml")),
];
