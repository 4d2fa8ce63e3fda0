//! Limits and logs around a bus.

use std::sync::{Arc, Mutex};
use std::time::Duration;

use tdcr_hw::clock::VirtualClock;
use tdcr_hw::dynamixel::{Bus, BusSettings, Item, Model};
use tdcr_hw::servo::{
    Limited, Limits, Logged, Record, ServoBus, ServoError, ServoId, Setting, SharedLimits, Ticks,
    Torque,
};

use super::devices::{Device, Devices};

const LIMITS: Limits = Limits {
    min: Ticks(-1200),
    max: Ticks(6800),
    step: 100,
    current: 0.5,
};

fn three() -> Devices {
    Devices::new([1, 2, 3].map(|id| Device::new(id, Model::Xl330M288, 46)))
}

fn bus(devices: &mut Devices) -> Bus<&mut Devices> {
    Bus::new(devices, BusSettings::default())
}

fn ids() -> [ServoId; 3] {
    [1, 2, 3].map(|id| ServoId::new(id).unwrap())
}

fn limits(ids: impl IntoIterator<Item = ServoId>) -> SharedLimits {
    let limits = SharedLimits::default();
    limits.set(ids.into_iter().map(|id| (id, LIMITS)));
    limits
}

#[track_caller]
fn refused<T>(result: &Result<T, ServoError>, what: &str) {
    match result {
        Err(error @ ServoError::OutOfRange { .. }) => {
            assert!(error.to_string().contains(what), "{error}");
        }
        Err(error) => panic!("{error}"),
        Ok(_) => panic!("it was sent"),
    }
}

#[test]
fn goals_stay_within_their_limits_and_go_in_steps() {
    let mut devices = three();
    devices.device(1).set(Item::PresentPosition, 6750);
    let [one, two, three] = ids();
    let mut bus = Limited::new(bus(&mut devices), limits([one, two]));
    // From where they are; one servo has no limits, and gets no goals.
    let results = bus.set(Setting::GoalPositions(&[
        (one, Ticks(6801)),
        (two, Ticks(100)),
        (three, Ticks(0)),
    ]));
    refused(
        &results[0],
        "goal in ticks 6801 is not within -1200 to 6800",
    );
    assert!(results[1].is_ok());
    assert!(matches!(results[2], Err(ServoError::Unknown { id }) if id == three));
    // From the goal before, whether or not the servo has followed.
    let results = bus.set(Setting::GoalPositions(&[(two, Ticks(201))]));
    refused(&results[0], "step in ticks from one goal to the next 101");
    assert!(bus.set(Setting::GoalPositions(&[(two, Ticks(200))]))[0].is_ok());
    assert_eq!(bus.goal_positions(&[two])[0].as_ref().unwrap(), &Ticks(200));
    // Where torque goes off, a servo goes where it is pulled.
    assert!(bus.set(Setting::Torque(&[two], Torque::Off))[0].is_ok());
    refused(
        &bus.set(Setting::GoalPositions(&[(two, Ticks(200))]))[0],
        "step",
    );
}

#[test]
fn a_servo_beyond_its_limits_may_only_stay_or_come_nearer() {
    let mut devices = three();
    devices.device(1).set(Item::PresentPosition, 7000);
    let [one, ..] = ids();
    let mut bus = Limited::new(bus(&mut devices), limits([one]));
    refused(
        &bus.set(Setting::GoalPositions(&[(one, Ticks(7001))]))[0],
        "goal",
    );
    for goal in [7000, 6900, 6850, 6800, 6700] {
        assert!(bus.set(Setting::GoalPositions(&[(one, Ticks(goal))]))[0].is_ok());
    }
    refused(
        &bus.set(Setting::GoalPositions(&[(one, Ticks(6801))]))[0],
        "goal",
    );
}

#[test]
fn currents_stay_within_their_limits() {
    let mut devices = three();
    let [one, two, _] = ids();
    let mut bus = Limited::new(bus(&mut devices), limits([one]));
    let results = bus.set(Setting::GoalCurrents(&[(one, -0.5), (two, 0.1)]));
    assert!(results[0].is_ok());
    assert!(matches!(results[1], Err(ServoError::Unknown { .. })));
    for current in [0.51, -0.51, f64::NAN] {
        refused(
            &bus.set(Setting::GoalCurrents(&[(one, current)]))[0],
            "current in A",
        );
        refused(
            &bus.set(Setting::CurrentLimits(&[(one, current)]))[0],
            "current in A",
        );
    }
    drop(bus);
    assert_eq!(devices.device(1).get(Item::GoalCurrent), -500);
    assert_eq!(devices.device(1).get(Item::CurrentLimit), 1750);
}

#[test]
fn a_log_has_each_goal_and_reading_with_its_results() {
    let mut devices = three();
    let lines = Mutex::new(Vec::new());
    let sink = |_: Duration, record: Record| {
        let line = match record {
            Record::Set(Setting::GoalPositions(goals), results) => {
                format!("goals {} {}", goals.len(), results[1].is_ok())
            }
            Record::Set(Setting::Torque(ids, torque), _) => {
                format!("torque {} {torque:?}", ids.len())
            }
            Record::Present(ids, results) => {
                format!("present {} {}", ids.len(), results[0].is_ok())
            }
            Record::Ping(id, result) => format!("ping {id} {}", result.is_ok()),
            Record::Reboot(id, result) => format!("reboot {id} {}", result.is_ok()),
            other => format!("{other:?}"),
        };
        lines.lock().unwrap().push(line);
    };
    let limited = Limited::new(bus(&mut devices), limits([ids()[0]]));
    let mut bus = Logged::new(limited, Arc::new(VirtualClock::new()), sink);
    bus.ping(ids()[0]).unwrap();
    drop(bus.set(Setting::Torque(&ids(), Torque::On)));
    drop(bus.set(Setting::GoalPositions(&ids().map(|id| (id, Ticks(1))))));
    drop(bus.present(&ids()));
    bus.reboot(ids()[2]).unwrap();
    drop(bus);
    assert_eq!(
        lines.into_inner().unwrap(),
        [
            "ping 1 true",
            "torque 3 On",
            "goals 3 false",
            "present 3 true",
            "reboot 3 true"
        ]
    );
}

#[test]
fn decorators_stack_on_a_bus_of_any_kind() {
    let mut devices = three();
    let boxed: Box<dyn ServoBus + '_> = Box::new(bus(&mut devices));
    let limited = Limited::new(boxed, limits(ids()));
    let mut logged = Logged::new(limited, Arc::new(VirtualClock::new()), |_, _: Record| {});
    let bus: &mut dyn ServoBus = &mut logged;
    for result in bus.set(Setting::Watchdog(&ids(), Some(Duration::from_millis(200)))) {
        result.unwrap();
    }
    assert_eq!(bus.temperatures(&ids()).len(), 3);
}
