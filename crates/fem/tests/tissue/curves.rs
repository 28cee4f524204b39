//! Stress of every registered law in uniaxial and equibiaxial tension and in simple shear, against closed forms in the
//! principal stretches, written here from the energies in the literature and independent of the code.
#![allow(non_snake_case)]

use crate::tissue_setup;
use crate::tissue_setup::all_materials;
use nalgebra::{Matrix3, Vector3};
use palpate_fem::material::{
    ArrudaBoyce, Lame, Law, Material, MooneyRivlin, Ogden, VerondaWestmann, arruda_boyce, ogden, veronda_westmann,
};

const YOUNG: f64 = 5e3;
const POISSON: f64 = 0.45;

/// Weights of the five-term series for `N = 8` as the literature prints them.
const CHAIN: [f64; 5] = [0.5, 1.0 / 160.0, 11.0 / 67_200.0, 19.0 / 3_584_000.0, 519.0 / (673_750.0 * 4096.0)];

/// `Σ p c_p x^(p-1)` for the chain law.
fn chain_slope(x: f64) -> f64 {
    CHAIN.iter().enumerate().map(|(k, c)| (k + 1) as f64 * c * x.powi(k as i32)).sum()
}

/// First Piola stress in the principal frame for stretches `s`.
fn principal(name: &str, s: [f64; 3]) -> [f64; 3] {
    let Lame { mu, lambda } = Lame::from_young_poisson(YOUNG, POISSON);
    let bulk = lambda + mu * 2.0 / 3.0;
    let J = s[0] * s[1] * s[2];
    let I1: f64 = s.iter().map(|s| s * s).sum();
    // `λ ∂W/∂λ` of the isochoric laws at the isochoric stretches `e`, their deviator and the pressure `k ln J / J`.
    let isochoric = |stress: &dyn Fn(f64, f64) -> f64| {
        let e = s.map(|s| s / J.cbrt());
        let trace = e.iter().map(|e| e * e).sum();
        let t = e.map(|e| stress(e, trace));
        let mean = (t[0] + t[1] + t[2]) / 3.0;
        std::array::from_fn(|a| (t[a] - mean + bulk * J.ln()) / s[a])
    };
    match name {
        "linear" | "corotational" => s.map(|a| 2.0 * mu * (a - 1.0) + lambda * (s[0] + s[1] + s[2] - 3.0)),
        "st_venant_kirchhoff" => s.map(|a| a * (mu * (a * a - 1.0) + 0.5 * lambda * (I1 - 3.0))),
        "neo_hookean" => s.map(|a| mu * a + (lambda * J.ln() - mu) / a),
        "stable_neo_hookean" => {
            let (m, l) = (4.0 / 3.0 * mu, lambda + 5.0 / 6.0 * mu);
            let alpha = 1.0 + m / l - m / (4.0 * l);
            s.map(|a| m * a - m * a / (I1 + 1.0) + l * (J - alpha) * J / a)
        }
        "mooney_rivlin" => isochoric(&|e, _| 0.5 * mu * (e * e - 1.0 / (e * e))),
        "arruda_boyce" => {
            let modulus = mu / (2.0 * chain_slope(3.0));
            isochoric(&|e, trace| 2.0 * modulus * e * e * chain_slope(trace))
        }
        "veronda_westmann" => isochoric(&|e, trace| {
            let c2 = 1.0;
            let c1 = mu / c2;
            2.0 * c1 * c2 * (c2 * (trace - 3.0)).exp() * e * e + c1 * c2 / (e * e)
        }),
        "ogden" => isochoric(&|e, _| 2.0 * mu / 8.0 * e.powi(8)),
        other => panic!("no closed form for {other}: write one"),
    }
}

/// Shear stress `dΨ/dγ` in simple shear `F = I + γ e1 e2ᵀ`.
fn shear(name: &str, g: f64) -> f64 {
    let Lame { mu, lambda } = Lame::from_young_poisson(YOUNG, POISSON);
    let root = (g * g + 4.0).sqrt();
    let s = 0.5 * (g + root);
    match name {
        "linear" | "neo_hookean" | "mooney_rivlin" => mu * g,
        // Stretches s and 1/s, ds/dγ = s / root.
        "corotational" => {
            let slope = |s: f64| {
                2.0 * mu * ((s - 1.0) - (1.0 / s - 1.0) / (s * s))
                    + lambda * (s + 1.0 / s - 2.0) * (1.0 - 1.0 / (s * s))
            };
            slope(s) * s / root
        }
        "st_venant_kirchhoff" => mu * (g + g.powi(3)) + 0.5 * lambda * g.powi(3),
        "stable_neo_hookean" => 4.0 / 3.0 * mu * g * (1.0 - 1.0 / (4.0 + g * g)),
        "arruda_boyce" => mu * g * chain_slope(3.0 + g * g) / chain_slope(3.0),
        "veronda_westmann" => mu * g * (2.0 * (g * g).exp() - 1.0),
        "ogden" => 2.0 * mu / 8.0 * (s.powi(8) - s.powi(-8)) / root,
        other => panic!("no closed form for {other}: write one"),
    }
}

