//! The server: the page's files, and a socket for each page.

use std::fs::File;
use std::future::pending;
use std::io;
use std::net::{Ipv4Addr, SocketAddr, TcpListener as StdListener};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::channel;
use std::thread::{self, JoinHandle};
use std::time::Duration;

use axum::Router;
use axum::extract::ws::{Message, WebSocket, WebSocketUpgrade};
use axum::extract::{FromRequestParts, Request, State};
use axum::http::{HeaderMap, HeaderName, HeaderValue, Method, StatusCode, header};
use axum::response::{IntoResponse, Response};
use tdcr_hw::capture::CaptureError;
use tdcr_sim::robot::RobotSpec;
use thiserror::Error;
use tokio::net::TcpListener;
use tokio::runtime::{Builder, Runtime};
use tokio::sync::{mpsc, oneshot, watch};

use super::assets::{self, PAGE};
use super::desk::{Desk, DeskLink, Order, PageId, Seen};
use super::error::RequestError;
use super::exhibit::{Exhibit, Source, Watched};
use super::guard::{Guard, token};
use super::message::Letter;
use super::post::{Given, Input, Output};
use super::session;
use crate::pipeline::{PipelineError, lock_folder};

/// How often a robot file is looked at.
const LOOK: Duration = Duration::from_millis(200);
/// Longest message of a page (bytes): a robot file has a thousandth.
const LONGEST: usize = 4 << 20;
/// Frames that wait for a page: a slow one gets fewer.
const WAITING: usize = 2;

/// A robot in the browser, until it is dropped.
#[derive(Debug)]
pub struct View {
    address: String,
    end: Option<oneshot::Sender<()>>,
    server: Option<JoinHandle<()>>,
    desk: Option<Desk>,
    log: Option<PathBuf>,
    /// As long as the log may be written.
    _lock: Option<File>,
    given: watch::Sender<Option<Arc<Given>>>,
}

