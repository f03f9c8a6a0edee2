//! Packings at random seeds: gaps kept, within the ply, the same for the same seed; refused when they cannot fit.

use plywave::{FiberSpec, PlySpec, Shape, YarnSpec};
use plywave_sim::{PlySection, SimError};

fn yarn(shape: Shape, fibers: u32, radius_um: f64) -> YarnSpec {
    YarnSpec {
        name: "test".into(),
        fiber: FiberSpec {
            shape,
            size_jitter: 0.05,
            shape_jitter: 0.1,
            angle_jitter_rad: None,
            eta: 1.55,
            alpha_fiber: 0.2,
        },
        ply: PlySpec {
            fibers,
            radius_um: Some(radius_um),
            radii_um: None,
            min_gap_um: 0.2,
            fiber_pitch_um: Some(800.0),
            handedness: Default::default(),
        },
        beam: Default::default(),
        absorption: Default::default(),
        simulation: Default::default(),
    }
}

#[test]
fn circles_keep_gap_and_lie_within() {
    for seed in 0..20 {
        let start = std::time::Instant::now();
        let ply = PlySection::generate(&yarn(Shape::Circle { radius_um: 7.5 }, 30, 50.0), seed).unwrap();
        eprintln!("seed {seed}: {:?} bound {:.2} gap {:.4}", start.elapsed(), ply.bound_radius_um, ply.min_gap_um());
        assert!(ply.min_gap_um() >= 0.2 && ply.bound_radius_um <= 50.0);
    }
    for seed in 0..5 {
        let start = std::time::Instant::now();
        let ply = PlySection::generate(&yarn(Shape::Ellipse { a_um: 11.0, b_um: 6.0 }, 30, 60.0), seed).unwrap();
        eprintln!("ell {seed}: {:?} bound {:.2} gap {:.4}", start.elapsed(), ply.bound_radius_um, ply.min_gap_um());
        assert!(ply.min_gap_um() >= 0.2 && ply.bound_radius_um <= 60.0);
    }
}

#[test]
fn too_many_fibers_are_refused() {
    let crowd = yarn(Shape::Circle { radius_um: 7.5 }, 200, 50.0);
    let error = PlySection::generate(&crowd, 1).unwrap_err();
    eprintln!("{error}");
    assert!(matches!(error, SimError::CannotPack { fibers: 200, .. }));
    let start = std::time::Instant::now();
    let error = PlySection::generate(&yarn(Shape::Circle { radius_um: 7.5 }, 30, 46.0), 1).unwrap_err();
    eprintln!("{error} {:?}", start.elapsed());
}
