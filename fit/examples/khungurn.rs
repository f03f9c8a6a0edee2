//! From a photographed swatch to a fiber, and from one fiber model to another.
//!
//! ```sh
//! cargo run --release -p plywave-fit --example khungurn [PICTURE [X Y WIDTH HEIGHT [WHITE]]]
//! ```
//!
//! The picture (PNG, JPEG) is a photograph of an opaque swatch of aligned fibers that is lit from above, in
//! sRGB without other corrections. The rectangle [pixels] is the swatch in the picture; by default all of it.
//! WHITE is the linear value, 0 to 1, of a white standard in the same light, by default 1; division by it is
//! the only correction of the exposure.

use plywave::color::{RGB_LAMBDA_UM, srgb_decode};
use plywave::frame::direction;
use plywave_fiber::dual_scattering::{DualOptions, DualScattering};
use plywave_fiber::{FiberModel, FiberQuery};
use plywave_fiber::{KhungurnFiber, KhungurnParameters, RoughDielectricFiber, RoughDielectricParameters};
use plywave_fit::{SwatchOptions, SwatchSample, fit_khungurn, fit_khungurn_swatch};

/// Mean linear red, green and blue of a rectangle of a picture over those of white.
fn photographed(args: &[String]) -> Result<[f64; 3], Box<dyn std::error::Error>> {
    let [file, rest @ ..] = args else {
        // A red swatch beside a white standard.
        return Ok([0.42, 0.11, 0.09]);
    };
    let picture = image::open(file).map_err(|e| format!("{file}: {e}"))?.into_rgb16();
    let number = |text: &String| text.parse::<u32>().map_err(|_| format!("{text}: use a whole number of pixels"));
    let [x, y, width, height] = match rest {
        [] => [0, 0, picture.width(), picture.height()],
        [x, y, width, height, ..] => [number(x)?, number(y)?, number(width)?, number(height)?],
        _ => return Err("a rectangle is X Y WIDTH HEIGHT".into()),
    };
    let inside = |from: u32, size: u32, all: u32| size > 0 && from.checked_add(size).is_some_and(|end| end <= all);
    if !inside(x, width, picture.width()) || !inside(y, height, picture.height()) {
        let [w, h] = [picture.width(), picture.height()];
        return Err(format!("{file}: no rectangle of {width} x {height} at {x}, {y} in {w} x {h} pixels").into());
    }
    let white = match rest.get(4) {
        Some(text) => text.parse::<f64>().ok().filter(|w| *w > 0.0 && *w <= 1.0),
        None => Some(1.0),
    };
    let white = white.ok_or("WHITE: use a number above 0, 1 at most")?;
    let mut sum = [0.0; 3];
    for j in y..y + height {
        for i in x..x + width {
            let encoded = picture.get_pixel(i, j).0.map(|v| f64::from(v) / f64::from(u16::MAX));
            (0..3).for_each(|k| sum[k] += srgb_decode(encoded[k]));
        }
    }
    Ok(sum.map(|s| s / (f64::from(width) * f64::from(height)) / white))
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let args: Vec<String> = std::env::args().skip(1).collect();
    let photographed = photographed(&args)?;
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
