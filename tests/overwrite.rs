//! Outputs that would destroy something: inputs under any of their names, and files of another kind.

use crate::support::{Ran, Small, fringecell_in, fringetool_in, root};
use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

/// Points of a small cloud.
const CLOUD: &str = "ply\nformat ascii 1.0\nelement vertex 4\nproperty double x\nproperty double y\nproperty double z\n\
                     end_header\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n";

/// A folder with an input of each kind.
fn inputs() -> Small {
    let small = Small::new();
    let put = |name: &str, text: &str| fs::write(small.path(name), text).unwrap();
    let scene = root().join("configs/complex-artefact.scene.toml");
    fs::copy(&scene, small.path("scene.toml")).unwrap();
    small.edit("cell.toml", &format!("{:?}", scene.display().to_string()), "\"scene.toml\"");
    fs::copy(root().join("configs/budgets/end-gauge.toml"), small.path("budget.toml")).unwrap();
    fs::copy(root().join("configs/complex-artefact.plan.toml"), small.path("plan.toml")).unwrap();
    let config = fs::read_to_string(small.path("cell.toml")).unwrap();
    put("planned.toml", &config.replace("rig = ", "plan = \"plan.toml\"\nrig = "));
    put("cloud.ply", CLOUD);
    put("reference.ply", CLOUD);
    put("start.json", "{\"matrix\": [[1,0,0,0],[0,1,0,0],[0,0,1,0],[0,0,0,1]]}");
    put("notes.json", "{\"mine\": 1}");
    put("machine.csv", "name,value,unit,u\na,1,mm,0.1\n");
    small
}

/// Every file of a folder with its bytes.
fn contents(folder: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    let mut all = BTreeMap::new();
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_symlink() {
            continue;
        }
        if path.is_dir() {
            all.extend(contents(&path));
        } else {
            all.insert(path.clone(), fs::read(&path).unwrap());
        }
    }
    all
}

/// Runs a command line in the folder of the inputs; `@` names the output.
fn run(folder: &Path, line: &str, output: &str) -> Ran {
    let mut words: Vec<String> = line.split(' ').map(|word| word.replace('@', output)).collect();
    let program = words.remove(0);
    if program == "fringecell" { fringecell_in(folder, &words) } else { fringetool_in(folder, &words) }
}

/// The victim under another name: by a detour, a symbolic link, a hard link, a linked folder.
fn spelled(folder: &Path, victim: &str, way: usize) -> String {
    let name = |kind: &str| {
        let extension = Path::new(victim).extension().unwrap().to_str().unwrap();
        format!("{kind}-{}.{extension}", victim.replace('/', "-"))
    };
    let fresh = |name: &str| {
        let _ = fs::remove_file(folder.join(name));
        folder.join(name)
    };
    match way % 4 {
        0 => format!("./rec/../{victim}"),
        1 => {
            std::os::unix::fs::symlink(victim, fresh(&name("soft"))).unwrap();
            name("soft")
        }
        2 => {
            fs::hard_link(folder.join(victim), fresh(&name("hard"))).unwrap();
            name("hard")
        }
        _ => {
            std::os::unix::fs::symlink(".", fresh("here")).unwrap();
            format!("here/{victim}")
        }
    }
}

