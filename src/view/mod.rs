//! A robot in the browser that follows the hand: a page served on this machine alone, and the solver behind it.
//!
//! [`View::open`] serves an [`Exhibit`] at an address with a random token, and nothing to those who do not know it: see `guard`.
//! Each page that opens the address gets a session of its own (`session`), a thread with a robot that it commands. What a page
//! asks for comes as JSON, what a robot does goes back as frames of numbers (`message`, `frame`); what is drawn is said once for each robot
//! (`drawing`). The robot follows its tendons at rest, with friction, or in motion (`body`).
//! Over it there may be clouds of a data set, a network's predictions, a recording and the rows of a study (`overlays`, `over`); a
//! network predicts in a thread of its own (`twin`). Of a rig, all pages see the same one, which one of them may hold (`desk`).
//!
//! The server is axum on one thread of tokio: HTTP/1 and WebSockets by the libraries that most servers in Rust stand on. Settling happens in the sessions' threads. The page is JavaScript without a build step,
//! with three.js beside it; all of it is in the binary, and nothing is fetched from anywhere.

mod assets;
mod body;
mod cloud;
mod desk;
mod drag;
mod drawing;
mod error;
mod exhibit;
mod frame;
mod given;
mod guard;
mod message;
mod over;
mod overlaid;
mod overlays;
mod pictures;
mod post;
mod recording;
mod server;
mod session;
mod showing;
mod twin;

pub use error::RequestError;
pub use exhibit::{Exhibit, Source};
pub use overlays::{Clouds, OverlayError, OverlayFiles, Overlays};
pub use post::{Given, Marks, Subject};
pub use recording::{Recording, RecordingError};
pub use server::{View, ViewError};
pub use twin::TwinError;
