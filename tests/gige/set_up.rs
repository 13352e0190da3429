//! Cameras on the network before the first part: configurations that cannot be, the commands that set a cell up, and warming up.

use super::{cell, network, run, serve};
use crate::support::fringetool;
use std::path::Path;
use std::process::Command;

#[test]
fn impossible_devices_are_refused_with_their_key() {
    let (folder, _, live) = cell(6);
    let text = std::fs::read_to_string(&live).unwrap();
    let [a, b, c] = network(6);
    let address = &*format!("address = \"{a}.{b}.{c}.11\"");
    let cases = [
        ("driver = \"network\"\n", "driver = \"twin\"\n", "[twin]"),
        ("driver = \"genicam\"", "driver = \"recording\"", "address"),
        ("[[camera]]", "[[camera]]\nserial = \"1\"", "either address or serial"),
        ("[[camera]]", "[[camera]]\npixel_format = \"Mono9\"", "pixel_format"),
        ("[[camera]]", "[[camera]]\nexposure_us = -1.0", "exposure_us"),
        ("[[camera]]", "[[camera]]\ngain_db = 1e9", "gain_db"),
        ("[[camera]]", "[[camera]]\noffset_px = [65535, 0]", "offset_px"),
        ("[[camera]]", "[[camera]]\npacket_bytes = 1501", "packet_bytes"),
        (
            "[[camera]]",
            "[[camera]]\ntransport = \"usb\"",
            "transport \"usb\" is unknown; known: gige, aravis, usb3",
        ),
        (
            "[[camera]]",
            "[[camera]]\ntransport = \"usb3\"",
            "camera[0].address: a camera with transport = \"usb3\"",
        ),
        (address, "transport = \"usb3\"\nserial = \"1\"\npacket_bytes = 1500", "camera[0].packet_bytes"),
        (
            address,
            "transport = \"usb3\"\nserial = \"1\"\npacket_delay_ticks = 1",
            "camera[0].packet_delay_ticks",
        ),
        (address, "transport = \"usb3\"\nserial = \"1\"\nptp = false", "camera[0].ptp"),
        (address, "transport = \"usb3\"", "serial of camera \"cam1\" is missing"),
        (".12\"", ".11\"", "camera \"cam1\" too"),
        (":3957\"", "\"", "address"),
        ("width_px = 608", "width_px = 608\ntrigger = \"sequenced\"", "period_ms"),
        ("width_px = 608", "width_px = 608\nperiod_ms = 20.0", "sequenced"),
        ("width_px = 608", "width_px = 608\ntrigger = \"sequenced\"\nperiod_ms = 1e9", "period_ms"),
        ("width_px = 608", "width_px = 608\ntrigger = \"sequenced\"\nperiod_ms = 59999.0", "last"),
        ("width_px = 608", "width_px = 608\nrefresh_hz = 0.0", "refresh_hz"),
        ("width_px = 608", "width_px = 608\nrefresh_hz = 60.0", "add exposure_us = 16667"),
        (
            "width_px = 608",
            "width_px = 608\ntrigger = \"sequenced\"\nperiod_ms = 20.0\nrefresh_hz = 60.0",
            "add exposure_us = 16667",
        ),
        ("width_px = 608", "width_px = 608\ntrigger = \"free\"", "trigger"),
        (
            "{ set = \"black\" },",
            "{ set = \"black\" }, { set = \"check\", axis = \"y\", stripe_px = 8.0 },",
            "prove the order",
        ),
    ];
    for (from, to, named) in cases {
        assert!(text.contains(from));
        let path = folder.path().join("bad.toml");
        std::fs::write(&path, text.replacen(from, to, 1)).unwrap();
        let message = refusal(&path);
        assert!(message.contains(named) && message.contains("bad.toml"), "{to}: {message}");
    }
    let wrong = fringetool(&["serve-camera", &live, "--fault", "drop=0"]);
    assert_eq!(wrong.code, Some(2), "{}", wrong.stderr);
}