/// The lateral stretch at which `free(t)` vanishes, by halving; `free` grows with `t`.
fn lateral(free: impl Fn(f64) -> f64) -> f64 {
    let (mut low, mut high) = (0.3, 3.0);
    for _ in 0..200 {
        let t = 0.5 * (low + high);
        if free(t) < 0.0 { low = t } else { high = t }
    }
    0.5 * (low + high)
}

/// Compares the three diagonal stresses; 1e-11 of Young's modulus is the rounding of sums of terms as large as the bulk
/// modulus times the strain.
fn agrees(material: &Material, stretches: [f64; 3]) {
    let P = material.first_piola(&Matrix3::from_diagonal(&Vector3::from(stretches)));
    let expected = principal(material.name(), stretches);
    let size = expected.iter().fold(YOUNG, |m, p| m.max(p.abs()));
    for a in 0..3 {
        let difference = (P[(a, a)] - expected[a]).abs();
        assert!(difference < 1e-11 * size, "{} {stretches:?}: {} {}", material.name(), P[(a, a)], expected[a]);
    }
    assert!((P - Matrix3::from_diagonal(&P.diagonal())).amax() < 1e-12 * size, "{}", material.name());
}

#[test]
fn uniaxial_tension_and_compression_follow_the_closed_forms() {
    for material in all_materials(YOUNG, POISSON) {
        for stretch in [0.7, 0.85, 0.999, 1.0, 1.2, 1.5, 1.7] {
            let t = lateral(|t| principal(material.name(), [stretch, t, t])[1]);
            let free = principal(material.name(), [stretch, t, t])[1];
            assert!(free.abs() < 1e-9 * YOUNG, "{} {stretch}: sides are not free", material.name());
            agrees(&material, [stretch, t, t]);
        }
    }
}

#[test]
fn equibiaxial_tension_and_compression_follow_the_closed_forms() {
    for material in all_materials(YOUNG, POISSON) {
        for stretch in [0.8, 0.95, 1.1, 1.3, 1.6] {
            let t = lateral(|t| principal(material.name(), [stretch, stretch, t])[2]);
            agrees(&material, [stretch, stretch, t]);
        }
    }
}

#[test]
fn simple_shear_follows_the_closed_forms() {
    for material in all_materials(YOUNG, POISSON) {
        for g in [-0.9, -0.1, 1e-3, 0.3, 0.5, 1.0] {
            let mut F = Matrix3::identity();
            F[(0, 1)] = g;
            let (P, expected) = (material.first_piola(&F)[(0, 1)], shear(material.name(), g));
            assert!(
                (P - expected).abs() < 1e-11 * YOUNG.max(expected.abs()),
                "{} {g}: {P} {expected}",
                material.name()
            );
        }
    }
}

/// Constants whose documentation states a consequence.
#[test]
fn documented_defaults_hold() {
    assert_eq!(arruda_boyce::DEFAULT_LINKS, 8.0);
    assert_eq!(veronda_westmann::DEFAULT_STIFFENING, 1.0);
    assert_eq!(ogden::DEFAULT_ALPHA, 8.0);
    let mu = Lame::from_young_poisson(YOUNG, POISSON).mu;
    assert!((shear("veronda_westmann", 0.5) / (0.5 * mu) - 1.57).abs() < 5e-3);
    assert!((shear("ogden", 0.5) / (0.5 * mu) - 1.72).abs() < 5e-3);
    // The ratio of the shear modulus at rest to the modulus of the chains.
    let chains = ArrudaBoyce { modulus: 770.0, bulk: 3e5, links: 8.0 };
    assert!((chains.small_strain().mu / 770.0 - 1.085).abs() < 5e-4);
    assert!((chains.small_strain().bulk() - 3e5).abs() < 1e-6);
}

/// Laws that contain one another: other branches of the code for the same mathematics.
#[test]
fn laws_agree_where_one_contains_the_other() {
    let (mu, bulk) = (1.7e3, 2e4);
    let rivlin = |c1: f64, c2: f64| Material::from(MooneyRivlin { c1, c2, bulk });
    let pairs = [
        (Material::from(Ogden { mu, alpha: 2.0, bulk }), rivlin(0.5 * mu, 0.0), 1e-11),
        (Material::from(Ogden { mu, alpha: -2.0, bulk }), rivlin(0.0, 0.5 * mu), 1e-11),
        // Terms of second order in 1/N are left.
        (Material::from(ArrudaBoyce { modulus: mu, bulk, links: 1e10 }), rivlin(0.5 * mu, 0.0), 1e-8),
    ];
    let mut random = tissue_setup::Random(17);
    for (one, other, tolerance) in pairs {
        for _ in 0..50 {
            let F = Matrix3::identity() + Matrix3::from_fn(|_, _| 0.25 * random.symmetric());
            let (P, Q) = (one.first_piola(&F), other.first_piola(&F));
            assert!((P - Q).amax() < tolerance * (Q.amax() + mu), "{} {P} {Q}", one.name());
            let (a, b) = (one.energy_density(&F), other.energy_density(&F));
            assert!((a - b).abs() < tolerance * (b.abs() + mu), "{} {a} {b}", one.name());
        }
    }
    // The exponential's scale: c1 c2 is the shear modulus.
    let exponential = VerondaWestmann { c1: 400.0, c2: 3.0, bulk };
    assert!((exponential.small_strain().mu - 1200.0).abs() < 1e-9);
}
