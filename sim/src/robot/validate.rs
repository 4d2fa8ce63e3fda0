//! What a robot specification must satisfy.

use super::spec::{
    Backbone, BaseSpec, Body, Drive, Holes, Limit, MassSpec, ModuleSpec, PerDisc, RobotSpec,
    RouteSpec, Routing, TendonSpec,
};
use super::{SpecError, file::refuse};

/// Far above any robot built, and small enough that every product of sizes fits in memory.
const MAX_DISCS: usize = 1000;
/// No quantity of a robot in SI units comes near, and products of several such do not overflow.
const LARGEST: f64 = 1e15;
/// Largest distance within a robot (m): beside it the others are not lost in rounding.
const MAX_DISTANCE: f64 = 1e3;
/// Largest coordinate of the base (m), for the same reason.
const MAX_COORDINATE: f64 = 1e6;

impl RobotSpec {
    /// Checks every field.
    ///
    /// # Errors
    /// [`SpecError::Field`] for the first field that no robot can have.
    pub fn validate(&self) -> Result<(), SpecError> {
        finite("gravity", &self.gravity)?;
        self.base.validate()?;
        if self.modules.is_empty() {
            return Err(refuse("modules", "empty", "at least one module"));
        }
        for (index, module) in self.modules.iter().enumerate() {
            module.validate(&|field| format!("modules[{index}].{field}"))?;
        }
        let discs = self.disc_count();
        if discs > MAX_DISCS {
            let found = format!("{discs} discs");
            return Err(refuse("modules", found, "1000 discs in all at most"));
        }
        self.validate_guides()?;
        for (index, route) in self.routes.iter().enumerate() {
            self.validate_route(index, route)?;
        }
        self.cameras.validate()
    }

    /// Every body that a module's tendons pass has a hole for each.
    fn validate_guides(&self) -> Result<(), SpecError> {
        let below = |module: usize| match module.checked_sub(1) {
            None => ("base.holes".to_owned(), self.base.holes.count()),
            Some(m) => (format!("modules[{m}].holes"), self.modules[m].holes.count()),
        };
        for (index, module) in self.modules.iter().enumerate() {
            if module.tendons.is_none() {
                continue;
            }
            let lowest = match self.routing {
                Routing::Base => 0,
                Routing::ModuleBelow => index,
            };
            for (field, holes) in (lowest..=index).map(below) {
                if holes < module.holes.count() {
                    let expected = "at least as many holes as each module whose tendons pass here";
                    return Err(refuse(&field, format!("a list of {holes}"), expected));
                }
            }
        }
        Ok(())
    }

    fn validate_route(&self, index: usize, route: &RouteSpec) -> Result<(), SpecError> {
        let at = |field: &str| format!("routes[{index}].{field}");
        for (place, waypoint) in route.through.iter().enumerate() {
            let field = at(&format!("through[{place}]"));
            let Some(holes) = self.holes(waypoint.0) else {
                let Body::Disc(disc) = waypoint.0 else {
                    continue;
                };
                return Err(refuse(&field, disc, "\"base\" or the number of a disc"));
            };
            if waypoint.1 >= holes.count() {
                let found = format!("hole {} of {}", waypoint.1, holes.count());
                return Err(refuse(&field, found, "a hole's number, counted from 0"));
            }
        }
        if let Some(place) = route.through.windows(2).position(|pair| pair[0] == pair[1]) {
            let field = at(&format!("through[{}]", place + 1));
            return Err(refuse(&field, "the hole before it again", "another hole"));
        }
        let leaves_its_body = route.through.iter().any(|w| w.0 != route.through[0].0);
        if !leaves_its_body {
            let found = format!("a list of {}", route.through.len());
            let expected = "at least two holes, not all of one body";
            return Err(refuse(&at("through"), found, expected));
        }
        route
            .tendon
            .validate(&|field| at(&format!("tendon.{field}")))
    }
}

impl BaseSpec {
    fn validate(&self) -> Result<(), SpecError> {
        finite("base.position", &self.position)?;
        finite("base.orientation", &self.orientation)?;
        if self.orientation.iter().all(|x| x.abs() < 1e-6) {
            let found = format!("{:?}", self.orientation);
            return Err(refuse(
                "base.orientation",
                found,
                "a quaternion (w, x, y, z)",
            ));
        }
        finite("base.hole_height", &[self.hole_height])?;
        self.holes.validate("base.holes")?;
        let far = "coordinates of at most 1e6 m";
        at_most(MAX_COORDINATE, "base.position", &self.position, far)?;
        at_most(MAX_DISTANCE, "base.hole_height", &[self.hole_height], NEAR)?;
        self.holes.validate_distances("base.holes")
    }
}

impl Holes {
    fn validate(&self, field: &str) -> Result<(), SpecError> {
        match self {
            Self::At(holes) => finite(field, holes.as_flattened()),
            Self::Circle(circle) => {
                not_negative(&format!("{field}.radius"), circle.radius)?;
                finite(&format!("{field}.angles"), &circle.angles)
            }
        }
    }

    fn validate_distances(&self, field: &str) -> Result<(), SpecError> {
        match self {
            Self::At(holes) => at_most(MAX_DISTANCE, field, holes.as_flattened(), NEAR),
            Self::Circle(circle) => {
                let field = format!("{field}.radius");
                at_most(MAX_DISTANCE, &field, &[circle.radius], NEAR)
            }
        }
    }
}

