//! `tdcr view`: who may talk to the server, and what it answers.

use std::fs;
use std::io::{BufRead, BufReader, Read, Write};
use std::net::TcpStream;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use serde_json::{Value, json};
use tungstenite::{Message, WebSocket, client};

use crate::{COMMAND, refuse, succeed_json, tdcr, text};

/// Longest wait for an answer.
pub(crate) const PATIENCE: Duration = Duration::from_secs(20);

/// A server, ended with the test.
pub(crate) struct Server {
    pub(crate) child: Child,
    /// `127.0.0.1:PORT`.
    host: String,
    /// `/TOKEN/`.
    path: String,
}

impl Server {
    pub(crate) fn start(arguments: &[&str]) -> Self {
        let mut child = tdcr(&[&["view", "--no-browser"], arguments].concat())
            .stdout(Stdio::piped())
            .spawn()
            .unwrap();
        let mut line = String::new();
        let mut stdout = BufReader::new(child.stdout.take().unwrap());
        stdout.read_line(&mut line).unwrap();
        let address = line.trim_end().strip_prefix("http://").unwrap();
        let (host, path) = address.split_at(address.find('/').unwrap());
        let (host, path) = (host.to_owned(), path.to_owned());
        Self { child, host, path }
    }

    /// Status and body of the answer to a GET.
    fn get(&self, path: &str, headers: &[(&str, &str)]) -> (u16, String) {
        let mut stream = TcpStream::connect(&self.host).unwrap();
        let mut request = format!("GET {path} HTTP/1.1\r\nConnection: close\r\n");
        for (name, value) in headers {
            request += &format!("{name}: {value}\r\n");
        }
        stream.write_all((request + "\r\n").as_bytes()).unwrap();
        stream.set_read_timeout(Some(PATIENCE)).unwrap();
        let mut answer = Vec::new();
        stream.read_to_end(&mut answer).unwrap();
        let answer = String::from_utf8_lossy(&answer);
        let status = answer.split(' ').nth(1).unwrap().parse().unwrap();
        (status, answer.into_owned())
    }

    /// Status of the answer to a page's request for a socket.
    fn ask_for_socket(&self, path: &str, origin: &str) -> u16 {
        let mut stream = TcpStream::connect(&self.host).unwrap();
        let request = format!(
            "GET {path} HTTP/1.1\r\nHost: {}\r\nOrigin: {origin}\r\nConnection: Upgrade\r\nUpgrade: websocket\r\n\
             Sec-WebSocket-Version: 13\r\nSec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n\r\n",
            self.host
        );
        stream.write_all(request.as_bytes()).unwrap();
        stream.set_read_timeout(Some(PATIENCE)).unwrap();
        let mut line = String::new();
        BufReader::new(stream).read_line(&mut line).unwrap();
        line.split(' ').nth(1).unwrap().parse().unwrap()
    }

