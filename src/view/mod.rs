//! A robot in the browser that follows the hand: a page served on this machine alone, and the solver behind it.
//!
//! [`View::open`] serves an [`Exhibit`] at an address with a random token, and nothing to those who do not know it: see `guard`.
//! Each page that opens the address gets a session of its own (`session`), a thread with a robot that it commands. What a page
//! asks for comes as JSON, what a robot does goes back as frames of numbers (`message`, `frame`); what is drawn is said once for each robot
//! (`drawing`).
//!
//! The server is axum on one thread of tokio: HTTP/1 and WebSockets by the libraries that most servers in Rust stand on. Settling happens in the sessions' threads. The page is JavaScript without a build step,
//! with three.js beside it; all of it is in the binary, and nothing is fetched from anywhere.

mod assets;
mod drag;
mod drawing;
mod exhibit;
mod frame;
mod guard;
mod message;
mod server;
mod session;

pub use exhibit::{Exhibit, Source};
pub use server::{View, ViewError};
pub use session::RequestError;
