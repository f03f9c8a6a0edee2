//! References: digits of an arbitrary-precision calculation, and Wronskians (DLMF 10.5.3) over the range in
//! use.
use super::expansions::I;
use super::*;
use std::f64::consts::PI;

/// `(z, [J_0, J_1, H_0, H_1])`. Python 3.11, mpmath 1.3:
/// ```text
/// from mpmath import *; mp.dps = 60
/// J = besselj; H = lambda n, z: 2/(pi*1j)*exp(-1j*pi*n/2)*besselk(n, -1j*z)
/// print([nstr(f(n, mpc(x, y)), 17) for f in (J, H) for n in (0, 1)])
/// ```
#[rustfmt::skip]
#[allow(clippy::excessive_precision, reason = "digits as printed")]
const ORDERS_01: &[(C64, [C64; 4])] = &[
    (C64::new(0.01, 0.0), [C64::new(9.9997500015624957e-1, 0.0), C64::new(4.9999375002604162e-3, 0.0), C64::new(9.9997500015624957e-1, -3.0054556370836459), C64::new(4.9999375002604162e-3, -6.3678596282060655e+1)]),
    (C64::new(0.9, 0.3), [C64::new(8.236514129547051e-1, -1.2314376134552576e-1), C64::new(4.1957229153533372e-1, 1.0809565042502828e-1), C64::new(5.6703841796650785e-1, -7.5249480121988787e-2), C64::new(1.4794412287531321e-1, -7.1471933096250323e-1)]),
    (C64::new(1.0, 0.001), [C64::new(7.6519784913152653e-1, -4.4005063993611924e-4), C64::new(4.4005074831849513e-1, 3.2514713911419623e-4), C64::new(7.6441663645513775e-1, 8.781734831049604e-2), C64::new(4.3918127908320607e-1, -7.8088723942690445e-1)]),
    (C64::new(2.2, 0.0), [C64::new(1.1036226692217385e-1, 0.0), C64::new(5.5596304981906391e-1, 0.0), C64::new(1.1036226692217385e-1, 5.2078428538802269e-1), C64::new(5.5596304981906391e-1, 1.4877892897633682e-3)]),
    (C64::new(3.9, 2.5), [C64::new(-2.2392626715478611, 5.3248771896268702e-1), C64::new(-7.0823977467754778e-1, -2.0379142225350786), C64::new(-2.8329322163908924e-2, 9.7753376726571046e-3), C64::new(7.9246116669252642e-3, 3.0860794525068786e-2)]),
    (C64::new(0.5, 7.0), [C64::new(1.5064619056892836e+2, -7.5170399756533819e+1), C64::new(7.044083579997843e+1, 1.3907384222581328e+2), C64::new(1.3760478528165293e-4, -2.3243126818536466e-4), C64::new(-2.4777623324944589e-4, -1.4818834724994887e-4)]),
    (C64::new(17.0, 0.0), [C64::new(-1.6985425215118355e-1, 0.0), C64::new(-9.766849275778065e-2, 0.0), C64::new(-1.6985425215118355e-1, -9.2637198442323693e-2), C64::new(-9.766849275778065e-2, 1.6720503607723369e-1)]),
    (C64::new(63.9, 0.5), [C64::new(1.0808462384968411e-1, -1.483653014853409e-2), C64::new(3.2230488533372695e-2, 4.9731919698333935e-2), C64::new(5.8231520842029651e-2, 1.6548253360286356e-2), C64::new(1.7005334678620123e-2, -5.8107405132406569e-2)]),
    (C64::new(64.1, 12.0), [C64::new(6.7567088594805513e+3, -4.3632458866497857e+3), C64::new(4.4081997127974448e+3, 6.7144360190360019e+3), C64::new(5.616597739186301e-7, 2.297822543468608e-7), C64::new(2.3433927279082296e-7, -5.6073828004736396e-7)]),
    (C64::new(250.0, 0.0), [C64::new(-2.6053373425204234e-2, 0.0), C64::new(-4.326903841033075e-2, 0.0), C64::new(-2.6053373425204234e-2, -4.3216845440366268e-2), C64::new(-4.326903841033075e-2, 2.5966992185484582e-2)]),
    (C64::new(250.0, 40.0), [C64::new(-2.6370111276495144e+15, 5.2802686047562397e+15), C64::new(-5.2837748601274895e+15, -2.6258931299991297e+15), C64::new(-1.2408660059889608e-19, -1.731423829218914e-19), C64::new(-1.7343862787805303e-19, 1.2378801199915944e-19)]),
    (C64::new(3000.0, 0.0), [C64::new(-7.7918452618898996e-3, 0.0), C64::new(1.2306980664764856e-2, 0.0), C64::new(-7.7918452618898996e-3, 1.2308279134657472e-2), C64::new(1.2306980664764856e-2, 7.7938967499087473e-3)]),
];

