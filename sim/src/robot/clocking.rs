//! How modules turn the holes of bodies.

use super::{Body, Holes, ModuleSpec, RobotSpec, Routing};

/// A body's holes where modules are clocked: the body's pattern, turned by its own module's
/// clocking, and once more for each other clocking among the modules above whose tendons pass. Hole
/// `k` of copy `c` of a pattern of `n` holes is number `c n + k`.
impl RobotSpec {
    /// Number of holes of a body, all copies of its pattern together; `None` for a disc that the
    /// robot does not have.
    pub fn hole_count(&self, body: Body) -> Option<usize> {
        Some(self.holes(body)?.count() * self.clockings(body).len())
    }

    /// The x and y of a hole in its body's frame (m), by its number; `None` for one that there is
    /// not.
    pub fn hole_position(&self, body: Body, hole: usize) -> Option<[f64; 2]> {
        let pattern = self.holes(body)?;
        let copy = hole.checked_div(pattern.count())?;
        // Of the first copy, without a list of all.
        let angle = match copy {
            0 => self.own_clocking(self.module_at(body)),
            _ => *self.clockings(body).get(copy)?,
        };
        Some(turned(pattern.position(hole % pattern.count())?, angle))
    }

    /// The x and y of all holes of a body in its frame (m), in the order of their numbers; empty for
    /// a disc that the robot does not have.
    pub fn hole_positions(&self, body: Body) -> Vec<[f64; 2]> {
        let pattern = self.holes(body).map(Holes::positions).unwrap_or_default();
        let copy = |angle: f64| pattern.iter().map(move |hole| turned(*hole, angle));
        self.clockings(body).into_iter().flat_map(copy).collect()
    }

    /// Number of hole `hole` of the pattern of `body`, in the copy turned as module `module` is.
    pub(super) fn clocked_hole(&self, body: Body, module: usize, hole: usize) -> Option<usize> {
        let clocking = self.modules.get(module)?.clocking;
        let copy = (self.clockings(body).iter()).position(|angle| *angle == clocking)?;
        Some(copy * self.holes(body)?.count() + hole)
    }

    /// The angles (rad) by which the copies of a body's pattern are turned.
    fn clockings(&self, body: Body) -> Vec<f64> {
        let own = self.module_at(body);
        let above = own.map_or(0, |module| module + 1);
        let passing = match self.routing {
            Routing::Base => self.modules.get(above..),
            Routing::ModuleBelow => self.modules.get(above..(above + 1).min(self.modules.len())),
        };
        let mut angles = vec![self.own_clocking(own)];
        for ModuleSpec { clocking, .. } in passing.unwrap_or_default() {
            if !angles.contains(clocking) {
                angles.push(*clocking);
            }
        }
        angles
    }

    fn own_clocking(&self, module: Option<usize>) -> f64 {
        module.map_or(0.0, |module| self.modules[module].clocking)
    }

    /// The module of a disc; `None` for the base.
    pub(super) fn module_at(&self, body: Body) -> Option<usize> {
        match body {
            Body::Base => None,
            Body::Disc(disc) => self.module_of(disc),
        }
    }
}

/// A place turned about the z axis.
fn turned([x, y]: [f64; 2], angle: f64) -> [f64; 2] {
    if angle == 0.0 {
        // To the bit as the file has it.
        return [x, y];
    }
    let (sin, cos) = angle.sin_cos();
    [cos * x - sin * y, sin * x + cos * y]
}
