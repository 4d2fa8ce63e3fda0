//! Progress and interruption of long work.

/// Watches over long work: hears how far it is, and may ask it to stop.
pub trait Monitor: Sync {
    /// A stage of `steps` steps begins, `done` of them done before.
    fn begin(&self, stage: &str, steps: u64, done: u64);

    /// `steps` more steps are done.
    fn advance(&self, steps: u64);

    /// Something worth showing beside the progress, e.g. the latest score; between two stages, on its own.
    fn note(&self, text: &str);

    /// The present state, shown until the next status or [`Self::note`]; too frequent for a log.
    fn status(&self, text: &str);

    /// The stage is over.
    fn end(&self);

    /// Whether the work should stop at the next point where nothing is lost.
    fn interrupted(&self) -> bool;

    /// Has a person hang a payload (kg) at the tip of a robot that is released, 0 for none, and waits until that is done; `false`
    /// where nobody does.
    fn hang(&self, _payload: f64) -> bool {
        false
    }
}

/// Shows nothing and never interrupts.
#[derive(Clone, Copy, Debug, Default)]
pub struct Silent;

impl Monitor for Silent {
    fn begin(&self, _stage: &str, _steps: u64, _done: u64) {}
    fn advance(&self, _steps: u64) {}
    fn note(&self, _text: &str) {}
    fn status(&self, _text: &str) {}
    fn end(&self) {}
    fn interrupted(&self) -> bool {
        false
    }
}