/// `(hankel, n, z, digits, power of ten)`, by the same functions with `e = floor(log10(abs(v)))`,
/// `nstr(v/mpf(10)**e, 17)`.
#[rustfmt::skip]
#[allow(clippy::excessive_precision, reason = "digits as printed")]
const HIGH_ORDERS: &[(bool, i64, C64, C64, i32)] = &[
    (false, 50, C64::new(1.0, 0.0), C64::new(2.9060049481732394, 0.0), -80),
    (true, 50, C64::new(1.0, 0.0), C64::new(0.0, -2.191142812605339), 77),
    (false, 200, C64::new(100.0, 0.0), C64::new(2.0594424939411679, 0.0), -41),
    (true, 200, C64::new(100.0, 0.0), C64::new(0.0, -8.9236648125530524), 37),
    (false, 30, C64::new(0.001, 0.0), C64::new(3.5110745564222169, 0.0), -132),
    (true, 30, C64::new(0.001, 0.0), C64::new(0.0, -3.0219607629673332), 129),
    (false, 100, C64::new(80.0, 300.0), C64::new(-5.2425923233070328, -6.422826611997922), 121),
    (true, 100, C64::new(80.0, 300.0), C64::new(7.157426797847272e-1, 9.4287661914216356e-1), -125),
    (false, 2000, C64::new(1900.0, 0.0), C64::new(6.8030992025913941, 0.0), -12),
    (true, 2000, C64::new(1900.0, 0.0), C64::new(6.8030992025913941e-19, -7.4933501621804225), 7),
    (false, 3000, C64::new(3100.0, 5.0), C64::new(-4.8727132459305088, 2.0675957105906788), -2),
    (true, 3000, C64::new(3100.0, 5.0), C64::new(-7.3373749243090628, -3.4159220797215308), -3),
    (false, 5, C64::new(20.0, 800.0), C64::new(3.4373218649714491, 1.5866852102868498), 345),
    (true, 5, C64::new(20.0, 800.0), C64::new(-4.1635212552780029e-1, -9.646149123737493e-1), -349),
];

/// Maximum error of any route; that of J against its envelope (|H^(1)| + |H^(2)|) / 2, since J has zeros near
/// the real axis.
fn error(z: C64, got: Cylinder01, want: &[C64; 4]) -> f64 {
    (0..2)
        .map(|n| {
            let (j, h) = (want[n].norm(), want[2 + n].norm());
            let floor = if z.norm() < 1.0 { j } else { 0.5 * (h + (2.0 * want[n] - want[2 + n]).norm()) };
            ((got.j[n] - want[n]).norm() / floor).max((got.h[n] - want[2 + n]).norm() / h)
        })
        .fold(0.0, f64::max)
}

/// The phase of a wave at |z| carries |z| roundings; beyond that 1e-15 or so.
fn allowed(z: C64) -> f64 {
    3e-15 + 4e-16 * z.norm()
}

#[test]
fn orders_0_and_1_agree_with_published_digits() {
    for (z, want) in ORDERS_01 {
        let err = error(*z, cylinder01(*z), want);
        assert!(err < allowed(*z), "crate at {z}: error {err:e}");
        let ray = Ray::new(*z / 3.0);
        let err = error(*z, ray.cylinder01(3.0), want);
        assert!(err < allowed(*z), "ray at {z}: error {err:e}");
        let h = ray.hankel01(3.0);
        assert!((h[0] - want[2]).norm() < allowed(*z) * want[2].norm(), "ray's hankel01 at {z}");
        let (js, hs) = (Sequence::bessel(*z, 1), Sequence::hankel(*z, 1));
        let got = Cylinder01 { j: [js.value(0), js.value(1)], h: [hs.value(0), hs.value(1)] };
        let err = error(*z, got, want);
        assert!(err < allowed(*z), "sequence at {z}: error {err:e}");
        if z.im == 0.0 {
            let h = real01(z.re);
            for n in 0..2 {
                assert!((h[n] - want[2 + n]).norm() < allowed(*z) * want[2 + n].norm(), "real01 at {z}");
            }
        }
    }
    // Abramowitz and Stegun, Table 9.1, x = 1 and 10.
    let (one, ten) = (real01(1.0), real01(10.0));
    for (got, want) in [
        (one[0], (0.765_197_686_6, 0.088_256_964_2)),
        (one[1], (0.440_050_585_7, -0.781_212_821_3)),
        (ten[0], (-0.245_935_764_5, 0.055_671_167_3)),
        (ten[1], (0.043_472_746_2, 0.249_015_424_2)),
    ] {
        assert!((got.re - want.0).abs() < 6e-11 && (got.im - want.1).abs() < 6e-11, "{got} against {want:?}");
    }
}

