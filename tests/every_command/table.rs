//! Every command of `fringetool` as a line, and the inputs of these lines.

use super::output;
use crate::acceptance::spheres;
use crate::acceptance_report::master;
use crate::running::{Cell, text};
use crate::support::{fringetool, root};
use std::fmt::Write as _;
use std::process::{Command, Output, Stdio};

/// Commands of `fringetool` that take seconds, in an order in which inputs come first. `DIR` has the inputs, `NEW` is a folder
/// of its own for each pass, `CONFIGS` that of the repository. All of them take `--json`.
pub const QUICK: &[&str] = &[
    "simulate DIR/cell.toml --out NEW/rec",
    "decode DIR/rec",
    "explore DIR/rec",
    "unwrap DIR/rec",
    "reconstruct --rig DIR/rig.toml --out NEW/cloud.ply DIR/rec",
    "reference-plane calibrate --plane 0=DIR/z0 --plane 10=DIR/z10 --plane 20=DIR/z20 --out NEW/planes",
    "reference-plane measure DIR/z10 --calibration NEW/planes --out NEW/heights.npy",
    "rotation-stage calibrate --diameter 20 --out NEW/stage.toml --view 0=DIR/ball0.ply --view 40=DIR/ball40.ply \
     --view 80=DIR/ball80.ply",
    "rotation-stage merge --stage NEW/stage.toml --view 0=DIR/ball0.ply --view 40=DIR/ball40.ply --out NEW/whole.ply",
    "fit sphere DIR/ball0.ply",
    "flatness --box=-25,-25,-5,25,25,5 DIR/plane.ply",
    "compare DIR/cloud.ply DIR/cloud.ply",
    "convert DIR/cloud.ply --mesh --decimate 0.2 --out NEW/mesh.stl",
    "register DIR/cloud.ply --to DIR/cloud.ply --out NEW/aligned.ply",
    "new-plan DIR/cloud.ply --out NEW/draft.toml --min-points 100 --picture NEW/draft.png",
    "plan-from-cad CONFIGS/../tests/step/turned.step --out NEW/cad.toml --chord-mm 0.05 --picture NEW/cad.png",
    "measure DIR/plan.toml DIR/cloud.ply --html NEW/part.html --pdf NEW/part.pdf --csv NEW/part.csv --qif NEW/part.qif --dfq NEW/part.dfq",
    "spc DIR/values.csv --report NEW/spc.html --dfq NEW/spc.dfq",
    "place DIR/plan.toml DIR/cloud.ply --out NEW/placed.toml",
    "vdi2634 DIR/thesis.test.toml",
    "cmm-plan part DIR/plan.toml --points 25 --out NEW/probing.csv",
    "cmm-compare DIR/measured.json CONFIGS/complex-artefact.cmm.csv",
    "import DIR/layout.toml --from DIR/rec/frames/proj1 --out NEW/imported",
    "export --rig DIR/rig.toml --pair pair1 --out NEW/stereo.yml",
    "import-rig NEW/stereo.yml --views cam1,cam2 --out NEW/imported.toml",
    "calibrate --target DIR/target.toml --images left=DIR/left*.png --out NEW/calibrated.toml",
    "check-rig DIR/lit --rig DIR/lit-rig.toml",
    "correct-rig DIR/lit --rig DIR/lit-rig.toml --out NEW/corrected.toml",
    "gamma DIR/grey",
    "focus --images DIR/focus*.png --positions 460:560:10",
    "uncertainty CONFIGS/budgets/sphere-spacing.toml",
    "patterns DIR/cell.toml --out NEW/patterns --one-bit --packed",
    "plan-patterns --rig DIR/rig.toml --want-u-um 50",
    "plan-views CONFIGS/bracket/bracket.stl --rig DIR/rig.toml --element-mm 8 --bounce-rays 4 --picture NEW/views.png --csv NEW/views.csv",
    "report DIR/master.json --csv NEW/values.csv",
    "replay DIR/record",
    "cameras",
    "doctor DIR/cell.toml",
    "expose DIR/cell.toml --rounds 1",
    "preview DIR/cell.toml --frames 1 --png NEW/preview.png",
];

/// Commands that take a minute or more.
pub const SLOW: &[&str] = &[
    "simulate-test --reduced --out NEW/test",
    "bench accuracy",
    "bench calibration --trials 2 --images 0",
    "bench drift --trials 1 --undrifted 1 --sets 1 --recordings 1",
    "bench error-sources",
    "bench exposures",
    "bench features --trials 3 --point-trials 1",
    "bench order-errors",
    "bench peers-case --case stream",
    "bench phase-methods",
    "bench plan-patterns",
    "bench speed --repeats 1",
    "bench stage-axis",
    "bench unwrap",
    "bench transport",
];

