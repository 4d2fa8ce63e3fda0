//! A simulated rig among obstacles.

use std::ops::ControlFlow;

use nalgebra::Vector3;
use tdcr_hw::capture::Program;
use tdcr_hw::plan::{Bend, Shape};
use tdcr_hw::rig::{Pace, Rig, RigFile};
use tdcr_sim::cloud::PointCloud;
use tdcr_sim::contact::ContactSettler;
use tdcr_sim::robot::Loads;
use tdcr_sim::statics::Settler;

const RIG: &str = include_str!("../../../../examples/rig-sim.toml");

/// The example's rig with two small cameras, nothing but a wall 45 mm beside its home, which the table `table` of its file names.
fn beside_a_wall(table: &str) -> Rig {
    let folder = tempfile::tempdir().unwrap();
    let mut text = RIG[..RIG.match_indices("[[cameras]]").nth(2).unwrap().0]
        .replace("[640, 480]", "[160, 120]")
        .replace("sensor = \"d435\"\n", "")
        .replace("surroundings = \"table\"\n", "");
    text = text.replacen("[simulation]\n", table, 1);
    let robot = include_str!("../../../../examples/paper-robot.toml");
    std::fs::write(folder.path().join("paper-robot.toml"), robot).unwrap();
    let wall = "[[obstacle]]\nname = \"wall\"\nbox = { size = [0.02, 0.3, 0.5] }\nposition = [0.055, 0.0, 0.25]\n";
    std::fs::write(folder.path().join("wall.toml"), wall).unwrap();
    let file = RigFile::parse(&text, &folder.path().join("rig.toml")).unwrap();
    Rig::open_file(file, Pace::Computed).unwrap()
}

/// Bends a rig towards the wall, as its robot could go in empty space.
fn bent(mut rig: Rig) -> Rig {
    let mut free = rig.file().clone();
    free.scene = None;
    let mut program = Program::new(&free, 1).unwrap();
    let rest = program.rest().clone();
    let towards = Shape(vec![Bend::new(0.0, 0.5, 12.0), Bend::new(0.0, 0.6, 12.0)]);
    let path = program.path(&rest, &towards).unwrap();
    rig.engage().unwrap();
    rig.move_along(&path, &mut || ControlFlow::Continue(()))
        .unwrap();
    (0..20).try_for_each(|_| rig.poll().map(drop)).unwrap();
    rig
}

/// Points that the cameras see on the face of the wall that the robot is not at.
fn points_on_the_wall(rig: &mut Rig) -> usize {
    let mut cloud = PointCloud::default();
    for frame in rig.grab().unwrap().frames {
        cloud.add_frame(&frame.value);
    }
    let on_wall = |[x, y, z]: &&[f32; 3]| {
        (x - 0.065).abs() < 1e-4 && y.abs() < 0.151 && (z - 0.25).abs() < 0.251
    };
    cloud.points.iter().filter(on_wall).count()
}

#[test]
fn a_robot_presses_against_a_wall_and_its_cameras_see_the_wall() {
    let mut free = bent(beside_a_wall("[simulation]\n"));
    let named = "[scene]\nfile = \"wall.toml\"\n\n[simulation]\n";
    for table in ["[simulation]\nscene = \"wall.toml\"\n", named] {
        let mut rig = bent(beside_a_wall(table));
        let simulator = rig.simulator().unwrap();
        let (robot, truth) = (simulator.robot(), simulator.truth());
        let rest: Vec<f64> = (truth.tendons.iter())
            .map(|tendon| tendon.rest_length)
            .collect();
        let (command, loads) = (robot.command(&rest).unwrap(), Loads::default());
        let mut among = ContactSettler::new(&robot, &rig.file().simulated_scene);
        let found = among.settle(&command, &loads).unwrap();
        assert!(truth.settled && !found.contacts.is_empty());
        let tip = |position: &Vector3<f64>| truth.discs[9].translation.vector - position;
        let off = tip(&found.equilibrium.positions[9]);
        assert!(off.norm() < 1e-7, "{off}");
        let mut alone = Settler::new(&robot);
        let through = tip(&alone.settle(&command, &loads).positions[9]);
        assert!(through.norm() > 5e-3, "{through}");
        // The servos feel it.
        let [pulls, without] = [&rig, &free].map(|rig| {
            let states = rig.last_states().unwrap();
            states.iter().map(|state| state.pull).collect::<Vec<f64>>()
        });
        let most = pulls.iter().zip(&without).map(|(a, b)| (a - b).abs());
        assert!(most.fold(0.0, f64::max) > 0.02, "{pulls:?}, {without:?}");
        assert!(points_on_the_wall(&mut rig) > 500);
    }
    // Of the robot, which is there by chance.
    let without = points_on_the_wall(&mut free);
    assert!(without < 20, "{without}");
}
