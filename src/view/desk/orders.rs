//! What pages want of the rig, and which of them holds it.

use std::sync::mpsc::{Receiver, RecvTimeoutError};
use std::time::{Duration, Instant};

use tdcr_hw::plan::Shape;

use super::SILENCE;

/// A page, by the number of its socket.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
#[serde(transparent)]
pub(in crate::view) struct PageId(pub u64);

/// What is wanted of the rig.
#[derive(Debug)]
pub(in crate::view) enum Order {
    /// A page wants to hold it.
    Arm(PageId),
    /// It does no longer.
    Disarm(PageId),
    /// It is gone.
    Gone(PageId),
    /// It is there.
    Here(PageId),
    /// It wants the robot in a shape.
    Shape(PageId, Shape),
    /// The server ends.
    End,
}

/// What was wanted so far.
pub(super) struct Orders {
    inbox: Receiver<Order>,
    /// Who holds the rig, and when that was last heard.
    holder: Option<(PageId, Instant)>,
    /// The newest shape that the holder wants.
    shape: Option<Shape>,
    ended: bool,
    /// What was refused, and to whom.
    pub refused: Vec<(PageId, String)>,
}

impl Orders {
    pub fn new(inbox: Receiver<Order>) -> Self {
        Self {
            inbox,
            holder: None,
            shape: None,
            ended: false,
            refused: Vec::new(),
        }
    }

    /// Takes what comes within a time, and all that has come by then.
    pub fn wait(&mut self, time: Duration) {
        match self.inbox.recv_timeout(time) {
            Ok(order) => self.take(order),
            Err(RecvTimeoutError::Timeout) => {}
            Err(RecvTimeoutError::Disconnected) => self.ended = true,
        }
        self.take_all();
    }

    fn take_all(&mut self) {
        while let Ok(order) = self.inbox.try_recv() {
            self.take(order);
        }
    }

    fn take(&mut self, order: Order) {
        let now = Instant::now();
        match order {
            Order::Arm(page) => match self.holder {
                Some((holder, _)) if holder != page => {
                    let reason =
                        "another page has armed the rig; it holds it until it is closed or lets go";
                    self.refused.push((page, reason.to_owned()));
                }
                _ => self.holder = Some((page, now)),
            },
            Order::Disarm(page) | Order::Gone(page) if self.is_holder(page) => self.let_go(),
            Order::Here(page) if self.is_holder(page) => self.holder = Some((page, now)),
            Order::Shape(page, shape) if self.is_holder(page) => {
                self.holder = Some((page, now));
                self.shape = Some(shape);
            }
            Order::Shape(page, _) => {
                let reason = "this page has not armed the rig; nothing has moved";
                self.refused.push((page, reason.to_owned()));
            }
            Order::Disarm(_) | Order::Gone(_) | Order::Here(_) => {}
            Order::End => {
                self.ended = true;
                self.let_go();
            }
        }
    }

    fn is_holder(&self, page: PageId) -> bool {
        self.holder.is_some_and(|(holder, _)| holder == page)
    }

    /// Who holds the rig.
    pub fn holder(&self) -> Option<PageId> {
        self.holder.map(|(page, _)| page)
    }

    /// Whether a page holds the rig still, all that has come considered.
    pub fn is_held_by(&mut self, page: PageId) -> bool {
        self.take_all();
        let heard = self.holder.filter(|(holder, _)| *holder == page);
        let is_heard = heard.is_some_and(|(_, heard)| heard.elapsed() < SILENCE);
        if heard.is_some() && !is_heard {
            let text = format!(
                "not heard for {} s: the tension is released",
                SILENCE.as_secs()
            );
            self.refused.push((page, text));
            self.let_go();
        }
        is_heard && !self.ended
    }

    /// Nobody holds the rig any more.
    pub fn let_go(&mut self) {
        self.holder = None;
        self.shape = None;
    }

    /// The newest shape that is wanted, once.
    pub fn shape(&mut self) -> Option<Shape> {
        self.shape.take()
    }

    pub fn ended(&self) -> bool {
        self.ended
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

    use std::sync::mpsc::channel;

    use tdcr_hw::plan::Bend;

    use super::*;

    #[test]
    fn one_page_holds_the_rig_until_it_is_gone_and_others_move_nothing() {
        let (sender, inbox) = channel();
        let mut orders = Orders::new(inbox);
        let (one, other) = (PageId(1), PageId(2));
        let shape = |tension| Shape(vec![Bend::new(0.0, 0.1, tension)]);
        for order in [
            Order::Shape(one, shape(1.0)),
            Order::Arm(one),
            Order::Arm(other),
            Order::Shape(other, shape(2.0)),
            Order::Shape(one, shape(3.0)),
            Order::Shape(one, shape(4.0)),
            Order::Disarm(other),
            Order::Gone(other),
        ] {
            sender.send(order).unwrap();
        }
        assert!(orders.is_held_by(one) && !orders.is_held_by(other));
        assert_eq!(orders.shape(), Some(shape(4.0)));
        assert_eq!(orders.shape(), None);
        let refused: Vec<PageId> = orders.refused.iter().map(|(page, _)| *page).collect();
        assert_eq!(refused, [one, other, other]);

        sender.send(Order::Shape(one, shape(5.0))).unwrap();
        sender.send(Order::Gone(one)).unwrap();
        assert!(!orders.is_held_by(one));
        assert_eq!(
            orders.shape(),
            None,
            "what a page that is gone wanted is not done"
        );

        sender.send(Order::Arm(other)).unwrap();
        assert!(orders.is_held_by(other));
        sender.send(Order::End).unwrap();
        assert!(!orders.is_held_by(other) && orders.ended());
    }

    #[test]
    fn a_page_that_is_silent_does_not_hold_the_rig_and_one_that_is_heard_does() {
        let (sender, inbox) = channel();
        let mut orders = Orders::new(inbox);
        let page = PageId(7);
        let long_ago = Instant::now() - SILENCE;
        orders.holder = Some((page, long_ago));
        sender.send(Order::Here(page)).unwrap();
        assert!(orders.is_held_by(page));
        orders.holder = Some((page, long_ago));
        assert!(!orders.is_held_by(page));
        assert_eq!(orders.holder(), None);
        sender.send(Order::Here(page)).unwrap();
        assert!(!orders.is_held_by(page), "it has to arm the rig anew");
    }
}
