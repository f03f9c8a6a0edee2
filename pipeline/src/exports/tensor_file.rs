//! Writes the tensor file of the EPFL's material database (RGL), which Mitsuba, pbrt, Falcor and Tekari read:
//! named arrays, little-endian, each at an offset that is a multiple of eight.

use std::borrow::Cow;

/// Elements of an array.
pub enum Numbers<'a> {
    /// Bytes.
    U8(Cow<'a, [u8]>),
    /// Single precision.
    F32(Cow<'a, [f32]>),
}

/// A named array.
pub struct Field<'a> {
    /// Name of the array.
    pub name: &'a str,
    /// Lengths of its axes, the last index fastest.
    pub shape: Vec<usize>,
    /// Elements of the array.
    pub numbers: Numbers<'a>,
}

impl<'a> Field<'a> {
    /// An array in single precision.
    pub fn f32(name: &'a str, shape: &[usize], numbers: impl Into<Cow<'a, [f32]>>) -> Field<'a> {
        Field { name, shape: shape.to_vec(), numbers: Numbers::F32(numbers.into()) }
    }

    /// An array of bytes.
    pub fn bytes(name: &'a str, bytes: impl Into<Cow<'a, [u8]>>) -> Field<'a> {
        let bytes = bytes.into();
        Field { name, shape: vec![bytes.len()], numbers: Numbers::U8(bytes) }
    }

    fn byte_count(&self) -> usize {
        match &self.numbers {
            Numbers::U8(bytes) => bytes.len(),
            Numbers::F32(numbers) => 4 * numbers.len(),
        }
    }
}

/// Bytes of a file with these arrays, version 1.0.
pub fn bytes(fields: &[Field<'_>]) -> Vec<u8> {
    let head = 18 + fields.iter().map(|f| 2 + f.name.len() + 2 + 1 + 8 + 8 * f.shape.len()).sum::<usize>();
    let aligned = |at: usize| at.next_multiple_of(8);
    let mut out = Vec::new();
    out.extend(b"tensor_file\0\x01\x00");
    out.extend((fields.len() as u32).to_le_bytes());
    let mut offset = aligned(head);
    for field in fields {
        out.extend((field.name.len() as u16).to_le_bytes());
        out.extend(field.name.as_bytes());
        out.extend((field.shape.len() as u16).to_le_bytes());
        out.push(match field.numbers {
            Numbers::U8(_) => 1,
            Numbers::F32(_) => 10,
        });
        out.extend((offset as u64).to_le_bytes());
        field.shape.iter().for_each(|n| out.extend((*n as u64).to_le_bytes()));
        offset = aligned(offset + field.byte_count());
    }
    for field in fields {
        out.resize(aligned(out.len()), 0);
        match &field.numbers {
            Numbers::U8(bytes) => out.extend(bytes.iter()),
            Numbers::F32(numbers) => numbers.iter().for_each(|v| out.extend(v.to_le_bytes())),
        }
    }
    out
}
