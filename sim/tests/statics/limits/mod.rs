//! The statics against what they must tend to: closed forms and continuous rods, and the figures of
//! another group's published code.
//!
//! A rod of length `L` is a chain of `n` discs with pitch `h = L/n` and a joint in the middle of each
//! pitch, of stiffness `E I / h`: the midpoint rule, so errors fall as `1/n²`.

mod branches;
mod buckling;
mod cantilever;
mod contact;
mod continuous;
mod convergence;
mod elastica;
mod motion;
mod published;
mod rod;
mod spatial;
mod tendon;
