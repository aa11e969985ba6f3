//! Messages over a line: good, bad and endless ones.

use karst_core::{Bounds, Cluster, Estimates, FrameStatus, I18F14, Point, Spot};
use karst_link::*;
use karst_regs::MAX_BLOCK_WORDS;
use proptest::prelude::*;
use proptest::strategy::ValueTree;
use proptest::test_runner::TestRunner;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use crate::messages::{decode, frame, message, numbered_message};

/// `count` different messages, the same ones in every run.
fn messages(count: usize) -> Vec<Message> {
    let mut runner = TestRunner::deterministic();
    let strategy = numbered_message();
    (0..count).map(|_| strategy.new_tree(&mut runner).unwrap().current()).collect()
}

#[test]
fn one_percent_byte_errors_over_10_000_messages_let_no_wrong_message_through_and_lose_no_undamaged_one() {
    let sent = messages(10_000);
    let (mut encoder, mut decoder) = (Encoder::new(), Decoder::new());
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let (mut received, mut undamaged) = (Vec::new(), Vec::new());
    for message in &sent {
        let mut bytes = frame(&mut encoder, message);
        let mut damaged = false;
        for byte in &mut bytes {
            if rng.random_bool(0.01) {
                *byte ^= rng.random_range(1..=255_u8);
                damaged = true;
            }
        }
        if !damaged {
            undamaged.push(message.clone());
        }
        received.extend(decode(&mut decoder, &bytes));
    }
    // A frame with damage outside its content, in a delimiter, may be received as well: every message received must be
    // one that was sent, in order, and every undamaged one must be among them.
    let in_order = |part: &[Message], whole: &[Message]| {
        let mut rest = whole.iter();
        part.iter().all(|message| rest.any(|other| other == message))
    };
    assert!(in_order(&received, &sent));
    assert!(in_order(&undamaged, &received));
    assert!(undamaged.len() > 5_000 && undamaged.len() < 9_000, "{}", undamaged.len());
    let counters = decoder.counters();
    assert_eq!(counters.received as usize, received.len());
    // The last messages of a stream may be missing without a later one to tell
    let told = sent.len() - counters.received as usize - counters.lost as usize;
    assert!(told <= 8, "{told} messages neither received nor lost");
    assert!(counters.corrupt > 1_000);
    let silent = [counters.reordered, counters.duplicate, counters.unknown, counters.restarts];
    assert_eq!(silent, [0; 4]);
}

#[test]
fn gaps_duplicates_and_late_messages_are_counted_exactly() {
    let mut encoder = Encoder::new();
    let frames: Vec<Vec<u8>> = messages(200).iter().map(|message| frame(&mut encoder, message)).collect();
    let mut decoder = Decoder::new();
    // 3, 4 and 7 are lost; 5 comes after 6; 8 comes twice
    let order = [0, 1, 2, 6, 5, 8, 8, 9];
    let received: usize = order.iter().map(|&i| decode(&mut decoder, &frames[i]).len()).sum();
    assert_eq!(received, 7);
    let expected = LinkCounters { received: 7, lost: 3, reordered: 1, duplicate: 1, ..LinkCounters::default() };
    assert_eq!(decoder.counters(), expected);
    // A gap wider than the window, and then a number from before it
    decode(&mut decoder, &frames[199]);
    assert_eq!(decoder.counters().lost, 3 + 189);
    decode(&mut decoder, &frames[10]);
    assert_eq!(decoder.counters().restarts, 1);
}

#[test]
fn gaps_are_counted_across_the_wrap_of_the_sequence_number() {
    let (mut encoder, mut decoder) = (Encoder::new(), Decoder::new());
    let message = Message::Request(Request::Status);
    for number in 0..70_000_u32 {
        let bytes = frame(&mut encoder, &message);
        if !number.is_multiple_of(7) || number == 0 {
            decode(&mut decoder, &bytes);
        }
    }
    let counters = decoder.counters();
    assert_eq!((counters.received, counters.lost), (60_001, 9_999));
    assert_eq!((counters.restarts, counters.duplicate), (0, 0));
}

#[test]
fn a_hello_starts_the_numbering_again() {
    let mut decoder = Decoder::new();
    let hello = Message::Hello(Hello::new([0, 1, 0], 12));
    let request = Message::Request(Request::Status);
    for _ in 0..2 {
        let mut encoder = Encoder::new();
        for message in [&hello, &request, &request] {
            assert_eq!(&decode(&mut decoder, &frame(&mut encoder, message)), std::slice::from_ref(message));
        }
    }
    assert_eq!(decoder.counters(), LinkCounters { received: 6, ..LinkCounters::default() });
}