/// A program without Aravis tells which key asks for it, and how to build one that has it.
#[cfg(not(feature = "aravis"))]
#[test]
fn a_transport_that_the_program_is_built_without_is_refused_with_the_remedy() {
    let (folder, _, live) = cell(23);
    let text = std::fs::read_to_string(&live).unwrap();
    let path = folder.path().join("bad.toml");
    let [a, b, c] = network(23);
    for name in ["aravis", "usb3"] {
        let keys = format!("transport = \"{name}\"\nserial = \"1\"");
        std::fs::write(&path, text.replace(&format!("address = \"{a}.{b}.{c}.11\""), &keys)).unwrap();
        for arguments in [&["schedule"][..], &["run", "--cycles", "1"]] {
            let refused =
                Command::new(env!("CARGO_BIN_EXE_fringecell")).args(arguments).arg(&path).output().unwrap();
            let message = String::from_utf8_lossy(&refused.stderr).into_owned();
            assert_eq!(refused.status.code(), Some(2), "{arguments:?}: {message}");
            let named = ["bad.toml", "camera[0].transport", name, "cargo build --release --features aravis"];
            assert!(named.iter().all(|part| message.contains(part)), "{arguments:?}: {message}");
        }
        let preview = fringetool(&["preview", path.to_str().unwrap(), "--camera", "cam1"]);
        assert_eq!(preview.code, Some(2), "{}", preview.stderr);
        assert!(preview.stderr.contains("--features aravis"), "{}", preview.stderr);
    }
}

/// What `fringecell schedule` says of a configuration that it must refuse.
fn refusal(path: &Path) -> String {
    let refused = Command::new(env!("CARGO_BIN_EXE_fringecell")).arg("schedule").arg(path).output().unwrap();
    let message = String::from_utf8_lossy(&refused.stderr).into_owned();
    assert_eq!(refused.status.code(), Some(2), "{message}");
    message
}

/// Exposures and periods under a projector whose refresh rate is known are whole numbers of refreshes.
#[test]
fn exposures_are_whole_refreshes_where_the_rate_is_known() {
    let (folder, _, live) = cell(18);
    let text = std::fs::read_to_string(&live).unwrap();
    let path = folder.path().join("timed.toml");
    for (exposure_us, period_ms, named) in [
        (16_667.0, None, ""),
        (50_000.0, None, ""),
        (20_000.0, None, "write exposure_us = 16667"),
        (16_667.0, Some(33.333), ""),
        (16_667.0, Some(25.0), "write period_ms = 33.333"),
        (33_333.0, Some(33.333), "below 33333 µs, the period_ms of projector \"proj1\""),
    ] {
        let period = period_ms
            .map_or(String::new(), |ms: f64| format!("trigger = \"sequenced\"\nperiod_ms = {ms:?}\n"));
        let timed = text
            .replace("width_px = 608", &format!("refresh_hz = 60.0\n{period}width_px = 608"))
            .replace("driver = \"genicam\"", &format!("driver = \"genicam\"\nexposure_us = {exposure_us:?}"));
        std::fs::write(&path, timed).unwrap();
        let ran = Command::new(env!("CARGO_BIN_EXE_fringecell")).arg("schedule").arg(&path).output().unwrap();
        let said = String::from_utf8_lossy(&ran.stderr).into_owned();
        let code = if named.is_empty() { Some(0) } else { Some(2) };
        assert_eq!(ran.status.code(), code, "{exposure_us} {period_ms:?}: {said}");
        assert!(said.contains(named), "{exposure_us} {period_ms:?}: {said}");
    }
}

