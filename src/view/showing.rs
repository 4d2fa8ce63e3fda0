//! What a session tells its page of the robot.

use tdcr_sim::contact::Contact;

use super::body::Body;
use super::drawing::Layout;
use super::frame::Frame;
use super::message::Reply;
use super::post::Output;
use super::session::Session;

impl Session {
    /// What stays the same while this robot is shown.
    pub fn introduce(&self, recorded: &[Vec<f64>]) -> Output {
        let fits = |values: &&Vec<f64>| self.robot.command(values).is_ok();
        let recorded: Vec<Vec<f64>> = recorded.iter().filter(fits).cloned().collect();
        let pose = self.body.show(&self.settler).pose;
        let layout = Layout::new(&self.robot, &self.scene, pose, &recorded);
        Output::Words(Reply::Robot(Box::new(layout)))
    }

    /// Where the robot is, as the answer to the request of this number.
    pub fn show(&mut self, stamp: f64) -> Output {
        let shown = self.body.show(&self.settler);
        let frame = &mut self.frame;
        frame.stamp = stamp;
        let (residual, iterations, converged, stability) = match shown.equilibrium {
            Some(found) => (
                found.residual,
                found.iterations,
                found.converged,
                found.stability,
            ),
            None => (0.0, 0, true, None),
        };
        frame.residual = residual;
        frame.iterations = iterations as f64;
        frame.converged = f64::from(u8::from(converged));
        frame.tell_stability(stability);
        frame.payload = self.loads.tip_payload().mass;
        frame.physics = match self.body {
            Body::AtRest => 0.0,
            Body::WithFriction { .. } => 1.0,
            Body::InMotion(_) => 2.0,
            Body::Posed(_) => 3.0,
        };
        (frame.time, frame.load) = self.body.time().unwrap_or_default();
        let pose = shown.pose;
        frame.tip = pose.positions.last().copied().unwrap_or_default().into();
        frame.command = self.command.as_slice().to_vec();
        frame.tensions = pose.tendon_tensions.to_vec();
        frame.lengths = pose.tendon_lengths.to_vec();
        frame.draw(&self.robot, pose);
        frame.contacts = shown.contacts.iter().map(numbers).collect();
        let (command, mass) = (self.command.as_slice(), frame.payload);
        self.over
            .want(&self.robot, &self.scene, command, mass, pose);
        Output::Numbers(Frame::bytes(frame))
    }
}

/// A contact, as [`Frame::contacts`] has it.
fn numbers(contact: &Contact) -> [f64; 12] {
    let partner = match (contact.partner.obstacle(), contact.partner.disc()) {
        (Some(obstacle), _) => obstacle as f64,
        (None, disc) => -1.0 - disc.unwrap_or_default() as f64,
    };
    let (at, normal, force) = (contact.point, contact.normal, contact.force);
    [
        contact.disc as f64,
        partner,
        at.x,
        at.y,
        at.z,
        normal.x,
        normal.y,
        normal.z,
        force.x,
        force.y,
        force.z,
        contact.gap,
    ]
}
