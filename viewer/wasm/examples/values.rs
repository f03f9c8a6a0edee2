//! Values of a model by this machine's own code, to lay beside those of WebAssembly (`viewer/tests`).
//!
//! `cargo run --release -p plywave-web --example values -- FILE..`: for each file, the numbers of [`values`]
//! as 32-bit floats, little endian.
//!
//! ci: build only

use plywave_web::{Cloth, Picture, Ply};
use std::io::Write;

/// As `values` of `viewer/tests/values.mjs`.
fn values(bytes: &[u8], file: &str) -> Result<Vec<f32>, wasm_bindgen::JsError> {
    if file.ends_with(".pwm") {
        let mut ply = Ply::new(bytes, file)?;
        let mut out = Vec::new();
        for (theta_i, h_rel, sigma) in [(0.0, 0.0, 0.0), (0.5, 0.3, 0.004), (-1.0, -0.8, 0.02)] {
            let h_um = h_rel * ply.h_max_um() as f32;
            out.extend(ply.map(theta_i, h_um, sigma, 0.55, true, 90, 180));
            out.extend(ply.energies(theta_i, h_um, sigma));
        }
        return Ok(out);
    }
    let cloth = Cloth::new(bytes, file)?.with_sigma(0.005);
    let mut out = Vec::new();
    for (theta, phi) in [(0.0, 0.0), (0.8, 0.5), (1.4, 2.0), (2.2, 4.0)] {
        out.extend(cloth.map(theta, phi, 0.55, 45, 90));
    }
    let wi: Vec<f32> = (0..64)
        .flat_map(|k| {
            let (z, phi) = (1.0 - (k as f32 + 0.5) / 32.0, 2.4 * k as f32);
            let sin = (1.0 - z * z).sqrt();
            [sin * phi.cos(), sin * phi.sin(), z]
        })
        .collect();
    for k in 0..64 {
        let point = [37.0 * k as f32, 91.0 * k as f32];
        out.extend(cloth.eval(&point, 5.0, &[0.48, 0.36, 0.8], 0.55, &wi)?);
    }
    for scene in ["swatch", "front"] {
        let mut picture = Picture::new(&cloth, scene, 32, 32, 0.0, 1, 0, 1)?;
        while picture.pass(16)? < 8 {}
        out.extend(picture.linear());
    }
    Ok(out)
}

fn main() -> std::io::Result<()> {
    for file in std::env::args().skip(1) {
        let bytes = std::fs::read(&file)?;
        let Ok(values) = values(&bytes, &file) else { return Err(std::io::Error::other(file)) };
        std::io::stdout().write_all(&values.iter().flat_map(|v| v.to_le_bytes()).collect::<Vec<u8>>())?;
    }
    Ok(())
}