const WAYS: [(&str, &str); 34] = [
    ("fringetool reconstruct --rig rig.toml --out @ rec", "rec/frames/proj1/cam1/003.png"),
    ("fringetool reconstruct --rig rig.toml --out @ rec", "rec/recording.toml"),
    ("fringetool reconstruct --rig rig.toml --out new.ply --json @ rec", "rig.toml"),
    ("fringetool reconstruct --config cell.toml --out new.ply --json @ rec", "rig.toml"),
    ("fringetool reconstruct --config planned.toml --out new.ply --json @ rec", "plan.toml"),
    ("fringetool reconstruct --config cell.toml --out @ rec", "scene.toml"),
    ("fringetool decode rec --json @", "rec/frames/proj1/cam2/000.png"),
    ("fringetool simulate cell.toml --out new --json @", "scene.toml"),
    ("fringetool simulate cell.toml --out new --json @", "rig.toml"),
    ("fringetool simulate cell.toml --out new --json @", "rec.truth.toml"),
    ("fringetool fit sphere cloud.ply --json @", "rec.truth.toml"),
    ("fringetool fit sphere cloud.ply --json @", "cloud.ply"),
    ("fringetool fit plane cloud.ply --json @", "notes.json"),
    ("fringetool measure plan.toml cloud.ply --json @", "plan.toml"),
    (
        "fringetool register cloud.ply --to reference.ply --out new.ply --start start.json --json @",
        "start.json",
    ),
    ("fringetool register cloud.ply --to reference.ply --out @", "reference.ply"),
    ("fringetool compare cloud.ply reference.ply --align best-fit --start start.json --json @", "start.json"),
    ("fringetool compare cloud.ply reference.ply --report @", "reference.ply"),
    ("fringetool place plan.toml cloud.ply --start start.json --out new.toml --json @", "start.json"),
    ("fringetool place plan.toml cloud.ply --out @", "plan.toml"),
    ("fringetool flatness cloud.ply --report @", "cloud.ply"),
    (
        "fringetool focus --images rec/frames/proj1/cam1/*.png --positions 1,2,3,4,5,6,7,8,9,10,11,12,13,14,15,16,17,18,19 --report @",
        "rec/frames/proj1/cam1/000.png",
    ),
    (
        "fringetool check-rig rec --rig rig.toml --trend new.trend --picture @",
        "rec/frames/proj1/cam1/001.png",
    ),
    ("fringetool check-rig rec --rig rig.toml --trend @", "rec/frames/proj1/cam1/001.png"),
    ("fringetool uncertainty budget.toml --report @", "budget.toml"),
    ("fringetool export --rig rig.toml --pair pair1 --out new.yml --json @", "rig.toml"),
    ("fringetool plan-patterns --rig rig.toml --out @", "rig.toml"),
    ("fringetool cmm-compare start.json machine.csv --csv @", "machine.csv"),
    ("fringecell schedule planned.toml --picture @", "planned.toml"),
    ("fringecell schedule planned.toml --picture @", "plan.toml"),
    ("fringecell schedule planned.toml --picture @", "scene.toml"),
    ("fringecell run cell.toml --cycles 1 --trace @", "rig.toml"),
    ("fringecell run cell.toml --cycles 1 --trace @", "notes.json"),
    ("fringecell run cell.toml --cycles 1 --trace @", "rec.truth.toml"),
];

