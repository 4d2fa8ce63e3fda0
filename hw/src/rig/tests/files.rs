//! Rig files, right and wrong.

use super::*;

#[test]
fn the_example_files_are_read() {
    let sim = file(SIMULATED).unwrap();
    assert_eq!(sim.spec.cameras.len(), 4);
    assert_eq!(sim.robot.cameras.count(), 4);
    let paper = file(PAPER).unwrap();
    assert!(matches!(paper.spec.servos.link, ServoLink::Serial(_)));
    // What a file says comes back.
    for spec in [sim.spec, paper.spec] {
        let text = toml::to_string(&spec).unwrap();
        assert_eq!(toml::from_str::<RigSpec>(&text).unwrap(), spec);
    }
}

#[test]
fn a_wrong_file_is_refused_with_line_field_and_reason() {
    for (from, to, expected) in [
        (
            "ids = [1, 2, 3, 4, 5, 6]",
            "ids = [1, 2, 3]",
            "rig.toml:10: servos.ids is 3 ids; expected 6",
        ),
        (
            "ids = [1, 2, 3, 4, 5, 6]",
            "ids = [1, 2, 3, 4, 5, 5]",
            "servos.ids[5] is 5; expected no address twice",
        ),
        (
            "ids = [1, 2, 3, 4, 5, 6]",
            "ids = [1, 2, 3, 4, 5, 253]",
            "0 to 252",
        ),
        (
            "directions = [1]",
            "directions = [2]",
            "direction 2; expected 1 where",
        ),
        (
            "directions = [1]",
            "directions = [1, 1]",
            "servos.directions is 2 entries; expected one for each",
        ),
        (
            "spool_radius = [0.005]",
            "spool_radius = [0.0]",
            "rig.toml:14: servos.spool_radius[0] is 0;",
        ),
        (
            "spool_radius = [0.005]",
            "spool_radius = [1e300]",
            "rig.toml:14: servos.spool_radius[0] is 1000",
        ),
        (
            "baud = 1000000",
            "baud = 1000001",
            "servos.baud is 1000001; expected one of the servos' rates",
        ),
        (
            "current_limit = [0.8]",
            "current_limit = [75.0]",
            "servos.current_limit[0] is 75; expected 0.01 to 2.352 A",
        ),
        (
            "[-1300, 2400]",
            "[-1300, 2147483647]",
            "servos.limits[0] is [-1300, 2147483647]",
        ),
        (
            "current = 0.75",
            "current = 75.0",
            "safety.current is 75; expected 0.001 to 2.352",
        ),
        (
            "current = 0.75",
            "current = 0.8",
            "rig.toml:33: safety.current is 0.8; expected below servos.current_limit, 0.8 A",
        ),
        (
            "current_limit = [0.8]",
            "current_limit = [0.8, 0.8, 0.8, 0.8, 0.8, 0.6]",
            "safety.current is 0.75; expected below servos.current_limit, 0.6 A",
        ),
        (
            "slew = 0.02",
            "slew = 1e-12",
            "rig.toml:29: motion.slew is 0.000000000001; expected 0.0001 to 1",
        ),
        (
            "slew = 0.02",
            "slew = 0.2",
            "motion.slew is 0.2; expected no more than 0.060 m/s",
        ),
        (
            "tension = [1.0, 60.0]",
            "tension = [1.0, 6000.0]",
            "commands.tension is [1, 6000]; expected no more than 240 N",
        ),
        (
            "watchdog = 0.5",
            "watchdog = 0.02",
            "rig.toml:32: safety.watchdog is 0.02; expected at least 2 times motion.period, 0.05",
        ),
        (
            "slew = 0.02",
            "slew = 0.02\npicture = 6.0",
            "motion.picture is 6; expected no more than motion.patience, 5",
        ),
        (
            "slew = 0.02",
            "slew = 0.02\narrived = 400",
            "motion.arrived is 400; expected no more than safety.lag, 300",
        ),
        (
            "slew = 0.02",
            "slew = 0.02\nstill_speed = 1e300",
            "motion.still_speed is 1000",
        ),
        (
            "slew = 0.02",
            "slew = 0.02\nstill_depth = 1.0",
            "motion.still_depth is 1; expected 0.000001 to 0.05",
        ),
        (
            "release = \"home\"",
            "lag = 2147483647",
            "safety.lag is 2147483647; expected 1 to 2048",
        ),
        (
            "limits = [[-1300, 2400], [-1300, 2400], [-1300, 2400], [-1300, 6800], [-1300, 6800], [-1300, 6800]]",
            "limits = [[-100, 150]]",
            "safety.lag is 300; expected below 250",
        ),
        (
            "release = \"home\"",
            "drift = 1e300",
            "safety.drift is 1000",
        ),
        (
            "resume_below = 50.0",
            "resume_below = -300.0",
            "safety.resume_below is -300; expected 10 to 100",
        ),
        (
            "largest = { gap = 6 }",
            "largest = { gap = 4294967295 }",
            "rig.toml:41: masks.largest.gap is 4294967295; expected 0 to 479",
        ),
        (
            "largest = { gap = 6 }",
            "not = { components = { pixels = 20, gap = 480 } }",
            "masks.not.components.gap is 480; expected 0 to 479",
        ),
        (
            "largest = { gap = 6 }",
            "components = { pixels = 400000, gap = 2 }",
            "masks.components.pixels is 400000; expected no more than 307200",
        ),
        ("low = [-0.20,", "low = [-1e300,", "masks.box is -1000"),
        (
            "spool_radius",
            "spool_diameter",
            "unknown field `spool_diameter`",
        ),
        (
            "[-1300, 2400]",
            "[100, 2400]",
            "servos.limits[0] is [100, 2400]",
        ),
        (
            "home_tension = [6.0]",
            "home_tension = [9000.0]",
            "servos.home_tension is 9000 N, for which tendon 1",
        ),
        (
            "bend = [0.6, 0.8]",
            "bend = [0.9, 1.0, 1.1]",
            "commands.bend is 3 entries; expected one for each of the 2",
        ),
        (
            "watchdog = 0.5",
            "watchdog = 5.0",
            "safety.watchdog is 5; expected 0.02 to 2.54",
        ),
        (
            "pause_above = 60.0",
            "pause_above = 80.0",
            "safety.pause_above is 80",
        ),
        (
            "serial = \"east\"",
            "serial = \"south\"",
            "cameras[1].serial is \"south\"; expected a serial",
        ),
        (
            "fovy = 42.5",
            "fovy = 242.5",
            "cameras[0].lens.fovy` is 242.5; expected degrees",
        ),
        (
            "link = \"simulated\"\nbaud",
            "link = { serial = \"/dev/ttyUSB0\" }\nbaud",
            "cameras[0].link is \"simulated\"",
        ),
        (
            "link = \"simulated\"\nbaud",
            "link = \"wireless\"\nbaud",
            "unknown variant `wireless`",
        ),
        ("paper-robot.toml", "nobody.toml", "nobody.toml"),
        (
            "low = [-0.20,",
            "low = [0.30,",
            "masks.box is 0.3 to 0.2 along axis 0",
        ),
        (
            "largest = { gap = 6 }",
            "color = { hue = [0.0, 400.0], saturation = [0.5, 1.0], value = [0.0, 1.0] }",
            "rig.toml:41: masks.color.hue is [0, 400]; expected two numbers of 0 to 360",
        ),
        (
            "largest = { gap = 6 }",
            "any = [{ largest = { gap = 2 } }, { color = { hue = [0, 9], saturation = [0.5, 0.2], value = [0, 1] } }]",
            "masks.any[1].color.saturation is [0.5, 0.2]",
        ),
        (
            "largest = { gap = 6 }",
            "not = {}",
            "masks.not is empty; expected a table with one",
        ),
        (
            "largest = { gap = 6 }",
            "largest = { gap = 6 }\ncomponents = { pixels = 50, gap = 2 }",
            "rig.toml:42: masks.components is there beside largest",
        ),
        (
            "largest = { gap = 6 }",
            "background = { log = \"empty.mcap\", margin = -0.1 }",
            "masks.background.margin is -0.1; expected 0 to 1",
        ),
        (
            "largest = { gap = 6 }",
            "background = { log = \"empty.mcap\", deviations = 1e9 }",
            "masks.background.deviations is 1000000000; expected 0 to 100",
        ),
    ] {
        assert!(SIMULATED.contains(from), "{from}");
        let wrong = SIMULATED.replacen(from, to, 1);
        let said = file(&wrong).and_then(|file| file.winches(&file.compile()?).map(drop));
        let said = said.expect_err(to).to_string();
        assert!(
            said.contains(expected),
            "{to} said\n{said}\nnot\n{expected}"
        );
    }
}