/// Commands that end only when they are stopped; see the tests of network cameras.
pub const ENDLESS: &[&str] = &["serve-camera DIR/cell.toml"];

/// Commands that need cameras on the network; see the tests of network cameras.
pub const ON_NETWORK: &[&str] = &["new-cell --out NEW/cell.toml"];

/// Commands whose output is no result.
pub const WITHOUT_JSON: &[&str] = &["completions bash", "man --out NEW/man"];

/// What the commands of the table need.
pub struct Inputs {
    pub cell: Cell,
}

impl Inputs {
    pub fn new() -> Self {
        let inputs = Self { cell: Cell::played("table", 0.0, "") };
        let small = &inputs.cell.small;
        small.reconstruct(&[]).expect_success();
        // Limits and numbers of points for so few points.
        let plan = small.path("plan.toml");
        std::fs::write(&plan, crate::control::plan(-50.0, 50.0)).unwrap();
        let run = |line: &str| fringetool(&inputs.words(line, "")).expect_success();
        fringetool(&["measure", &plan, &small.path("cloud.ply"), "--json", &small.path("measured.json")])
            .expect_success();
        run("simulate DIR/cell.toml --scene CONFIGS/plane.scene.toml --grey-levels 32 --out DIR/grey");
        std::fs::write(small.path("values.csv"), "value,lower,upper\n9.9,8,12\n10.1,8,12\n10,8,12\n")
            .unwrap();
        std::fs::write(small.path("master.json"), master().to_string()).unwrap();
        let layout = "format = \"fringecell-layout/1\"\n[[projector]]\nname = \"proj1\"\nwidth_px = 608\nheight_px = 684\n\
            sequence = [\n{ set = \"sine\", axis = \"x\", period_px = 16.0, steps = 10 },\n\
            { set = \"gray\", axis = \"x\", bits = 7, stripe_px = 8.0 },\n{ set = \"white\" }, { set = \"black\" },\n]\n\
            [[projector.camera]]\nname = \"cam1\"\nfiles = \"cam1/{nnn}.png\"\n\
            [[projector.camera]]\nname = \"cam2\"\nfiles = \"cam2/{nnn}.png\"\n";
        std::fs::write(small.path("layout.toml"), layout).unwrap();
        inputs.clouds();
        crate::focus::stack(small.folder.path());
        crate::calibrate_bad::boards(small.folder.path());
        crate::rig_state::lit(small.folder.path());
        crate::single_view::planes(small.folder.path(), &[0.0, 10.0, 20.0]);
        crate::acceptance::thesis_test(small.folder.path());
        let recorded =
            inputs.cell.run("played.toml", &["--cycles", "1", "--cycle-record", &small.path("record")]);
        assert_eq!(recorded.status.code(), Some(0), "{}", text(&recorded.stderr));
        inputs
    }

    /// A ball on a rotation stage, and a plane.
    fn clouds(&self) {
        for degrees in [0, 40, 80] {
            let (sin, cos) = f64::from(degrees).to_radians().sin_cos();
            let ball = spheres(&[([30.0 * cos, 30.0 * sin, 5.0], 20.0)]);
            std::fs::write(self.cell.small.path(&format!("ball{degrees}.ply")), ball).unwrap();
        }
        let mut plane = "ply\nformat ascii 1.0\nelement vertex 62500\nproperty double x\nproperty double y\nproperty double \
            z\nend_header\n"
            .to_owned();
        for i in 0..62_500 {
            let at = |step: i32| 0.2 * f64::from(step) - 25.0;
            let _ = writeln!(plane, "{} {} {}", at(i % 250), at(i / 250), 0.001 * f64::from(i * 7 % 11));
        }
        std::fs::write(self.cell.small.path("plane.ply"), plane).unwrap();
    }

    fn words(&self, line: &str, pass: &str) -> Vec<String> {
        let (folder, configs) = (self.cell.small.path(""), root().join("configs").display().to_string());
        let folder = folder.trim_end_matches('/');
        let line = line.replace("CONFIGS", &configs).replace("NEW", &format!("DIR/{pass}"));
        line.replace("DIR", folder).split_whitespace().map(str::to_owned).collect()
    }

    /// Runs a line of the table.
    pub fn run(&self, line: &str, pass: &str, more: &[&str], stdout: Stdio) -> Output {
        std::fs::create_dir_all(self.cell.small.path(pass)).unwrap();
        let mut program = Command::new(env!("CARGO_BIN_EXE_fringetool"));
        program.args(self.words(line, pass)).args(more).stdout(stdout).stderr(Stdio::piped());
        // Outside the repository: what is not named is part of the program.
        output(program.current_dir(self.cell.small.folder.path()))
    }
}
