//! Instructions to several servos.

use std::time::Duration;

use tdcr_hw::clock::Clock;
use tdcr_hw::dynamixel::joined::sections;
use tdcr_hw::dynamixel::{Answers, Instruction, Item, PacketId};
use tdcr_hw::simulated::Fault;

use super::{Answer, Desk, id, setup};

const POSITIONS: (u16, u16) = (132, 4);

fn sync_read(answers: Answers, ids: &[u8]) -> Instruction<'_> {
    Instruction::SyncRead {
        answers,
        address: POSITIONS.0,
        length: POSITIONS.1,
        ids,
    }
}

fn who(answers: &[Answer]) -> Vec<u8> {
    answers.iter().map(|answer| answer.id.byte()).collect()
}

#[test]
fn all_answer_a_ping_spaced_by_their_ids() {
    let mut setup = setup("2m");
    setup.latency = Duration::ZERO;
    setup.servos[5].id = id(252);
    let mut desk = Desk::new(&setup);
    let mut ping = Vec::new();
    Instruction::Ping
        .encode(PacketId::Broadcast, &mut ping)
        .expect("a short frame");
    tdcr_hw::transport::Transport::write(&mut desk.bus, &ping).expect("it is plugged in");
    let heard = super::answers(&desk.listen(Duration::from_secs(1)));
    assert_eq!(who(&heard), [1, 2, 3, 4, 5, 252]);
    // The vendor's SDK listens for 252 statuses, and 3 ms each. The last patience found nothing.
    let window = Duration::from_micros(252 * (140 + 3000) + 16_000);
    let ended = desk.clock.now() - Duration::from_secs(1);
    assert!(
        ended < window && ended > window - Duration::from_millis(20),
        "{ended:?}"
    );
}

#[test]
fn a_sync_read_is_answered_in_its_order() {
    let mut desk = Desk::of("3m");
    let heard = desk.ask_all(PacketId::Broadcast, &sync_read(Answers::Each, &[9, 1, 4]));
    assert_eq!(who(&heard), [9, 1, 4]);
    assert!(heard.iter().all(|answer| answer.data == [0, 8, 0, 0])); // 2048
}

#[test]
fn one_that_is_silent_costs_no_other_ones_answer() {
    let mut desk = Desk::of("3m");
    desk.simulator.inject(Fault::Silent(id(4)));
    let heard = desk.ask_all(PacketId::Broadcast, &sync_read(Answers::Each, &[1, 4, 9]));
    assert_eq!(who(&heard), [1, 9]);
}

#[test]
fn a_fast_sync_read_is_one_status_with_chained_checksums() {
    let mut desk = Desk::of("3m");
    let instruction = sync_read(Answers::Fast, &[3, 7, 4]);
    let bytes = desk.exchange(PacketId::Broadcast, &instruction);
    assert_eq!(bytes.len(), 8 + 3 * 8);
    assert_eq!(bytes[..8], [0xFF, 0xFF, 0xFD, 0x00, 0xFE, 25, 0, 0x55]);
    let asked = [3, 7, 4].map(|number| (id(number), 4));
    let found: Vec<_> = sections(&bytes, asked).collect();
    assert_eq!(found.len(), 3);
    assert!(found.iter().all(|section| section.data == [0, 8, 0, 0]));
    // It is a frame, and ends before one that is silent.
    let heard = desk.ask_all(PacketId::Broadcast, &instruction);
    assert_eq!(who(&heard), [0xFE]);
    desk.simulator.inject(Fault::Silent(id(7)));
    let bytes = desk.exchange(PacketId::Broadcast, &instruction);
    let found: Vec<_> = sections(&bytes, asked).map(|section| section.id).collect();
    assert_eq!((bytes.len(), found), (16, vec![id(3)]));
}

#[test]
fn bulk_reads_and_writes_name_an_address_for_each() {
    let mut desk = Desk::of("2m");
    let rows = [1, 65, 0, 1, 0, 1, 2, 112, 0, 4, 0, 0x2C, 0x01, 0, 0];
    let heard = desk.ask_all(PacketId::Broadcast, &Instruction::BulkWrite { rows: &rows });
    assert_eq!(heard, []);
    assert_eq!(
        (desk.read(1, Item::Led), desk.read(2, Item::ProfileVelocity)),
        (1, 300)
    );
    let rows = [2, 112, 0, 4, 0, 1, 65, 0, 1, 0];
    for answers in [Answers::Each, Answers::Fast] {
        let read = Instruction::BulkRead {
            answers,
            rows: &rows,
        };
        let heard = desk.ask_all(PacketId::Broadcast, &read);
        match answers {
            Answers::Each => {
                assert_eq!(who(&heard), [2, 1]);
                assert_eq!(heard[0].data, [0x2C, 0x01, 0, 0]);
                assert_eq!(heard[1].data, [1]);
            }
            Answers::Fast => {
                let data = &heard[0].data;
                assert_eq!(data[..5], [2, 0x2C, 0x01, 0, 0]);
                assert_eq!(data[7..10], [0, 1, 1]);
            }
        }
    }
}

#[test]
fn a_sync_write_reaches_all_and_nobody_answers() {
    let mut desk = Desk::of("2m");
    let rows: Vec<u8> = (1..=6).flat_map(|id| [id, 1]).collect();
    let write = Instruction::SyncWrite {
        address: 65,
        length: 1,
        rows: &rows,
    };
    assert_eq!(desk.ask_all(PacketId::Broadcast, &write), []);
    for id in 1..=6 {
        assert_eq!(desk.read(id, Item::Led), 1);
    }
}

#[test]
fn registered_writes_of_all_act_at_once() {
    let mut desk = Desk::of("2m");
    for id in [1, 5] {
        let lamp = Instruction::RegWrite {
            address: 65,
            data: &[1],
        };
        assert!(desk.ask(id, &lamp).is_some());
    }
    assert_eq!(desk.ask_all(PacketId::Broadcast, &Instruction::Action), []);
    assert_eq!([1, 2, 5].map(|id| desk.read(id, Item::Led)), [1, 0, 1]);
}

#[test]
fn two_servos_of_one_id_talk_over_each_other() {
    let mut desk = Desk::of("2m");
    desk.write(2, Item::Led, 1);
    desk.write(2, Item::Id, 1);
    let read = Instruction::Read {
        address: 65,
        length: 1,
    };
    let bytes = desk.exchange(PacketId::Servo(id(1)), &read);
    assert_eq!(bytes.len(), 12);
    assert_eq!(super::answers(&bytes), []);
}
