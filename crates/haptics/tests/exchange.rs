//! Hand-over between threads.

use palpate_haptics::exchange::{every, latest};

#[test]
fn the_reader_sees_the_newest_value_and_keeps_it() {
    let (mut writer, mut reader) = latest(&0_u64);
    assert!(!reader.has_new());
    assert!(!writer.send(1));
    assert!(writer.send(2), "1 was overwritten unread");
    assert_eq!(*reader.current(), 0);
    assert!(reader.has_new());
    assert!(reader.refresh());
    assert_eq!(*reader.current(), 2);
    assert!(!reader.refresh());
    assert_eq!(*reader.latest(), 2);
}

#[test]
fn values_filled_in_place_arrive_whole_across_threads() {
    // Every value holds one number throughout; a torn read would mix two.
    let (mut writer, mut reader) = latest(&[0_u64; 512]);
    let filler = std::thread::spawn(move || {
        for i in 1..=20_000 {
            writer.value_mut().fill(i);
            writer.publish();
        }
    });
    let mut last = 0;
    while last < 20_000 {
        let value = reader.latest();
        assert!(value.iter().all(|entry| *entry == value[0]));
        assert!(value[0] >= last, "values go forward");
        last = value[0];
    }
    filler.join().unwrap();
}

#[test]
fn a_full_ring_drops_and_counts_and_what_was_sent_arrives_in_order() {
    let (mut sender, mut receiver) = every::<u32>(4);
    let sent: Vec<bool> = (0..6).map(|i| sender.send(i)).collect();
    assert_eq!(sent, [true, true, true, true, false, false]);
    assert_eq!((sender.dropped(), receiver.dropped(), receiver.len()), (2, 2, 4));
    assert_eq!(std::iter::from_fn(|| receiver.receive()).collect::<Vec<_>>(), [0, 1, 2, 3]);
    assert!(receiver.is_empty() && !receiver.is_closed());
    drop(sender);
    assert!(receiver.is_closed());
}

#[test]
fn every_value_arrives_once_across_threads() {
    let (mut sender, mut receiver) = every::<u64>(64);
    let sending = std::thread::spawn(move || {
        let mut sent = 0;
        for i in 0..50_000 {
            sent += u64::from(sender.send(i));
        }
        (sent, sender.dropped())
    });
    let (mut received, mut last) = (0_u64, None);
    while !(receiver.is_closed() && receiver.is_empty()) {
        if let Some(value) = receiver.receive() {
            assert!(last < Some(value));
            last = Some(value);
            received += 1;
        }
    }
    let (sent, dropped) = sending.join().unwrap();
    assert_eq!((received, sent + dropped, dropped), (sent, 50_000, receiver.dropped()));
}
