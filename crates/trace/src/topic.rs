//! Topics and the schemas they carry.

use std::collections::BTreeMap;

use foxglove::Encode;
use foxglove::messages::{FrameTransforms, Log, PointCloud, PoseInFrame, SceneUpdate};

use crate::record::{FactorRecord, Record, RigidRecord, StepRecord, TickRecord};

/// The channels of a trace.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Topic {
    /// Frames `tool`, `device` and those of rigid bodies, by their names, in `world`.
    Transforms,
    /// Pose of the tool.
    ToolPose,
    /// Shape of the tool, once.
    ToolShape,
    /// One sample per tick.
    HapticSample,
    /// One report per step.
    Step,
    /// Where each rigid body is after each step.
    RigidState,
    /// Shapes of fixed and rigid bodies, once.
    BodyShapes,
    /// One event per factorisation.
    Factor,
    /// Deformed surface of the tissue.
    TissueSurface,
    /// Nodes of the tissue with the magnitude of their displacement.
    TissueNodes,
    /// Log.
    Log,
}

/// What a schema record holds.
pub(crate) struct TopicSchema {
    pub(crate) name: String,
    /// Binary `FileDescriptorSet`.
    pub(crate) data: Vec<u8>,
    pub(crate) channel_metadata: BTreeMap<String, String>,
}

impl Topic {
    /// Every topic, in the order of their channels.
    pub const ALL: [Self; 11] = [
        Self::Transforms,
        Self::ToolPose,
        Self::ToolShape,
        Self::HapticSample,
        Self::Step,
        Self::RigidState,
        Self::BodyShapes,
        Self::Factor,
        Self::TissueSurface,
        Self::TissueNodes,
        Self::Log,
    ];

    /// Name in the file.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Transforms => "/tf",
            Self::ToolPose => "/tool/pose",
            Self::ToolShape => "/tool/shape",
            Self::HapticSample => "/haptic/sample",
            Self::Step => "/sim/step",
            Self::RigidState => "/rigid/state",
            Self::BodyShapes => "/body/shapes",
            Self::Factor => "/factor/event",
            Self::TissueSurface => "/tissue/surface",
            Self::TissueNodes => "/tissue/nodes",
            Self::Log => "/log",
        }
    }

    pub(crate) fn schema(self) -> TopicSchema {
        match self {
            Self::Transforms => foxglove_schema::<FrameTransforms>(),
            Self::ToolPose => foxglove_schema::<PoseInFrame>(),
            Self::ToolShape | Self::BodyShapes | Self::TissueSurface => foxglove_schema::<SceneUpdate>(),
            Self::TissueNodes => foxglove_schema::<PointCloud>(),
            Self::Log => foxglove_schema::<Log>(),
            Self::HapticSample => record_schema::<TickRecord>(),
            Self::Step => record_schema::<StepRecord>(),
            Self::RigidState => record_schema::<RigidRecord>(),
            Self::Factor => record_schema::<FactorRecord>(),
        }
    }
}

fn foxglove_schema<M: Encode>() -> TopicSchema {
    // The messages used here all have a schema; an empty one would make the file say so to its reader.
    let (name, data) = M::get_schema().map(|s| (s.name, s.data.into_owned())).unwrap_or_default();
    TopicSchema { name, data, channel_metadata: BTreeMap::new() }
}

fn record_schema<R: Record>() -> TopicSchema {
    TopicSchema {
        name: R::MESSAGE.full_name(),
        data: R::MESSAGE.file_descriptor_set(),
        channel_metadata: R::MESSAGE.channel_metadata(),
    }
}
