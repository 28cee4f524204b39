//! Writes a sample trace: `cargo run --release -p palpate-trace --example write_sample -- FILE [STEPS]`.
//!
//! 33 ticks a step; the same steps always give the same bytes.

use std::error::Error;
use std::io::Write;

use palpate_trace::InlineTrace;

#[path = "../tests/sample/mod.rs"]
mod sample;

fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments = std::env::args().skip(1);
    let path = arguments.next().ok_or("name the file to write")?;
    let count: u64 = arguments.next().map_or(Ok(300), |text| text.parse())?;
    let (mut trace, mut ticks, mut steps, mut factors) = InlineTrace::create(path.as_ref(), &sample::config())?;
    for k in 0..count {
        sample::push_step(k, &mut ticks, &mut steps, &mut factors);
        trace.drain();
    }
    Ok(writeln!(std::io::stdout(), "{}", trace.finish())?)
}
