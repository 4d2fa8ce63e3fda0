//! `tdcr servo-sim`: servos on a pseudo-terminal.

use std::collections::BTreeSet;
use std::io::{BufRead, BufReader, Read, Write};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::sync::mpsc::channel;
use std::thread;
use std::time::{Duration, Instant};

use serde_json::Value;

use crate::{refuse, stderr, succeed_json, tdcr, text};

/// The e-Manual's ping of servo 1.
const PING: [u8; 10] = [0xFF, 0xFF, 0xFD, 0x00, 0x01, 0x03, 0x00, 0x01, 0x19, 0x4E];

/// A server, ended with the test.
pub(crate) struct Server {
    child: Child,
    stdout: BufReader<std::process::ChildStdout>,
    port: String,
}

impl Server {
    fn start(arguments: &[&str]) -> Self {
        Self::of("2m", arguments)
    }

    /// With a robot behind the servos.
    pub(crate) fn of(robot: &str, arguments: &[&str]) -> Self {
        let mut child = tdcr(&[&["servo-sim", "--robot", robot], arguments].concat())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        let mut stdout = BufReader::new(child.stdout.take().unwrap());
        let mut port = String::new();
        stdout.read_line(&mut port).unwrap();
        Self {
            child,
            stdout,
            port: port.trim_end().to_owned(),
        }
    }

    /// The path of its port.
    pub(crate) fn port(&self) -> &str {
        &self.port
    }

    /// Sends bytes as any program would, and returns what comes back; nothing for what takes longer than a second.
    fn ask(&self, bytes: &[u8], answer: usize) -> Vec<u8> {
        let mut port = std::fs::File::options()
            .read(true)
            .write(true)
            .open(&self.port)
            .unwrap();
        port.write_all(bytes).unwrap();
        let (sender, receiver) = channel();
        thread::spawn(move || {
            let mut buffer = vec![0; answer];
            let _ = sender.send(port.read_exact(&mut buffer).map(|()| buffer));
        });
        let answered = receiver.recv_timeout(Duration::from_secs(1));
        answered.map_or_else(|_| Vec::new(), |read| read.unwrap_or_default())
    }

    /// Waits until it ends by itself; its exit status, and what it said on stderr.
    fn end(mut self) -> (Option<i32>, String) {
        let began = Instant::now();
        while self.child.try_wait().unwrap().is_none() {
            assert!(began.elapsed() < Duration::from_secs(10), "it goes on");
            thread::sleep(Duration::from_millis(10));
        }
        let status = self.child.wait().unwrap();
        let mut rest = String::new();
        self.stdout.read_to_string(&mut rest).unwrap();
        assert_eq!(rest, "");
        let mut said = String::new();
        let mut stderr = self.child.stderr.take().unwrap();
        stderr.read_to_string(&mut said).unwrap();
        (status.code(), said)
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        let _ = self.child.kill();
    }
}

fn interrupt(child: &Child) {
    let id = child.id().to_string();
    let sent = Command::new("kill").args(["-INT", &id]).status().unwrap();
    assert!(sent.success());
}

#[test]
fn servos_answer_on_the_terminal_until_ctrl_c() {
    let server = Server::start(&[]);
    assert!(Path::new(&server.port).exists(), "{}", server.port);
    // Programs come and go.
    for _ in 0..2 {
        let answer = server.ask(&PING, 14);
        assert_eq!(
            answer[..12],
            [0xFF, 0xFF, 0xFD, 0x00, 1, 7, 0, 0x55, 0, 0xD8, 0x04, 52]
        );
    }
    interrupt(&server.child);
    let (status, said) = server.end();
    assert_eq!(status, Some(0), "{said}");
    assert!(said.contains("serving 6 servos at 1000000 baud"), "{said}");
    assert!(!said.contains("panicked"), "{said}");
}

#[test]
fn models_and_firmware_are_as_asked_for() {
    let server = Server::start(&["--model", "xl330-m288", "--firmware", "60"]);
    assert_eq!(server.ask(&PING, 14)[9..12], [0xB0, 0x04, 60]);
}

#[test]
fn the_result_can_be_json() {
    let mut child = tdcr(&[
        "servo-sim",
        "--robot",
        "2m",
        "--baud",
        "57600",
        "--json",
        "--quiet",
    ])
    .stdout(Stdio::piped())
    .spawn()
    .unwrap();
    let mut lines = BufReader::new(child.stdout.take().unwrap()).lines();
    let mut text = String::new();
    while !text.ends_with("\n}") {
        text.push('\n');
        text.push_str(&lines.next().unwrap().unwrap());
    }
    child.kill().unwrap();
    child.wait().unwrap();
    let served: Value = serde_json::from_str(&text).unwrap();
    assert!(served["port"].as_str().unwrap().starts_with("/dev/"));
    assert_eq!(served["baud"], 57600);
    assert_eq!(served["ids"], serde_json::json!([1, 2, 3, 4, 5, 6]));
}

#[test]
fn faults_come_when_they_are_told_to() {
    let silent = Server::start(&["--fault", "silent:1"]);
    assert!(silent.ask(&PING, 14).is_empty());
    let unplugged = Server::start(&["--fault", "unplugged@0.3"]);
    let (status, said) = unplugged.end();
    assert_eq!(status, Some(1));
    assert!(
        said.contains("the cable of the simulated bus is unplugged"),
        "{said}"
    );
}

