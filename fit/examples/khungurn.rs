//! From a photographed swatch to a fiber, and from one fiber model to another.
//!
//! ```sh
//! cargo run --release -p plywave-fit --example khungurn
//! ```

use plywave::color::RGB_LAMBDA_UM;
use plywave::fiber::dual_scattering::{DualOptions, DualScattering};
use plywave::fiber::{KhungurnFiber, KhungurnParameters, RoughDielectricFiber, RoughDielectricParameters};
use plywave::frame::direction;
use plywave::{FiberModel, FiberQuery};
use plywave_fit::{SwatchOptions, SwatchSample, fit_khungurn, fit_khungurn_swatch};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    // Linear red, green and blue of an opaque swatch of aligned fibers beside a white standard, lit from above.
    let photographed = [0.42, 0.11, 0.09];
    let samples: Vec<SwatchSample> = RGB_LAMBDA_UM
        .iter()
        .zip(photographed)
        .map(|(lambda, reflectance)| SwatchSample { theta_i: 0.0, lambda_um: f64::from(*lambda), reflectance })
        .collect();
    let start = KhungurnParameters { gamma_tt: 0.5, ..Default::default() };
    let fit = fit_khungurn_swatch(&samples, &SwatchOptions::default(), &start)?;
    println!("C_TT of the swatch: {:?}", fit.parameters.c_tt);

    let fiber: FiberModel = KhungurnFiber::new(fit.parameters)?.into();
    let query = FiberQuery::new(direction(0.0, 0.0), RGB_LAMBDA_UM);
    let dual = DualScattering::new(&fiber, &query, DualOptions::default())?;
    println!("photographed {photographed:.3?}, of the fitted fibers {:.3?}", dual.reflectance(0.0));

    // A rough dielectric hair in Khungurn's terms.
    let hair = RoughDielectricParameters { shift: [0.0; 3], width_phi: [0.3; 3], ..Default::default() };
    let hair: FiberModel = RoughDielectricFiber::new(hair)?.into();
    let fit = fit_khungurn(&hair, &[0.55], &[0.01], 1, &KhungurnParameters::default())?;
    println!("the hair: {:?}, off by {:.0} % of its norm", fit.parameters, 100.0 * fit.error);
    Ok(())
}