/// Proves: no output of a command overwrites one of its inputs or a file of another kind, by whatever name; what is
/// there stays as it is, and one line states why.
#[test]
fn outputs_never_overwrite_inputs_nor_files_of_another_kind() {
    let small = inputs();
    let folder = small.folder.path();
    let before = contents(folder);
    let refusals =
        ["would overwrite an input", "would lie among the frames", "would replace it", "exists already"];
    let mut wrong = Vec::new();
    for (number, (line, victim)) in WAYS.iter().enumerate() {
        for output in [(*victim).to_owned(), spelled(folder, victim, number)] {
            let ran = run(folder, line, &output);
            let last = ran.stderr.lines().last().unwrap_or("").to_owned();
            if ran.code != Some(2) || !refusals.iter().any(|why| last.contains(why)) {
                wrong.push(format!("{line}\n  @ = {output}: {:?} {last}", ran.code));
            }
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
    let after = contents(folder);
    for (path, bytes) in &before {
        assert!(after.get(path) == Some(bytes), "{} was changed", path.display());
    }
}

/// Proves: no output lies among the frames of a recording, where it would be taken for one, and none has the name that the command itself gives to
/// another. Nothing is decoded before.
#[test]
fn outputs_neither_join_the_frames_nor_replace_each_other() {
    let small = inputs();
    let folder = small.folder.path();
    let rig = fs::read_to_string(small.path("rig.toml")).unwrap();
    let first = rig.split("[[pair]]").nth(1).expect("the rig has a pair");
    let again = first.replace("pair1", "pair9");
    fs::write(small.path("two.toml"), format!("{rig}\n[[pair]]{again}")).unwrap();
    let frames = "would lie among the frames of a recording";
    let before = contents(folder);
    for (line, why) in [
        ("fringetool decode rec --out rec/frames/proj1/cam1", frames),
        ("fringetool decode rec --out rec/frames/new", frames),
        ("fringetool decode rec --json rec/frames/proj1/cam1/notes.json", frames),
        ("fringetool reconstruct rec --rig rig.toml --out rec/frames/new.ply", frames),
        (
            "fringetool decode rec --out maps --json maps/proj1-cam1-x-phase.npy",
            "is a name of the files of --out",
        ),
        (
            "fringetool reconstruct rec --rig two.toml --out m-pair1.png --map m.png",
            "is also the file of --out",
        ),
        (
            "fringetool reconstruct rec --rig two.toml --out m.ply --map m.png --json m-pair9.png",
            "is also the file of --json",
        ),
    ] {
        let ran = run(folder, line, "");
        assert!(ran.code == Some(2) && ran.stderr.contains(why), "{line}: {:?} {}", ran.code, ran.stderr);
    }
    assert_eq!(contents(folder).len(), before.len(), "no file came");
}

/// Proves: a camera whose folder is a copy of another's is refused; noise never repeats.
#[test]
fn a_copy_of_a_camera_is_not_a_second_one() {
    let small = inputs();
    let folder = small.folder.path();
    for frame in fs::read_dir(folder.join("rec/frames/proj1/cam1")).unwrap() {
        let path = frame.unwrap().path();
        fs::copy(&path, folder.join("rec/frames/proj1/cam2").join(path.file_name().unwrap())).unwrap();
    }
    let ran = run(folder, "fringetool reconstruct rec --rig rig.toml --out new.ply", "");
    assert_eq!(ran.code, Some(2), "{}{}", ran.stdout, ran.stderr);
    let told = ["\"cam1\" and \"cam2\" have the same frames", "copy the frames of each camera anew"];
    assert!(told.iter().all(|why| ran.stderr.contains(why)), "{}", ran.stderr);
    assert!(!folder.join("new.ply").exists());
}

/// Files whose names a command makes itself: the truth beside a recording, the parts of a run.
#[test]
fn outputs_that_no_option_names_do_not_overwrite_inputs_either() {
    let small = inputs();
    let folder = small.folder.path();
    fs::copy(small.path("scene.toml"), small.path("new.truth.toml")).unwrap();
    let scene = fs::read(small.path("new.truth.toml")).unwrap();
    let ran = run(folder, "fringetool simulate cell.toml --scene new.truth.toml --out new", "");
    assert_eq!(ran.code, Some(2), "{}{}", ran.stdout, ran.stderr);
    assert!(ran.stderr.contains("would overwrite an input"), "{}", ran.stderr);
    assert_eq!(fs::read(small.path("new.truth.toml")).unwrap(), scene);
    assert!(!folder.join("new/recording.toml").exists(), "no recording without its truth");
}

/// Proves: a result replaces an earlier one of its kind, and another kind of file only with `--force`; never an input.
#[test]
fn a_result_is_replaced_by_its_own_kind_or_with_force() {
    let small = inputs();
    let folder = small.folder.path();
    let fit = |more: &str| run(folder, &format!("fringetool fit plane cloud.ply --json {more}"), "");
    let json = |name: &str| fs::read_to_string(folder.join(name)).unwrap();
    assert_eq!(fit("out.json").code, Some(0));
    assert_eq!(fit("out.json").code, Some(0), "the same kind");
    fs::write(small.path("empty.json"), "").unwrap();
    assert_eq!(fit("empty.json").code, Some(0), "nothing is lost");
    let refused = fit("notes.json");
    assert_eq!(refused.code, Some(2), "{}", refused.stderr);
    assert!(
        refused.stderr.contains("is an object with \"mine\" (JSON)") && refused.stderr.contains("--force"),
        "{}",
        refused.stderr
    );
    assert!(json("notes.json").contains("mine"));
    assert_eq!(fit("notes.json --force").code, Some(0));
    assert!(json("notes.json").contains("normal"));
    let input = fit("cloud.ply --force");
    assert_eq!(input.code, Some(2), "{}", input.stderr);
    assert_eq!(json("cloud.ply"), CLOUD);
}

/// Proves: the configuration that the demo invites to edit is not reset.
#[test]
fn the_demo_keeps_an_edited_configuration() {
    let folder = tempfile::tempdir().unwrap();
    let config = folder.path().join("out/config/demo.toml");
    fs::create_dir_all(config.parent().unwrap()).unwrap();
    let edited = "format = \"fringecell-config/1\" # mine\n";
    fs::write(&config, edited).unwrap();
    let ran = fringecell_in(folder.path(), &["demo", "--out", "out", "--cell", "t-demo-keep"]);
    assert_eq!(ran.code, Some(2), "{}", ran.stdout);
    assert!(ran.stderr.contains("differs from the one of the demo"), "{}", ran.stderr);
    assert_eq!(fs::read_to_string(&config).unwrap(), edited);
    assert_eq!(fs::read_dir(config.parent().unwrap()).unwrap().count(), 1);
}
