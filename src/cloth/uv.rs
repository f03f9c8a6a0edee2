//! Map from a surface's texture coordinates to the cloth's plane.

/// Placement of a cloth on a surface with texture coordinates (u, v): a scale, then a rotation. A host gives
/// directions in the frame (along u, along v, normal).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct UvMap {
    um_per_uv: [f64; 2],
    cos: f64,
    sin: f64,
}

impl UvMap {
    /// A map with `um_per_uv` um per unit of u and of v, whose x axis is rotated by `rotation_rad` from u
    /// towards v. Scales that are not finite count as 1 um, and such a rotation as 0 rad.
    pub fn new(um_per_uv: [f64; 2], rotation_rad: f64) -> UvMap {
        let (sin, cos) = if rotation_rad.is_finite() { rotation_rad.sin_cos() } else { (0.0, 1.0) };
        UvMap { um_per_uv: um_per_uv.map(|s| if s.is_finite() { s } else { 1.0 }), cos, sin }
    }

    /// Point of the cloth's plane [um] at (u, v).
    pub fn point_um(&self, uv: [f64; 2]) -> [f32; 2] {
        let [a, b] = [uv[0] * self.um_per_uv[0], uv[1] * self.um_per_uv[1]];
        [(a * self.cos + b * self.sin) as f32, (b * self.cos - a * self.sin) as f32]
    }

    /// Transforms a direction from the surface's frame to the cloth's.
    pub fn to_cloth(&self, w: [f32; 3]) -> [f32; 3] {
        let (c, s) = (self.cos as f32, self.sin as f32);
        [w[0] * c + w[1] * s, w[1] * c - w[0] * s, w[2]]
    }

    /// Transforms a direction from the cloth's frame to the surface's.
    pub fn to_surface(&self, w: [f32; 3]) -> [f32; 3] {
        let (c, s) = (self.cos as f32, self.sin as f32);
        [w[0] * c - w[1] * s, w[1] * c + w[0] * s, w[2]]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_turned_weft_runs_where_it_was_turned_to() {
        let map = UvMap::new([2000.0, 1000.0], 0.5);
        let w = [0.5f32.cos(), 0.5f32.sin(), 0.0];
        let along = map.to_cloth(w);
        assert!((along[0] - 1.0).abs() < 1e-6 && along[1].abs() < 1e-6, "{along:?}");
        let back = map.to_surface(map.to_cloth([0.3, -0.5, 0.81]));
        assert!((back[0] - 0.3).abs() < 1e-6 && (back[1] + 0.5).abs() < 1e-6 && back[2] == 0.81);
        // A step along the weft on the surface is a step along x.
        let step = map.point_um([f64::from(w[0]) / 2000.0, f64::from(w[1]) / 1000.0]);
        assert!((step[0] - 1.0).abs() < 1e-5 && step[1].abs() < 1e-5, "{step:?}");
        assert_eq!(UvMap::new([f64::NAN, 1.0], f64::INFINITY).point_um([3.0, 4.0]), [3.0, 4.0]);
    }
}
