//! What MuJoCo can represent of a robot.

use crate::formats::ExportError;
use crate::lens::Distortion;
use crate::robot::{
    Cameras, Drive, Lens, Loads, MassSpec, ModuleSpec, Payload, PerDisc, PinholeSpec, RigidMass,
    Robot, RobotSpec, SolidMass, TendonSpec,
};

use super::write::is_xml_char;

/// MuJoCo's smallest mass and moment of inertia of a body that moves (`mjMINVAL`).
pub(super) const SMALLEST_MASS: f64 = 1e-15;

/// Longest chain that MuJoCo 4.0 reads, with a payload: its XML parser goes 500 elements deep (that
/// of MuJoCo 2.2.2 goes 100).
const MAX_DISCS: usize = 495;

/// Deviations of focal lengths (relative) and principal points (pixels) that no picture shows.
const SQUARE: f64 = 1e-9;
const CENTRED: f64 = 1e-6;

/// Refuses what MuJoCo cannot represent with the same meaning.
pub(super) fn representable(robot: &Robot, payload: &Payload) -> Result<(), ExportError> {
    let spec = robot.spec();
    Loads::default().with_payload(*payload)?;
    if !spec.name.chars().all(is_xml_char) {
        let found = format!("{:?}", spec.name);
        return Err(refuse("name", found, "text without control characters"));
    }
    if spec.disc_count() > MAX_DISCS {
        let found = format!("{} discs in all", spec.disc_count());
        return Err(refuse("modules", found, "495 discs at most"));
    }
    if spec.fluid.is_some() {
        return Err(refuse(
            "fluid",
            "a fluid",
            "none: its drag is by another law",
        ));
    }
    check_masses(robot)?;
    for (index, module) in spec.modules.iter().enumerate() {
        check_joints(index, module)?;
        if let Some(tendons) = &module.tendons {
            check_tendon(&format!("modules[{index}].tendons"), tendons)?;
        }
    }
    check_cameras(&spec.cameras)?;
    for (index, route) in spec.routes.iter().enumerate() {
        check_tendon(&format!("routes[{index}].tendon"), &route.tendon)?;
    }
    Ok(())
}

/// MuJoCo draws all cameras of a model in one buffer, each by its field of view alone.
fn check_cameras(cameras: &Cameras) -> Result<(), ExportError> {
    let cameras = match cameras {
        Cameras::Free(cameras) => cameras,
        Cameras::Ring(ring) => return check_distortion("cameras", ring.distortion.as_ref()),
    };
    for (index, camera) in cameras.iter().enumerate() {
        let at = |field: &str| format!("cameras[{index}]{field}");
        check_distortion(&at(""), camera.distortion.as_ref())?;
        let [width, height] = camera.resolution;
        if camera.resolution != cameras[0].resolution {
            let expected = "the same resolution for all cameras";
            return Err(refuse(
                &at(".resolution"),
                format!("[{width}, {height}]"),
                expected,
            ));
        }
        if let Lens::Pixels(PinholeSpec { focal, principal }) = camera.lens {
            if (focal[0] / focal[1] - 1.0).abs() > SQUARE {
                let expected = "equal focal lengths";
                return Err(refuse(
                    &at(".lens.pixels.focal"),
                    format!("{focal:?}"),
                    expected,
                ));
            }
            let center = [width, height].map(|side| (f64::from(side) - 1.0) / 2.0);
            if (0..2).any(|k| (principal[k] - center[k]).abs() > CENTRED) {
                let (field, found) = (at(".lens.pixels.principal"), format!("{principal:?}"));
                return Err(refuse(
                    &field,
                    found,
                    "a principal point at the image's centre",
                ));
            }
        }
    }
    Ok(())
}

fn check_distortion(camera: &str, distortion: Option<&Distortion>) -> Result<(), ExportError> {
    match distortion {
        Some(distortion) if *distortion != Distortion::default() => {
            let (field, found) = (format!("{camera}.distortion"), distortion.coefficients());
            Err(refuse(
                &field,
                format!("{found:?}"),
                "lenses without distortion",
            ))
        }
        _ => Ok(()),
    }
}

