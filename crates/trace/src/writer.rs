//! The synchronous core: records in, MCAP out.

use std::collections::BTreeMap;
use std::path::Path;

use mcap::McapResult;

use crate::config::TraceConfig;
use crate::container::{Container, WriteReport};
use crate::error::TraceError;
use crate::geometry::ToolHinge;
use crate::record::{FactorRecord, LogRecord, RigidRecord, StepRecord, TickRecord};
use crate::ring::Skin;
use crate::scene_message::{body_shapes, frame_transforms, log, rigid_transform, tool_pose};
use crate::sink::TraceSink;
use crate::tissue_message::TissueMessages;
use crate::tool_message::{hinge_of, tool_shape};
use crate::topic::Topic;

/// Writes records as they come. Chunks are built in memory and handed over whole, so a file that is cut at any time
/// holds every chunk before the cut.
///
/// After an error the writer refuses further records; [`TraceWriter::finish`] closes what was whole. The sink should
/// not hold back what it is given.
pub struct TraceWriter<S: TraceSink> {
    container: Container<S>,
    /// What the tool's jaws turn about.
    hinge: Option<ToolHinge>,
    pose_stride: u64,
    /// Names of the bodies that move.
    rigid: Vec<String>,
    tissue: Option<TissueMessages>,
}

impl TraceWriter<std::fs::File> {
    /// Creates the file at `path`, replacing what was there.
    ///
    /// # Errors
    /// [`TraceError::Config`], [`TraceError::Create`] for a bad path, [`TraceError::Write`] for a full disk.
    pub fn create(path: &Path, config: &TraceConfig) -> Result<Self, TraceError> {
        Self::new(create_file(path)?, config)
    }
}

/// Creates the file at `path`, replacing what was there.
pub(crate) fn create_file(path: &Path) -> Result<std::fs::File, TraceError> {
    std::fs::File::create(path).map_err(|source| TraceError::Create { path: path.into(), source })
}

impl<S: TraceSink> TraceWriter<S> {
    /// Writes schemas, channels, metadata, attachments and the tool's shape to `sink`.
    ///
    /// # Errors
    /// [`TraceError::Config`] for a description that makes no sense, [`TraceError::Write`] when the sink refuses.
    pub fn new(sink: S, config: &TraceConfig) -> Result<Self, TraceError> {
        config.validate()?;
        let mut writer = Self {
            container: Container::new(sink, config)?,
            pose_stride: config.pose_stride,
            hinge: hinge_of(config.tool.as_ref()),
            rigid: config.solids.iter().filter(|s| s.moves).map(|s| s.name.clone()).collect(),
            tissue: (!config.bodies.is_empty()).then(|| TissueMessages::new(&config.bodies)),
        };
        let begun = writer.begin(config);
        writer.container.checked(begun)?;
        Ok(writer)
    }

    fn begin(&mut self, config: &TraceConfig) -> McapResult<()> {
        self.container.describe(config)?;
        if let Some(shape) = &config.tool {
            self.container.put_foxglove(Topic::ToolShape, 0, &tool_shape(shape, config.start_unix_ns))?;
        }
        if !config.solids.is_empty() {
            self.container.put_foxglove(Topic::BodyShapes, 0, &body_shapes(&config.solids, config.start_unix_ns))?;
        }
        self.container.flush()
    }

    /// Writes a tick, and its poses every `pose_stride` ticks.
    ///
    /// # Errors
    /// [`TraceError::Write`], as for every other method that writes.
    pub fn write_tick(&mut self, tick: &TickRecord) -> Result<(), TraceError> {
        let written = self.put_tick(tick);
        self.container.checked(written)
    }

    /// Writes a step.
    ///
    /// # Errors
    /// [`TraceError::Write`]
    pub fn write_step(&mut self, step: &StepRecord) -> Result<(), TraceError> {
        let written = self.container.put_record(Topic::Step, step.time_ns, step);
        self.container.checked(written)
    }

