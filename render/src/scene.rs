//! A scene: a sheet of triangles in a BVH, props, lamps and a sky, and the intersections of rays with them.

use crate::light::Sources;
use crate::surface::mesh::Mesh;
use crate::surface::props::Prop;
use crate::{Environment, Light, LightSampling};
use glam::{Vec3, Vec3A};
use obvhs::cwbvh::CwBvh;
use obvhs::ray::{Ray, RayHit};
use obvhs::triangle::Triangle;

/// Unit axes of the surface at a point: along u, along v, and the normal.
#[derive(Clone, Copy, Debug)]
pub struct Frame {
    /// Unit axes.
    pub axes: [Vec3; 3],
}

impl Frame {
    /// Components of `v` along the axes of the frame.
    pub fn local(&self, v: Vec3) -> [f32; 3] {
        self.axes.map(|a| a.dot(v))
    }

    /// The vector with the components `v` along the axes of the frame.
    pub fn world(&self, v: [f32; 3]) -> Vec3 {
        self.axes[0] * v[0] + self.axes[1] * v[1] + self.axes[2] * v[2]
    }
}

/// Intersection of a ray with the sheet.
#[derive(Clone, Copy, Debug)]
pub struct SurfacePoint {
    /// Distance along the ray [mm].
    pub t: f32,
    /// Position [mm].
    pub position: Vec3,
    /// Axes with the interpolated normal.
    pub frame: Frame,
    /// Unit normal of the triangle, on the side of the frame's normal.
    pub face: Vec3,
    /// Position on the cloth [um].
    pub uv_um: [f32; 2],
}

/// A sheet with its props and light sources.
pub struct Scene {
    bvh: CwBvh,
    triangles: Vec<Triangle>,
    /// Indices of the vertices, in the order of `triangles`.
    corners: Vec<[u32; 3]>,
    mesh: Mesh,
    /// Rectangular lamps.
    pub lights: Vec<Light>,
    /// Light from infinitely far.
    pub environment: Environment,
    /// Props beside the sheet.
    pub props: Vec<Prop>,
    /// Sampling of light.
    pub sampling: LightSampling,
}

/// First hit of a ray.
#[derive(Clone, Copy, Debug)]
pub(crate) enum SceneHit {
    /// The ray hits the sheet.
    Sheet(SurfacePoint),
    /// The ray hits a prop of this albedo.
    Prop(SurfacePoint, f32),
}

impl SceneHit {
    pub fn point(&self) -> &SurfacePoint {
        match self {
            SceneHit::Sheet(point) | SceneHit::Prop(point, _) => point,
        }
    }
}

/// A ray for the BVH. Adding 0 turns -0 into 0, because the BVH derives a ray's octant from the sign of the
/// inverse in one place and from the sign of the component in another.
fn ray(origin: Vec3, direction: Vec3, reach: f32) -> Ray {
    Ray::new(origin.into(), Vec3A::from(direction) + Vec3A::ZERO, 0.0, reach)
}

impl Scene {
    /// Builds the BVH over the triangles of `mesh`.
    pub fn new(mesh: Mesh, lights: Vec<Light>, environment: Environment) -> Scene {
        let v = |i: u32| Vec3A::from(mesh.positions[i as usize]);
        let triangles: Vec<Triangle> =
            mesh.triangles.iter().map(|t| Triangle { v0: v(t[0]), v1: v(t[1]), v2: v(t[2]) }).collect();
        let bvh = crate::surface::bvh::build(&triangles);
        let order = &bvh.primitive_indices;
        let corners = order.iter().map(|&i| mesh.triangles[i as usize]).collect();
        let triangles = order.iter().map(|&i| triangles[i as usize]).collect();
        let (props, sampling) = (Vec::new(), LightSampling::default());
        Scene { bvh, triangles, corners, mesh, lights, environment, props, sampling }
    }

    /// Scales the sides of all lamps by `times` about their centers and their radiance by `1 / times^2`, so
    /// that a distant point receives the same light.
    pub fn widen_lamps(&mut self, times: f32) {
        for light in &mut self.lights {
            light.corner += 0.5 * (1.0 - times) * (light.edges[0] + light.edges[1]);
            light.edges = light.edges.map(|edge| edge * times);
            light.radiance /= times * times;
        }
    }

