//! A rig behind the pages: one thread looks at it all the time, and moves it for the one page that has armed it.
//!
//! As long as no page has, motors are off and the rig is only looked at. A page that arms it holds it until it says otherwise, is
//! closed, or is not heard for [`SILENCE`]; another page is refused meanwhile. However it ends, the tension is released as the rig's
//! file says: [`Session::end`], which `tdcr jog` ends with, too.

mod orders;
mod sight;

use std::cell::RefCell;
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::mpsc::{Sender, channel};
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};

use tdcr_hw::capture::{CaptureError, Program, Session, SessionSettings};
use tdcr_hw::plan::Shape;
use tdcr_hw::rig::{LOG_LEAVES, Pace, Rig, RigError, RigFile, WinchState};
use tokio::sync::watch;

pub(super) use orders::{Order, PageId};
pub(super) use sight::{RigLimits, Seen};

use super::recording::Servo;
use orders::Orders;
use sight::Sight;

/// How long a page that holds the rig may be silent: it says that it is there twice a second.
pub(super) const SILENCE: Duration = Duration::from_secs(3);
/// Time between two looks at a rig that nobody holds.
const LOOK: Duration = Duration::from_millis(100);

/// A rig that pages look at.
#[derive(Debug)]
pub(super) struct Desk {
    link: DeskLink,
    thread: Option<JoinHandle<()>>,
}

/// A page's way to the rig.
#[derive(Clone, Debug)]
pub(super) struct DeskLink {
    pub orders: Sender<Order>,
    pub seen: watch::Receiver<Arc<Seen>>,
    pub limits: Arc<RigLimits>,
}

impl Desk {
    /// Opens the rig of a file and begins to look at it; with a log in the folder `out`, whose path is returned, too. No motor is
    /// switched on.
    ///
    /// # Errors
    /// As [`Rig::open_file`], [`Program::new`] and [`Rig::log_in`].
    pub fn open(
        file: RigFile,
        out: Option<&Path>,
    ) -> Result<(Self, Option<PathBuf>), CaptureError> {
        let program = Program::new(&file, 0)?;
        let limits = Arc::new(RigLimits::of(&file, program.rest()));
        let mut rig = Rig::open_file(file, Pace::RealTime)?;
        let settings = SessionSettings::default();
        let log = out.map(|out| rig.log_in(out, "log", LOG_LEAVES));
        let log = log.transpose()?;
        let sight = Sight::new(&mut rig, settings.voxel_size)?;
        let seen = sight.watch();
        let (orders, inbox) = channel();
        let worker = Worker {
            rest: program.rest().clone(),
            orders: RefCell::new(Orders::new(inbox)),
            sight,
            settings,
        };
        let thread = thread::spawn(move || {
            worker.run(&mut rig);
            if let Err(error) = rig.finish_log() {
                tracing::warn!("the log is not whole: {error}");
            }
        });
        let desk = Self {
            link: DeskLink {
                orders,
                seen,
                limits,
            },
            thread: Some(thread),
        };
        Ok((desk, log))
    }

    pub fn link(&self) -> DeskLink {
        self.link.clone()
    }
}

impl Drop for Desk {
    /// Waits until the tension is released.
    fn drop(&mut self) {
        // A thread that has ended hears nothing, and needs not.
        let _ = self.link.orders.send(Order::End);
        if let Some(thread) = self.thread.take() {
            drop(thread.join());
        }
    }
}

struct Worker {
    rest: Shape,
    orders: RefCell<Orders>,
    sight: Sight,
    settings: SessionSettings,
}

impl Worker {
    fn run(mut self, rig: &mut Rig) {
        loop {
            let armed = {
                let mut orders = self.orders.borrow_mut();
                orders.wait(LOOK);
                if orders.ended() {
                    return;
                }
                orders.holder()
            };
            self.sight.hear(self.orders.get_mut());
            match armed {
                None => self.sight.look_at_rest(rig),
                Some(page) => {
                    let held = self.hold(rig, page);
                    self.orders.get_mut().let_go();
                    self.sight.seen.armed = None;
                    self.sight.seen.moving = false;
                    let text = match held {
                        // The page asked for it, or is gone.
                        Ok(()) | Err(CaptureError::Rig(RigError::Interrupted)) => {
                            "the tension is released, the motors are off".to_owned()
                        }
                        Err(error) => error.to_string(),
                    };
                    self.sight.say(None, text);
                    self.sight.publish();
                }
            }
        }
    }

    /// Moves the rig for a page as long as that holds it; the motors are off at the end.
    fn hold(&mut self, rig: &mut Rig, page: PageId) -> Result<(), CaptureError> {
        let (orders, sight) = (&self.orders, &mut self.sight);
        sight.seen.armed = Some(page);
        sight.seen.moving = true;
        sight.publish();
        let mut go_on = || match orders.borrow_mut().is_held_by(page) {
            true => ControlFlow::Continue(()),
            false => ControlFlow::Break(()),
        };
        let mut session = Session::begin(rig, &self.settings, None, &mut go_on)?;
        session.check_tendons()?;
        sight.say(Some(page), "armed: the robot follows this page".to_owned());
        loop {
            if !orders.borrow_mut().is_held_by(page) {
                return Ok(session.end()?);
            }
            sight.hear(&mut orders.borrow_mut());
            let asked = orders.borrow_mut().shape();
            let moved = match asked {
                Some(shape) if shape.0.len() == self.rest.0.len() => {
                    sight.seen.moving = true;
                    let moved = session.visit_watched(shape, &mut |states| sight.see(states));
                    sight.seen.moving = false;
                    moved
                }
                Some(shape) => {
                    let (found, expected) = (shape.0.len(), self.rest.0.len());
                    let text = format!("{found} modules are asked for; the robot has {expected}");
                    sight.say(Some(page), text);
                    Ok(())
                }
                None => {
                    sight.seen.moving = false;
                    sight.look(session.rig())
                }
            };
            match moved {
                // Beyond what the tendons or the servos may do: nothing has moved.
                Err(CaptureError::Plan(error)) => sight.say(Some(page), error.to_string()),
                other => other?,
            }
        }
    }
}

/// What servos do, as pages are told it.
fn servos(states: &[WinchState], ids: &[u8], temperatures: &[Option<f64>]) -> Vec<Servo> {
    let servos = states.iter().zip(ids).enumerate();
    servos
        .map(|(place, (state, &id))| Servo {
            id,
            position: state.position.0,
            current: state.pull,
            temperature: temperatures.get(place).copied().flatten(),
        })
        .collect()
}

/// When something is due next.
struct Due(Instant);

impl Due {
    fn now() -> Self {
        Self(Instant::now())
    }

    /// Whether it is due; if so, it is again after `period`.
    fn comes(&mut self, period: Duration) -> bool {
        let now = Instant::now();
        let is_due = now >= self.0;
        if is_due {
            self.0 = now + period;
        }
        is_due
    }
}
