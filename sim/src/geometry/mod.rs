//! Shapes and solids: what cameras see, and what a body can touch.
//!
//! A [`Shape`] is centred on its frame's origin: a cylinder, box, sphere or capsule by its dimensions, or a triangle
//! mesh ([`Shape::read_stl`]). A [`Solid`] is a shape with a pose in the world (m), a colour, and the [`Instance`] that
//! it is a part of. A [`Pipe`] is the inside of a straight or bent tube. An [`AlphaShape`] is what points enclose,
//! [`Triangles`] a surface for drawings.
//!
//! ```
//! use tdcr_sim::geometry::Shape;
//!
//! let shelf = Shape::cuboid([0.1, 0.1, 0.005])?;
//! # Ok::<(), tdcr_sim::geometry::ShapeError>(())
//! ```

mod alpha_shape;
mod beads;
mod delaunay;
mod distance;
mod pipe;
mod primitives;
mod robot;
mod shape;
mod solid;
mod stand;
mod stl;
mod triangles;

pub use alpha_shape::AlphaShape;
pub use beads::{Bead, Beads};
pub(crate) use distance::Nearest;
pub use pipe::Pipe;
pub(crate) use primitives::{Capsule, Cuboid, Cylinder, Mesh, Sphere};
pub use robot::disc_color;
pub(crate) use robot::{
    BASE_COLOR, base_pose, base_solids, between, disc_solids, rod_pieces, rod_solids,
};
pub(crate) use shape::Kind;
pub use shape::{Dimensions, Shape, ShapeError};
pub use solid::{Instance, Solid};
pub use stand::{Overlaps, Stand};
pub use stl::StlError;
pub use triangles::Triangles;