    /// Lamps and sky as light sources.
    pub(crate) fn sources(&self) -> Sources<'_> {
        Sources { lights: &self.lights, environment: &self.environment, sampling: self.sampling }
    }

    /// Position on the cloth [um] in the middle of a triangle, chosen by a number in [0, 1).
    pub(crate) fn place_on_cloth(&self, u: f32) -> [f32; 2] {
        let Some(corners) = self.corners.get((u * self.corners.len() as f32) as usize) else { return [0.0; 2] };
        let [a, b, c] = corners.map(|k| self.mesh.uv_um[k as usize]);
        [(a[0] + b[0] + c[0]) / 3.0, (a[1] + b[1] + c[1]) / 3.0]
    }

    fn nearest(&self, origin: Vec3, direction: Vec3, reach: f32) -> Option<(usize, f32)> {
        let mut hit = RayHit::none();
        self.bvh.ray_traverse(ray(origin, direction, reach), &mut hit, |ray, i| self.triangles[i].intersect(ray));
        (hit.t < f32::INFINITY).then_some((hit.primitive_id as usize, hit.t))
    }

    /// Whether no surface occludes the point at distance `reach` along `direction` from `origin`.
    pub fn free(&self, origin: Vec3, direction: Vec3, reach: f32) -> bool {
        self.props.iter().all(|prop| prop.hit(origin, direction).is_none_or(|t| t >= reach))
            && self.bvh.ray_traverse_miss(ray(origin, direction, reach), |ray, i| self.triangles[i].intersect(ray))
    }

    /// First hit of a ray with the sheet or a prop; lamps do not count.
    pub(crate) fn first(&self, origin: Vec3, direction: Vec3) -> Option<SceneHit> {
        let sheet = self.meet(origin, direction);
        let reach = sheet.map_or(f32::INFINITY, |point| point.t);
        let prop = self
            .props
            .iter()
            .filter_map(|prop| prop.hit(origin, direction).filter(|t| *t < reach).map(|t| (t, prop)))
            .min_by(|a, b| a.0.total_cmp(&b.0));
        let Some((t, prop)) = prop else { return sheet.map(SceneHit::Sheet) };
        let position = origin + direction * t;
        let face = prop.normal(position);
        let x = face.any_orthonormal_vector();
        let frame = Frame { axes: [x, face.cross(x), face] };
        Some(SceneHit::Prop(SurfacePoint { t, position, frame, face, uv_um: [0.0; 2] }, prop.albedo))
    }

    /// First hit of a ray with the sheet.
    pub fn meet(&self, origin: Vec3, direction: Vec3) -> Option<SurfacePoint> {
        let (i, t) = self.nearest(origin, direction, f32::INFINITY)?;
        let corners = self.corners[i].map(|c| c as usize);
        let [a, b, c] = corners.map(|c| self.mesh.positions[c]);
        let position = origin + direction * t;
        let (e1, e2) = (b - a, c - a);
        let area = e1.cross(e2);
        let inverse = 1.0 / area.length_squared().max(1e-30);
        let v = (position - a).cross(e2).dot(area) * inverse;
        let w = e1.cross(position - a).dot(area) * inverse;
        let weights = [1.0 - v - w, v, w];
        let mut normal = Vec3::ZERO;
        let mut uv = [0.0; 2];
        for k in 0..3 {
            normal += self.mesh.normals[corners[k]] * weights[k];
            let at = self.mesh.uv_um[corners[k]];
            uv = [uv[0] + weights[k] * at[0], uv[1] + weights[k] * at[1]];
        }
        let mut face = area.normalize_or_zero();
        if face.dot(normal) < 0.0 {
            face = -face;
        }
        let mut normal = normal.normalize_or(face);
        // The shading normal must lie on the side of the face from which the ray comes; otherwise the face
        // normal replaces it.
        if normal.dot(direction) * face.dot(direction) <= 0.0 {
            normal = face;
        }
        // Direction of increasing u on the triangle.
        let [p, q, r] = corners.map(|c| self.mesh.uv_um[c]);
        let (du1, dv1, du2, dv2) = (q[0] - p[0], q[1] - p[1], r[0] - p[0], r[1] - p[1]);
        let determinant = du1 * dv2 - du2 * dv1;
        let along = (e1 * dv2 - e2 * dv1) * determinant.signum();
        let x = (along - normal * normal.dot(along)).normalize_or(normal.any_orthonormal_vector());
        let y = normal.cross(x);
        Some(SurfacePoint { t, position, frame: Frame { axes: [x, y, normal] }, face, uv_um: uv })
    }
}