/// Why nothing is served.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum ViewError {
    /// The port is taken, or not ours to take.
    #[error("cannot serve at port {port} of 127.0.0.1: {source}")]
    Port {
        /// The port; 0 for any free one.
        port: u16,
        /// What the operating system said.
        source: io::Error,
    },
    /// The robot does not settle where it is to begin.
    #[error(transparent)]
    Exhibit(#[from] RequestError),
    /// The rig cannot be opened, or its log not begun.
    #[error(transparent)]
    Rig(#[from] CaptureError),
    /// The folder of the log cannot be written to, or another program writes to it.
    #[error(transparent)]
    Folder(#[from] PipelineError),
}

/// What a file of a robot holds by now; `None` as long as it has not changed.
type FileState = Option<Arc<Result<RobotSpec, String>>>;

/// What all requests share.
struct Shared {
    exhibit: Exhibit,
    guard: Guard,
    nonce: String,
    port: u16,
    file: watch::Receiver<FileState>,
    desk: Option<DeskLink>,
    given: watch::Receiver<Option<Arc<Given>>>,
    /// Sockets so far.
    pages: AtomicU64,
}

impl View {
    /// Serves `exhibit` at a port of 127.0.0.1; 0 for any free one.
    ///
    /// # Errors
    /// [`ViewError::Exhibit`] for a robot, command or loads that do not fit each other or the scene; [`ViewError::Port`] where the port is
    /// not to be had; [`ViewError::Rig`] for a rig that cannot be opened; [`ViewError::Folder`] for the folder of its log.
    pub fn open(exhibit: Exhibit, port: u16) -> Result<Self, ViewError> {
        session::check(&exhibit)?;
        let refused = |source| ViewError::Port { port, source };
        let listener = StdListener::bind((Ipv4Addr::LOCALHOST, port)).map_err(refused)?;
        listener.set_nonblocking(true).map_err(refused)?;
        let at = listener.local_addr().map_err(refused)?;
        let runtime = Builder::new_current_thread()
            .enable_all()
            .build()
            .map_err(refused)?;
        let out = exhibit.out.clone().filter(|_| exhibit.rig.is_some());
        let lock = out.as_deref().map(lock_folder).transpose()?;
        let opened = (exhibit.rig.clone()).map(|file| Desk::open(file, out.as_deref()));
        let (desk, log) = opened.transpose()?.unzip();
        let link = desk.as_ref().map(Desk::link);
        let (given, shown) = watch::channel(None);
        let token = token();
        let (end, ended) = oneshot::channel();
        let address = format!("http://{at}/{token}/");
        let server = thread::spawn(move || {
            let door = Guard::new(at, &token);
            serve(
                &runtime,
                listener,
                (at, door),
                exhibit,
                (link, shown),
                ended,
            );
        });
        Ok(Self {
            address,
            end: Some(end),
            server: Some(server),
            desk,
            log: log.flatten(),
            _lock: lock,
            given,
        })
    }

    /// Shows something on all pages, and on those that are opened later. What the robot that a page shows cannot do is said there.
    pub fn show(&self, given: Given) {
        self.given.send_replace(Some(Arc::new(given)));
    }

    /// The log of the rig, where one is written.
    pub fn log(&self) -> Option<&Path> {
        self.log.as_deref()
    }

    /// The address to open in a browser, with the token in it.
    pub fn address(&self) -> &str {
        &self.address
    }
}

impl Drop for View {
    fn drop(&mut self) {
        drop(self.end.take());
        if let Some(server) = self.server.take() {
            drop(server.join());
        }
        // Waits until the tension of a rig is released.
        drop(self.desk.take());
    }
}

/// Serves until `ended` resolves.
fn serve(
    runtime: &Runtime,
    listener: StdListener,
    (at, guard): (SocketAddr, Guard),
    exhibit: Exhibit,
    (desk, given): (Option<DeskLink>, watch::Receiver<Option<Arc<Given>>>),
    ended: oneshot::Receiver<()>,
) {
    let (changed, file) = watch::channel(None);
    let watched = match &exhibit.source {
        Source::Memory => None,
        Source::File(path) => Some(Watched::new(path)),
    };
    let shared = Arc::new(Shared {
        exhibit,
        guard,
        nonce: token(),
        port: at.port(),
        file,
        desk,
        given,
        pages: AtomicU64::new(0),
    });
    runtime.block_on(async {
        let Ok(listener) = TcpListener::from_std(listener) else {
            return;
        };
        let router = Router::new().fallback(answer).with_state(shared);
        tokio::select! {
            served = axum::serve(listener, router) => drop(served),
            () = watch_file(watched, &changed) => {}
            _ = ended => {}
        }
    });
}

/// Tells the sessions what is in a file whenever it changes.
async fn watch_file(watched: Option<Watched>, changed: &watch::Sender<FileState>) {
    let Some(mut watched) = watched else {
        return pending().await;
    };
    loop {
        tokio::time::sleep(LOOK).await;
        if let Some(robot) = watched.changed() {
            let robot = robot.map_err(|error| error.to_string());
            changed.send_replace(Some(Arc::new(robot)));
        }
    }
}

/// Answers a request.
async fn answer(State(shared): State<Arc<Shared>>, request: Request) -> Response {
    let headers = request.headers();
    let path = request.uri().path().to_owned();
    let asked = super::guard::Request {
        path: &path,
        host: text(headers, &header::HOST),
        origin: text(headers, &header::ORIGIN),
    };
    match shared.guard.admit(asked) {
        Err(refusal) => (StatusCode::FORBIDDEN, refusal.reason()).into_response(),
        Ok("socket") => socket(shared, request).await,
        Ok(path) if request.method() == Method::GET => file(&shared, path),
        Ok(_) => StatusCode::METHOD_NOT_ALLOWED.into_response(),
    }
}

fn text<'h>(headers: &'h HeaderMap, name: &HeaderName) -> Option<&'h str> {
    // Bytes that are no text are as foreign as any other name.
    headers.get(name).map(|value| value.to_str().unwrap_or(""))
}

/// A file of the page.
fn file(shared: &Shared, path: &str) -> Response {
    let mut response = match path {
        "" => {
            let page = PAGE.replace("{{nonce}}", &shared.nonce);
            let html = (header::CONTENT_TYPE, "text/html; charset=utf-8");
            ([html], page).into_response()
        }
        _ => match assets::find(path) {
            Some(asset) => ([(header::CONTENT_TYPE, asset.mime)], asset.bytes).into_response(),
            None => StatusCode::NOT_FOUND.into_response(),
        },
    };
    // The page runs what is served here, talks to this server, and is shown within pages of this machine (notebooks) alone.
    let policy = format!(
        "default-src 'none'; script-src 'self' 'nonce-{}'; style-src 'self'; img-src 'self' blob: data:; connect-src 'self' \
         ws://127.0.0.1:{port} ws://localhost:{port}; base-uri 'none'; form-action 'none'; frame-ancestors http://127.0.0.1:* http://localhost:*",
        shared.nonce,
        port = shared.port,
    );
    let headers = response.headers_mut();
    if let Ok(policy) = HeaderValue::from_str(&policy) {
        headers.insert(header::CONTENT_SECURITY_POLICY, policy);
    }
    for (name, value) in [
        (header::X_CONTENT_TYPE_OPTIONS, "nosniff"),
        (header::REFERRER_POLICY, "no-referrer"),
        (header::CACHE_CONTROL, "no-store"),
    ] {
        headers.insert(name, HeaderValue::from_static(value));
    }
    response
}

