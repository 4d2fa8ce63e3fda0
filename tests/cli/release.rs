//! Every way out of a command that holds torque lets go of it.

use std::fs;
use std::io::{Read, Write};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::{Arc, Mutex};
use std::thread::{self, sleep};
use std::time::{Duration, Instant};

use tdcr::hw::clock::SystemClock;
use tdcr::hw::dynamixel::{Bus, BusSettings};
use tdcr::hw::log::{Entry, LogReader, LogRecord};
use tdcr::hw::serial::{Serial, SerialSettings};
use tdcr::hw::servo::{ServoBus, ServoId, Torque};

use crate::capture::small_rig;
use crate::servo_sim::{LATE, Server, rig_on};
use crate::{tdcr, text};

/// What a thread reads of a child as it comes.
pub(crate) type Said = Arc<Mutex<String>>;

pub(crate) fn listen(mut to: impl Read + Send + 'static) -> Said {
    let said = Said::default();
    let heard = said.clone();
    thread::spawn(move || {
        let mut buffer = [0; 1024];
        while let Ok(count @ 1..) = to.read(&mut buffer) {
            let text = String::from_utf8_lossy(&buffer[..count]);
            heard.lock().unwrap().push_str(&text);
        }
    });
    said
}

pub(crate) fn send(signal: &str, id: u32) {
    let sent = Command::new("kill")
        .args([signal, &id.to_string()])
        .status();
    assert!(sent.unwrap().success());
}

/// Waits for something of a running command; `None` where that ends first.
pub(crate) fn wait_for<T>(child: &mut Child, mut found: impl FnMut() -> Option<T>) -> Option<T> {
    let began = Instant::now();
    loop {
        if let Some(found) = found() {
            return Some(found);
        }
        if child.try_wait().unwrap().is_some() {
            return None;
        }
        assert!(began.elapsed() < Duration::from_secs(60), "it never comes");
        sleep(Duration::from_millis(20));
    }
}

pub(crate) fn ended(child: &mut Child) -> Option<i32> {
    let began = Instant::now();
    while child.try_wait().unwrap().is_none() {
        if began.elapsed() > Duration::from_secs(30) {
            child.kill().unwrap();
            panic!("the signal was not heard");
        }
        sleep(Duration::from_millis(10));
    }
    child.wait().unwrap().code()
}

