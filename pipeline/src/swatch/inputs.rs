//! Two photographs, and what is known of their cloth.

use super::geometry::SwatchGeometry;
use super::photo::Photo;
use plywave_textile::NamedWeave;

/// What the user knows of a swatch.
#[derive(Clone, Debug, Default)]
pub struct SwatchKnown {
    /// A fiber of the library; otherwise cotton, and polyester for satins.
    pub fiber: Option<String>,
    /// The weave.
    pub weave: Option<NamedWeave>,
    /// Mass per area [g/m2].
    pub g_per_m2: Option<f64>,
    /// Ends and picks per centimeter.
    pub per_cm: [Option<f64>; 2],
    /// Linear density of warp and weft [tex].
    pub tex: Option<f64>,
}

/// Two photographs with what is known.
#[derive(Clone, Debug)]
pub struct SwatchInputs {
    /// The face, lit from the front, and with the lamp behind.
    pub photos: [Photo; 2],
    /// Camera and lamps.
    pub geometry: SwatchGeometry,
    /// What is known.
    pub known: SwatchKnown,
}
