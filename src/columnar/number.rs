//! Number and boolean columns of other programs, such as an age or a count.

use parquet::{
    basic::{ConvertedType, LogicalType, Type as PhysicalType},
    schema::types::ColumnDescriptor,
};

/// How the numbers of a column are stored.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Number {
    /// Boolean.
    Truth,
    /// 32-bit integers.
    Int {
        is_signed: bool,
    },
    /// 64-bit integers.
    Long {
        is_signed: bool,
    },
    Float,
    Double,
}

/// Integer types as older writers declare them.
const SIGNED: [ConvertedType; 4] = [ConvertedType::INT_8, ConvertedType::INT_16, ConvertedType::INT_32, ConvertedType::INT_64];
const UNSIGNED: [ConvertedType; 4] =
    [ConvertedType::UINT_8, ConvertedType::UINT_16, ConvertedType::UINT_32, ConvertedType::UINT_64];

impl Number {
    /// Returns how a column stores numbers, or `None` for other columns. Dates and decimal fractions stored as integers also give `None`.
    pub(super) fn of(column: &ColumnDescriptor) -> Option<Self> {
        let converted = column.converted_type();
        let is_signed = match column.logical_type_ref() {
            Some(LogicalType::Integer(integer)) => integer.is_signed,
            None if UNSIGNED.contains(&converted) => false,
            None if converted == ConvertedType::NONE || SIGNED.contains(&converted) => true,
            _ => return None,
        };
        match column.physical_type() {
            PhysicalType::BOOLEAN => Some(Self::Truth),
            PhysicalType::INT32 => Some(Self::Int { is_signed }),
            PhysicalType::INT64 => Some(Self::Long { is_signed }),
            PhysicalType::FLOAT => Some(Self::Float),
            PhysicalType::DOUBLE => Some(Self::Double),
            PhysicalType::INT96 | PhysicalType::BYTE_ARRAY | PhysicalType::FIXED_LEN_BYTE_ARRAY => None,
        }
    }
}
