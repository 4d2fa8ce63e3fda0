//! Numbers of joints and links that no robot has.

use urdf_rs::{Geometry, Joint, Link};

use crate::formats::{is_inertia, negative};

/// What is wrong with the numbers of a joint, and what would be right.
pub(super) fn of_joint(joint: &Joint) -> Result<(), String> {
    finite("origin xyz", &joint.origin.xyz.0)?;
    finite("origin rpy", &joint.origin.rpy.0)?;
    finite("axis xyz", &joint.axis.xyz.0)?;
    let Some(dynamics) = &joint.dynamics else {
        return Ok(());
    };
    finite("damping", &[dynamics.damping])?;
    finite("friction", &[dynamics.friction])?;
    match negative(&[dynamics.damping]) {
        Some(damping) => Err(format!("the damping is {damping}; expected 0 or above")),
        None => Ok(()),
    }
}

/// What is wrong with the numbers of a link, and what would be right.
pub(super) fn of_link(link: &Link) -> Result<(), String> {
    let inertia = &link.inertial.inertia;
    let moments = [inertia.ixx, inertia.iyy, inertia.izz];
    finite("inertial xyz", &link.inertial.origin.xyz.0)?;
    finite("inertial rpy", &link.inertial.origin.rpy.0)?;
    finite("mass", &[link.inertial.mass.value])?;
    finite("inertia", &moments)?;
    finite("inertia", &[inertia.ixy, inertia.ixz, inertia.iyz])?;
    if let Some(mass) = negative(&[link.inertial.mass.value]) {
        return Err(format!("the mass is {mass}; expected 0 or above"));
    }
    is_inertia(moments)?;
    let visuals = (link.visual.iter()).map(|visual| (&visual.geometry, &visual.origin));
    let collisions = (link.collision.iter()).map(|c| (&c.geometry, &c.origin));
    for (geometry, origin) in visuals.chain(collisions) {
        finite("geometry's xyz", &origin.xyz.0)?;
        finite("geometry's rpy", &origin.rpy.0)?;
        if let Geometry::Cylinder { radius, length } = geometry {
            for (what, size) in [("radius", *radius), ("length", *length)] {
                if !(size.is_finite() && size > 0.0) {
                    let expected = "expected a finite number above 0";
                    return Err(format!("the cylinder's {what} is {size}; {expected}"));
                }
            }
        }
    }
    Ok(())
}

fn finite(what: &str, numbers: &[f64]) -> Result<(), String> {
    match numbers.iter().find(|number| !number.is_finite()) {
        Some(number) => Err(format!("the {what} is {number}; expected finite numbers")),
        None => Ok(()),
    }
}
