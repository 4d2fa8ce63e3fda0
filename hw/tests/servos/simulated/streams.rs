//! Whatever bytes come.

use std::time::Duration;

use proptest::prelude::*;
use tdcr_hw::clock::Clock;
use tdcr_hw::dynamixel::{Instruction, PacketId, crc16};
use tdcr_hw::transport::Transport;

use super::{Desk, id};

/// Bytes in which much looks like frames of all instructions.
fn bytes() -> impl Strategy<Value = Vec<u8>> {
    let noise = prop::collection::vec(any::<u8>(), 0..40);
    let frame = (
        prop_oneof![0u8..8, Just(0xFE), any::<u8>()],
        prop_oneof![
            prop::sample::select(vec![
                1u8, 2, 3, 4, 5, 6, 8, 0x10, 0x20, 0x55, 0x82, 0x83, 0x8A, 0x92, 0x93, 0x9A
            ]),
            any::<u8>()
        ],
        prop::collection::vec(prop_oneof![0u8..8, 60u8..150, any::<u8>()], 0..30),
        any::<bool>(),
    )
        .prop_map(|(id, instruction, parameters, whole)| {
            let mut frame = vec![0xFF, 0xFF, 0xFD, 0x00, id];
            frame.extend((parameters.len() as u16 + 3).to_le_bytes());
            frame.push(instruction);
            frame.extend(parameters);
            let crc = crc16(0, &frame).wrapping_add(u16::from(!whole));
            frame.extend(crc.to_le_bytes());
            frame
        });
    prop::collection::vec(prop_oneof![1 => noise, 5 => frame], 0..12)
        .prop_map(|parts| parts.concat())
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 400, ..ProptestConfig::default() })]

    #[test]
    fn no_bytes_stop_the_bus(parts in prop::collection::vec((bytes(), 0u64..40), 1..4)) {
        let mut desk = Desk::of("2m");
        let mut total = 0;
        for (part, milliseconds) in parts {
            desk.bus.write(&part).expect("it is plugged in");
            total += part.len();
            desk.clock.wait(Duration::from_millis(milliseconds));
            let heard = desk.listen(Duration::from_millis(150));
            // No instruction is answered by more than a hundred bytes for each of its own.
            prop_assert!(heard.len() <= 100 * total + 100);
        }
        for tendon in desk.simulator.truth().tendons {
            prop_assert!(tendon.tension >= 0.0 && tendon.tension.is_finite());
        }
        // Somebody who knows their id and baud rate can always talk to them again.
        desk.wait(1.0);
        let found = [1_000_000, 9_600, 57_600, 115_200, 2_000_000, 3_000_000, 4_000_000]
            .into_iter()
            .any(|rate| {
                desk.bus.set_baud_rate(rate);
                let mut ping = Vec::new();
                Instruction::Ping.encode(PacketId::Broadcast, &mut ping).expect("short");
                desk.bus.write(&ping).expect("it is plugged in");
                !super::answers(&desk.listen(Duration::from_secs(6))).is_empty()
            });
        prop_assert!(found);
    }
}

#[test]
fn a_writer_who_never_reads_fills_no_memory() {
    let mut desk = Desk::of("3m");
    let ids: Vec<u8> = (1..=9).collect();
    let mut read = Vec::new();
    let instruction = Instruction::SyncRead {
        answers: tdcr_hw::dynamixel::Answers::Each,
        address: 0,
        length: 147,
        ids: &ids,
    };
    instruction
        .encode(PacketId::Broadcast, &mut read)
        .expect("a short frame");
    for _ in 0..200 {
        desk.bus.write(&read).expect("it is plugged in");
        desk.wait(0.05);
    }
    // 200 times 9 times 158 bytes were said; the buffer has kept what fits.
    let heard = desk.listen(Duration::from_millis(10));
    assert!(
        heard.len() <= 16_384 && heard.len() > 10_000,
        "{}",
        heard.len()
    );
    // After that it talks as before; more bytes than fit at once hold their writer up.
    desk.bus.write(&vec![0; 100_000]).expect("it is plugged in");
    assert!(desk.clock.now() > Duration::from_secs(10));
    desk.wait(1.0);
    assert_eq!(
        desk.ask(5, &Instruction::Ping).map(|a| a.id),
        Some(PacketId::Servo(id(5)))
    );
}
