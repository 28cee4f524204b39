//! The hand-over between threads under loom: every order in which two threads may run, and every old value that a relaxed
//! load may return. Built by `cargo xtask test --only loom` with `exchange.rs` and the sources of the two crates under it,
//! their atomics replaced by loom's; no part of the crate's own tests.

use exchange_under_loom::exchange::{Receiver, every, latest};
use loom::sync::Arc;
use loom::sync::atomic::{AtomicUsize, Ordering};
use loom::thread;

/// Two numbers that belong together, written and read without any order of their own: only the hand-over orders them.
struct Pair(AtomicUsize, AtomicUsize);

impl Pair {
    fn set(&self, value: usize) {
        self.0.store(value, Ordering::Relaxed);
        self.1.store(10 * value, Ordering::Relaxed);
    }

    fn get(&self) -> usize {
        let (value, tenfold) = (self.0.load(Ordering::Relaxed), self.1.load(Ordering::Relaxed));
        assert_eq!(10 * value, tenfold, "half of a value was seen");
        value
    }
}

impl Clone for Pair {
    fn clone(&self) -> Self {
        Self(AtomicUsize::new(self.get()), AtomicUsize::new(10 * self.get()))
    }
}

#[test]
fn the_latest_value_is_whole_and_never_older_than_the_last_one_seen() {
    loom::model(|| {
        let initial = Pair(AtomicUsize::new(0), AtomicUsize::new(0));
        let (mut writer, mut reader) = latest(&initial);
        let writing = thread::spawn(move || {
            for value in 1..=2 {
                writer.value_mut().set(value);
                writer.publish();
            }
        });
        let mut last = 0;
        for _ in 0..2 {
            let told = reader.has_new();
            let new = reader.refresh();
            assert!(new || !told, "what was there cannot go");
            let value = reader.current().get();
            assert!(value >= last && (new || value == last), "{value} after {last}");
            last = value;
        }
        writing.join().unwrap();
        assert_eq!(reader.latest().get(), 2, "nothing newer is lost");
    });
}

#[test]
fn every_value_arrives_once_in_order_or_is_counted() {
    loom::model(|| {
        let cells: Vec<&'static AtomicUsize> = (0..3).map(|_| &*Box::leak(Box::new(AtomicUsize::new(0)))).collect();
        let (mut sender, mut receiver) = every::<(usize, &'static AtomicUsize)>(1);
        let sending = thread::spawn(move || {
            let mut sent = 0;
            for (k, cell) in cells.into_iter().enumerate() {
                // Seen by the receiver because it was written before it was sent.
                cell.store(k + 1, Ordering::Relaxed);
                sent += usize::from(sender.send((k, cell)));
            }
            sent
        });
        let mut received = Vec::new();
        let mut take = |receiver: &mut Receiver<(usize, &'static AtomicUsize)>| {
            while let Some((k, cell)) = receiver.receive() {
                assert_eq!(cell.load(Ordering::Relaxed), k + 1, "it came before its content");
                received.push(k);
            }
        };
        take(&mut receiver);
        let sent = sending.join().unwrap();
        take(&mut receiver);
        assert!(receiver.is_closed() && receiver.is_empty());
        assert!(received.is_sorted_by(|a, b| a < b), "{received:?}");
        assert_eq!((received.len(), receiver.dropped()), (sent, 3 - sent as u64));
    });
}

#[test]
fn drops_counted_by_one_thread_are_read_by_another() {
    loom::model(|| {
        let (mut sender, receiver) = every::<usize>(1);
        let done = Arc::new(AtomicUsize::new(0));
        let flag = Arc::clone(&done);
        let sending = thread::spawn(move || {
            (0..3).for_each(|k| _ = sender.send(k));
            flag.store(1, Ordering::Release);
            sender.dropped()
        });
        let finished = done.load(Ordering::Acquire) == 1;
        let seen = receiver.dropped();
        assert!(seen <= 2 && (!finished || seen == 2), "{seen}");
        assert_eq!((sending.join().unwrap(), receiver.dropped()), (2, 2));
    });
}