#[test]
fn high_orders_agree_with_published_digits() {
    for (hankel, n, z, want, power) in HIGH_ORDERS {
        let top = *n as usize + 5;
        let sequence = if *hankel { Sequence::hankel(*z, top) } else { Sequence::bessel(*z, top) };
        let got = sequence.get(*n);
        // Ten to a power in two halves, since the whole may leave the range.
        let half = 10f64.powi(power / 2);
        let rest = 10f64.powi(power - power / 2);
        let got =
            got.mantissa / half * power_of_two(got.exponent / 2) / rest * power_of_two(got.exponent - got.exponent / 2);
        let err = (got - want).norm() / want.norm();
        assert!(err < 2e-14 + 2e-16 * z.norm(), "hankel {hankel} order {n} at {z}: {got}, want {want}, error {err:e}");
    }
}

/// J_{n+1} H_n - J_n H_{n+1} = 2 i / (pi z), DLMF 10.5.3 with H = J + i Y.
#[test]
fn wronskians_hold_at_all_orders() {
    let mut worst: f64 = 0.0;
    for size in [1e-3, 0.1, 1.0, 4.7, 30.0, 64.5, 300.0, 2000.0, 13000.0] {
        for angle in [0.0, 1e-9, 1e-3, 0.1, 0.7, 1.3, PI / 2.0] {
            let z = C64::from_polar(size, angle);
            let z = C64::new(if angle == PI / 2.0 { 0.0 } else { z.re }, z.im);
            let top = (1.3 * size) as usize + 60;
            let (j, h) = (Sequence::bessel(z, top), Sequence::hankel(z, top));
            // Roundings of the recurrence's |z| steps, most of which average out.
            let allowed = 2e-14 + 5e-17 * size;
            for n in 0..top as i64 {
                let (a, b) = (j.get(n + 1) * h.get(n), j.get(n) * h.get(n + 1));
                let (a, b) = (a.value(), b.value());
                let want = 2.0 * I / (PI * z);
                let err = (a - b - want).norm() / (a.norm() + b.norm());
                worst = worst.max(err / allowed);
                assert!(err < allowed, "n {n} z {z}: error {err:e}");
                // The same with derivatives, J_n H_n' - J_n' H_n.
                let (a, b) = ((j.get(n) * h.derivative(n)).value(), (j.derivative(n) * h.get(n)).value());
                let err = (a - b - want).norm() / (a.norm() + b.norm());
                assert!(err < allowed, "n {n} z {z}: error {err:e} with derivatives");
            }
        }
    }
    println!("largest error of a Wronskian: {worst:.2} of the allowance");
}

/// The fast path against the crate at many points of several rays, over all pieces and both series.
#[test]
fn rays_agree_with_the_crate() {
    for angle in [0.0, 1e-6, 0.01, 0.2, 0.9, 1.5, PI / 2.0] {
        let k = C64::from_polar(1.7, angle);
        let ray = Ray::new(k);
        let mut worst: f64 = 0.0;
        for i in 0..4000 {
            let r = 1e-6 * 1.006f64.powi(i);
            let z = k * r;
            if z.norm() > 500.0 || z.im > 600.0 {
                break;
            }
            let (got, want) = (ray.cylinder01(r), cylinder01(z));
            let e = error(z, got, &[want.j[0], want.j[1], want.h[0], want.h[1]]);
            // The error of the crate's H_0 is up to 6e-15 about |z| = 2.
            let allowed = 5e-15 + allowed(z);
            worst = worst.max(e / allowed);
            assert!(e < allowed, "z {z}: error {e:e}");
        }
        println!("angle {angle}: largest error {worst:.2} of the allowance");
    }
}
