//! The progress line of a run.

use indicatif::{ProgressBar, ProgressStyle};
use palpate::run::Progress;

/// One line on the terminal: time, rates, contacts, force. Silent where standard error is no terminal.
pub(crate) struct ProgressLine {
    bar: ProgressBar,
}

impl ProgressLine {
    /// A line for a run of `seconds`.
    pub(crate) fn new(seconds: f64) -> Self {
        let bar = ProgressBar::new((1e3 * seconds) as u64);
        if let Ok(style) = ProgressStyle::with_template("{bar:12} {msg}") {
            bar.set_style(style);
        }
        Self { bar }
    }

    pub(crate) fn show(&self, p: &Progress) {
        self.bar.set_position((1e3 * p.time) as u64);
        let rates = match p.rates {
            Some([step, factor, tick]) => format!("step {step:4.1}  factor {factor:4.1}  tick {tick:4.0} Hz"),
            None => "virtual time".into(),
        };
        self.bar.set_message(format!("{:5.2} s  {rates}  {:2} contacts  {:4.2} N", p.time, p.contacts, p.force));
    }

    pub(crate) fn finish(&self) {
        self.bar.finish_and_clear();
    }
}
