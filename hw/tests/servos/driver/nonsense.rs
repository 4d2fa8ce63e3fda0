//! Streams of bytes that nobody meant: no panic, bounded memory, and every frame that is in them is found.

use proptest::prelude::*;
use proptest::test_runner::RngSeed;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use tdcr_hw::dynamixel::{
    Bus, BusSettings, Decoder, ErrorByte, Frame, FrameWriter, Instruction, Item, LastingChanges,
    MAX_FRAME, PacketId, STATUS, Span, Status,
};
use tdcr_hw::servo::{ServoBus, ServoId, Setting, Torque};

use super::noise::NoiseTransport;

/// The same cases in each run: garbage may hold a frame by chance, which swallows another.
fn seeded(cases: u32) -> ProptestConfig {
    ProptestConfig {
        cases,
        rng_seed: RngSeed::Fixed(16),
        ..ProptestConfig::default()
    }
}

/// A frame to hide: id, instruction, parameters.
type Hidden = (u8, u8, Vec<u8>);

/// Bytes of which headers are made occur often.
fn tricky_byte() -> impl Strategy<Value = u8> {
    prop_oneof![
        3 => Just(0xFF_u8),
        2 => Just(0xFD_u8),
        2 => Just(0x00_u8),
        1 => Just(STATUS),
        1 => 0..8_u8,
        3 => any::<u8>(),
    ]
}

fn hidden() -> impl Strategy<Value = Hidden> {
    let id = prop_oneof![0..=252_u8, Just(254)];
    (id, any::<u8>(), prop::collection::vec(tricky_byte(), 0..40)).prop_filter(
        "an answer of several servos is not stuffed",
        |(id, instruction, _)| (*id, *instruction) != (254, STATUS),
    )
}

fn encode((id, instruction, parameters): &Hidden) -> Vec<u8> {
    let mut bytes = Vec::new();
    let mut writer = FrameWriter::new(&mut bytes, PacketId::from_byte(*id).unwrap(), *instruction);
    writer.bytes(parameters);
    writer.finish().unwrap();
    bytes
}

/// All frames in a stream that arrives in pieces of `piece` bytes.
fn frames(stream: &[u8], piece: usize) -> Vec<Hidden> {
    fn keep(found: &mut Vec<Hidden>, frame: &Frame) {
        found.push((
            frame.id.byte(),
            frame.instruction,
            frame.parameters.to_vec(),
        ));
    }
    let mut decoder = Decoder::new();
    let mut found = Vec::new();
    for mut piece in stream.chunks(piece) {
        while !piece.is_empty() {
            let taken = decoder.fill(piece);
            assert!(taken > 0, "a decoder that has been emptied takes bytes");
            piece = &piece[taken..];
            while let Some(frame) = decoder.next_frame() {
                keep(&mut found, &frame);
            }
            assert!(decoder.pending().len() < MAX_FRAME);
        }
    }
    // Nothing more will come.
    while !decoder.pending().is_empty() {
        decoder.give_up();
        while let Some(frame) = decoder.next_frame() {
            keep(&mut found, &frame);
        }
    }
    found
}

proptest! {
    #![proptest_config(seeded(10_000))]

    #[test]
    fn every_frame_after_garbage_is_found(
        parts in prop::collection::vec((prop::collection::vec(tricky_byte(), 0..30), hidden()), 1..4),
        piece in 1..64_usize,
    ) {
        let mut stream = Vec::new();
        for (garbage, hidden) in &parts {
            stream.extend_from_slice(garbage);
            stream.extend_from_slice(&encode(hidden));
        }
        let found = frames(&stream, piece);
        // Garbage may hold a frame of its own; ours are all there, in order.
        let mut left = found.iter();
        for (_, hidden) in &parts {
            prop_assert!(left.any(|frame| frame == hidden), "{hidden:?} in {found:?}");
        }
    }

    #[test]
    fn parameters_survive_stuffing(hidden in hidden()) {
        let bytes = encode(&hidden);
        // Behind the header there is none.
        prop_assert!(!bytes[4..bytes.len() - 2].windows(4).any(|window| window == [0xFF, 0xFF, 0xFD, 0x00]));
        prop_assert_eq!(frames(&bytes, 64), [hidden]);
    }

    #[test]
    fn instructions_are_read_as_they_are_written_or_refused(
        instruction in any::<u8>(), parameters in prop::collection::vec(tricky_byte(), 0..30),
    ) {
        let frame = Frame { id: PacketId::Broadcast, instruction, parameters: &parameters };
        if let Ok(decoded) = Instruction::decode(&frame) {
            let mut bytes = Vec::new();
            decoded.encode(frame.id, &mut bytes).unwrap();
            prop_assert_eq!(frames(&bytes, 64), [(254, instruction, parameters)]);
        }
    }
}

