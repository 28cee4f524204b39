//! The factor stage's way into the trace.

use palpate_fem::factor::FactorStatus;
use palpate_trace as trace;
use palpate_trace::FactorTrace;

use super::nanoseconds;
use crate::refresh::RefreshReport;

/// The factor stage's way into the trace.
pub(crate) struct FactorLine(pub(super) Option<FactorTrace>);

impl FactorLine {
    /// Hands a report over.
    pub(crate) fn push(&mut self, report: &RefreshReport, keep_times: bool) {
        let Some(line) = &mut self.0 else { return };
        let duration_ns = if keep_times { nanoseconds(report.work) } else { 0 };
        line.push(trace::FactorRecord {
            epoch: report.epoch,
            time_ns: nanoseconds(report.handed_over),
            taken_ns: nanoseconds(report.time),
            taken_step: report.step,
            duration_ns,
            status: match report.status {
                FactorStatus::Ok => trace::FactorStatus::Ready,
                FactorStatus::NonFinite { .. } => trace::FactorStatus::NonFinite,
                _ => trace::FactorStatus::Indefinite,
            },
        });
    }
}
