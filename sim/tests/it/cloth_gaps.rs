//! Light through the gaps of a cloth of curves, and colors by yarn.

use crate::cloth_model::{JERSEY, ORGANZA, any, direction, even, made, place};
use plywave::Document;
use plywave::bsdf::{Bsdf, BsdfSample};
use plywave::cloth::{ClothModel, ClothOptions, ColorOf, GapLight, YarnColor};
use plywave::{ClothQuery, Error};
use plywave_check::check_bsdf;
use plywave_sim::cloth::{Effort, make_cloth};
use plywave_textile::ClothSpec;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;

const LAMBDA: [f32; 3] = [0.45, 0.55, 0.65];
/// The light of a point alone.
const ALONE: ClothOptions = ClothOptions { layers: false, shadowing: false, ..ClothOptions::SMOOTH };

/// As a point moves across a gap in steps of 0.1 um, the light that the gap diffracts jumps at hardly any of
/// them.
#[test]
fn light_of_gaps_changes_steadily_with_the_place() {
    for (name, data) in [("organza", &*ORGANZA), ("jersey", &*JERSEY)] {
        let cloth = ClothModel::from_data(data.clone(), &ALONE).unwrap();
        let (mut steps, mut jumps, mut largest) = (0usize, 0usize, 0.0f32);
        for k in 0..400 {
            let wo = direction([0.98, 0.8, -0.9][k % 3], even(k, 0.618_034));
            let ([x, y], (s, c)) = (place(k), (6.3 * even(k, 0.414_214)).sin_cos());
            let off = direction(0.995, even(k, 0.732_051));
            // About the straight direction.
            let mut wi = [0, 1, 2].map(|i| -wo[i] + if i < 2 { off[i] } else { 0.0 });
            let length = wi.iter().map(|v| v * v).sum::<f32>().sqrt();
            wi = wi.map(|v| v / length);
            let f: Vec<Option<[f32; 3]>> = (0..40)
                .map(|i| {
                    let by = 0.1 * i as f32;
                    let at = cloth.at(&ClothQuery::new([x + by * c, y + by * s], wo, LAMBDA));
                    at.is_gap().then(|| at.eval(wi))
                })
                .collect();
            for w in f.windows(4) {
                let [Some(a), Some(b), Some(c), Some(d)] = [w[0], w[1], w[2], w[3]] else { continue };
                for i in 0..3 {
                    let slope = (b[i] - a[i]).abs().max((d[i] - c[i]).abs());
                    let jump = ((c[i] - b[i]).abs() - 3.0 * slope) / a[i].max(d[i]).max(0.02);
                    steps += 1;
                    jumps += usize::from(jump > 0.05);
                    largest = largest.max(jump);
                }
            }
        }
        println!("{name}: {jumps} of {steps} steps are jumps, the largest by {largest:.3} of f");
        assert!(steps > 2000, "{name}: {steps} steps");
        assert!((jumps as f64) < 2e-3 * steps as f64, "{name}: {jumps} of {steps}");
    }
}

/// What passes a gap is a scattering function of its energy, whose samples have their density; nothing of it
/// goes straight on.
#[test]
#[ignore = "slow: 12 s: gaps keep their energy"]
fn gaps_keep_their_energy() {
    let cloth = ClothModel::from_data(ORGANZA.clone(), &ALONE).unwrap();
    let mut rng = Pcg64Mcg::seed_from_u64(2);
    let (mut checked, mut k) = (0, 0);
    while checked < 3 {
        k += 1;
        let wo = direction([0.97, 0.7, -0.85][checked], even(k, 0.618_034));
        let at = cloth.at(&ClothQuery::new(place(k), wo, LAMBDA));
        if !at.is_gap() {
            continue;
        }
        checked += 1;
        assert_eq!((at.straight(), at.outcomes().straight), ([0.0; 3], 0.0));
        let r = check_bsdf(&at, [0.003; 2], 20_000, &mut || rng.random());
        assert!(r.furnace_error < 0.01 && r.pdf_error < 0.005, "{k}: {r:?}");
        assert!(r.weight_error < 1e-3 && r.sampled_furnace_se < 5.0 && r.chi2_p > 1e-4, "{k}: {r:?}");
    }
    let straight = ClothOptions { gaps: GapLight::Straight, ..ALONE };
    let cloth = ClothModel::from_data(ORGANZA.clone(), &straight).unwrap();
    assert_eq!(cloth.at(&ClothQuery::new(place(k), direction(-0.85, even(k, 0.618_034)), LAMBDA)).straight(), [1.0; 3]);
}

/// The mean over the cell diffracts as many places do: shares of the light that passes within 1, 3 and 10
/// degrees of the straight direction.
#[test]
#[ignore = "slow: 14 s: the mean over the cell diffracts as its places do"]
fn the_mean_diffracts_as_places_do() {
    let data = made("organza", &["silk_single"; 2], true);
    let cloth = ClothModel::from_data(data, &ClothOptions { far: true, ..ALONE }).unwrap();
    const PLACES: usize = 3000;
    const SAMPLES: usize = 4;
    for (i, wo) in [direction(0.97, 0.1), direction(0.75, 0.33), direction(-0.6, 0.7)].iter().enumerate() {
        let within = |w: [f32; 3]| {
            let cosine = -(w[0] * wo[0] + w[1] * wo[1] + w[2] * wo[2]);
            [1.0f32, 3.0, 10.0].map(|degrees| f64::from(u8::from(cosine > degrees.to_radians().cos())))
        };
        let mut shares = [[0.0f64; 3]; 2];
        for (of, shares) in shares.iter_mut().enumerate() {
            let footprint_um = if of == 0 { 0.0 } else { 1e5 };
            for k in 0..PLACES * SAMPLES {
                let query = ClothQuery { footprint_um, ..ClothQuery::new(place(k / SAMPLES + 7000 * i), *wo, [0.55]) };
                let u = [0.819_172_513, 0.671_043_606, 0.549_700_478].map(|step| even(k, step));
                if let BsdfSample::Scattered(s) = cloth.at(&query).sample(u) {
                    for (sum, inside) in shares.iter_mut().zip(within(s.w)) {
                        *sum += f64::from(s.weight[0]) * inside / (PLACES * SAMPLES) as f64;
                    }
                }
            }
        }
        println!("from {wo:?}: within 1, 3, 10 degrees by places {:.3?}, by the mean {:.3?}", shares[0], shares[1]);
        assert!(shares[0][0] > 0.05, "{shares:?}");
        for (places, mean) in shares[0].iter().zip(shares[1]) {
            assert!((places - mean).abs() < 0.04, "from {wo:?}: {shares:?}");
        }
    }
}