    pub(crate) fn open(&self) -> Page {
        let stream = TcpStream::connect(&self.host).unwrap();
        stream.set_read_timeout(Some(PATIENCE)).unwrap();
        let address = format!("ws://{}{}socket", self.host, self.path);
        Page(client(address, stream).unwrap().0)
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// What a page does with its socket.
pub(crate) struct Page(pub(crate) WebSocket<TcpStream>);

impl Page {
    /// The next answer in words; frames are passed over, and the list of overlays that comes first.
    pub(crate) fn words(&mut self) -> Value {
        loop {
            let words = self.next_words();
            if words["type"] != "overlays" {
                return words;
            }
        }
    }

    /// The next answer in words; frames are passed over.
    pub(crate) fn next_words(&mut self) -> Value {
        loop {
            if let Message::Text(text) = self.0.read().unwrap() {
                return serde_json::from_str(&text).unwrap();
            }
        }
    }

    /// Sends a request.
    pub(crate) fn send(&mut self, stamp: f64, mut request: Value) {
        request["stamp"] = json!(stamp);
        self.0.send(Message::text(request.to_string())).unwrap();
    }

    /// The next message of numbers whose first one, its kind, is this.
    pub(crate) fn numbers(&mut self, kind: f64) -> Vec<u8> {
        loop {
            if let Message::Binary(bytes) = self.0.read().unwrap()
                && bytes[..8] == kind.to_le_bytes()
            {
                return bytes.to_vec();
            }
        }
    }

    /// The frame that answers a request.
    pub(crate) fn ask(&mut self, stamp: f64, request: Value) -> Vec<f64> {
        self.send(stamp, request);
        loop {
            if let Message::Binary(bytes) = self.0.read().unwrap() {
                let frame = doubles(&bytes);
                if frame[0] == 0.0 && frame[1] == stamp {
                    return frame;
                }
            }
        }
    }
}

pub(crate) fn doubles(bytes: &[u8]) -> Vec<f64> {
    let numbers = bytes.chunks_exact(8);
    numbers
        .map(|b| f64::from_le_bytes(b.try_into().unwrap()))
        .collect()
}

/// Where the tip is in a frame (m).
pub(crate) fn tip(frame: &[f64]) -> [f64; 3] {
    [frame[11], frame[12], frame[13]]
}

pub(crate) fn distance(one: [f64; 3], other: [f64; 3]) -> f64 {
    one.iter()
        .zip(other)
        .map(|(a, b)| (a - b).powi(2))
        .sum::<f64>()
        .sqrt()
}

#[test]
fn the_page_is_served_to_who_has_the_token_and_comes_under_its_own_name() {
    let server = Server::start(&[]);
    let own = server.host.clone();
    let port = own.rsplit(':').next().unwrap();
    let (status, page) = server.get(&server.path, &[("Host", &own)]);
    assert_eq!(status, 200, "{page}");
    assert!(
        page.contains("tdcr view") && page.contains("content-security-policy: default-src 'none'"),
        "{page}"
    );
    for file in ["main.js", "style.css", "three/three.core.min.js"] {
        assert_eq!(
            server
                .get(&format!("{}{file}", server.path), &[("Host", &own)])
                .0,
            200
        );
    }
    assert_eq!(
        server
            .get(&format!("{}none.js", server.path), &[("Host", &own)])
            .0,
        404
    );

    for path in ["/", "/main.js", "/0123456789abcdef0123456789abcdef/"] {
        assert_eq!(server.get(path, &[("Host", &own)]).0, 403, "{path}");
    }
    let foreign = format!("robots.example:{port}");
    assert_eq!(server.get(&server.path, &[("Host", &foreign)]).0, 403);
    let origin = ("Origin", "http://robots.example");
    assert_eq!(server.get(&server.path, &[("Host", &own), origin]).0, 403);

    let (socket, here) = (format!("{}socket", server.path), format!("http://{own}"));
    assert_eq!(server.ask_for_socket(&socket, &here), 101);
    assert_eq!(server.ask_for_socket(&socket, "http://robots.example"), 403);
    assert_eq!(server.ask_for_socket("/socket", &here), 403);
}

#[test]
fn a_command_moves_the_robot_to_where_settle_has_it_and_a_dragged_disc_arrives() {
    let server = Server::start(&[]);
    let mut page = server.open();
    let robot = page.words();
    assert_eq!(
        (&robot["type"], &robot["name"]),
        (&json!("robot"), &json!("2m"))
    );
    assert_eq!(robot["tendons"].as_array().unwrap().len(), 6);
    let command: Vec<f64> = COMMAND.split(',').map(|c| c.parse().unwrap()).collect();
    let frame = page.ask(1.0, json!({"type": "settle", "command": command}));
    let settled = succeed_json(&["settle", "--command", COMMAND]);
    let expected: Vec<f64> = serde_json::from_value(settled["positions"][9].clone()).unwrap();
    let expected = [expected[0], expected[1], expected[2]];
    assert!(
        distance(tip(&frame), expected) < 1e-9,
        "{:?}, not {expected:?}",
        tip(&frame)
    );
    assert_eq!(frame[5], 1.0, "it settles");

    let to = [expected[0] + 0.01, expected[1] - 0.01, expected[2]];
    let mut dragged = frame;
    for step in 0..20 {
        dragged = page.ask(
            2.0 + f64::from(step),
            json!({"type": "drag", "disc": 9, "to": to}),
        );
    }
    assert!(
        distance(tip(&dragged), to) < 1e-4,
        "{:?}, not {to:?}",
        tip(&dragged)
    );

    let heavy = page.ask(50.0, json!({"type": "payload", "mass": 0.05}));
    assert!(tip(&heavy)[2] < tip(&dragged)[2]);
}

#[test]
fn a_push_ends_with_the_hand_and_leaves_the_loads_that_were_given() {
    let server = Server::start(&["--wrench", "tip:0.2,0,0", "--payload", "0.01"]);
    let mut page = server.open();
    page.words();
    let at_rest = page.ask(1.0, json!({"type": "payload", "mass": 0.01}));
    let pushed = page.ask(
        2.0,
        json!({"type": "push", "disc": 9, "force": [0, 0.5, 0]}),
    );
    assert!(distance(tip(&pushed), tip(&at_rest)) > 1e-3);
    let let_go = page.ask(3.0, json!({"type": "push", "disc": 9, "force": [0, 0, 0]}));
    assert!(distance(tip(&let_go), tip(&at_rest)) < 1e-9);
}

#[test]
fn a_push_in_motion_swings_the_robot_and_it_comes_to_rest_where_it_was() {
    let server = Server::start(&["--command", COMMAND]);
    let mut page = server.open();
    page.words();
    let rest = page.ask(1.0, json!({"type": "payload", "mass": 0.0}));
    page.ask(2.0, json!({"type": "physics", "physics": "in_motion"}));
    page.ask(
        3.0,
        json!({"type": "push", "disc": 9, "force": [0, 0.2, 0]}),
    );
    let mut farthest = 0.0_f64;
    let mut last = rest.clone();
    let mut let_go = false;
    // Frames come without being asked for: the robot swings out, and back when it is let go.
    let begun = Instant::now();
    while begun.elapsed() < PATIENCE {
        let frame = doubles(&page.numbers(0.0));
        assert_eq!(frame[8], 2.0, "in motion");
        farthest = farthest.max(distance(tip(&frame), tip(&rest)));
        if frame[9] > 0.5 && !let_go {
            page.ask(4.0, json!({"type": "push", "disc": 9, "force": [0, 0, 0]}));
            let_go = true;
        }
        last = frame;
        // Its slowest motion decays within many seconds.
        if last[9] > 1.5 && distance(tip(&last), tip(&rest)) < 0.2 * farthest {
            break;
        }
    }
    assert!(farthest > 1e-2, "{farthest} m");
    let left = distance(tip(&last), tip(&rest));
    assert!(left < 0.2 * farthest, "{left} m of {farthest} m");
    let settled = page.ask(5.0, json!({"type": "physics", "physics": "at_rest"}));
    assert_eq!(settled[8], 0.0);
    assert!(distance(tip(&settled), tip(&rest)) < 1e-6);
}

#[test]
fn friction_holds_the_robot_back_among_obstacles_too() {
    let server = Server::start(&[]);
    let mut page = server.open();
    page.words();
    let bent: Vec<f64> = COMMAND.split(',').map(|c| c.parse().unwrap()).collect();
    let free = page.ask(1.0, json!({"type": "command", "command": bent}));
    page.ask(2.0, json!({"type": "settle", "command": vec![0.02; 6]}));
    let friction = json!({"type": "physics", "physics": "with_friction", "coefficient": 0.3});
    page.ask(3.0, friction.clone());
    let rubbed = page.ask(4.0, json!({"type": "command", "command": bent}));
    assert_eq!(rubbed[8], 1.0);
    let apart = distance(tip(&free), tip(&rubbed));
    assert!(apart > 1e-3, "{apart} m");

    let among = Server::start(&[
        "--scene",
        concat!(env!("CARGO_MANIFEST_DIR"), "/examples/scenes/shelf.toml"),
    ]);
    let mut page = among.open();
    page.words();
    page.ask(1.0, json!({"type": "settle", "command": vec![0.02; 6]}));
    page.ask(2.0, friction);
    let among = page.ask(3.0, json!({"type": "command", "command": bent}));
    assert_eq!(among[8], 1.0);
    // What stands around it is in the way.
    let apart = distance(tip(&among), tip(&rubbed));
    assert!(apart > 1e-3, "{apart} m");
}

#[test]
fn every_camera_gives_a_picture_in_which_the_robot_is_seen() {
    let server = Server::start(&[]);
    let mut page = server.open();
    let count = page.words()["cameras"].as_u64().unwrap();
    assert_eq!(count, 8);
    page.send(1.0, json!({"type": "pictures"}));
    for camera in 0..count {
        let message = page.numbers(2.0);
        let head = doubles(&message[..40]);
        assert_eq!(head[1], camera as f64);
        let (width, height) = (head[3] as usize, head[4] as usize);
        let pixels = &message[40..];
        assert_eq!(pixels.len(), 3 * width * height);
        let background = &pixels[..3];
        let robot = pixels.chunks_exact(3).filter(|p| *p != background).count();
        let share = robot as f64 / (width * height) as f64;
        assert!((0.005..0.5).contains(&share), "camera {camera}: {share}");
    }
}

#[test]
fn what_is_wrong_is_refused_by_name_and_changes_nothing() {
    let server = Server::start(&[]);
    let mut page = server.open();
    page.words();
    let before = page.ask(1.0, json!({"type": "payload", "mass": 0.0}));
    for (request, expected) in [
        (json!({"type": "command", "command": [0.0]}), "6 tendons"),
        (
            json!({"type": "command", "command": [9, 0, 0, 0, 0, 0]}),
            "command entry 1",
        ),
        (
            json!({"type": "drag", "disc": 99, "to": [0, 0, 0]}),
            "disc 99",
        ),
        (json!({"type": "payload", "mass": -1}), "payload"),
        (
            json!({"type": "robot", "toml": "name = 3"}),
            "robot specification",
        ),
        (json!({"type": "dance"}), "dance"),
        (json!([1, 2]), "expected"),
    ] {
        let mut letter = request.clone();
        if let Some(letter) = letter.as_object_mut() {
            letter.insert("stamp".to_owned(), json!(2.0));
        }
        page.0.send(Message::text(letter.to_string())).unwrap();
        let refused = page.words();
        assert_eq!(refused["type"], "refused", "{request}");
        let reason = refused["reason"].as_str().unwrap();
        assert!(reason.contains(expected), "{request}: {reason}");
    }
    let after = page.ask(3.0, json!({"type": "payload", "mass": 0.0}));
    assert!(distance(tip(&before), tip(&after)) < 1e-9);
}

#[test]
fn a_robot_file_is_watched_and_every_page_has_a_robot_of_its_own() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("robot.toml");
    let robot =
        fs::read_to_string(concat!(env!("CARGO_MANIFEST_DIR"), "/sim/robots/2m.toml")).unwrap();
    fs::write(&file, &robot).unwrap();
    let server = Server::start(&["--robot", text(&file)]);
    let mut pages: Vec<Page> = (0..10).map(|_| server.open()).collect();
    for page in &mut pages {
        assert_eq!(page.words()["type"], "robot");
    }
    let bent: Vec<f64> = COMMAND.split(',').map(|c| c.parse().unwrap()).collect();
    let moved = pages[0].ask(1.0, json!({"type": "settle", "command": bent}));
    let still = pages[1].ask(1.0, json!({"type": "payload", "mass": 0.0}));
    assert!(distance(tip(&moved), tip(&still)) > 0.01);

    fs::write(&file, "nonsense").unwrap();
    let refused = pages[0].words();
    assert_eq!(
        (&refused["type"], &refused["of"]),
        (&json!("refused"), &json!("robot"))
    );
    assert!(refused["reason"].as_str().unwrap().contains("robot.toml"));
    let renamed = robot.replacen("name = \"2m\"", "name = \"renamed\"", 1);
    assert_ne!(renamed, robot);
    fs::write(&file, renamed).unwrap();
    for page in &mut pages {
        let mut words = page.words();
        if words["type"] == "refused" {
            words = page.words();
        }
        assert_eq!(words["name"], "renamed");
    }
}

#[test]
fn ctrl_c_ends_the_server_with_pages_open_and_a_taken_port_is_said() {
    let server = Server::start(&[
        "--scene",
        concat!(env!("CARGO_MANIFEST_DIR"), "/examples/scenes/shelf.toml"),
    ]);
    let mut page = server.open();
    assert!(!page.words()["obstacles"].as_array().unwrap().is_empty());
    let port = server.host.rsplit(':').next().unwrap().to_owned();
    let said = format!("cannot serve at port {port} of 127.0.0.1");
    refuse(&["view", "--no-browser", "--port", &port], 1, &said);

    let mut server = server;
    let id = server.child.id().to_string();
    assert!(
        Command::new("kill")
            .args(["-INT", &id])
            .status()
            .unwrap()
            .success()
    );
    let begun = Instant::now();
    let status = loop {
        if let Some(status) = server.child.try_wait().unwrap() {
            break status;
        }
        assert!(begun.elapsed() < PATIENCE, "it goes on");
        std::thread::sleep(Duration::from_millis(20));
    };
    assert!(status.code().is_some(), "{status}");
    while page.0.read().is_ok() {}
}
