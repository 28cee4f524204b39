//! Bad paths are errors at set-up; a sink that fails later is reported once, and the run goes on.

use crate::sample;
use std::io::{self, Cursor, Write};

use palpate_trace::{InlineTrace, Topic, Trace, TraceConfig, TraceError, TraceReader, TraceSink, TraceThread};

#[test]
fn a_bad_path_is_named_at_set_up() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("missing").join("run.mcap");
    let error = TraceThread::spawn(&path, &sample::config()).unwrap_err();
    assert!(matches!(error, TraceError::Create { .. }), "{error}");
    let text = error.to_string();
    assert!(text.contains(&path.display().to_string()) && text.contains("No such file"), "{text}");
    assert!(matches!(TraceThread::spawn(folder.path(), &sample::config()), Err(TraceError::Create { .. })));
}

#[test]
fn a_config_without_sense_is_refused_before_the_file_is_touched() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.mcap");
    let refused = |change: fn(&mut TraceConfig), word: &str| {
        let mut config = sample::config();
        change(&mut config);
        let text = TraceThread::spawn(&path, &config).unwrap_err().to_string();
        assert!(text.contains(word), "{text}");
        assert!(!path.exists());
    };
    refused(|config| config.tick_capacity = 0, "tick_capacity is 0");
    refused(|config| config.geometry_stride = 0, "geometry_stride is 0");
    refused(|config| config.bodies[0].triangles[2][1] = 4, "triangle 2 of body 'tetrahedron' is 4");
    refused(
        |config| config.tool = Some(palpate_trace::ToolShape::Sphere { radius: -1.0 }),
        "radius of a tool or body is -1",
    );
    refused(
        |config| config.tool = Some(palpate_trace::ToolShape::Mesh { vertices: vec![], triangles: vec![[0, 1, 2]] }),
        "body 'tool'",
    );
}

#[cfg(target_os = "linux")]
#[test]
fn a_full_disk_is_reported_once_and_the_producers_go_on() {
    let (trace, mut ticks, mut steps, mut factors) = TraceThread::spawn("/dev/full", &sample::config()).unwrap();
    // Many more records than the rings hold: they only fit because the thread keeps emptying them.
    for k in 0..600 {
        while !sample::push_step(k, &mut ticks, &mut steps, &mut factors) {
            std::thread::yield_now();
        }
        if k % 100 == 99 {
            std::thread::sleep(std::time::Duration::from_millis(30));
        }
    }
    let failure = trace.take_failure().expect("the failure is reported while the run goes on");
    assert!(failure.to_string().contains("No space left on device"), "{failure}");
    assert!(trace.take_failure().is_none(), "and only once");
    assert!(trace.status().failed);
    let summary = trace.finish();
    assert!(summary.failure.is_some());
    assert!(summary.lost > 19_800, "{} records lost", summary.lost);
}

/// A disk with room for so many bytes.
#[derive(Debug)]
struct SmallDisk {
    data: Cursor<Vec<u8>>,
    room: usize,
}

impl Write for SmallDisk {
    fn write(&mut self, data: &[u8]) -> io::Result<usize> {
        let free = self.room - self.data.get_ref().len();
        if free == 0 && !data.is_empty() {
            return Err(io::ErrorKind::StorageFull.into());
        }
        self.data.write(&data[..data.len().min(free)])
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

impl TraceSink for SmallDisk {
    fn truncate(&mut self, length: u64) -> io::Result<()> {
        self.data.truncate(length)
    }
}

#[test]
fn a_disk_that_fills_during_the_run_leaves_a_readable_file() {
    // The whole run takes more than the largest of these. The first do not even hold the beginning.
    let whole = run(usize::MAX);
    assert!(whole.1.failure.is_none());
    let length = whole.0.unwrap().data.into_inner().len();
    for room in [0, 7, 100, 5_000].into_iter().chain((20_000..length).step_by(40_001)).chain([length - 1]) {
        let (sink, summary) = run(room);
        let failure = summary.failure.expect("the disk is too small").to_string();
        let Some(sink) = sink else {
            assert!(room <= 5_000, "with {room} bytes the beginning fits");
            continue;
        };
        let bytes = sink.data.into_inner();
        assert!(bytes.len() <= room, "{} bytes in a room of {room}", bytes.len());
        assert_eq!(summary.bytes, bytes.len() as u64, "{failure}");
        let (read, damage) = Trace::collect(TraceReader::new(Cursor::new(bytes.clone()), bytes.len() as u64, "disk"));
        assert!(damage.is_none(), "room {room}: {damage:?}");
        // What the summary promises is there, from the first tick on without a gap.
        let promised = summary.messages.iter().find(|(topic, _)| *topic == Topic::HapticSample).map_or(0, |(_, n)| *n);
        assert_eq!(read.ticks.len() as u64, promised);
        assert!(read.ticks.iter().map(|tick| tick.tick).eq(0..promised));
        // Where only the indexes did not fit, nothing is lost.
        assert!(summary.lost > 0 || promised == 200 * sample::TICKS_PER_STEP);
        assert!(failure.contains("after"), "{failure}");
    }
}

fn run(room: usize) -> (Option<SmallDisk>, palpate_trace::TraceSummary) {
    let disk = SmallDisk { data: Cursor::default(), room };
    let (mut trace, mut ticks, mut steps, mut factors) = InlineTrace::with_sink(disk, &sample::config()).unwrap();
    for k in 0..200 {
        assert!(sample::push_step(k, &mut ticks, &mut steps, &mut factors), "a full disk does not fill the rings");
        trace.drain();
    }
    trace.finish_into_sink()
}
