//! The figures of a study, and the page that shows them.

mod axes;
mod dexterity;
mod distribution;
mod drawing;
mod hysteresis;
mod outputs;
pub(in crate::study) mod page;
mod training;
