//! One basis of the many that a lattice has.

use crate::optics::ArrayKind;

/// The angle by which an array turns into itself, radians.
pub(super) fn symmetry(array: ArrayKind) -> f64 {
    match array {
        ArrayKind::Square => std::f64::consts::FRAC_PI_2,
        ArrayKind::Hexagonal => std::f64::consts::FRAC_PI_3,
    }
}

/// The basis that [`Grid`](crate::imaging::grid::Grid) promises: the first vector's angle from +x within half the array's symmetry, the second that
/// symmetry further.
pub(super) fn canonical(array: ArrayKind, basis: [[f64; 2]; 2]) -> [[f64; 2]; 2] {
    let period = symmetry(array);
    let mut vectors: Vec<[f64; 2]> = Vec::new();
    for m in -2i32..=2 {
        for n in -2i32..=2 {
            if (m, n) != (0, 0) {
                let (m, n) = (f64::from(m), f64::from(n));
                vectors.push([m * basis[0][0] + n * basis[1][0], m * basis[0][1] + n * basis[1][1]]);
            }
        }
    }
    let length = |v: &[f64; 2]| v[0].hypot(v[1]);
    let shortest = vectors.iter().map(length).fold(f64::INFINITY, f64::min);
    // Neighbours differ in length by what the array and the sensor are off; diagonals by 41 or 73 %.
    vectors.retain(|v| length(v) < 1.2 * shortest);
    let nearest = |to: f64| {
        let off = |v: &[f64; 2]| {
            let turned = v[1].atan2(v[0]) - to + std::f64::consts::PI;
            (turned.rem_euclid(std::f64::consts::TAU) - std::f64::consts::PI).abs()
        };
        vectors.iter().copied().min_by(|a, b| off(a).total_cmp(&off(b))).unwrap_or(basis[0])
    };
    // A hair towards +y decides between the two ends of the half-open range.
    let first = nearest(1e-9);
    let second = nearest(first[1].atan2(first[0]) + period);
    [first, second]
}
