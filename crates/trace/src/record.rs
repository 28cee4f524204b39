//! What a run leaves behind: one `Copy` struct per kind of record.
//!
//! [`record!`] declares a record, its protobuf message and its codec from one table, so that the three cannot drift.
//! Field numbers are the format: a field may be added under a new number, never renumbered.

mod factor;
mod log;
mod rigid;
mod step;
mod tick;

pub use factor::{FactorRecord, FactorStatus};
pub use log::{LogLevel, LogRecord};
pub use rigid::RigidRecord;
pub use step::{StepFlags, StepRecord};
pub use tick::{TickFlags, TickRecord};

use crate::schema::MessageDescription;
use crate::wire::WireError;

/// A record with a protobuf message of our own.
pub(crate) trait Record: Copy + Default {
    const MESSAGE: MessageDescription;

    /// Appends the message to `out`, every field, zeros too.
    fn encode(&self, out: &mut Vec<u8>);

    /// Fields that are missing keep their default, unknown ones are passed over.
    fn decode(message: &[u8]) -> Result<Self, WireError>;
}

/// Declares a record: `number => name: type, "unit";` per field.
macro_rules! record {
    (
        $(#[$meta:meta])*
        $Name:ident = $message:literal {
            $( $(#[$field_meta:meta])* $number:literal => $field:ident : $kind:ty, $unit:literal; )*
        }
    ) => {
        $(#[$meta])*
        #[derive(Clone, Copy, Debug, Default, PartialEq)]
        pub struct $Name {
            $( $(#[$field_meta])* pub $field: $kind, )*
        }

        impl $Name {
            /// Whether every field has the same bits, as a replay demands: NaN equals itself, -0.0 is not 0.0.
            pub fn same_bits(&self, other: &Self) -> bool {
                let (mut ours, mut theirs) = (Vec::new(), Vec::new());
                $crate::record::Record::encode(self, &mut ours);
                $crate::record::Record::encode(other, &mut theirs);
                ours == theirs
            }
        }

        impl $crate::record::Record for $Name {
            const MESSAGE: $crate::schema::MessageDescription = $crate::schema::MessageDescription {
                name: $message,
                fields: &[ $( $crate::schema::FieldDescription {
                    number: $number,
                    name: stringify!($field),
                    kind: <$kind as $crate::field::FieldValue>::KIND,
                    unit: $unit,
                    flags: <$kind as $crate::field::FieldValue>::FLAGS,
                } ),* ],
            };

            fn encode(&self, out: &mut Vec<u8>) {
                $( $crate::field::FieldValue::put(&self.$field, $number, out); )*
            }

            fn decode(message: &[u8]) -> Result<Self, $crate::wire::WireError> {
                let mut record = Self::default();
                for field in $crate::wire::fields(message) {
                    let (number, value) = field?;
                    match number {
                        $( $number => record.$field = $crate::field::FieldValue::get(value)
                            .ok_or($crate::wire::WireError::FieldType { message: $message, field: number })?, )*
                        _ => {}
                    }
                }
                Ok(record)
            }
        }
    };
}
pub(crate) use record;

/// Declares a set of flags: one bit per name, from bit 0.
macro_rules! flags {
    (
        $(#[$meta:meta])*
        $Name:ident { $( $(#[$bit_meta:meta])* $bit:literal => $CONST:ident; )* }
    ) => {
        $(#[$meta])*
        #[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
        pub struct $Name(
            /// The bits; bits without a name are kept.
            pub u32,
        );

        impl $Name {
            $( $(#[$bit_meta])* pub const $CONST: Self = Self(1 << $bit); )*

            /// The bits that have a name.
            pub const ALL: &'static [(&'static str, Self)] = &[ $( (stringify!($CONST), Self::$CONST) ),* ];

            /// Whether every bit of `other` is set.
            pub const fn contains(self, other: Self) -> bool {
                self.0 & other.0 == other.0
            }

            /// Sets the bits of `other` where `condition` holds.
            pub const fn set(&mut self, other: Self, condition: bool) {
                if condition {
                    self.0 |= other.0;
                }
            }
        }

        impl std::ops::BitOr for $Name {
            type Output = Self;

            fn bitor(self, other: Self) -> Self {
                Self(self.0 | other.0)
            }
        }

        impl $crate::field::FieldValue for $Name {
            const KIND: $crate::schema::FieldKind = $crate::schema::FieldKind::Uint32;
            const FLAGS: &'static [&'static str] = &[ $( stringify!($CONST) ),* ];

            fn put(&self, number: u32, out: &mut Vec<u8>) {
                $crate::field::FieldValue::put(&self.0, number, out);
            }

            fn get(value: $crate::wire::Value<'_>) -> Option<Self> {
                <u32 as $crate::field::FieldValue>::get(value).map(Self)
            }
        }
    };
}
pub(crate) use flags;

#[cfg(test)]
mod tests {
    use super::*;
    use crate::wire::{put_bytes, put_double, put_uint};

    /// The numbers are the format: each belongs to one field, and those of the first version have no gap.
    fn numbers_are_unique<R: Record>() {
        let numbers: Vec<_> = R::MESSAGE.fields.iter().map(|field| field.number).collect();
        let expected: Vec<_> = (1..=numbers.len() as u32).collect();
        assert_eq!(numbers, expected, "{}", R::MESSAGE.name);
    }

    #[test]
    fn each_field_has_its_own_number() {
        numbers_are_unique::<TickRecord>();
        numbers_are_unique::<StepRecord>();
        numbers_are_unique::<FactorRecord>();
        numbers_are_unique::<RigidRecord>();
    }

    #[test]
    fn channel_metadata_names_units_and_bits() {
        let metadata = TickRecord::MESSAGE.channel_metadata();
        assert_eq!(metadata["unit.force"], "N");
        assert_eq!(metadata["flags.bit00"], "FORCE_LIMITED");
        assert!(!metadata.contains_key("unit.contacts"));
        for (bit, (name, flag)) in StepFlags::ALL.iter().enumerate() {
            assert_eq!(flag.0, 1 << bit, "{name} is not bit {bit}, as the metadata of the channel says");
        }
        for (bit, (name, flag)) in TickFlags::ALL.iter().enumerate() {
            assert_eq!(flag.0, 1 << bit, "{name} is not bit {bit}, as the metadata of the channel says");
        }
    }

    #[test]
    fn a_reader_passes_over_new_fields_and_defaults_missing_ones() {
        let mut message = Vec::new();
        put_uint(&mut message, 1, 7);
        put_double(&mut message, 1000, 2.5);
        put_bytes(&mut message, 1001, b"later");
        let expected = TickRecord { tick: 7, ..TickRecord::default() };
        assert_eq!(TickRecord::decode(&message), Ok(expected));
    }

    /// A 0 would be told for a force without error.
    #[test]
    fn a_step_of_before_its_force_error_was_kept_has_none() {
        let mut message = Vec::new();
        put_uint(&mut message, 1, 7);
        let before = StepRecord::decode(&message);
        assert_eq!(before.map(|step| (step.step, step.force_error)), Ok((7, None)));
        put_double(&mut message, 38, 0.0);
        assert_eq!(StepRecord::decode(&message).map(|step| step.force_error), Ok(Some(0.0)));
    }

    #[test]
    fn a_field_of_another_type_is_named() {
        let mut message = Vec::new();
        put_double(&mut message, 13, 2.5);
        let error = WireError::FieldType { message: "HapticSample", field: 13 };
        assert_eq!(TickRecord::decode(&message), Err(error));
        let mut large = Vec::new();
        put_uint(&mut large, 13, 1 << 32);
        assert_eq!(TickRecord::decode(&large), Err(error), "a count beyond 32 bits is not cut");
    }

    #[test]
    fn same_bits_tells_zeros_apart_and_takes_nan_for_itself() {
        let record = TickRecord { gap: f64::NAN, force: [-0.0; 3], ..TickRecord::default() };
        assert!(record.same_bits(&record) && record != { record });
        assert!(!record.same_bits(&TickRecord { force: [0.0; 3], ..record }));
    }
}
