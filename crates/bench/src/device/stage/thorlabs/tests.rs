//! The protocol's bytes.

use proptest::prelude::*;

use super::*;

/// The answer to a question about a channel, of a unit.
fn told(id: u16, source: u8, data: &[u8]) -> Message {
    Message { id, dest: HOST, source, body: Body::Data([&[CHANNEL, 0], data].concat()) }
}

fn state(position: i32) -> Message {
    told(0x0491, USB_UNIT, &[&position.to_le_bytes()[..], &[0; 4], &0x8000_0400u32.to_le_bytes()].concat())
}

#[test]
fn messages_are_the_documents() {
    // "Move channel 1 to 200000": the document's example has a bay's address.
    let moves = Message::numbers(id::MOVE_ABSOLUTE, 0x22, &[200_000]);
    assert_eq!(moves.bytes(), [0x53, 0x04, 0x06, 0x00, 0xA2, 0x01, 0x01, 0x00, 0x40, 0x0D, 0x03, 0x00]);
    let stop = Message::short(id::STOP, 0x50, 1, Stop::Ramp as u8);
    assert_eq!(stop.bytes(), [0x65, 0x04, 0x01, 0x02, 0x50, 0x01]);
    for message in [moves, stop, state(-7)] {
        assert_eq!(Message::read(&message.bytes()), Some((message.clone(), message.bytes().len())));
    }
    assert_eq!(state(-7).long(2), Some(-7));
}

#[test]
fn an_answer_is_told_from_others_by_number_unit_and_channel() {
    let (apt, asked) = (Apt::default(), Message::short(id::REQ_SERVO, USB_UNIT, 1, 0).bytes());
    assert_eq!(apt.classify(&state(5), Some(&asked)), Kind::Last);
    assert_eq!(apt.classify(&state(5), None), Kind::Noise);
    let of_a_bay = Message { source: 0x21, ..state(5) };
    let of_another_channel = Message { body: Body::Data([&[2, 0], &state(5).data()[2..]].concat()), ..state(5) };
    for other in [of_a_bay, of_another_channel, Message { id: 0x0412, ..state(5) }] {
        assert_eq!(apt.classify(&other, Some(&asked)), Kind::Noise, "{other:?}");
    }
    for notice in [Message { id: id::COMPLETED, ..state(5) }, Message::read(&asked).unwrap().0] {
        assert_eq!(apt.classify(&notice, Some(&asked)), Kind::Notice, "{notice:?}");
    }
    // Which of the two is there is not known before.
    let who = [USB_UNIT, MAIN_BOARD].map(|unit| Message::short(id::REQ_INFO, unit, 0, 0).bytes()).concat();
    for (source, kind) in [(USB_UNIT, Kind::Last), (MAIN_BOARD, Kind::Last), (0x21, Kind::Noise)] {
        let info = Message { id: 0x0006, dest: HOST, source, body: Body::Data(vec![0; 84]) };
        assert_eq!(apt.classify(&info, Some(&who)), kind, "{source:#x}");
    }
}

#[test]
fn what_is_refused_in_words_ends_the_exchange_that_it_names() {
    let rich = |about: u16| {
        let mut data = [about.to_le_bytes(), 4u16.to_le_bytes()].concat();
        data.extend(b"invalid parameter");
        data.resize(68, 0);
        Message { id: id::RICH_RESPONSE, dest: HOST, source: USB_UNIT, body: Body::Data(data) }
    };
    let apt = Apt::default();
    let asked = Message::numbers(id::SET_SPEED, USB_UNIT, &[0, 1, 2]).bytes();
    let asked = [asked, Message::short(id::REQ_SPEED, USB_UNIT, 1, 0).bytes()].concat();
    assert_eq!(apt.classify(&rich(id::SET_SPEED), Some(&asked)), Kind::Refused);
    assert_eq!(apt.classify(&rich(id::MOVE_HOME), Some(&asked)), Kind::Notice);
    assert_eq!(apt.classify(&rich(0), None), Kind::Notice);
    assert_eq!(apt.text(&rich(0)), "error 4: invalid parameter");
}

proptest! {
    #[test]
    fn noise_costs_the_message_it_is_in_and_a_pause_ends_it(
        noise in proptest::collection::vec(any::<u8>(), 0..500), cut in 1usize..20,
    ) {
        let mut apt = Apt::default();
        for piece in noise.chunks(cut) {
            let _ = apt.frame(piece);
            prop_assert!(apt.bytes.len() < HEADER + MOST_DATA);
        }
        apt.gap();
        prop_assert_eq!(apt.frame(&state(5).bytes()), vec![state(5)]);
    }

    #[test]
    fn fragments_make_no_difference(cut in 1usize..30, positions in proptest::collection::vec(any::<i32>(), 1..9)) {
        let bytes: Vec<u8> = positions.iter().flat_map(|position| state(*position).bytes()).collect();
        let mut apt = Apt::default();
        let found: Vec<Message> = bytes.chunks(cut).flat_map(|piece| apt.frame(piece)).collect();
        prop_assert_eq!(found, positions.into_iter().map(state).collect::<Vec<_>>());
    }

    #[test]
    fn a_lost_byte_costs_its_message_and_the_next_even_without_a_pause(at in 0usize..20, position in 0i32..1000) {
        let mut bytes = state(position).bytes();
        bytes.remove(at);
        for _ in 0..4 {
            bytes.extend(state(position).bytes());
        }
        let found = Apt::default().frame(&bytes);
        let whole = found.iter().filter(|message| **message == state(position)).count();
        prop_assert!(whole >= 3, "{found:?}");
    }

    #[test]
    fn bytes_of_any_kind_are_cut_without_end(bytes in proptest::collection::vec(any::<u8>(), 0..300)) {
        for message in Message::all(&bytes) {
            let _ = (complaint(&message), message.subject());
        }
    }
}
