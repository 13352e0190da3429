//! Files that promise more than fits, and a machine that gives too little: a message with numbers and exit code 2, never an abort.

use crate::running::text;
use crate::support::root;
use std::fs::File;
use std::io::Write as _;
use std::path::Path;
use std::process::{Command, Output};

/// Runs `fringetool` under a limit of its address space.
fn limited(kib: u64, arguments: &[&str], threads: &str) -> Output {
    let script = format!("ulimit -v {kib}; exec \"$@\"");
    let mut shell = Command::new("bash");
    shell.args(["-c", &script, "sh", env!("CARGO_BIN_EXE_fringetool")]).args(arguments);
    shell.env("RAYON_NUM_THREADS", threads).output().unwrap()
}

fn refused(output: &Output, words: &[&str]) {
    let said = text(&output.stderr);
    assert_eq!(output.status.code(), Some(2), "{:?}: {said}", output.status);
    assert!(!said.contains("panicked"), "{said}");
    assert!(said.starts_with("error: "), "{said}");
    for word in words {
        assert!(said.contains(word), "{word} is not in: {said}");
    }
}

/// A file of so many bytes that takes no room on the disk.
fn sparse(path: &Path, header: &[u8], bytes: u64) -> String {
    let mut file = File::create(path).unwrap();
    file.write_all(header).unwrap();
    file.set_len(bytes).unwrap();
    path.to_str().unwrap().to_owned()
}

/// What is promised is compared with what there is before anything is read.
#[test]
fn files_that_do_not_fit_are_refused_with_both_numbers() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let points = "ply\nformat binary_little_endian 1.0\nelement vertex 150000000\nproperty float x\nproperty float y\n\
        property float z\nend_header\n";
    let cloud = sparse(&at("cloud.ply"), points.as_bytes(), 150_000_000 * 12 + points.len() as u64);
    let mesh = points
        .replace("150000000", "1000")
        .replace("end_header", "element face 150000000\nproperty list uchar int vertex_indices\nend_header");
    let mesh = sparse(&at("mesh.ply"), mesh.as_bytes(), 150_000_000 * 13 + 12_000);
    let mut stl = vec![b' '; 80];
    stl.extend(40_000_000_u32.to_le_bytes());
    let stl = sparse(&at("part.stl"), &stl, 84 + 50 * 40_000_000);
    let out = at("out.ply").to_str().unwrap().to_owned();
    let numbers = ["of memory", "are available"];
    for (file, what) in [
        (&cloud, "150000000 elements \"vertex\" need at least 16.8 GB"),
        (&mesh, "150000000 elements \"face\" need at least"),
        (&stl, "40000000 triangles need at least"),
    ] {
        for command in [
            &["fit", "sphere", file][..],
            &["compare", &cloud, file],
            &["register", file, "--to", &cloud, "--out", &out],
        ] {
            if command[0] == "fit" && *file == stl {
                continue; // a mesh is no cloud
            }
            let output = limited(4_000_000, command, "2");
            refused(&output, &numbers);
            if command[0] == "fit" {
                refused(&output, &[what]);
            }
        }
    }
    // A picture: 20000 × 20000 px of 16 bits are 800 MB, twice.
    let png = at("large.png");
    std::fs::write(&png, png_header(20_000, 20_000)).unwrap();
    let focus = ["focus", "--images", png.to_str().unwrap(), "--positions", "0:0:1"];
    refused(&limited(1_000_000, &focus, "2"), &["large.png"]);
}

/// The start of a greyscale PNG of 16 bits whose pixels are missing.
fn png_header(width: u32, height: u32) -> Vec<u8> {
    let mut ihdr = b"IHDR".to_vec();
    ihdr.extend(width.to_be_bytes());
    ihdr.extend(height.to_be_bytes());
    ihdr.extend([16, 0, 0, 0, 0]);
    let crc = |bytes: &[u8]| {
        !bytes.iter().fold(!0_u32, |crc, byte| {
            (0..8).fold(crc ^ u32::from(*byte), |crc, _| {
                (crc >> 1) ^ (0xedb8_8320 & (!(crc & 1)).wrapping_add(1))
            })
        })
    };
    let mut png = b"\x89PNG\r\n\x1a\n".to_vec();
    png.extend(13_u32.to_be_bytes());
    png.extend(&ihdr);
    png.extend(crc(&ihdr).to_be_bytes());
    let idat = b"IDAT\x78\x01";
    png.extend(2_u32.to_be_bytes());
    png.extend(idat);
    png.extend(crc(idat).to_be_bytes());
    png
}