fn check_masses(robot: &Robot) -> Result<(), ExportError> {
    for (index, disc) in robot.discs().iter().enumerate() {
        let field = || mass_field(robot.spec(), index);
        if disc.mass < SMALLEST_MASS {
            let found = format!("{:e} kg", disc.mass);
            return Err(refuse(&field(), found, "masses of discs above 1e-15 kg"));
        }
        let [a, b, c]: [f64; 3] = disc.inertia.into();
        let found = format!("{a:e}, {b:e}, {c:e} kg m2");
        if a.min(b).min(c) < SMALLEST_MASS {
            let expected = "moments of inertia above 1e-15 kg m2";
            return Err(refuse(&field(), found, expected));
        }
        if a + b < c || b + c < a || c + a < b {
            let expected = "moments of inertia of which none exceeds the sum of the others";
            return Err(refuse(&field(), found, expected));
        }
    }
    Ok(())
}

fn mass_field(spec: &RobotSpec, disc: usize) -> String {
    let module = spec.module_of(disc).unwrap_or_default();
    let first: usize = spec.modules[..module].iter().map(|m| m.discs).sum();
    let (kind, each) = match &spec.modules[module].mass {
        MassSpec::Density(density) => ("density", matches!(density, PerDisc::<f64>::Each(_))),
        MassSpec::Solid(solid) => ("solid", matches!(solid, PerDisc::<SolidMass>::Each(_))),
        MassSpec::Rigid(rigid) => ("rigid", matches!(rigid, PerDisc::<RigidMass>::Each(_))),
    };
    let index = each.then(|| format!("[{}]", disc - first));
    format!("modules[{module}].mass.{kind}{}", index.unwrap_or_default())
}

fn check_joints(index: usize, module: &ModuleSpec) -> Result<(), ExportError> {
    if module.limit.is_some() {
        let expected = "free joints: its own limits are not springs";
        return Err(refuse(
            &format!("modules[{index}].limit"),
            "a spring",
            expected,
        ));
    }
    Ok(())
}

fn check_tendon(field: &str, tendon: &TendonSpec) -> Result<(), ExportError> {
    if tendon.friction.is_some_and(|f| f.coefficient > 0.0) {
        let expected = "tendons without friction in their holes";
        return Err(refuse(
            &format!("{field}.friction"),
            "a coefficient above 0",
            expected,
        ));
    }
    if tendon.stiffening > 0.0 {
        let expected = "0: its actuators pull in proportion to the stretch";
        return Err(refuse(
            &format!("{field}.stiffening"),
            tendon.stiffening,
            expected,
        ));
    }
    if tendon.servo.is_some() {
        let expected = "none: its actuators follow their commands at once, however strong";
        return Err(refuse(&format!("{field}.servo"), "a servo", expected));
    }
    if tendon.drive == Drive::Length && tendon.axial_stiffness.is_none() {
        let expected = "an `axial_stiffness` with it: it has no drive that sets a length exactly";
        return Err(refuse(&format!("{field}.drive"), "`length`", expected));
    }
    Ok(())
}

fn refuse(field: &str, value: impl ToString, expected: &'static str) -> ExportError {
    ExportError::Unsupported {
        format: "MuJoCo",
        field: field.to_owned(),
        value: value.to_string(),
        expected,
    }
}

/// A length (m) that a tendon never exceeds, however its joints turn.
pub(super) fn longest(robot: &Robot, tendon: usize) -> f64 {
    let segments = (robot.segments().iter())
        .filter(|segment| segment.tendon == tendon)
        .map(|segment| segment.from.norm() + segment.to.norm());
    let spans = (robot.spans().iter())
        .filter(|span| span.tendon == tendon)
        .map(|span| {
            let first = span.lower.map_or(0, |disc| disc + 1);
            let between = robot.discs()[first..=span.upper].iter();
            let offsets: f64 = between.map(|disc| disc.joint_offset.norm()).sum();
            span.from.norm() + offsets + span.to.norm()
        });
    segments.sum::<f64>() + spans.sum::<f64>() + robot.tendons()[tendon].fixed_length
}
