//! Robots that touch obstacles: MuJoCo finds them at rest under the forces that we report.

use nalgebra::Vector3;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use tdcr_sim::contact::ContactSettler;
use tdcr_sim::robot::Loads;

use crate::probe::{self, Probe};
use crate::scenes::scene;

#[test]
fn mujoco_finds_no_force_where_our_contacts_press() {
    let mut rng = ChaCha8Rng::seed_from_u64(36);
    for robot in crate::standard_robots() {
        let model = probe::model(&robot);
        let (mut pressed, mut largest) = (0, 0.0_f64);
        while pressed < 40 {
            let scene = scene(&mut rng, &robot);
            let command = robot.random_command(&mut rng);
            let mut settler = ContactSettler::new(&robot, &scene);
            let Ok(found) = settler.settle(&command, &Loads::default()) else {
                continue;
            };
            if found.contacts.is_empty() || !found.equilibrium.converged {
                continue;
            }
            pressed += 1;
            let mut probe = Probe::new(&model, &robot, &command, &Loads::default());
            for disc in 0..robot.discs().len() {
                let (mut force, mut moment) = (Vector3::zeros(), Vector3::zeros());
                for contact in found.contacts.iter().filter(|contact| contact.disc == disc) {
                    let arm = contact.point - found.equilibrium.positions[disc];
                    force += contact.force;
                    moment += arm.cross(&contact.force);
                }
                probe.push(disc, force, moment);
            }
            largest = largest.max(probe.force_at(&found.equilibrium.configuration));
        }
        eprintln!("{}: {largest:e} N m", robot.spec().name);
        assert!(largest <= 2e-9, "{}: {largest:e} N m", robot.spec().name);
    }
}
