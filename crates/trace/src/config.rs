//! What a trace holds besides its records, and how it is written.

use std::collections::BTreeMap;
use std::time::{SystemTime, UNIX_EPOCH};

use crate::error::TraceError;
use crate::geometry::{BodyGeometry, SolidGeometry, ToolShape};

/// A file carried inside the trace: the scene, the rest mesh, a device preset.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Attachment {
    /// File name, such as `scene.toml`.
    pub name: String,
    /// Media type, such as `application/toml`.
    pub media_type: String,
    /// Content.
    pub data: Vec<u8>,
}

/// Description of a trace.
#[derive(Clone, Debug, PartialEq)]
pub struct TraceConfig {
    /// Unix time of the start of the run (ns); 0 (default) in lockstep, so that equal runs give equal bytes.
    /// [`TraceConfig::real_time`] takes the clock's.
    pub start_unix_ns: u64,
    /// Entries of the metadata record `engine`: version, scene, scene hash, seed, host, rates. The writer adds
    /// `start_unix_ns`.
    pub engine: BTreeMap<String, String>,
    /// Files carried inside the trace.
    pub attachments: Vec<Attachment>,
    /// Bodies whose nodes are traced, in the order of their nodes in the positions handed over. May be empty.
    pub bodies: Vec<BodyGeometry>,
    /// Fixed and rigid bodies. May be empty.
    pub solids: Vec<SolidGeometry>,
    /// Shape of the tool.
    pub tool: Option<ToolShape>,
    /// Every so many ticks a pose goes to `/tf` and `/tool/pose` (default 10: 100 Hz). At least 1.
    pub pose_stride: u64,
    /// Every so many steps the geometry is written (default 2: 15 Hz). At least 1.
    pub geometry_stride: u64,
    /// Data are handed to the system when the time of the records has gone on by this much (ns) (default 1 s): a run
    /// that is killed loses no more.
    pub flush_period_ns: u64,
    /// Ticks that may wait for the trace thread (default 8192: eight seconds). At least 1.
    pub tick_capacity: usize,
    /// Steps that may wait (default 256). At least 1.
    pub step_capacity: usize,
    /// Factorisations that may wait (default 256). At least 1.
    pub factor_capacity: usize,
    /// Lines of the log that may wait, for each of the two that speak (default 256). At least 1.
    pub log_capacity: usize,
    /// Buffers of node positions that go round (default 8). At least 1.
    pub geometry_buffers: usize,
}

impl Default for TraceConfig {
    fn default() -> Self {
        Self {
            start_unix_ns: 0,
            engine: BTreeMap::new(),
            attachments: Vec::new(),
            bodies: Vec::new(),
            solids: Vec::new(),
            tool: None,
            pose_stride: 10,
            geometry_stride: 2,
            flush_period_ns: 1_000_000_000,
            tick_capacity: 8192,
            step_capacity: 256,
            factor_capacity: 256,
            log_capacity: 256,
            geometry_buffers: 8,
        }
    }
}

impl TraceConfig {
    /// The default with the present time as start of the run.
    pub fn real_time() -> Self {
        let now = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
        Self { start_unix_ns: u64::try_from(now.as_nanos()).unwrap_or(u64::MAX), ..Self::default() }
    }

    /// Number of nodes of all bodies.
    pub fn node_count(&self) -> usize {
        self.bodies.iter().map(|body| body.rest_positions.len()).sum()
    }

    /// Number of bodies that move as a whole.
    pub fn rigid_count(&self) -> usize {
        self.solids.iter().filter(|solid| solid.moves).count()
    }

    pub(crate) fn validate(&self) -> Result<(), TraceError> {
        let at_least_one = [
            ("pose_stride", self.pose_stride),
            ("geometry_stride", self.geometry_stride),
            ("flush_period_ns", self.flush_period_ns),
            ("tick_capacity", self.tick_capacity as u64),
            ("step_capacity", self.step_capacity as u64),
            ("factor_capacity", self.factor_capacity as u64),
            ("log_capacity", self.log_capacity as u64),
            ("geometry_buffers", self.geometry_buffers as u64),
        ];
        for (what, value) in at_least_one {
            if value == 0 {
                let remedy = "it must be at least 1";
                return Err(TraceError::Config { what: what.into(), value: value.to_string(), remedy });
            }
        }
        self.bodies.iter().try_for_each(BodyGeometry::validate)?;
        self.tool.iter().chain(self.solids.iter().map(|solid| &solid.shape)).try_for_each(ToolShape::validate)
    }
}
