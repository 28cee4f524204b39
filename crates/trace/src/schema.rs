//! Protobuf descriptors of our own messages, built from the same table as the records and their codec.

use std::collections::BTreeMap;

use foxglove::Encode;
use foxglove::messages::{Quaternion, Vector3};

use crate::wire::{put_bytes, put_uint};

/// Type of a field.
#[derive(Clone, Copy, Debug)]
pub(crate) enum FieldKind {
    Double,
    Uint64,
    Uint32,
    Sint32,
    Sint64,
    /// `foxglove.Vector3`
    Vector3,
    /// `foxglove.Quaternion`
    Quaternion,
    Enum(&'static EnumDescription),
}

/// A protobuf enumeration of package `palpate`; the first value is 0, as proto3 demands.
#[derive(Debug)]
pub(crate) struct EnumDescription {
    pub(crate) name: &'static str,
    pub(crate) values: &'static [&'static str],
}

/// One field of a message.
#[derive(Debug)]
pub(crate) struct FieldDescription {
    pub(crate) number: u32,
    pub(crate) name: &'static str,
    pub(crate) kind: FieldKind,
    /// SI unit; empty for counts and dimensionless numbers.
    pub(crate) unit: &'static str,
    /// Names of the bits, from bit 0, where the field is a set of flags.
    pub(crate) flags: &'static [&'static str],
}

/// One message of package `palpate`.
#[derive(Debug)]
pub(crate) struct MessageDescription {
    /// Name without the package.
    pub(crate) name: &'static str,
    pub(crate) fields: &'static [FieldDescription],
}

impl FieldKind {
    /// `FieldDescriptorProto.Type` and the full name of the type where it has one.
    fn descriptor_type(self) -> (u64, Option<String>) {
        match self {
            Self::Double => (1, None),
            Self::Uint64 => (4, None),
            Self::Vector3 => (11, Some(".foxglove.Vector3".into())),
            Self::Quaternion => (11, Some(".foxglove.Quaternion".into())),
            Self::Uint32 => (13, None),
            Self::Enum(description) => (14, Some(format!(".palpate.{}", description.name))),
            Self::Sint32 => (17, None),
            Self::Sint64 => (18, None),
        }
    }

    /// The file that defines the type, as a one-file `FileDescriptorSet`.
    fn dependency(self) -> Option<(&'static str, foxglove::Schema)> {
        match self {
            Self::Vector3 => Some(("foxglove/Vector3.proto", Vector3::get_schema()?)),
            Self::Quaternion => Some(("foxglove/Quaternion.proto", Quaternion::get_schema()?)),
            _ => None,
        }
    }
}

impl MessageDescription {
    /// Name with the package, as the schema record carries it.
    pub(crate) fn full_name(&self) -> String {
        format!("palpate.{}", self.name)
    }

    /// Binary `FileDescriptorSet`: the files this message depends on, then its own.
    ///
    /// Sets concatenate by concatenating their bytes, since a set is nothing but its repeated field `file`.
    pub(crate) fn file_descriptor_set(&self) -> Vec<u8> {
        let dependencies: BTreeMap<_, _> = self.fields.iter().filter_map(|field| field.kind.dependency()).collect();
        let mut file = Vec::new();
        put_bytes(&mut file, 1, format!("palpate/{}.proto", self.name).as_bytes());
        put_bytes(&mut file, 2, b"palpate");
        for name in dependencies.keys() {
            put_bytes(&mut file, 3, name.as_bytes());
        }
        put_bytes(&mut file, 4, &self.message_descriptor());
        for field in self.fields {
            if let FieldKind::Enum(description) = field.kind {
                put_bytes(&mut file, 5, &enum_descriptor(description));
            }
        }
        put_bytes(&mut file, 12, b"proto3");

        let mut set = Vec::new();
        for schema in dependencies.values() {
            set.extend_from_slice(&schema.data);
        }
        put_bytes(&mut set, 1, &file);
        set
    }

    fn message_descriptor(&self) -> Vec<u8> {
        const LABEL_OPTIONAL: u64 = 1;
        let mut message = Vec::new();
        put_bytes(&mut message, 1, self.name.as_bytes());
        for field in self.fields {
            let (kind, type_name) = field.kind.descriptor_type();
            let mut descriptor = Vec::new();
            put_bytes(&mut descriptor, 1, field.name.as_bytes());
            put_uint(&mut descriptor, 3, u64::from(field.number));
            put_uint(&mut descriptor, 4, LABEL_OPTIONAL);
            put_uint(&mut descriptor, 5, kind);
            if let Some(type_name) = type_name {
                put_bytes(&mut descriptor, 6, type_name.as_bytes());
            }
            put_bytes(&mut message, 2, &descriptor);
        }
        message
    }

    /// What the descriptor cannot say: units and names of bits, as metadata of the channel.
    pub(crate) fn channel_metadata(&self) -> BTreeMap<String, String> {
        let mut metadata = BTreeMap::new();
        for field in self.fields {
            if !field.unit.is_empty() {
                metadata.insert(format!("unit.{}", field.name), field.unit.to_owned());
            }
            for (bit, flag) in field.flags.iter().enumerate() {
                metadata.insert(format!("{}.bit{bit:02}", field.name), (*flag).to_owned());
            }
        }
        metadata
    }
}

fn enum_descriptor(description: &EnumDescription) -> Vec<u8> {
    let mut out = Vec::new();
    put_bytes(&mut out, 1, description.name.as_bytes());
    for (number, name) in description.values.iter().enumerate() {
        let mut value = Vec::new();
        put_bytes(&mut value, 1, name.as_bytes());
        put_uint(&mut value, 2, number as u64);
        put_bytes(&mut out, 2, &value);
    }
    out
}
