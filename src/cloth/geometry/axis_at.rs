//! The axis of a ply at a point along it.

/// The axis of the yarn or ply that light leaves, at one point along it.
pub struct AxisAt<T> {
    /// The point on the axis [um].
    pub center_um: [f32; 3],
    /// Unit tangent.
    pub axis: [f32; 3],
    /// Curvature vector [1/um].
    pub bend_per_um: [f32; 3],
    /// Radius of the ply [um].
    pub radius_um: f32,
    /// Identifies the yarn or ply, or its parameter.
    pub of: T,
}
