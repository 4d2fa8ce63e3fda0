//! Derivatives of equilibria against differences of settled poses.

mod case;
mod parameters;
mod random;
mod special;
mod tendons;