/// Headers that lie about a small file.
#[test]
fn headers_that_promise_more_than_the_file_has_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let ply = |count: &str| {
        format!(
            "ply\nformat binary_little_endian 1.0\nelement vertex {count}\nproperty float x\nproperty float y\n\
             property float z\nend_header\n"
        )
        .into_bytes()
    };
    let mut stl = vec![b' '; 80];
    stl.extend(u32::MAX.to_le_bytes());
    let mut e57 = b"ASTM-E57\x01\0\0\0\0\0\0\0".to_vec();
    for word in [1024_u64, 48, 1 << 60, 1 << 50] {
        e57.extend(word.to_le_bytes());
    }
    e57.resize(1024, 0);
    let files: [(&str, Vec<u8>); 6] = [
        ("many.ply", ply("150000000")),
        ("most.ply", ply("18446744073709551615")),
        ("negative.ply", ply("-1")),
        ("many.stl", stl),
        ("many.e57", e57),
        (
            "many.npy",
            b"\x93NUMPY\x01\x00\x46\x00{'descr': '<f4', 'fortran_order': False, 'shape': (65535, 65535), }\n"
                .to_vec(),
        ),
    ];
    for (name, bytes) in files {
        let path = folder.path().join(name);
        std::fs::write(&path, bytes).unwrap();
        let path = path.to_str().unwrap();
        let command: &[&str] =
            if name.ends_with("npy") { &["unwrap", path] } else { &["compare", path, path] };
        refused(&limited(1_000_000, command, "2"), &[name]);
    }
}

/// What is not seen beforehand ends in the same way: memory that runs out at work is a message and exit code 2.
#[test]
fn memory_that_runs_out_at_work_is_an_error_and_no_abort() {
    let plan = root().join("configs/budgets/sphere-spacing.toml");
    let folder = tempfile::tempdir().unwrap();
    let rec = folder.path().join("rec");
    let simulate = ["simulate", "configs/demo.toml", "--out", rec.to_str().unwrap()];
    let demo = root().join("configs/demo.toml");
    let simulate = [simulate[0], demo.to_str().unwrap(), simulate[2], simulate[3]];
    refused(&limited(60_000, &simulate, "1"), &["no memory for"]);
    assert!(!rec.join("recording.toml").exists());
    // Enough for a small task.
    assert_eq!(limited(400_000, &["uncertainty", plan.to_str().unwrap()], "1").status.code(), Some(0));
}

#[test]
fn numbers_of_threads_and_options_of_benchmarks_are_bounded() {
    let run = |threads: &str, arguments: &[&str]| {
        let mut tool = Command::new(env!("CARGO_BIN_EXE_fringetool"));
        tool.args(arguments).env("RAYON_NUM_THREADS", threads).output().unwrap()
    };
    let budget = root().join("configs/budgets/sphere-spacing.toml");
    let budget = ["uncertainty", budget.to_str().unwrap()];
    for threads in ["100000", "-1", "many"] {
        refused(&run(threads, &budget), &["RAYON_NUM_THREADS", "512"]);
    }
    assert_eq!(run("3", &budget).status.code(), Some(0));
    for bench in [
        &["speed", "--repeats", "0"][..],
        &["speed", "--repeats", "1000000"],
        &["calibration", "--trials", "9999999999"],
        &["calibration", "--subsamples", "1000"],
        &["calibration", "--columns", "4000000000"],
        &["calibration", "--poses", "0"],
        &["unwrap", "--side-px", "100000"],
        &["order-errors", "--pixels", "99999999999"],
        &["stage-axis", "--trials", "0"],
        &["error-sources", "--width-px", "100000"],
        &["transport", "--frames", "1000000"],
        &["transport", "--rate-hz", "nan"],
        &["exposures", "--exposures", "nan"],
    ] {
        refused(&run("2", &[&["bench"], bench].concat()), &[bench[1].trim_matches(['-', 's'])]);
    }
}
