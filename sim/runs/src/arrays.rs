//! Results of shards: a part is a list of arrays, in the order of the job's layout, that are added over
//! shards. The layout has the name, shape, precision and range of each array.

use safetensors::tensor::Dtype;

/// The numbers of an array.
#[derive(Clone, Debug, PartialEq)]
pub enum Values {
    /// Single precision.
    F32(Vec<f32>),
    /// Double precision.
    F64(Vec<f64>),
}

impl Values {
    pub(super) fn len(&self) -> usize {
        match self {
            Values::F32(v) => v.len(),
            Values::F64(v) => v.len(),
        }
    }

    pub(super) fn dtype(&self) -> Dtype {
        match self {
            Values::F32(_) => Dtype::F32,
            Values::F64(_) => Dtype::F64,
        }
    }

    pub(super) fn bytes(&self) -> Vec<u8> {
        match self {
            Values::F32(v) => v.iter().flat_map(|v| v.to_le_bytes()).collect(),
            Values::F64(v) => v.iter().flat_map(|v| v.to_le_bytes()).collect(),
        }
    }

    fn add(&mut self, other: &Values) {
        match (self, other) {
            (Values::F32(to), Values::F32(from)) => to.iter_mut().zip(from).for_each(|(a, b)| *a += b),
            (Values::F64(to), Values::F64(from)) => to.iter_mut().zip(from).for_each(|(a, b)| *a += b),
            // All parts of a job have arrays of the same type.
            _ => {}
        }
    }
}

/// Layout of an array in a job's parts.
#[derive(Clone, Debug, PartialEq)]
pub struct ArrayLayout {
    /// Name of the array in the file.
    pub name: &'static str,
    /// Length of each axis; the last axis is the fastest.
    pub shape: Vec<usize>,
    /// Whether the array is of single precision.
    pub single: bool,
    /// Minimum and maximum plausible value.
    pub range: [f64; 2],
}

impl ArrayLayout {
    /// An array of double precision.
    pub fn f64(name: &'static str, shape: &[usize], range: [f64; 2]) -> ArrayLayout {
        ArrayLayout { name, shape: shape.to_vec(), single: false, range }
    }

    /// An array of single precision.
    pub fn f32(name: &'static str, shape: &[usize], range: [f64; 2]) -> ArrayLayout {
        ArrayLayout { name, shape: shape.to_vec(), single: true, range }
    }

    /// Number of values.
    pub fn len(&self) -> usize {
        self.shape.iter().product()
    }

    /// Whether the array has no values.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }
}

/// Result of a shard, or sum of the results of consecutive shards.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Part {
    /// Arrays in the order of the job's layout.
    pub arrays: Vec<Values>,
    /// Time of the work [s]; not part of the result.
    pub seconds: f64,
    /// Peak memory of the work [bytes]; not part of the result.
    pub peak_bytes: u64,
}

impl Part {
    /// A part of these arrays.
    pub fn new(arrays: Vec<Values>) -> Part {
        Part { arrays, seconds: 0.0, peak_bytes: 0 }
    }

    /// The values of array `at` of the layout; empty if it has another type.
    pub fn f32(&self, at: usize) -> &[f32] {
        match self.arrays.get(at) {
            Some(Values::F32(v)) => v,
            _ => &[],
        }
    }

    /// The values of array `at` of the layout in double precision; empty if it has another type.
    pub fn f64(&self, at: usize) -> &[f64] {
        match self.arrays.get(at) {
            Some(Values::F64(v)) => v,
            _ => &[],
        }
    }

    /// Adds the part of the next shard.
    pub fn add(&mut self, next: &Part) {
        self.arrays.iter_mut().zip(&next.arrays).for_each(|(to, from)| to.add(from));
        self.seconds += next.seconds;
        self.peak_bytes = self.peak_bytes.max(next.peak_bytes);
    }
}