    /// Writes where a rigid body is, and the frame of its shape.
    ///
    /// # Errors
    /// [`TraceError::Write`]
    pub fn write_rigid(&mut self, body: &RigidRecord) -> Result<(), TraceError> {
        let written = self.put_rigid(body);
        self.container.checked(written)
    }

    /// Writes a factorisation.
    ///
    /// # Errors
    /// [`TraceError::Write`]
    pub fn write_factor(&mut self, factor: &FactorRecord) -> Result<(), TraceError> {
        let written = self.container.put_record(Topic::Factor, factor.time_ns, factor);
        self.container.checked(written)
    }

    /// Writes a line of the log.
    ///
    /// # Errors
    /// [`TraceError::Write`]
    pub fn write_log(&mut self, record: &LogRecord) -> Result<(), TraceError> {
        let message = log(record, self.container.unix_ns(record.time_ns));
        let written = self.container.put_foxglove(Topic::Log, record.time_ns, &message);
        self.container.checked(written)
    }

    /// Writes surface and nodes of all bodies from the positions of their nodes (m), `x, y, z` of each in the order of
    /// [`TraceConfig::bodies`]; none without bodies. `skin` is the first body's from now on, where it has changed.
    ///
    /// # Errors
    /// [`TraceError::Write`]
    pub fn write_positions(&mut self, time_ns: u64, skin: Option<&Skin>, positions: &[f64]) -> Result<(), TraceError> {
        let Some(tissue) = &mut self.tissue else { return Ok(()) };
        skin.iter().for_each(|triangles| tissue.change_skin(triangles));
        tissue.update(positions, self.container.unix_ns(time_ns));
        let written = self
            .container
            .put_foxglove(Topic::TissueSurface, time_ns, &tissue.surface)
            .and_then(|()| self.container.put_foxglove(Topic::TissueNodes, time_ns, &tissue.nodes));
        self.container.checked(written)
    }

    /// Writes a metadata record.
    ///
    /// # Errors
    /// [`TraceError::Write`]
    pub fn write_metadata(&mut self, name: &str, entries: BTreeMap<String, String>) -> Result<(), TraceError> {
        let written = self.container.put_metadata(name, entries);
        self.container.checked(written)
    }

    /// Closes the chunk and hands it to the system.
    ///
    /// # Errors
    /// [`TraceError::Write`]
    pub fn flush(&mut self) -> Result<(), TraceError> {
        let flushed = self.container.flush();
        self.container.checked(flushed)
    }

    /// Bytes handed to the sink so far.
    pub fn bytes(&self) -> u64 {
        self.container.bytes()
    }

    /// Writes indexes and statistics and closes the file.
    ///
    /// Where that fails, or something failed before, the sink is cut back to the last whole chunk and closed there
    /// without indexes, and the error is handed out beside the report. Where the sink refuses even this, the chunks
    /// remain readable by recovery tools.
    pub fn finish(self) -> (S, WriteReport, Option<TraceError>) {
        self.container.finish()
    }

    fn put_tick(&mut self, tick: &TickRecord) -> McapResult<()> {
        self.container.put_record(Topic::HapticSample, tick.time_ns, tick)?;
        if tick.tick.is_multiple_of(self.pose_stride) {
            let unix_ns = self.container.unix_ns(tick.time_ns);
            let transforms = frame_transforms(tick, self.hinge.as_ref(), unix_ns);
            self.container.put_foxglove(Topic::Transforms, tick.time_ns, &transforms)?;
            self.container.put_foxglove(Topic::ToolPose, tick.time_ns, &tool_pose(tick, unix_ns))?;
        }
        Ok(())
    }

    fn put_rigid(&mut self, body: &RigidRecord) -> McapResult<()> {
        self.container.put_record(Topic::RigidState, body.time_ns, body)?;
        let Some(name) = self.rigid.get(body.body as usize) else { return Ok(()) };
        let message = rigid_transform(name, body, self.container.unix_ns(body.time_ns));
        self.container.put_foxglove(Topic::Transforms, body.time_ns, &message)
    }
}
