//! The contacts of a step, from what is near.

use nalgebra::Vector3;

use super::super::Partner;
use super::super::near::Near;
use super::ContactStepper;
use super::law::Push;
use super::problem::Problem;
use super::touch::{Name, Opposite, Side, Touch};
use crate::objects::Body;
use crate::scene::ContactLaw;

impl ContactStepper {
    /// Sets the contacts of the problem to those of the beads that are near.
    pub(super) fn set_touches(&mut self) {
        let problem = &mut self.problem;
        problem.touches.clear();
        problem.movables.all.clear();
        for near in &self.neighbourhood.near {
            let object = self.objects.of_obstacle(near.obstacle);
            let Some(mut touch) = self.touch_of(near, object.map(|(_, body)| body)) else {
                continue;
            };
            if let Some((number, body)) = object {
                let object = self.problem.movables.place(number, body);
                let arm = self.place_of(near) - body.centre;
                touch.against = Some(Opposite { object, arm });
            }
            self.problem.touches.push(touch);
        }
        self.add_pairs();
        let h = self.stepper.timestep();
        let Problem {
            movables, touches, ..
        } = &mut self.problem;
        self.objects.add_meetings(h, movables, touches);
    }

    /// Adds the beads of discs that are near each other.
    fn add_pairs(&mut self) {
        let h = self.stepper.timestep();
        let (Some(own), ContactLaw::Compliant { relaxation }) =
            (&self.own, self.scene.contact_law())
        else {
            return;
        };
        let centres = &self.centres;
        let touches = own.pairs.near.iter().map(|near| {
            // Without friction the forces are along the line of the centres, and might act at any of its points.
            let rubbed = near.meeting();
            let ends = [0, 1].map(|end| {
                let disc = near.beads[end].disc;
                let point = match own.friction > 0.0 {
                    true => rubbed,
                    false => near.centres[end],
                };
                (disc, point - centres[disc])
            });
            let [free, other] = ends.map(|(disc, arm)| self.motions.of(disc, &arm));
            let free = free - other;
            Touch {
                name: Name::Discs(near.beads[0], near.beads[1]),
                on: Side::Disc(ends[0].0),
                against: None,
                other: Some(ends[1]),
                partner: Partner::Disc(ends[1].0),
                gap: near.gap,
                gradient: near.normal,
                normal: near.normal,
                arm: ends[0].1,
                push: Push::compliant(near.gap, own.compliance, relaxation, h),
                friction: own.friction,
                bound: 0.0,
                free,
                velocity: free,
                impulse: Vector3::zeros(),
            }
        });
        self.problem.touches.extend(touches);
    }

    /// Where a bead is nearest to the surface that it is near (m).
    fn place_of(&self, near: &Near) -> Vector3<f64> {
        let normal = near.normal.try_normalize(0.0).unwrap_or(near.normal);
        near.centre - normal * (near.gap + near.bead.radius)
    }

    /// A bead near an obstacle, which may be an object, as the problem has it; none if the law takes no notice of it.
    fn touch_of(&self, near: &Near, object: Option<&Body>) -> Option<Touch> {
        let h = self.stepper.timestep();
        let disc = near.bead.disc;
        let obstacle = &self.scene.obstacles()[near.obstacle];
        let normal = near.normal.try_normalize(0.0)?;
        let arm = near.arm - normal * (near.gap + near.bead.radius);
        let (push, friction) = match self.scene.contact_law() {
            ContactLaw::Compliant { relaxation } => {
                let push = Push::compliant(near.gap, obstacle.compliance, relaxation, h);
                (push, obstacle.friction)
            }
            ContactLaw::Impedance(_) if near.gap > 0.0 => return None,
            ContactLaw::Impedance(law) => {
                let mut speed = near.normal.dot(&self.starts.of(disc, &arm));
                let mut mobility = self.mobilities[disc];
                if let Some(body) = object {
                    let arm = self.place_of(near) - body.centre;
                    speed -= near.normal.dot(&body.twist.at(&arm));
                    mobility += 1.0 / body.mass;
                }
                (law.push(near.gap, speed, mobility, h), 0.0)
            }
        };
        let mut free = self.motions.of(disc, &arm);
        if let Some(body) = object {
            free -= body.free.at(&(self.place_of(near) - body.centre));
        }
        Some(Touch {
            name: Name::Bead(near.bead, near.obstacle),
            on: Side::Disc(disc),
            against: None,
            other: None,
            partner: Partner::Obstacle(near.obstacle),
            gap: near.gap,
            gradient: near.normal,
            normal,
            arm,
            push,
            friction,
            bound: 0.0,
            free,
            velocity: free,
            impulse: Vector3::zeros(),
        })
    }
}