/// One of very many short streams: frames with garbage before them.
fn short_stream(seed: u64) -> (Vec<u8>, Vec<Hidden>) {
    const TRICKY: [u8; 8] = [0xFF, 0xFF, 0xFF, 0xFD, 0xFD, 0x00, 0x00, STATUS];
    let rng = &mut ChaCha8Rng::seed_from_u64(seed);
    let byte = |rng: &mut ChaCha8Rng| match rng.random_range(0..12) {
        k @ 0..8 => TRICKY[k],
        _ => rng.random(),
    };
    let (mut stream, mut frames) = (Vec::new(), Vec::new());
    for _ in 0..rng.random_range(1..4) {
        stream.extend((0..rng.random_range(0..16)).map(|_| byte(rng)));
        let parameters = (0..rng.random_range(0..12)).map(|_| byte(rng)).collect();
        let frame = (rng.random_range(0..=252), rng.random(), parameters);
        stream.extend(encode(&frame));
        frames.push(frame);
    }
    (stream, frames)
}

proptest! {
    #![proptest_config(seeded(1_000_000))]

    #[test]
    fn every_frame_of_a_million_streams_is_found(seed in any::<u64>(), piece in 1..64_usize) {
        let (stream, hidden) = short_stream(seed);
        let found = frames(&stream, piece);
        let mut left = found.iter();
        prop_assert!(hidden.iter().all(|hidden| left.any(|frame| frame == hidden)));
    }
}

/// A million bytes at once, with long promises.
#[test]
fn a_long_stream_of_headers_costs_no_more_than_its_frames() {
    let hidden = (7, 3, vec![1, 2, 3]);
    let mut stream = Vec::new();
    for turn in 0..2_000_u32 {
        for step in 0..60 {
            let [low, high, ..] = (turn * 37 + step * 11).to_le_bytes();
            stream.extend_from_slice(&[0xFF, 0xFF, 0xFD, 0x00, 1, low, high & 3, STATUS]);
        }
        stream.extend_from_slice(&encode(&hidden));
    }
    assert!(stream.len() > 900_000);
    let found = frames(&stream, 256);
    // By chance one checksum in 65,536 fits.
    let ours = found.iter().filter(|&frame| *frame == hidden).count();
    assert!(ours >= 1_990, "{ours}");
    assert!(found.len() < ours + 20);
}

/// Statuses of the servos that are asked, among noise.
fn babble() -> impl Strategy<Value = Vec<u8>> {
    let status = (
        1..4_u8,
        any::<u8>(),
        prop::collection::vec(tricky_byte(), 0..24),
    )
        .prop_map(|(id, error, parameters)| {
            let mut bytes = Vec::new();
            let status = Status {
                id: PacketId::Servo(ServoId::new(id).unwrap()),
                error: ErrorByte(error),
                parameters: &parameters,
            };
            status.encode(&mut bytes).unwrap();
            bytes
        });
    let noise = prop::collection::vec(tricky_byte(), 0..20);
    prop::collection::vec(prop_oneof![3 => status, 1 => noise], 0..30)
        .prop_map(|parts| parts.concat())
}

proptest! {
    #![proptest_config(seeded(2_000))]

    #[test]
    fn a_driver_gives_one_result_for_each_servo_whatever_is_answered(bytes in babble()) {
        let settings = BusSettings { lasting_changes: LastingChanges::Allowed, ..BusSettings::default() };
        let mut bus = Bus::new(NoiseTransport::new(bytes), settings);
        let ids = [1, 2, 3].map(|id| ServoId::new(id).unwrap());
        drop(bus.ping(ids[0]));
        prop_assert_eq!(bus.present(&ids).len(), 3);
        prop_assert_eq!(bus.set(Setting::Torque(&ids, Torque::On)).len(), 3);
        prop_assert_eq!(bus.read_items(&ids, Item::GoalPosition).len(), 3);
        let spans = ids.map(|id| Span { id, address: 100 + u16::from(id.get()), length: 4 });
        prop_assert_eq!(bus.read_many(&spans).len(), 3);
        drop(bus.scan());
    }
}
