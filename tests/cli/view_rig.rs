//! `tdcr view --rig`: who moves the rig, and that its motors are off however that ends.

use std::fs;
use std::time::{Duration, Instant};

use serde_json::{Value, json};
use tdcr::hw::servo::Torque;

use crate::capture::small_rig;
use crate::release::{ended, send, torques};
use crate::servo_sim::{self, LATE, rig_on};
use crate::view::{Page, Server, doubles};
use crate::{refuse, succeed_json, tdcr, text};

/// Longest wait for the rig.
const LONG: Duration = Duration::from_secs(60);

/// Servos on a port with the paper's robot, homed; the folder of their rig; and a server of its page.
struct Desk {
    servos: servo_sim::Server,
    view: Server,
    _folder: tempfile::TempDir,
}

/// Why a test begins anew: a busy machine ran the servos' server later than the driver waits.
struct Late;

impl Desk {
    fn new() -> Result<Self, Late> {
        let robot = concat!(env!("CARGO_MANIFEST_DIR"), "/examples/paper-robot.toml");
        let servos = servo_sim::Server::of(robot, &[]);
        let folder = tempfile::tempdir().unwrap();
        let rig = rig_on(&servos, folder.path());
        let homed = tdcr(&["home", "--rig", text(&rig), "--here", "--no-log", "--quiet"]);
        if !{ homed }.output().unwrap().status.success() {
            return Err(Late);
        }
        let view = Server::start(&["--rig", text(&rig)]);
        Ok(Self {
            servos,
            view,
            _folder: folder,
        })
    }

    fn are_off(&self) -> bool {
        let found = torques(self.servos.port());
        found.iter().all(|&torque| torque == Torque::Off)
    }
}

/// What a page is next told of the rig that is as wanted; it says meanwhile that it is there.
fn until(page: &mut Page, wanted: impl Fn(&Value) -> bool) -> Result<Value, Late> {
    let began = Instant::now();
    let mut said = Instant::now();
    loop {
        let words = page.words();
        if words["type"] == "rig" {
            let text = words["said"][1].as_str().unwrap_or_default();
            if wanted(&words) {
                return Ok(words);
            }
            if LATE.iter().any(|late| text.contains(late)) {
                return Err(Late);
            }
        }
        if said.elapsed() > Duration::from_millis(300) {
            said = Instant::now();
            page.send(0.0, json!({"type": "here"}));
        }
        assert!(began.elapsed() < LONG, "it never comes: {words}");
    }
}

fn arm(page: &mut Page) -> Result<(), Late> {
    page.send(0.0, json!({"type": "arm"}));
    until(page, |rig| rig["armed"] == "here" && rig["moving"] == false).map(drop)
}

fn bent(angle: f64) -> Value {
    let module = |angle: f64| json!({"toward": [angle, 0.0], "tension": 12.0});
    json!({"type": "shape", "modules": [module(angle), module(0.0)]})
}

fn ticks(rig: &Value) -> Vec<i64> {
    let servos = rig["servos"].as_array().unwrap().iter();
    servos
        .map(|servo| servo["position"].as_i64().unwrap())
        .collect()
}

fn says<'a>(expected: &'a str) -> impl Fn(&Value) -> bool + 'a {
    move |rig| {
        rig["said"][1]
            .as_str()
            .is_some_and(|text| text.contains(expected))
    }
}

/// Runs a test again where servos on a port were heard late.
fn in_time(test: impl Fn() -> Result<(), Late>) {
    for _ in 0..10 {
        if test().is_ok() {
            return;
        }
    }
    panic!("servos on a port are never heard in time");
}

#[test]
fn a_rig_moves_for_the_page_that_armed_it_alone_and_lets_go_when_its_socket_is_lost() {
    in_time(|| {
        let mut desk = Desk::new()?;
        let (mut one, mut other) = (desk.view.open(), desk.view.open());
        let home = until(&mut one, |rig| {
            rig["servos"].as_array().is_some_and(|s| !s.is_empty())
        })?;
        one.send(0.0, bent(0.3));
        until(&mut one, says("has not armed"))?;
        arm(&mut one)?;
        other.send(0.0, json!({"type": "arm"}));
        let refused = until(&mut other, says("another page has armed"))?;
        assert_eq!(refused["armed"], "elsewhere");
        other.send(0.0, bent(0.3));
        until(&mut other, says("has not armed"))?;

        one.send(0.0, bent(0.3));
        let moved = until(&mut one, |rig| {
            let moves = ticks(rig).into_iter().zip(ticks(&home));
            let apart = moves.map(|(a, b)| (a - b).abs()).max();
            rig["moving"] == false && apart.is_some_and(|apart| apart > 100)
        })?;
        assert!(
            moved["servos"][0]["temperature"]
                .as_f64()
                .is_some_and(|t| t > 10.0)
        );
        // Beyond what a tendon bears: refused, and nothing moves.
        one.send(
            0.0,
            json!({"type": "shape", "modules": [
            {"toward": [0.0, 0.0], "tension": 500.0}, {"toward": [0.0, 0.0], "tension": 500.0}]}),
        );
        until(&mut one, |rig| {
            rig["armed"] == "here" && says("its servo allows")(rig)
        })?;

        drop(one);
        until(&mut other, |rig| rig["armed"] == "no")?;
        // Whatever the process would do at its end, it does not come to.
        desk.view.child.kill().unwrap();
        desk.view.child.wait().unwrap();
        assert!(desk.are_off());
        Ok(())
    });
}