/// A window of the sensor and a clock that follows the network work in a cell; what a camera does not take ends the start with camera, feature and
/// both values.
#[test]
fn windows_and_clocks_are_set_and_what_a_camera_refuses_is_told() {
    let (folder, simulated, live) = cell(16);
    let mut rig = files::rig_file::read_rig(&folder.path().join("rig.toml")).unwrap().rig;
    for view in &mut rig.cameras {
        (view.camera.width_px, view.camera.height_px) = (160, 108);
        view.camera.principal_point_px[0] -= 4.0;
        view.camera.principal_point_px[1] -= 2.0;
    }
    files::rig_file::write_rig(&folder.path().join("window.toml"), &rig, &toml::Table::new(), None).unwrap();
    let text = std::fs::read_to_string(&live).unwrap().replace("\"rig.toml\"", "\"window.toml\"");
    let _served = serve(&simulated, 16, &["old-names"]);
    let mut runs = 0;
    let mut with = |keys: &str| {
        runs += 1;
        let path = folder.path().join("window.cell.toml");
        let text = text.replace("driver = \"genicam\"", &format!("driver = \"genicam\"\n{keys}"));
        std::fs::write(&path, text).unwrap();
        let ran = run(folder.path(), path.to_str().unwrap(), &format!("window{runs}"), "1");
        (
            ran.status.code(),
            String::from_utf8_lossy(&ran.stdout).into_owned() + &String::from_utf8_lossy(&ran.stderr),
        )
    };
    let (code, said) = with("offset_px = [4, 2]\nptp = true\npacket_bytes = 1400\npacket_delay_ticks = 100");
    assert_eq!(code, Some(0), "{said}");
    for (keys, expected) in [
        ("offset_px = [12, 2]", "OffsetX: 12 was asked for (offset_px), the camera has 4"),
        ("offset_px = [6, 2]", "OffsetX: 6 was asked for (offset_px), the camera has 4"),
        (
            "offset_px = [4, 2]\nexposure_us = 5e6",
            "ExposureTimeAbs: 5000000 was asked for (exposure_us, µs), the camera has 10000",
        ),
    ] {
        let (code, said) = with(keys);
        assert_eq!(code, Some(1), "{keys}: {said}");
        assert!(
            said.contains(&format!("camera \"cam1\": {expected}"))
                || said.contains(&format!("camera \"cam2\": {expected}")),
            "{keys}: {said}"
        );
    }
}

/// A new cell of served cameras is accepted, ready, and measured as the twin is; each command works on it.
#[test]
fn a_cell_is_set_up_from_cameras_that_answer() {
    let (folder, simulated, _) = cell(13);
    let _served = serve(&simulated, 13, &[]);
    let [a, b, c] = network(13);
    let (cameras, light) = (format!("{a}.{b}.{c}.11,{a}.{b}.{c}.12"), format!("{a}.{b}.{c}.1:3957"));
    let path = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let new = fringetool(&[
        "new-cell",
        "--out",
        &path("new.toml"),
        "--name",
        "new",
        "--cameras",
        &cameras,
        "--projector",
        &light,
        "--projector-size",
        "608x684",
        "--json",
        &path("new.json"),
    ]);
    assert_eq!(new.code, Some(0), "{}{}", new.stdout, new.stderr);
    let schedule = Command::new(env!("CARGO_BIN_EXE_fringecell"))
        .args(["schedule", &path("new.toml")])
        .output()
        .unwrap();
    assert_eq!(schedule.status.code(), Some(0), "{}", String::from_utf8_lossy(&schedule.stderr));
    let doctor = fringetool(&["doctor", &path("new.toml"), "--json", &path("doctor.json")]);
    assert!(
        doctor.stdout.contains("camera \"cam1\"") && doctor.stdout.contains("TWIN-0001"),
        "{}",
        doctor.stdout
    );
    // The calibrated rig of the test: its cameras have the names and sizes.
    let taken = fringetool(&[
        "new-cell",
        "--out",
        &path("taken.toml"),
        "--rig",
        &path("rig.toml"),
        "--cameras",
        &cameras,
    ]);
    assert_eq!(taken.code, Some(0), "{}{}", taken.stdout, taken.stderr);
}

#[test]
fn cameras_are_exposed_and_looked_through() {
    let (folder, simulated, live) = cell(0);
    let _served = serve(&simulated, 0, &[]);
    let path = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let dark = fringetool(&[
        "expose",
        &live,
        "--start-us",
        "1000",
        "--write",
        &path("exposed.toml"),
        "--json",
        &path("exposed.json"),
    ]);
    assert_eq!(dark.code, Some(0), "{}{}", dark.stdout, dark.stderr);
    let exposed: serde_json::Value =
        serde_json::from_str(&std::fs::read_to_string(path("exposed.json")).unwrap()).unwrap();
    let us = exposed["cameras"][0]["exposure_us"].as_f64().unwrap();
    assert!((5_000.0..30_000.0).contains(&us), "{exposed}");
    assert!(std::fs::read_to_string(path("exposed.toml")).unwrap().contains("exposure_us = "));
    let preview = fringetool(&[
        "preview",
        &live,
        "--camera",
        "cam2",
        "--modulation",
        "--png",
        &path("a.png"),
        "--json",
        &path("preview.json"),
    ]);
    assert_eq!(preview.code, Some(0), "{}{}", preview.stdout, preview.stderr);
    assert!(
        std::fs::read(path("a.png")).unwrap().starts_with(b"\x89PNG") && preview.stdout.contains("sharpness")
    );
}

