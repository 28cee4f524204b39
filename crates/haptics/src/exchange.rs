//! Hand-over between threads: "latest value" and "every value".
//!
//! Both are wait-free on either side, allocate at construction only, and never free on the reading thread: the three
//! buffers of [`latest`] go round, and the values of [`every`] are `Copy`.

#[cfg(loom)]
use loom::sync::{
    Arc,
    atomic::{AtomicU64, Ordering},
};
#[cfg(not(loom))]
use std::sync::{
    Arc,
    atomic::{AtomicU64, Ordering},
};

/// A "latest value" channel: the reader sees the newest published value, older ones are lost.
///
/// `initial` is cloned into each of the three buffers; give it its full capacity.
#[must_use]
pub fn latest<T: Clone + Send>(initial: &T) -> (Writer<T>, Reader<T>) {
    let (input, output) = triple_buffer::triple_buffer(initial);
    (Writer { input }, Reader { output })
}

/// Writing end of [`latest`].
#[derive(Debug)]
pub struct Writer<T: Send> {
    input: triple_buffer::Input<T>,
}

impl<T: Send> Writer<T> {
    /// The buffer to fill in place. It holds some older value: overwrite all of it.
    pub fn value_mut(&mut self) -> &mut T {
        self.input.input_buffer_mut()
    }

    /// Hands the buffer over. Returns whether a value was overwritten that nobody had read.
    pub fn publish(&mut self) -> bool {
        self.input.publish()
    }
}

impl<T: Copy + Send> Writer<T> {
    /// Publishes a small value. Returns whether an unread one was overwritten.
    pub fn send(&mut self, value: T) -> bool {
        *self.value_mut() = value;
        self.publish()
    }
}

/// Reading end of [`latest`].
#[derive(Debug)]
pub struct Reader<T: Send> {
    output: triple_buffer::Output<T>,
}

impl<T: Send> Reader<T> {
    /// Whether a value was published since the last [`Reader::refresh`].
    #[must_use]
    pub fn has_new(&self) -> bool {
        self.output.updated()
    }

    /// The value of the last refresh, though a newer one may wait.
    #[must_use]
    pub fn current(&self) -> &T {
        self.output.output_buffer()
    }

    /// Takes the newest value. Returns whether there was one.
    pub fn refresh(&mut self) -> bool {
        self.output.update()
    }

    /// Refreshes and returns the newest value, to be worked on in place: the buffer is the reader's until the next refresh.
    pub fn latest_mut(&mut self) -> &mut T {
        self.output.update();
        self.output.output_buffer_mut()
    }

    /// Refreshes and returns the newest value.
    pub fn latest(&mut self) -> &T {
        self.output.read()
    }
}

/// An "every value" channel: a ring that drops and counts when it is full.
#[must_use]
pub fn every<T: Copy + Send>(capacity: usize) -> (Sender<T>, Receiver<T>) {
    let (producer, consumer) = rtrb::RingBuffer::new(capacity);
    let dropped = Arc::new(AtomicU64::new(0));
    (Sender { producer, dropped: Arc::clone(&dropped) }, Receiver { consumer, dropped })
}

/// Sending end of [`every`].
#[derive(Debug)]
pub struct Sender<T> {
    producer: rtrb::Producer<T>,
    dropped: Arc<AtomicU64>,
}

impl<T: Copy + Send> Sender<T> {
    /// Sends a value; when the ring is full it is dropped and counted. Returns whether it was sent.
    pub fn send(&mut self, value: T) -> bool {
        let sent = self.producer.push(value).is_ok();
        if !sent {
            self.dropped.fetch_add(1, Ordering::Relaxed);
        }
        sent
    }

    /// Values dropped so far.
    #[must_use]
    pub fn dropped(&self) -> u64 {
        self.dropped.load(Ordering::Relaxed)
    }
}

/// Receiving end of [`every`].
#[derive(Debug)]
pub struct Receiver<T> {
    consumer: rtrb::Consumer<T>,
    dropped: Arc<AtomicU64>,
}

impl<T: Copy + Send> Receiver<T> {
    /// The oldest value not yet received.
    pub fn receive(&mut self) -> Option<T> {
        self.consumer.pop().ok()
    }

    /// Values that wait.
    #[must_use]
    pub fn len(&self) -> usize {
        self.consumer.slots()
    }

    /// Whether none waits.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.consumer.is_empty()
    }

    /// Values dropped so far because the ring was full.
    #[must_use]
    pub fn dropped(&self) -> u64 {
        self.dropped.load(Ordering::Relaxed)
    }

    /// Whether the sender is gone; values may still wait.
    #[must_use]
    pub fn is_closed(&self) -> bool {
        self.consumer.is_abandoned()
    }
}