impl ModuleSpec {
    fn validate(&self, at: &dyn Fn(&str) -> String) -> Result<(), SpecError> {
        if !(1..=MAX_DISCS).contains(&self.discs) {
            return Err(refuse(&at("discs"), self.discs, "1 to 1000"));
        }
        positive(&at("first_offset"), self.first_offset)?;
        positive(&at("pitch"), self.pitch)?;
        not_negative(&at("joint_below"), self.joint_below)?;
        positive(&at("radius"), self.radius)?;
        positive(&at("half_height"), self.half_height)?;
        self.holes.validate(&at("holes"))?;
        match &self.mass {
            MassSpec::Density(density) => {
                self.each(density, &at("mass.density"), |f, d| not_negative(f, *d))?;
            }
            MassSpec::Rigid(rigid) => self.each(rigid, &at("mass.rigid"), |field, rigid| {
                not_negative(&format!("{field}.mass"), rigid.mass)?;
                for moment in rigid.inertia {
                    not_negative(&format!("{field}.inertia"), moment)?;
                }
                Ok(())
            })?,
        }
        self.each(&self.damping, &at("damping"), |f, d| not_negative(f, *d))?;
        self.each(&self.armature, &at("armature"), |f, a| not_negative(f, *a))?;
        if let Some(backbone) = &self.backbone {
            self.each(backbone, &at("backbone"), Backbone::validate)?;
        }
        if let Some(limit) = &self.limit {
            self.each(limit, &at("limit"), Limit::validate)?;
        }
        if let Some(tendons) = &self.tendons {
            tendons.validate(&|field| at(&format!("tendons.{field}")))?;
        }
        for (field, distance) in [
            ("first_offset", self.first_offset),
            ("pitch", self.pitch),
            ("joint_below", self.joint_below),
            ("radius", self.radius),
            ("half_height", self.half_height),
        ] {
            at_most(MAX_DISTANCE, &at(field), &[distance], NEAR)?;
        }
        self.holes.validate_distances(&at("holes"))
    }

    /// Checks a value of every disc, and that there is one for each.
    fn each<T>(
        &self,
        values: &PerDisc<T>,
        field: &str,
        check: impl Fn(&str, &T) -> Result<(), SpecError>,
    ) -> Result<(), SpecError> {
        match values {
            PerDisc::Uniform(value) => check(field, value),
            PerDisc::Each(values) if values.len() == self.discs => (values.iter().enumerate())
                .try_for_each(|(disc, value)| check(&format!("{field}[{disc}]"), value)),
            PerDisc::Each(values) => {
                let found = format!("a list of {}", values.len());
                Err(refuse(field, found, "one value per disc, or one for all"))
            }
        }
    }
}

impl Backbone {
    fn validate(field: &str, backbone: &Self) -> Result<(), SpecError> {
        for stiffness in backbone.bending {
            not_negative(&format!("{field}.bending"), stiffness)?;
        }
        not_negative(&format!("{field}.torsion"), backbone.torsion)?;
        finite(&format!("{field}.rest"), &backbone.rest)
    }
}

impl Limit {
    fn validate(field: &str, limit: &Self) -> Result<(), SpecError> {
        if !(limit.angle > 0.0 && limit.angle < std::f64::consts::PI) {
            let expected = "radians between 0 and pi";
            return Err(refuse(&format!("{field}.angle"), limit.angle, expected));
        }
        positive(&format!("{field}.stiffness"), limit.stiffness)
    }
}

impl TendonSpec {
    fn validate(&self, at: &dyn Fn(&str) -> String) -> Result<(), SpecError> {
        if let Drive::Gain(gain) = self.drive {
            positive(&at("drive.gain"), gain)?;
        }
        let [low, high] = self.range;
        if !(low.is_finite() && high.is_finite() && 0.0 <= low && low < high) {
            let expected = match self.drive {
                Drive::Gain(_) | Drive::Length => {
                    "[smallest, largest] in metres with 0 <= smallest < largest"
                }
                Drive::Tension => "[smallest, largest] in newtons with 0 <= smallest < largest",
            };
            return Err(refuse(&at("range"), format!("[{low}, {high}]"), expected));
        }
        finite(&at("range"), &self.range)?;
        if let Some(stiffness) = self.axial_stiffness {
            positive(&at("axial_stiffness"), stiffness)?;
        }
        if let Some(friction) = &self.friction {
            not_negative(&at("friction.coefficient"), friction.coefficient)?;
            let stiffness = friction.contact_stiffness;
            positive(&at("friction.contact_stiffness"), stiffness)?;
        }
        Ok(())
    }
}

/// What is expected of a distance within a robot.
const NEAR: &str = "distances of at most 1000 m";

fn at_most(
    limit: f64,
    field: &str,
    values: &[f64],
    expected: &'static str,
) -> Result<(), SpecError> {
    match values.iter().find(|value| value.abs() > limit) {
        Some(value) => Err(refuse(field, format!("{value:e}"), expected)),
        None => Ok(()),
    }
}

pub(super) fn finite(field: &str, values: &[f64]) -> Result<(), SpecError> {
    match values.iter().find(|value| !value.is_finite()) {
        Some(value) => Err(refuse(field, value, "finite numbers")),
        None => at_most(LARGEST, field, values, "numbers of at most 1e15"),
    }
}

pub(super) fn positive(field: &str, value: f64) -> Result<(), SpecError> {
    if value.is_finite() && value > 0.0 {
        at_most(LARGEST, field, &[value], "a number above 0 of at most 1e15")
    } else {
        Err(refuse(field, value, "a finite number above 0"))
    }
}

fn not_negative(field: &str, value: f64) -> Result<(), SpecError> {
    if value.is_finite() && value >= 0.0 {
        at_most(LARGEST, field, &[value], "a number from 0 to 1e15")
    } else {
        Err(refuse(field, value, "a finite number, 0 or above"))
    }
}
