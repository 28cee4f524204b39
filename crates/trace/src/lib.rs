//! Records of a run and their traces.
//!
//! Every thread of a run hands small `Copy` records to a ring; the trace thread writes them to an MCAP file that
//! Foxglove, Rerun and the `mcap` packages of Python and C++ read. The crate knows records, not physics: who runs the
//! simulation converts its reports to [`TickRecord`], [`StepRecord`] and [`FactorRecord`].
//!
//! | topic | schema | rate |
//! | --- | --- | --- |
//! | `/haptic/sample` | `palpate.HapticSample` | every tick |
//! | `/sim/step` | `palpate.Step` | every step |
//! | `/factor/event` | `palpate.Factor` | every factorisation |
//! | `/tf`, `/tool/pose` | `foxglove.FrameTransforms`, `foxglove.PoseInFrame` | every `pose_stride` ticks; rigid bodies every step |
//! | `/rigid/state` | `palpate.RigidBody` | every step, for each rigid body |
//! | `/tissue/surface`, `/tissue/nodes` | `foxglove.SceneUpdate`, `foxglove.PointCloud` | every `geometry_stride` steps |
//! | `/tool/shape`, `/body/shapes` | `foxglove.SceneUpdate` | once |
//! | `/log` | `foxglove.Log` | as it comes |
//!
//! SI units; `f64` fields are doubles in the file, so a replay compares forces to the bit. The unit of each field is
//! in the metadata of its channel. Log time is `TraceConfig::start_unix_ns` plus the `time_ns` of the record.

mod announced;
mod chunk;
mod config;
mod container;
mod drain;
mod error;
mod field;
mod geometry;
mod metadata;
mod reader;
mod record;
mod ring;
mod scene_message;
mod schema;
mod sink;
mod summary;
mod thread;
mod tissue_message;
mod tool_message;
mod topic;
mod trace;
mod wire;
mod writer;

pub use config::{Attachment, TraceConfig};
pub use container::WriteReport;
pub use drain::InlineTrace;
pub use error::{LostPart, TraceError};
pub use geometry::{BodyGeometry, SolidGeometry, ToolHinge, ToolJaw, ToolPart, ToolShape};
pub use metadata::MetadataTrace;
pub use reader::{TraceEvent, TraceReader};
pub use record::{
    FactorRecord, FactorStatus, LogLevel, LogRecord, RigidRecord, StepFlags, StepRecord, TickFlags, TickRecord,
};
pub use ring::{FactorTrace, Offer, Skin, StepTrace, TickTrace};
pub use sink::TraceSink;
pub use summary::{Dropped, TraceStatus, TraceSummary};
pub use thread::TraceThread;
pub use topic::Topic;
pub use trace::Trace;
pub use wire::WireError;
pub use writer::TraceWriter;
