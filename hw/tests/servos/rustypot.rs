//! The crate `rustypot`, unchanged, talks to simulated servos over a pseudo-terminal.

use std::error::Error;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;
use std::time::Duration;

use ::rustypot::DynamixelProtocolHandler;
use serialport::SerialPort;
use tdcr_hw::clock::SystemClock;
use tdcr_hw::servo::ServoId;
use tdcr_hw::simulated::{Fault, Simulator, SimulatorSetup, Terminal};
use tdcr_sim::robot::RobotSpec;

type Outcome = Result<(), Box<dyn Error>>;

/// Runs `talk` over a serial port at whose other end a 3m robot's servos are.
fn with_servos(talk: impl FnOnce(&mut dyn SerialPort, &Simulator) -> Outcome) -> Outcome {
    let robot = RobotSpec::standard("3m").ok_or("a standard robot")?;
    let setup = SimulatorSetup::of_robot(robot);
    let simulator = Simulator::new(&setup, Arc::new(SystemClock::new()))?;
    let mut terminal = Terminal::open(setup.baud_rate)?;
    let path = terminal.path().to_string_lossy().into_owned();
    let over = AtomicBool::new(false);
    thread::scope(|scope| {
        let served = scope.spawn(|| terminal.serve(&simulator, || over.load(Ordering::Relaxed)));
        let mut port = serialport::new(path, setup.baud_rate)
            .timeout(Duration::from_millis(100))
            .open()?;
        let talked = talk(port.as_mut(), &simulator);
        over.store(true, Ordering::Relaxed);
        served.join().map_err(|_| "the server panicked")??;
        talked
    })
}

const IDS: [u8; 9] = [1, 2, 3, 4, 5, 6, 7, 8, 9];
const GOAL_POSITION: u8 = 116;
const PRESENT_POSITION: u8 = 132;

#[test]
fn it_finds_reads_and_moves_them() -> Outcome {
    with_servos(|port, simulator| {
        let protocol = DynamixelProtocolHandler::v2();
        assert!(protocol.ping(port, 4)?);
        assert!(!protocol.ping(port, 40)?);
        assert_eq!(protocol.broadcast_ping(port)?, IDS);
        let positions = protocol.sync_read(port, &IDS, PRESENT_POSITION, 4)?;
        assert!(positions.iter().all(|data| data[..] == [0, 8, 0, 0]));
        // Extended position mode, torque on, goals 300 ticks further.
        for id in IDS {
            protocol.write(port, id, 11, &[4])?;
            protocol.write(port, id, GOAL_POSITION, &2048i32.to_le_bytes())?;
        }
        protocol.sync_write(port, &IDS, 64, &vec![vec![1]; 9])?;
        let goals = vec![2348i32.to_le_bytes().to_vec(); 9];
        protocol.sync_write(port, &IDS, GOAL_POSITION, &goals)?;
        thread::sleep(Duration::from_millis(700));
        for fast in [false, true] {
            let protocol = match fast {
                true => DynamixelProtocolHandler::v2().with_fast_sync_read(),
                false => DynamixelProtocolHandler::v2(),
            };
            let positions = protocol.sync_read_with_error(port, &IDS, PRESENT_POSITION, 4)?;
            for (data, error) in positions {
                let position = i32::from_le_bytes(data.as_slice().try_into()?);
                assert!(error.is_ok() && (position - 2348).abs() < 60, "{position}");
            }
        }
        assert!(
            simulator
                .truth()
                .tendons
                .iter()
                .all(|tendon| tendon.tension > 2.0)
        );
        Ok(())
    })
}

#[test]
fn it_sees_refusals_and_alerts() -> Outcome {
    with_servos(|port, simulator| {
        let protocol = DynamixelProtocolHandler::v2();
        // The model number is read only, and EEPROM is locked under torque.
        assert_eq!(
            protocol
                .write_with_error(port, 2, 0, &[0, 0])?
                .v2_instruction_error(),
            7
        );
        protocol.write(port, 2, 64, &[1])?;
        assert_eq!(
            protocol
                .write_with_error(port, 2, 11, &[3])?
                .v2_instruction_error(),
            7
        );
        assert_eq!(
            protocol
                .write_with_error(port, 2, 65, &[9])?
                .v2_instruction_error(),
            4
        );
        simulator.inject(Fault::Overheated(ServoId::new(2).ok_or("an id")?));
        thread::sleep(Duration::from_millis(20));
        let (errors, status) = protocol.read_with_error(port, 2, 70, 1)?;
        assert!(status.v2_alert());
        assert_eq!(errors, [1 << 2]);
        assert!(protocol.reboot(port, 2)?);
        Ok(())
    })
}
