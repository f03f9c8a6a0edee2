//! Metals with measured indices, and the Fresnel reflectance of conductors.

/// A metal with measured indices of refraction. They are linear in the wavelength between the measurements
/// and constant beyond them (0.365 to 0.79 um).
///
/// Gold, silver and copper: P. B. Johnson and R. W. Christy, "Optical constants of the noble metals", Phys.
/// Rev. B 6, 4370 (1972). Aluminium: A. D. Rakic, "Algorithm for the determination of intrinsic optical
/// constants of metal films: application to aluminum", Appl. Opt. 34, 4755 (1995). Numbers from
/// refractiveindex.info (public domain).
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
#[non_exhaustive]
pub enum Metal {
    /// Au.
    Gold,
    /// Ag.
    Silver,
    /// Al.
    #[serde(alias = "aluminum")]
    Aluminium,
    /// Cu.
    Copper,
}

impl Metal {
    /// The metal with a name: "gold", "silver", "aluminium" (or "aluminum"), "copper"; `None` for other
    /// names.
    pub fn named(name: &str) -> Option<Metal> {
        match name {
            "gold" => Some(Metal::Gold),
            "silver" => Some(Metal::Silver),
            "aluminium" | "aluminum" => Some(Metal::Aluminium),
            "copper" => Some(Metal::Copper),
            _ => None,
        }
    }

    /// Real and imaginary index `[eta, kappa]` at a wavelength [um].
    pub fn index(self, lambda_um: f32) -> [f32; 2] {
        let table: &[[f32; 3]] = match self {
            Metal::Gold => &GOLD,
            Metal::Silver => &SILVER,
            Metal::Aluminium => &ALUMINIUM,
            Metal::Copper => &COPPER,
        };
        let next = table.partition_point(|row| row[0] < lambda_um).clamp(1, table.len() - 1);
        let (a, b) = (table[next - 1], table[next]);
        let t = ((lambda_um - a[0]) / (b[0] - a[0])).max(0.0).min(1.0);
        [a[1] + t * (b[1] - a[1]), a[2] + t * (b[2] - a[2])]
    }
}

/// Reflectance of a conductor of index `eta - i kappa` for unpolarized light at the cosine `cos` of the angle
/// of incidence.
#[inline]
pub fn conductor(cos: f32, [eta, kappa]: [f32; 2]) -> f32 {
    let cos2 = (cos * cos).min(1.0);
    let (sin2, cos) = (1.0 - cos2, cos.max(0.0).min(1.0));
    // a - i b is the root of (eta - i kappa)^2 - sin^2, the normal component of the wave vector in the metal.
    let real = eta * eta - kappa * kappa - sin2;
    let size = (real * real + 4.0 * eta * eta * kappa * kappa).sqrt();
    let a = (0.5 * (size + real)).max(0.0).sqrt();
    let s = (size + cos2 - 2.0 * a * cos) / (size + cos2 + 2.0 * a * cos).max(f32::MIN_POSITIVE);
    let (sum, mix) = (size * cos2 + sin2 * sin2, 2.0 * a * cos * sin2);
    let p = s * (sum - mix) / (sum + mix).max(f32::MIN_POSITIVE);
    (0.5 * (s + p)).max(0.0).min(1.0)
}

/// `[wavelength [um], eta, kappa]` (Johnson and Christy 1972).
const GOLD: [[f32; 3]; 16] = [
    [0.367_9, 1.48, 1.895],
    [0.381_5, 1.46, 1.933],
    [0.397_4, 1.47, 1.952],
    [0.413_3, 1.46, 1.958],
    [0.430_5, 1.45, 1.948],
    [0.450_9, 1.38, 1.914],
    [0.471_4, 1.31, 1.849],
    [0.495_9, 1.04, 1.833],
    [0.520_9, 0.62, 2.081],
    [0.548_6, 0.43, 2.455],
    [0.582_1, 0.29, 2.863],
    [0.616_8, 0.21, 3.272],
    [0.659_5, 0.14, 3.697],
    [0.704_5, 0.13, 4.103],
    [0.756, 0.14, 4.542],
    [0.821_1, 0.16, 5.083],
];

/// `[wavelength [um], eta, kappa]` (Johnson and Christy 1972).
const SILVER: [[f32; 3]; 16] = [
    [0.367_9, 0.07, 1.657],
    [0.381_5, 0.05, 1.864],
    [0.397_4, 0.05, 2.07],
    [0.413_3, 0.05, 2.275],
    [0.430_5, 0.04, 2.462],
    [0.450_9, 0.04, 2.657],
    [0.471_4, 0.05, 2.869],
    [0.495_9, 0.05, 3.093],
    [0.520_9, 0.05, 3.324],
    [0.548_6, 0.06, 3.586],
    [0.582_1, 0.05, 3.858],
    [0.616_8, 0.06, 4.152],
    [0.659_5, 0.05, 4.483],
    [0.704_5, 0.04, 4.838],
    [0.756, 0.03, 5.242],
    [0.821_1, 0.04, 5.727],
];

/// `[wavelength [um], eta, kappa]` (Johnson and Christy 1972).
const COPPER: [[f32; 3]; 16] = [
    [0.367_9, 1.36, 1.975],
    [0.381_5, 1.33, 2.045],
    [0.397_4, 1.32, 2.116],
    [0.413_3, 1.28, 2.207],
    [0.430_5, 1.25, 2.305],
    [0.450_9, 1.24, 2.397],
    [0.471_4, 1.25, 2.483],
    [0.495_9, 1.22, 2.564],
    [0.520_9, 1.18, 2.608],
    [0.548_6, 1.02, 2.577],
    [0.582_1, 0.7, 2.704],
    [0.616_8, 0.3, 3.205],
    [0.659_5, 0.22, 3.747],
    [0.704_5, 0.21, 4.205],
    [0.756, 0.24, 4.665],
    [0.821_1, 0.26, 5.18],
];

/// `[wavelength [um], eta, kappa]` (Rakic 1995).
const ALUMINIUM: [[f32; 3]; 12] = [
    [0.364_66, 0.398_77, 4.395_7],
    [0.413_28, 0.521_35, 5.000_8],
    [0.442_8, 0.607_9, 5.367_6],
    [0.476_87, 0.727_8, 5.778_1],
    [0.516_6, 0.873_4, 6.241_8],
    [0.563_57, 1.072_8, 6.783_9],
    [0.619_93, 1.366, 7.405_2],
    [0.652_25, 1.572_4, 7.735_4],
    [0.688_81, 1.830_1, 8.060_1],
    [0.729_32, 2.160_6, 8.356_5],
    [0.774_91, 2.615_4, 8.491_4],
    [0.794_78, 2.767_5, 8.386_6],
];