#[test]
fn wrong_options_are_named() {
    let refuse = |arguments: &[&str], status, expected: &str| {
        refuse(&[&["servo-sim"], arguments].concat(), status, expected);
    };
    refuse(
        &["--baud", "12345"],
        2,
        "expected one of 9600, 57600, 115200, 1000000",
    );
    refuse(
        &["--fault", "snap:4"],
        2,
        "`snap:4` is no fault; expected lost=SHARE",
    );
    refuse(
        &["--fault", "snapped:7"],
        1,
        "--fault snapped:7: there is no servo 7",
    );
    for (option, beyond, expected) in [
        ("--spool-radius", ["0", "0.2"], "expected 0.0005 to 0.1"),
        ("--stiffness", ["0.5", "1e300"], "expected 1 to 100000000"),
        ("--friction", ["nan", "2.5"], "expected 0 to 2"),
    ] {
        for value in beyond {
            refuse(&[option, value], 2, expected);
        }
    }
    refuse(&["--robot", "4m"], 1, "unknown robot `4m`");
}

/// The file in `folder` of a rig whose servos are those of a server, without cameras.
pub(crate) fn rig_on(server: &Server, folder: &Path) -> PathBuf {
    let file = include_str!("../../examples/rig-sim.toml");
    let end = file.find("[[cameras]]").unwrap();
    let on_port = format!("link = {{ serial = \"{}\" }}", server.port);
    let file = file[..end].replace("link = \"simulated\"", &on_port);
    let robot = include_str!("../../examples/paper-robot.toml");
    std::fs::write(folder.join("paper-robot.toml"), robot).unwrap();
    let rig = folder.join("desk.toml");
    std::fs::write(&rig, file).unwrap();
    rig
}

/// What is said of servos on a port where a busy machine ran their server late.
pub(crate) const LATE: [&str; 4] = [
    "did not answer",
    // A part of it came in time.
    "answered arrived damaged",
    "was lost",
    "its watchdog ended it",
];

/// Homes a rig on a port: again where a busy machine ran the server later than the driver waits, or than the servos' watchdog.
fn home(rig: &Path, options: &[&str]) -> Output {
    let logs = || -> BTreeSet<PathBuf> {
        let files = std::fs::read_dir(rig.parent().unwrap()).unwrap();
        let paths = files.map(|file| file.unwrap().path());
        let is_log = |path: &PathBuf| path.extension().is_some_and(|end| end == "mcap");
        paths.filter(is_log).collect()
    };
    let arguments = ["home", "--rig", text(rig), "--here", "--json", "--quiet"];
    for _ in 0..30 {
        let before = logs();
        let output = tdcr(&[&arguments, options].concat()).output().unwrap();
        let said = stderr(&output);
        if !LATE.iter().any(|late| said.contains(late)) {
            return output;
        }
        for log in logs().difference(&before) {
            std::fs::remove_file(log).unwrap();
        }
    }
    panic!("servos on a port are never heard in time");
}

/// The same, which must succeed.
fn homed(rig: &Path, options: &[&str]) -> Value {
    let output = home(rig, options);
    assert!(output.status.success(), "{}", stderr(&output));
    serde_json::from_slice(&output.stdout).unwrap()
}

/// A log of what servos on a port said while they were homed lies beside the rig's file, one for each time.
#[test]
fn homing_servos_on_a_port_is_logged() {
    let server = Server::start(&[]);
    let folder = tempfile::tempdir().unwrap();
    let rig = rig_on(&server, folder.path());
    for name in ["desk.home.mcap", "desk.home-2.mcap"] {
        let homed = homed(&rig, &[]);
        assert_eq!(homed["servos"].as_array().unwrap().len(), 6);
        let log = folder.path().join(name);
        assert_eq!(homed["log"], text(&log));
        let info = succeed_json(&["log", "info", text(&log)]);
        assert_eq!(info["whole"], true);
        let topics = info["topics"].as_array().unwrap().iter();
        let topics: Vec<&str> = topics
            .map(|topic| topic["topic"].as_str().unwrap())
            .collect();
        for topic in ["/servos/present", "/servos/status", "/servos/homes"] {
            assert!(topics.contains(&topic), "{topics:?}");
        }
    }
    homed(&rig, &["--no-log"]);
    assert!(!folder.path().join("desk.home-3.mcap").exists());
}

#[test]
fn homing_names_a_tendon_that_does_not_pull() {
    let folder = tempfile::tempdir().unwrap();
    let robot = concat!(env!("CARGO_MANIFEST_DIR"), "/examples/paper-robot.toml");
    let whole = Server::of(robot, &[]);
    let rig = rig_on(&whole, folder.path());
    let homed = homed(&rig, &["--check"]);
    let pulls = homed["servos"].as_array().unwrap().iter();
    let pulls: Vec<f64> = pulls.map(|s| s["pull"].as_f64().unwrap()).collect();
    assert!(pulls.iter().all(|pull| *pull > 0.05), "{pulls:?}");
    drop(whole);
    let snapped = Server::of(robot, &["--fault", "snapped:4"]);
    let rig = rig_on(&snapped, folder.path());
    let refused = home(&rig, &["--check"]);
    let said = stderr(&refused);
    assert_eq!(refused.status.code(), Some(1), "{said}");
    assert!(said.contains("servo 4 takes"), "{said}");
}