#[test]
fn an_oversize_frame_is_counted_once_and_the_next_frame_received() {
    let mut decoder = Decoder::new();
    let mut bytes = vec![1; 100_000];
    let message = Message::Request(Request::Hello);
    bytes.extend(frame(&mut Encoder::new(), &message));
    assert_eq!(decode(&mut decoder, &bytes), [message]);
    assert_eq!(decoder.counters(), LinkCounters { received: 1, oversize: 1, ..LinkCounters::default() });
}

#[test]
fn a_message_of_a_later_protocol_is_counted_as_unknown() {
    // Sequence number 0, message 100
    let content = [0, 100];
    let crc = crc::Crc::<u32>::new(&crc::CRC_32_ISO_HDLC).checksum(&content);
    let mut bytes = [0; 16];
    cobs::encode(&[&content[..], &crc.to_le_bytes()].concat(), &mut bytes);
    let mut decoder = Decoder::new();
    assert_eq!(decode(&mut decoder, &bytes), []);
    assert_eq!(decoder.counters(), LinkCounters { unknown: 1, ..LinkCounters::default() });
}

#[test]
fn a_short_buffer_is_refused_and_takes_no_sequence_number() {
    let mut encoder = Encoder::new();
    let message = Message::Request(Request::Status);
    let length = frame(&mut Encoder::new(), &message).len();
    for short in 0..length {
        assert_eq!(encoder.encode(&message, &mut vec![0; short]), Err(BufferTooSmall));
    }
    assert_eq!(encoder.encode(&message, &mut vec![0; length]), Ok(frame(&mut Encoder::new(), &message).as_slice()));
}

