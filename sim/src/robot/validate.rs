//! What a robot specification must satisfy.

use std::f64::consts::PI;

use super::checks::{LARGEST, at_most, finite, not_negative, positive, radians};
use super::{
    Backbone, BaseSpec, Body, Drive, HingeJoint, Holes, Limit, MassSpec, ModuleSpec, PerDisc,
    RobotSpec, RodSpec, RouteSpec, Routing, ServoSpec, SpecError, TendonSpec, joints_along,
    spec_error::refuse,
};

/// Far above any robot built, and small enough that every product of sizes fits in memory.
const MAX_DISCS: usize = 1000;
/// Holes of a body; a tendon less than these can pass a joint.
const MAX_HOLES: usize = 1000;
/// Tendons at one joint, pieces of tendon that pass discs by counted three times.
const MAX_TENDONS_AT_JOINT: usize = 64;
/// Largest distance within a robot (m): beside it the others are not lost in rounding.
const MAX_DISTANCE: f64 = 1e3;
/// What is expected of a distance within a robot.
const NEAR: &str = "distances of at most 1000 m";
/// Largest coordinate of the base (m), for the same reason.
const MAX_COORDINATE: f64 = 1e6;

impl RobotSpec {
    /// Checks every field.
    ///
    /// # Errors
    /// [`SpecError::Field`] for the first field that no robot can have.
    pub fn validate(&self) -> Result<(), SpecError> {
        finite("gravity", &self.gravity)?;
        if let Some(fluid) = &self.fluid {
            not_negative("fluid.density", fluid.density)?;
            not_negative("fluid.drag_coefficient", fluid.drag_coefficient)?;
        }
        self.base.validate()?;
        if self.modules.is_empty() {
            return Err(refuse("modules", "empty", "at least one module"));
        }
        self.validate_sizes()?;
        for (index, module) in self.modules.iter().enumerate() {
            module.validate(&|field| format!("modules[{index}].{field}"))?;
        }
        self.validate_centres()?;
        self.validate_guides()?;
        for (index, route) in self.routes.iter().enumerate() {
            self.validate_route(index, route)?;
        }
        self.validate_crowding()?;
        self.cameras.validate()
    }

    /// The sizes that all other checks, and compiling, take time and memory in proportion to.
    fn validate_sizes(&self) -> Result<(), SpecError> {
        for (index, module) in self.modules.iter().enumerate() {
            if !(1..=MAX_DISCS).contains(&module.discs) {
                let field = format!("modules[{index}].discs");
                return Err(refuse(&field, module.discs, "1 to 1000"));
            }
        }
        let discs = self.modules.iter().map(|module| module.discs);
        let discs = discs.fold(0, usize::saturating_add);
        if discs > MAX_DISCS {
            let found = format!("{discs} discs");
            return Err(refuse("modules", found, "1000 discs in all at most"));
        }
        // Every copy of a pattern of holes is turned by the clocking of another module.
        let clocked = self.modules.iter().filter(|module| module.clocking != 0.0);
        let copies = 1 + clocked.count();
        let check = |field: String, holes: usize| {
            if holes * copies <= MAX_HOLES {
                return Ok(());
            }
            let found = format!("a list of {holes}");
            let expected = "1000 holes at most, counted anew for each module with a clocking";
            Err(refuse(&field, found, expected))
        };
        check("base.holes".to_owned(), self.base.holes.count())?;
        for (index, module) in self.modules.iter().enumerate() {
            check(format!("modules[{index}].holes"), module.holes.count())?;
        }
        // A tendon takes a joint at least.
        if self.routes.len() > MAX_TENDONS_AT_JOINT * discs {
            let found = format!("a list of {}", self.routes.len());
            return Err(refuse("routes", found, "64 tendons at a joint at most"));
        }
        Ok(())
    }