/// Number, count, columns and rows of a picture that a camera took, and its pixels.
fn taken(message: &[u8]) -> (Vec<f64>, Vec<[u8; 3]>) {
    let head = doubles(&message[8..40]);
    let pixels = message[40..].as_chunks::<3>().0.to_vec();
    assert_eq!(pixels.len(), (head[2] * head[3]) as usize);
    (head, pixels)
}

#[test]
fn a_page_has_the_cameras_pictures_with_what_is_taken_for_the_robot_and_all_is_logged() {
    let folder = tempfile::tempdir().unwrap();
    let rig = small_rig(folder.path());
    let out = folder.path().join("seen");
    let mut server = Server::start(&["--rig", text(&rig), "--out", text(&out)]);
    let mut page = server.open();
    for view in [0.0, 1.0] {
        let (head, pixels) = taken(&page.numbers(3.0));
        assert_eq!(head, [view, 2.0, 160.0, 120.0]);
        // Dimmed colours are half as bright as they may be.
        let coloured = pixels.iter().filter(|[red, ..]| *red > 127).count();
        assert!((50..pixels.len() / 4).contains(&coloured), "{coloured}");
    }
    send("-INT", server.child.id());
    assert!(ended(&mut server.child).is_some());
    let log = out.join("log.mcap");
    let info = succeed_json(&["log", "info", text(&log)]);
    assert_eq!(info["whole"], true, "{info}");
    for topic in ["/servos/present", "/cloud"] {
        let topics = info["topics"].as_array().unwrap();
        let of_topic = topics.iter().find(|one| one["topic"] == topic);
        assert!(
            of_topic.is_some_and(|one| one["messages"].as_u64() > Some(0)),
            "{info}"
        );
    }
    let alone = ["view", "--no-browser", "--out", text(&out)];
    refuse(&alone, 2, "--rig <FILE>");
}

#[test]
fn a_page_that_falls_silent_lets_go_of_the_rig() {
    in_time(|| {
        let mut desk = Desk::new()?;
        let (mut one, mut other) = (desk.view.open(), desk.view.open());
        arm(&mut one)?;
        until(&mut other, |rig| rig["armed"] == "elsewhere")?;
        // Its socket stays open, and nothing comes. It holds no more once the motors are off.
        until(&mut other, |rig| rig["armed"] == "no")?;
        desk.view.child.kill().unwrap();
        desk.view.child.wait().unwrap();
        assert!(desk.are_off());
        Ok(())
    });
}

#[test]
fn signals_release_a_rig_that_a_page_holds() {
    for signals in [&["-INT"][..], &["-TERM"], &["-INT", "-INT"]] {
        in_time(|| {
            let mut desk = Desk::new()?;
            let mut page = desk.view.open();
            arm(&mut page)?;
            for signal in signals {
                send(signal, desk.view.child.id());
                std::thread::sleep(Duration::from_millis(60));
            }
            assert!(ended(&mut desk.view.child).is_some());
            assert!(desk.are_off(), "{signals:?}");
            Ok(())
        });
    }
}

#[test]
fn the_obstacles_of_a_rigs_file_are_around_its_robot() {
    let folder = tempfile::tempdir().unwrap();
    let rig = small_rig(folder.path());
    fs::write(
        folder.path().join("post.toml"),
        "[[obstacle]]\nname = \"post\"\nposition = [0.3, 0.0, 0.2]\ncylinder = { radius = 0.01, length = 0.4 }\n",
    )
    .unwrap();
    let plain = fs::read_to_string(&rig).unwrap();
    let (head, tables) = plain.split_once("[simulation]").unwrap();
    let around = "[scene]\nfile = \"post.toml\"\n\n[simulation]";
    fs::write(&rig, format!("{head}{around}{tables}")).unwrap();
    let server = Server::start(&["--rig", text(&rig)]);
    let shown = server.open().words()["obstacles"].clone();
    assert_eq!(shown[0]["name"], "post", "{shown}");
    assert_eq!(shown.as_array().unwrap().len(), 1);
}