#[test]
fn set_up_commands_refuse_what_they_cannot_do_with_one_message() {
    let (folder, simulated, live) = cell(14);
    let path = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let [a, b, c] = network(14);
    let absent = format!("{a}.{b}.{c}.99");
    std::fs::write(path("foreign.toml"), "answer = 42\n").unwrap();
    let cases: [(&[&str], &str); 15] = [
        (&["new-cell", "--out", &path("n.toml"), "--cameras", &absent], &absent),
        (&["new-cell", "--out", &path("n.toml"), "--cameras", "1.2.3"], "--cameras"),
        (&["new-cell", "--out", &path("n.toml"), "--name", "Ä b"], "--name"),
        (&["new-cell", "--out", &path("n.toml"), "--projector-size", "99999999x1"], "--projector-size"),
        (&["new-cell", "--out", &path("n.toml"), "--distance-mm", "1e300"], "--distance-mm"),
        (&["new-cell", "--out", &path("n.toml"), "--period-ms", "nan"], "--period-ms"),
        (&["new-cell", "--out", &path("n.toml"), "--rig", &path("none.toml")], "none.toml"),
        (&["new-cell", "--out", &simulated, "--cameras", &absent], "--force"),
        (&["doctor", &path("foreign.toml")], "foreign.toml"),
        (&["expose", &simulated, "--write", &path("w.toml")], "[twin]"),
        (&["expose", &simulated, "--start-us", "1e99"], "--start-us"),
        (&["expose", &simulated, "--camera", "cam9"], "cam9"),
        (&["preview", &simulated, "--frame", "99999999999"], "--frame"),
        (&["preview", &simulated, "--serve", "0.0.0.0:0"], "--allow-remote"),
        (&["preview", &live], &format!("{a}.{b}.{c}.")),
    ];
    for (arguments, named) in cases {
        let ran = fringetool(arguments);
        assert_eq!(ran.code, Some(2), "{arguments:?}: {}{}", ran.stdout, ran.stderr);
        assert!(
            ran.stderr.contains(named) && !ran.stderr.contains("panicked"),
            "{arguments:?}: {}",
            ran.stderr
        );
        assert!(!folder.path().join("n.toml").exists(), "{arguments:?}");
    }
    let doctor = fringetool(&["doctor", &live]);
    assert_eq!(doctor.code, Some(1), "{}{}", doctor.stdout, doctor.stderr);
    assert!(
        doctor.stdout.contains("BAD") && doctor.stdout.contains(&format!("{a}.{b}.{c}.11")),
        "{}",
        doctor.stdout
    );
}

#[test]
fn no_part_has_a_verdict_before_the_cameras_have_settled() {
    let (folder, simulated, live) = cell(15);
    let _served = serve(&simulated, 15, &["warm-up=2"]);
    let gate = |change: f64, window: f64| {
        let text = std::fs::read_to_string(&live).unwrap();
        let path = folder.path().join("gate.toml");
        std::fs::write(
            &path,
            format!("{text}\n[warm_up]\nmax_change_k = {change:?}\nwindow_s = {window:?}\n"),
        )
        .unwrap();
        run(folder.path(), path.to_str().unwrap(), "gate", "2")
    };
    let cold = gate(0.5, 3600.0);
    let text = String::from_utf8_lossy(&cold.stdout).into_owned() + &String::from_utf8_lossy(&cold.stderr);
    assert_eq!(cold.status.code(), Some(1), "{text}");
    assert!(text.contains("has not settled"), "{text}");
    let result = std::fs::read_to_string(folder.path().join("gate/result.json")).unwrap();
    let result: serde_json::Value = serde_json::from_str(&result).unwrap();
    let state = &result["reports"]["frame/cam1"];
    assert!(
        state["temperature_c"].as_f64().is_some_and(|celsius| (20.0..40.0).contains(&celsius)),
        "{result}"
    );
    assert!(state["link"]["packets"].as_u64().is_some_and(|packets| packets > 100), "{result}");
}