    /// A disc with mass off the axis carries no rod: the two together have principal axes of their
    /// own.
    fn validate_centres(&self) -> Result<(), SpecError> {
        for (index, module) in self.modules.iter().enumerate() {
            let rods = self.modules[index..].iter().take(2);
            if !rods.filter_map(|m| m.rod).any(|rod| rod.density > 0.0) {
                continue;
            }
            let on_axis = |field: &str, [x, y, _]: &[f64; 3]| {
                if [*x, *y] == [0.0; 2] {
                    return Ok(());
                }
                let expected = "0 in x and y: its discs carry a rod with mass";
                Err(refuse(field, format!("[{x}, {y}, ..]"), expected))
            };
            let at = |field: &str| format!("modules[{index}].mass.{field}");
            match &module.mass {
                MassSpec::Density(_) => {}
                MassSpec::Solid(solid) => module.each(solid, &at("solid"), |field, solid| {
                    on_axis(&format!("{field}.centre_of_mass"), &solid.centre_of_mass)
                })?,
                MassSpec::Rigid(rigid) => module.each(rigid, &at("rigid"), |field, rigid| {
                    on_axis(&format!("{field}.centre_of_mass"), &rigid.centre_of_mass)
                })?,
            }
        }
        Ok(())
    }

    /// The statics' work at a joint grows with the square of the tendons there.
    fn validate_crowding(&self) -> Result<(), SpecError> {
        // Changes of the count from each joint to the next.
        let mut changes = vec![0_i64; self.disc_count() + 1];
        let mut add = |joints: std::ops::Range<usize>, count: i64| {
            changes[joints.start] += count;
            changes[joints.end] -= count;
        };
        let mut first_disc = 0;
        for module in &self.modules {
            let end = first_disc + module.discs;
            let start = match self.routing {
                Routing::ModuleBelow => first_disc,
                Routing::Base => 0,
            };
            if module.tendons.is_some() {
                add(start..end, module.holes.count() as i64);
            }
            first_disc = end;
        }
        for route in &self.routes {
            add(joints_along(&route.through), 1);
            for piece in route.through.windows(2) {
                let joints = joints_along(piece);
                if joints.len() > 1 {
                    // The columns across a piece reach down to the base: see `energy::Columns`.
                    add(0..joints.end, 2);
                }
            }
        }
        let mut count = 0;
        for (joint, change) in changes.iter().enumerate() {
            count += change;
            if count > MAX_TENDONS_AT_JOINT as i64 {
                let expected = "64 at most, pieces that pass discs by counted three times";
                return Err(refuse(
                    &format!("tendons at joint {joint}"),
                    count,
                    expected,
                ));
            }
        }
        Ok(())
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
            let Some(holes) = self.hole_count(waypoint.0) else {
                let Body::Disc(disc) = waypoint.0 else {
                    continue;
                };
                return Err(refuse(&field, disc, "\"base\" or the number of a disc"));
            };
            if waypoint.1 >= holes {
                let found = format!("hole {} of {holes}", waypoint.1);
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
                radians(&format!("{field}.angles"), &circle.angles, "degrees")
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
        positive(&at("first_offset"), self.first_offset)?;
        positive(&at("pitch"), self.pitch)?;
        radians(&at("clocking"), &[self.clocking], "clocking_degrees")?;
        not_negative(&at("joint_below"), self.joint_below)?;
        positive(&at("radius"), self.radius)?;
        positive(&at("half_height"), self.half_height)?;
        self.holes.validate(&at("holes"))?;
        match &self.mass {
            MassSpec::Density(density) => {
                self.each(density, &at("mass.density"), |f, d| not_negative(f, *d))?;
            }
            MassSpec::Solid(solid) => self.each(solid, &at("mass.solid"), |field, solid| {
                not_negative(&format!("{field}.density"), solid.density)?;
                finite(&format!("{field}.centre_of_mass"), &solid.centre_of_mass)
            })?,
            MassSpec::Rigid(rigid) => self.each(rigid, &at("mass.rigid"), |field, rigid| {
                not_negative(&format!("{field}.mass"), rigid.mass)?;
                for moment in rigid.inertia {
                    not_negative(&format!("{field}.inertia"), moment)?;
                }
                finite(&format!("{field}.centre_of_mass"), &rigid.centre_of_mass)
            })?,
        }
        self.each(&self.damping, &at("damping"), |f, d| not_negative(f, *d))?;
        self.each(&self.armature, &at("armature"), |f, a| not_negative(f, *a))?;
        if let Some(joint) = &self.joint {
            self.validate_hinges(joint, at)?;
        }
        if let Some(backbone) = &self.backbone {
            self.each(backbone, &at("backbone"), Backbone::validate)?;
        }
        if let Some(rod) = &self.rod {
            self.validate_rod(rod, at)?;
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

    fn validate_hinges(
        &self,
        joint: &PerDisc<HingeJoint>,
        at: &dyn Fn(&str) -> String,
    ) -> Result<(), SpecError> {
        for (field, given) in [
            ("backbone", self.backbone.is_some()),
            ("rod", self.rod.is_some()),
        ] {
            if given {
                let expected =
                    "none beside a `joint` of hinges, which have a stiffness of their own";
                return Err(refuse(&at(field), "given", expected));
            }
        }
        self.each(joint, &at("joint"), HingeJoint::validate)
    }

    fn validate_rod(&self, rod: &RodSpec, at: &dyn Fn(&str) -> String) -> Result<(), SpecError> {
        if self.backbone.is_some() {
            let expected = "none beside a `rod`, from which it follows";
            return Err(refuse(&at("backbone"), "given", expected));
        }
        positive(&at("rod.youngs"), rod.youngs)?;
        positive(&at("rod.radius"), rod.radius)?;
        not_negative(&at("rod.density"), rod.density)?;
        for (field, time) in [
            ("bending", rod.damping.bending),
            ("torsion", rod.damping.torsion),
        ] {
            not_negative(&at(&format!("rod.damping.{field}")), time)?;
        }
        if !(rod.poisson > -1.0 && rod.poisson <= 0.5) {
            let expected = "above -1, and at most 0.5";
            return Err(refuse(&at("rod.poisson"), rod.poisson, expected));
        }
        for (field, length) in [("first_offset", self.first_offset), ("pitch", self.pitch)] {
            let Backbone {
                bending, torsion, ..
            } = rod.backbone(length);
            if !(bending[0] <= LARGEST && torsion <= LARGEST) {
                let found = format!("of {} and {} N m/rad a joint", bending[0], torsion);
                return Err(refuse(&at("rod"), found, "at most 1e15 N m/rad"));
            }
            if self.joint_below > length {
                let expected = "where there is a rod, at most `first_offset` and `pitch`";
                let found = format!("{}, more than `{field}`", self.joint_below);
                return Err(refuse(&at("joint_below"), found, expected));
            }
        }
        Ok(())
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
        radians(&format!("{field}.rest"), &backbone.rest, "rest_degrees")
    }
}

impl Limit {
    fn validate(field: &str, limit: &Self) -> Result<(), SpecError> {
        if !(limit.angle > 0.0 && limit.angle < PI) {
            let expected = "radians between 0 and pi; `degrees` takes degrees in its place";
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
        not_negative(&at("stiffening"), self.stiffening)?;
        if self.stiffening > 0.0 && !self.stretches() {
            let found = self.stiffening.to_string();
            return Err(refuse(
                &at("stiffening"),
                found,
                "0, or a drive with a gain, or an axial_stiffness",
            ));
        }
        if let Some(friction) = &self.friction {
            not_negative(&at("friction.coefficient"), friction.coefficient)?;
            let stiffness = friction.contact_stiffness;
            positive(&at("friction.contact_stiffness"), stiffness)?;
        }
        match &self.servo {
            Some(servo) => self.validate_servo(servo, &|field: &str| at(&format!("servo.{field}"))),
            None => Ok(()),
        }
    }

    fn validate_servo(
        &self,
        servo: &ServoSpec,
        at: &dyn Fn(&str) -> String,
    ) -> Result<(), SpecError> {
        not_negative(&at("lag"), servo.lag)?;
        if let Some(rate) = servo.rate {
            positive(&at("rate"), rate)?;
        }
        let Some(force) = servo.largest_force else {
            return Ok(());
        };
        positive(&at("largest_force"), force)?;
        match self.stretches() {
            true => Ok(()),
            false => Err(refuse(
                &at("largest_force"),
                force,
                match self.drive {
                    Drive::Tension => "none: the largest command of a tension drive is its limit",
                    Drive::Gain(_) | Drive::Length => {
                        "none, or a tendon that stretches: an axial_stiffness"
                    }
                },
            )),
        }
    }
}