/// Striped yarns have their colors one after the other, in points and in the mean.
#[test]
fn stripes_are_those_of_their_yarns() {
    let mut data = ORGANZA.clone();
    let (red, blue) = ([0.7f32, 0.1, 0.1], [0.1f32, 0.2, 0.7]);
    data.looks[0].colors = [red, red, blue].map(YarnColor::Srgb).to_vec();
    let data = plywave::cloth::ClothData::from_bytes(&data.to_bytes().unwrap(), "striped").unwrap();
    let cloth = ClothModel::from_data(data, &ALONE).unwrap();
    let weft = YarnColor::Srgb([0.85, 0.78, 0.66]);
    let [reds, blues] = [red, blue].map(|c| cloth.with_colors([YarnColor::Srgb(c), weft], ColorOf::EvenSky));
    let spacing = 250.0;
    let mut seen = [0usize; 2];
    for k in 0..4000 {
        let at = ClothQuery::rgb(place(k), direction(0.98, even(k, 0.618_034)));
        let w = any(k);
        let [f, r, b] = [&cloth, &reds, &blues].map(|cloth| cloth.at(&at).eval(w));
        let off = |a: [f32; 3], b: [f32; 3]| (0..3).map(|i| (a[i] - b[i]).abs()).fold(0.0, f32::max);
        if off(r, b) < 1e-3 {
            continue;
        }
        let is_blue = (place(k)[0] / spacing).floor().rem_euclid(3.0) == 2.0;
        assert!(off(f, if is_blue { b } else { r }) < 1e-6, "{:?}: {f:?}, red {r:?}, blue {b:?}", place(k));
        seen[usize::from(is_blue)] += 1;
    }
    println!("red and blue yarns: {seen:?}");
    assert!(seen[0] > 300 && seen[1] > 150, "{seen:?}");
    assert_eq!(cloth.colors().len(), 3);
}

/// A WIF gives the draft in its shortest repeat, and the colors of all its threads.
#[test]
fn a_wif_gives_colors() {
    let wif = "[WIF]\nVersion=1.1\n[CONTENTS]\nWEAVING=true\nWARP=true\nWEFT=true\nTHREADING=true\nTREADLING=true\n\
        TIEUP=true\nCOLOR PALETTE=true\nCOLOR TABLE=true\nWARP COLORS=true\nWEFT COLORS=true\n\
        [WEAVING]\nShafts=2\nTreadles=2\nRising Shed=true\n[COLOR PALETTE]\nEntries=2\nRange=0,255\n\
        [COLOR TABLE]\n1=255,0,0\n2=0,0,255\n[WARP]\nThreads=6\nColor=1\n[WEFT]\nThreads=4\nColor=2\n\
        [WARP COLORS]\n1=1\n2=1\n3=2\n4=2\n5=1\n6=2\n[WEFT COLORS]\n1=2\n2=1\n3=2\n4=2\n\
        [THREADING]\n1=1\n2=2\n3=1\n4=2\n5=1\n6=2\n[TREADLING]\n1=1\n2=2\n3=1\n4=2\n[TIEUP]\n1=1\n2=2\n";
    let own = "color = [0.85, 0.78, 0.66]";
    assert!(ORGANZA.spec_text.contains(own));
    let colored = ORGANZA.spec_text.replace("kind = \"plain\"", "kind = \"wif\"\nfile = \"x.wif\"");
    let text = colored.replace(own, "");
    let spec = ClothSpec::parse(&text, "wif").unwrap();
    let mut read = |_: &str| -> Result<Vec<u8>, Error> { Ok(wif.into()) };
    let made = make_cloth(&spec, "wif", &mut read, Effort::Full, &|_| true).unwrap();
    // A plain weave: as the one of the spec.
    assert_eq!(made.curves, ORGANZA.curves);
    let [red, blue] = [[1.0, 0.0, 0.0], [0.0, 0.0, 1.0]];
    let colors = |colors: &[[f32; 3]]| colors.iter().copied().map(YarnColor::Srgb).collect::<Vec<_>>();
    assert_eq!(made.looks[0].colors, colors(&[red, red, blue, blue, red, blue]));
    assert_eq!(made.looks[1].colors, colors(&[blue, red, blue, blue]));
    // Colors of the spec are taken in place of those of the WIF.
    let striped = colored.replace(own, "stripes = [{ count = 2, color = [0, 1, 0] }]");
    for (text, want) in [(striped, colors(&[[0.0, 1.0, 0.0]; 2])), (colored, colors(&[[0.85, 0.78, 0.66]]))] {
        let spec = ClothSpec::parse(&text, "wif").unwrap();
        let made = make_cloth(&spec, "wif", &mut read, Effort::Full, &|_| true).unwrap();
        assert_eq!(made.looks[0].colors, want);
    }
}