/// How a command is seen to hold torque.
enum Sign {
    /// Its log says so, in the folder that `--out` names, or beside the rig.
    Log(&'static str),
    /// It shows what servos pull with.
    Pulls,
}

/// Whether a log that is being written says that motors are on.
pub(crate) fn says_on(log: &Path) -> bool {
    let Ok(mut reader) = LogReader::open(log) else {
        return false;
    };
    while let Ok(Some(entry)) = reader.next_entry() {
        let Entry::Message(message) = entry else {
            continue;
        };
        if let Ok(Some(LogRecord::Status(servos))) =
            LogRecord::decode(&message.channel, &message.data)
            && servos.iter().any(|servo| servo.torque == Some(Torque::On))
        {
            return true;
        }
    }
    false
}

/// What servos on a port say of their motors.
pub(crate) fn torques(port: &str) -> Vec<Torque> {
    let settings = SerialSettings {
        baud_rate: 1_000_000,
        ..SerialSettings::default()
    };
    let ids: Vec<ServoId> = (1..=6).filter_map(ServoId::new).collect();
    for _ in 0..50 {
        let clock = Arc::new(SystemClock::new());
        let line = Serial::open(Path::new(port), settings, clock).unwrap();
        let found = Bus::new(line, BusSettings::default()).torque(&ids);
        if let Ok(found) = found.into_iter().collect() {
            return found;
        }
    }
    panic!("the servos are never heard in time");
}

/// Runs a command on servos of a server until it holds torque, ends it by signals some milliseconds apart, and looks at the motors, at
/// the log, and at the exit status.
fn is_released(arguments: &[&str], sign: &Sign, signals: &[&str]) {
    // Again where a busy machine ran the server later than the driver waits.
    for _ in 0..10 {
        let server = Server::of(
            concat!(env!("CARGO_MANIFEST_DIR"), "/examples/paper-robot.toml"),
            &[],
        );
        let folder = tempfile::tempdir().unwrap();
        let rig = rig_on(&server, folder.path());
        let homed = tdcr(&["home", "--rig", text(&rig), "--here", "--no-log", "--quiet"]);
        if !{ homed }.output().unwrap().status.success() {
            continue;
        }
        let out = folder.path().join("out");
        let arguments: Vec<&str> = (arguments.iter())
            .map(|&argument| match argument {
                "RIG" => text(&rig),
                "OUT" => text(&out),
                other => other,
            })
            .collect();
        let mut child = tdcr(&arguments)
            .stdin(Stdio::piped())
            .stdout(Stdio::null())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        if arguments.contains(&"--payloads") {
            // The payload hangs.
            child.stdin.as_mut().unwrap().write_all(b"\n").ok();
        }
        let said = listen(child.stderr.take().unwrap());
        let log: Option<PathBuf> = match sign {
            Sign::Log(name) => Some(folder.path().join(name)),
            Sign::Pulls => None,
        };
        let on = wait_for(&mut child, || {
            let on = match &log {
                Some(log) => says_on(log),
                None => said.lock().unwrap().contains("pulling with"),
            };
            on.then_some(())
        });
        if on.is_some() {
            for signal in signals {
                send(signal, child.id());
                sleep(Duration::from_millis(60));
            }
        }
        let status = ended(&mut child);
        let said = said.lock().unwrap().clone();
        assert!(!said.contains("panicked"), "{arguments:?}: {said}");
        if LATE.iter().any(|late| said.contains(late)) {
            continue;
        }
        assert!(on.is_some(), "{arguments:?} ended by itself: {said}");
        assert_eq!(status, Some(130), "{arguments:?}, {signals:?}: {said}");
        let why = "motors are on, which nobody would look after while this program is stopped";
        assert_eq!(
            said.contains(why),
            signals[0] == "-TSTP",
            "{signals:?}: {said}"
        );
        let left = torques(server.port());
        assert!(
            left.iter().all(|&torque| torque == Torque::Off),
            "{arguments:?}, {signals:?}: {left:?}, {said}"
        );
        if let Some(log) = log {
            let mut reader = LogReader::open(&log).unwrap();
            while reader.next_entry().unwrap().is_some() {}
            assert!(
                reader.recovery().is_whole(),
                "{signals:?}: {:?}",
                reader.recovery()
            );
        }
        return;
    }
    panic!("servos on a port are never heard in time");
}

const JOG: [&str; 5] = ["jog", "--rig", "RIG", "--out", "OUT"];
const TRACK: [&str; 11] = [
    "track",
    "--rig",
    "RIG",
    "--out",
    "OUT",
    "--path",
    "circle",
    "--controller",
    "inverse",
    "--duration",
    "300",
];
const CAPTURE: [&str; 7] = [
    "capture",
    "--rig",
    "RIG",
    "--out",
    "OUT",
    "--commands",
    "10",
];
const HOME: [&str; 4] = ["home", "--rig", "RIG", "--check"];
/// More than the servos reach before a signal comes.
const WIND: [&str; 7] = [
    "pretension",
    "--rig",
    "RIG",
    "--current",
    "0.3",
    "--step",
    "1",
];
const BY_HAND: [&str; 6] = [
    "pretension",
    "--rig",
    "RIG",
    "--by-hand",
    "--current",
    "0.3",
];

#[test]
fn jog_lets_go_at_every_signal() {
    for signals in [
        &["-INT"][..],
        &["-TERM"],
        &["-HUP"],
        &["-QUIT"],
        &["-TSTP"],
        &["-INT", "-INT"],
        &["-TTOU"],
    ] {
        is_released(&JOG, &Sign::Log("out/log.mcap"), signals);
    }
}

#[test]
fn tracking_lets_go_at_every_signal() {
    for signals in [
        &["-INT"][..],
        &["-TERM"],
        &["-HUP"],
        &["-TSTP"],
        &["-INT", "-INT"],
    ] {
        is_released(&TRACK, &Sign::Log("out/log.mcap"), signals);
    }
}

#[test]
fn captures_let_go_at_every_signal() {
    for signals in [
        &["-TERM"][..],
        &["-HUP"],
        &["-QUIT"],
        &["-TSTP"],
        &["-INT", "-INT"],
        &["-USR1"],
    ] {
        is_released(&CAPTURE, &Sign::Log("out/log.mcap"), signals);
    }
    let loaded = [&CAPTURE[..], &["--payloads", "0.02"]].concat();
    is_released(&loaded, &Sign::Log("out/log.mcap"), &["-TERM"]);
}

#[test]
fn homing_and_tensioning_let_go_at_every_signal() {
    for signals in [&["-INT"][..], &["-HUP", "-TERM"], &["-QUIT"], &["-TSTP"]] {
        is_released(&HOME, &Sign::Log("desk.home.mcap"), signals);
    }
    for signals in [
        &["-TERM"][..],
        &["-INT", "-INT"],
        &["-QUIT"],
        &["-TSTP"],
        &["-TSTP", "-TSTP"],
    ] {
        is_released(&WIND, &Sign::Pulls, signals);
        is_released(&BY_HAND, &Sign::Pulls, signals);
    }
}

/// The process that runs `tdcr` with an argument.
fn process_with(argument: &str) -> Option<u32> {
    let processes = fs::read_dir("/proc").unwrap().flatten();
    let mut ids = processes.filter_map(|entry| entry.file_name().to_str()?.parse::<u32>().ok());
    ids.find(|id| {
        let command = fs::read(format!("/proc/{id}/cmdline")).unwrap_or_default();
        let words: Vec<&[u8]> = command.split(|&byte| byte == 0).collect();
        words.first().is_some_and(|name| name.ends_with(b"/tdcr"))
            && words.contains(&argument.as_bytes())
    })
}

/// `jog` in a terminal: its keys come one by one meanwhile, and afterwards the terminal is as it was.
#[test]
fn jog_leaves_the_terminal_as_it_was() {
    for ending in [
        "-TERM", "-INT", "-QUIT", "-TSTP", "wq", "\x1c", "w\x1a", "closed",
    ] {
        let folder = tempfile::tempdir().unwrap();
        let rig = small_rig(folder.path());
        let out = folder.path().join("out");
        let jog = format!(
            "{} jog --rig {} --out {}; stty -a",
            env!("CARGO_BIN_EXE_tdcr"),
            rig.display(),
            out.display()
        );
        let mut terminal = Command::new("script")
            .args(["-qec", &jog, "/dev/null"])
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        let said = listen(terminal.stdout.take().unwrap());
        let seen = |what: &str| said.lock().unwrap().contains(what);
        let ready = wait_for(&mut terminal, || seen("let go and end").then_some(()));
        assert!(ready.is_some(), "{}", said.lock().unwrap());
        let id = process_with(text(&out)).unwrap();
        let mut keyboard = terminal.stdin.take().unwrap();
        match ending {
            "closed" => terminal.kill().unwrap(),
            signal if signal.starts_with('-') => send(signal, id),
            keys => keyboard.write_all(keys.as_bytes()).unwrap(),
        }
        ended(&mut terminal);
        let began = Instant::now();
        while Path::new(&format!("/proc/{id}/cwd")).exists() {
            assert!(
                began.elapsed() < Duration::from_secs(20),
                "{ending}: it goes on"
            );
            sleep(Duration::from_millis(20));
        }
        let mut reader = LogReader::open(&out.join("log.mcap")).unwrap();
        while reader.next_entry().unwrap().is_some() {}
        assert!(
            reader.recovery().is_whole(),
            "{ending}: {:?}",
            reader.recovery()
        );
        if ending.starts_with('w') {
            assert!(
                seen("1 move, 0 refused"),
                "{ending}: {}",
                said.lock().unwrap()
            );
        }
        if ending != "closed" {
            let began = Instant::now();
            while !seen("icanon") && began.elapsed() < Duration::from_secs(5) {
                sleep(Duration::from_millis(20));
            }
            let said = said.lock().unwrap();
            assert!(
                said.contains(" icanon") && said.contains(" echo "),
                "{ending}: {said}"
            );
            assert!(
                !said.contains("-icanon") && !said.contains("-echo "),
                "{ending}: {said}"
            );
        }
    }
}