/// A page's socket.
async fn socket(shared: Arc<Shared>, request: Request) -> Response {
    let (mut parts, _) = request.into_parts();
    match WebSocketUpgrade::from_request_parts(&mut parts, &()).await {
        Ok(upgrade) => upgrade
            .max_message_size(LONGEST)
            .on_upgrade(|socket| talk(socket, shared)),
        Err(rejection) => rejection.into_response(),
    }
}

/// Carries letters to a session of the page's own, and its answers back, until either is gone.
async fn talk(mut socket: WebSocket, shared: Arc<Shared>) {
    let (letters, inbox) = channel();
    let (outbox, mut answers) = mpsc::channel(WAITING);
    let mut file = shared.file.clone();
    let mut exhibit = shared.exhibit.clone();
    if let Some(Ok(robot)) = file.borrow_and_update().as_deref() {
        let changed = Exhibit {
            robot: robot.clone(),
            start: None,
            ..exhibit.clone()
        };
        if session::check(&changed).is_ok() {
            exhibit = changed;
        }
    }
    let page = PageId(shared.pages.fetch_add(1, Ordering::Relaxed));
    let mut desk = shared.desk.clone().map(|link| PageAtDesk { link, page });
    let limits = desk.as_ref().map(|desk| desk.link.limits.clone());
    thread::spawn(move || session::run(&exhibit, limits, &inbox, &outbox));
    let mut given = shared.given.clone();
    if let Some(shown) = given.borrow_and_update().clone()
        && letters.send(Input::Given(shown)).is_err()
    {
        return;
    }
    loop {
        let goes_on = tokio::select! {
            message = socket.recv() => match message {
                Some(Ok(Message::Text(text))) => {
                    let input = read(text.as_str());
                    let ordered = desk.as_ref().is_some_and(|desk| desk.order(&input));
                    ordered || letters.send(input).is_ok()
                }
                Some(Ok(Message::Binary(_) | Message::Ping(_) | Message::Pong(_))) => true,
                Some(Ok(Message::Close(_)) | Err(_)) | None => false,
            },
            answer = answers.recv() => match answer.and_then(message) {
                Some(message) => socket.send(message).await.is_ok(),
                None => false,
            },
            Some(seen) = news(&mut desk) => letters.send(Input::Rig(page, seen)).is_ok(),
            Ok(()) = given.changed() => {
                let shown = given.borrow_and_update().clone();
                shown.is_none_or(|shown| letters.send(Input::Given(shown)).is_ok())
            }
            Ok(()) = file.changed() => {
                let state = file.borrow_and_update().clone();
                state.is_none_or(|robot| letters.send(Input::File(robot)).is_ok())
            }
        };
        if !goes_on {
            return;
        }
    }
}

/// A page before a rig, which lets go of it however the page goes.
struct PageAtDesk {
    link: DeskLink,
    page: PageId,
}

impl PageAtDesk {
    /// Passes on what a page wants of the rig; whether that is what it said.
    fn order(&self, input: &Input) -> bool {
        let order = match input {
            Input::Letter(letter) => letter.request.order(self.page),
            _ => None,
        };
        // A rig that is gone is not moved.
        order.is_some_and(|order| self.link.orders.send(order).is_ok())
    }
}

impl Drop for PageAtDesk {
    fn drop(&mut self) {
        let _ = self.link.orders.send(Order::Gone(self.page));
    }
}

/// What is seen of the rig, once it is something new; never without a rig.
async fn news(desk: &mut Option<PageAtDesk>) -> Option<Arc<Seen>> {
    let Some(desk) = desk else {
        return pending().await;
    };
    match desk.link.seen.changed().await {
        Ok(()) => Some(desk.link.seen.borrow_and_update().clone()),
        // The rig is gone, and so will be the server.
        Err(_) => pending().await,
    }
}

fn read(text: &str) -> Input {
    match serde_json::from_str::<Letter>(text) {
        Ok(letter) => Input::Letter(letter),
        Err(error) => Input::Unread(error.to_string()),
    }
}

fn message(output: Output) -> Option<Message> {
    match output {
        Output::Numbers(bytes) => Some(Message::Binary(bytes.into())),
        Output::Words(reply) => Some(Message::Text(serde_json::to_string(&reply).ok()?.into())),
    }
}
