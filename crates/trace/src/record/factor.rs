//! One refresh of the factor.

use super::record;
use crate::field::FieldValue;
use crate::schema::{EnumDescription, FieldKind};
use crate::wire::{Value, put_uint};

/// How a factorisation ended.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum FactorStatus {
    /// Not stated, or a value that this version does not know.
    #[default]
    Unknown,
    /// The factor was published.
    Ready,
    /// The matrix was indefinite; the last good factor stays.
    Indefinite,
    /// The matrix held a non-finite value; the last good factor stays.
    NonFinite,
}

static FACTOR_STATUS: EnumDescription =
    EnumDescription { name: "FactorStatus", values: &["UNKNOWN", "READY", "INDEFINITE", "NON_FINITE"] };

impl FieldValue for FactorStatus {
    const KIND: FieldKind = FieldKind::Enum(&FACTOR_STATUS);

    fn put(&self, number: u32, out: &mut Vec<u8>) {
        put_uint(out, number, *self as u64);
    }

    fn get(value: Value<'_>) -> Option<Self> {
        Some(match u64::get(value)? {
            1 => Self::Ready,
            2 => Self::Indefinite,
            3 => Self::NonFinite,
            _ => Self::Unknown,
        })
    }
}

record! {
    /// One factorisation of the system matrix in the background.
    FactorRecord = "Factor" {
        /// Number of the factor, from 1; 0 means none.
        1 => epoch: u64, "";
        /// Time since the start of the run when the factorisation ended (ns).
        2 => time_ns: u64, "ns";
        /// Time since the start of the run when its values were taken (ns).
        3 => taken_ns: u64, "ns";
        /// Step that its values were taken from.
        4 => taken_step: u64, "";
        /// Duration of the numeric factorisation (ns); 0 in lockstep.
        5 => duration_ns: u64, "ns";
        /// How it ended.
        6 => status: FactorStatus, "";
    }
}