/// The longest of each kind of message: every number at the end of its range, every list full.
fn longest() -> [(&'static str, Message); 9] {
    let far = I18F14::MIN;
    let frame = u32::MAX;
    let point = Point {
        laser: u16::MAX,
        position: [far; 3],
        along: far,
        sigma: Some(far),
        chi2: Some(far),
        estimates: Estimates { mono: [Some(far); 2], stereo: Some(far) },
        spots: [Some(u8::MAX); 2],
    };
    let cluster = Cluster {
        pixels: u32::MAX,
        green: u32::MAX,
        saturated: u32::MAX,
        weight: u32::MAX,
        weight_x: u64::MAX,
        weight_y: u64::MAX,
        bounds: Bounds { x_min: u16::MAX, x_max: u16::MAX, y_min: u16::MAX, y_max: u16::MAX },
        radius_squared: u32::MAX,
    };
    let frame_status = FrameStatus {
        rows: u16::MAX,
        hits: u32::MAX,
        outside: u32::MAX,
        overflow: u32::MAX,
        damaged_rows: u16::MAX,
        excess_rows: u16::MAX,
        truncated: true,
    };
    let link = LinkCounters {
        received: u32::MAX,
        lost: u32::MAX,
        corrupt: u32::MAX,
        oversize: u32::MAX,
        reordered: u32::MAX,
        duplicate: u32::MAX,
        unknown: u32::MAX,
        restarts: u32::MAX,
    };
    let status = Status {
        uptime_ms: u32::MAX,
        frames: u32::MAX,
        dropped_frames: u32::MAX,
        points: u32::MAX,
        errors: Errors::default(),
        link,
        calibration: Some(u32::MAX),
    };
    let words = heapless::Vec::from_array([u32::MAX; MAX_BLOCK_WORDS]);
    let part = CalibrationPart { crc: u32::MAX, lasers: u16::MAX, number: u16::MAX, words };
    let missing = TransferState::Missing(heapless::Vec::from_slice(&[u16::MAX; MAX_MISSING]).unwrap());
    let spot = Spot { position: [far; 2], variance: u32::MAX, cluster };
    let text = "x".repeat(MAX_LOG_TEXT).as_str().try_into().unwrap();
    [
        ("Hello", Message::Hello(Hello::new([u8::MAX; 3], u16::MAX))),
        ("Settings", Message::Settings(Settings { trigger_period_us: u32::MAX, ..Settings::default() })),
        ("Calibration", Message::Calibration(part)),
        ("CalibrationReply", Message::CalibrationReply(CalibrationReply { crc: u32::MAX, state: missing })),
        ("Laser", Message::Laser(LaserResult { frame, laser: u16::MAX, result: Ok(point) })),
        ("Spot", Message::Spot(LaserSpot { frame, camera: u8::MAX, laser: u16::MAX, spot })),
        (
            "FrameEnd",
            Message::FrameEnd(FrameEnd { frame, lasers: u16::MAX, spots: u16::MAX, detectors: [frame_status; 2] }),
        ),
        ("Status", Message::Status(status)),
        ("Log", Message::Log(Log { level: LogLevel::Error, text })),
    ]
}

#[test]
fn the_longest_messages_fit_a_frame_and_have_the_lengths_of_the_readme() {
    let readme = include_str!("../../README.md");
    for (name, message) in longest() {
        // At the end of the range of sequence numbers
        let mut encoder = Encoder::new();
        for _ in 0..u16::MAX {
            frame(&mut encoder, &Message::Request(Request::Status));
        }
        let bytes = frame(&mut encoder, &message).len();
        assert!(bytes <= MAX_FRAME, "{name}: {bytes}");
        assert!(readme.contains(&format!("| `{name}` | {bytes} |")), "{name}: {bytes} bytes");
    }
}

#[test]
fn a_decoder_takes_less_than_384_bytes() {
    assert!(size_of::<Decoder>() < 384, "{}", size_of::<Decoder>());
}

#[test]
fn two_ends_agree_on_the_newest_protocol_that_both_speak() {
    let speaks =
        |oldest_protocol, newest_protocol| Hello { oldest_protocol, newest_protocol, program: [0, 1, 0], lasers: 12 };
    assert_eq!(speaks(1, 3).agree(&speaks(2, 5)), Ok(3));
    assert_eq!(speaks(2, 5).agree(&speaks(1, 3)), Ok(3));
    let error = speaks(1, 2).agree(&speaks(3, 4)).unwrap_err();
    assert_eq!(error, Incompatible { ours: [1, 2], theirs: [3, 4] });
    assert!(error.to_string().contains("protocol 3 to 4"));
}

proptest! {
    #[test]
    fn the_sensor_hears_commands_as_the_host_sends_them(messages in prop::collection::vec(message(), 1..20)) {
        let mut encoder = Encoder::new();
        let (mut decoder, mut expected, mut others) = (Decoder::<Command>::new(), Vec::new(), 0);
        let mut commands = Vec::new();
        for message in messages {
            decoder.feed(&frame(&mut encoder, &message), |command| commands.push(command));
            match message {
                Message::Hello(hello) => expected.push(Command::Hello(hello)),
                Message::Request(request) => expected.push(Command::Request(request)),
                Message::Settings(settings) => expected.push(Command::Settings(settings)),
                Message::Calibration(part) => expected.push(Command::Calibration(part)),
                _ => others += 1,
            }
        }
        prop_assert_eq!(commands, expected);
        prop_assert_eq!(decoder.counters().unknown, others);
    }

    #[test]
    fn every_message_comes_back_as_it_was(messages in prop::collection::vec(message(), 1..20)) {
        let (mut encoder, mut decoder) = (Encoder::new(), Decoder::new());
        for message in &messages {
            prop_assert_eq!(&decode(&mut decoder, &frame(&mut encoder, message)), std::slice::from_ref(message));
        }
        prop_assert_eq!(
            decoder.counters(),
            LinkCounters { received: messages.len() as u32, ..LinkCounters::default() }
        );
    }

    #[test]
    fn chunks_do_not_matter(
        messages in prop::collection::vec(message(), 1..10),
        noise in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 0..10),
        chunk in 1_usize..300,
    ) {
        let mut encoder = Encoder::new();
        let mut bytes: Vec<u8> = messages.iter().flat_map(|message| frame(&mut encoder, message)).collect();
        for (place, byte) in noise {
            let place = place.index(bytes.len());
            bytes[place] = byte;
        }
        let (mut whole, mut chunked) = (Decoder::new(), Decoder::new());
        let expected = decode(&mut whole, &bytes);
        let mut received = Vec::new();
        for part in bytes.chunks(chunk) {
            received.extend(decode(&mut chunked, part));
        }
        prop_assert_eq!(received, expected);
        prop_assert_eq!(chunked.counters(), whole.counters());
    }

    #[test]
    fn after_any_bytes_the_next_frame_is_received(
        bytes in prop::collection::vec(prop_oneof![3 => any::<u8>(), 1 => Just(0_u8)], 0..2000),
        message in message(),
    ) {
        let mut decoder = Decoder::new();
        decode(&mut decoder, &bytes);
        // The end of the noise may be the beginning of a frame: the leading delimiter ends it
        prop_assert_eq!(decode(&mut decoder, &frame(&mut Encoder::new(), &message)), [message]);
    }
}
