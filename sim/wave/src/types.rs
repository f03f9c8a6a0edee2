//! The incident wave and the bodies that scatter it.

use num_complex::Complex64;
use std::f64::consts::TAU;

/// Complex number of the wave code.
pub type C64 = Complex64;

/// Wavelength and latitude of incidence, common to all sources of one solve.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Wave {
    /// Vacuum wavelength [um].
    pub lambda_um: f64,
    /// Latitude theta_i of the incidence [rad], in (-pi/2, pi/2).
    pub theta_i: f64,
}

impl Wave {
    /// Vacuum wavenumber k_0 [1/um].
    pub fn k0(&self) -> f64 {
        TAU / self.lambda_um
    }

    /// Axial wavenumber k_z = -k_0 sin theta_i [1/um], the same in every medium.
    pub fn kz(&self) -> f64 {
        -self.k0() * self.theta_i.sin()
    }

    /// Transverse wavenumber of the air outside [1/um], k_0 cos theta_i.
    pub fn k_rho(&self) -> f64 {
        self.k0() * self.theta_i.cos()
    }

    /// Transverse wavenumber [1/um] in a medium of complex `index`, with a non-negative imaginary part.
    pub fn k_rho_in(&self, index: C64) -> C64 {
        // eps - sin^2, without cancellation for air at grazing latitudes.
        let k = self.k0() * ((index - 1.0) * (index + 1.0) + self.theta_i.cos().powi(2)).sqrt();
        if k.im < 0.0 { -k } else { k }
    }
}

/// Polarization of the incident light, by the field that has an axial component.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Polarization {
    /// Electric field along `(-sin theta cos phi, -sin theta sin phi, cos theta)`: e != 0, h = 0.
    Tm,
    /// Electric field along `(-sin phi, cos phi, 0)`: h != 0, e = 0.
    Te,
}

/// Outline of a wall in its own frame. Counterclockwise; the solvers reverse clockwise ones.
#[derive(Clone, Debug, PartialEq)]
pub enum Shape {
    /// Circle about the origin.
    Circle {
        /// Radius [um].
        radius_um: f64,
    },
    /// Ellipse about the origin, first axis along x.
    Ellipse {
        /// Semi-axis along x [um].
        a_um: f64,
        /// Semi-axis along y [um].
        b_um: f64,
    },
    /// `z(t) = x + i y = sum c_k exp(i k t)`, t in [0, 2 pi).
    Fourier {
        /// `(k, c_k)`, c_k in um.
        coeffs: Vec<(i32, C64)>,
    },
    /// Polygon whose corners are replaced by circular arcs tangent to both edges.
    Polygon {
        /// Corners in order [um].
        points_um: Vec<[f64; 2]>,
        /// Radius of the arcs [um].
        rounding_um: f64,
    },
}

/// A homogeneous body bounded by a closed wall: a fiber, or the lumen inside of one. At most one lumen per
/// body, nested to any depth.
#[derive(Clone, Debug, PartialEq)]
pub struct Body {
    /// Outline of the wall.
    pub shape: Shape,
    /// Origin of the outline's frame in the scene [um].
    pub center_um: [f64; 2],
    /// Turn of the outline's frame [rad]: a point p of it lies at `center + Rot(rotation) p`.
    pub rotation_rad: f64,
    /// Real index.
    pub eta: f64,
    /// Imaginary index, >= 0.
    pub kappa: f64,
    /// The hollow (or filled) core.
    pub lumen: Option<Box<Body>>,
}

impl Body {
    /// Complex index eta + i kappa.
    pub fn index(&self) -> C64 {
        C64::new(self.eta, self.kappa)
    }
}
