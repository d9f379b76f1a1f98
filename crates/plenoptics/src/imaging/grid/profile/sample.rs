//! Which micro-images stand for all of them.

use crate::imaging::grid::MicroImage;

/// For each of so many micro-images one of two halves.
pub(super) fn halves(count: usize) -> Vec<bool> {
    let mut chance = chance();
    (0..count).map(|_| chance().is_multiple_of(2)).collect()
}

/// Numbers by chance, the same on every run.
pub(super) fn chance() -> impl FnMut() -> usize {
    let mut state = 1u64;
    move || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 33) as usize
    }
}

/// About `wanted` of the micro-images, one by chance of so many that follow each other: at even distances they would be
/// in step with a chequered board. All where they are hardly more.
pub(super) fn by_chance(lenses: &[MicroImage], wanted: usize) -> Vec<MicroImage> {
    let mut chance = chance();
    let every = (lenses.len() / wanted).max(1);
    lenses.chunks(every).map(|some| some[chance() % some.len()]).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn forerunners_come_from_all_over_the_frame() {
        let lenses = |count: i32| -> Vec<MicroImage> {
            (0..count).map(|n| MicroImage { i: n, j: 0, x: f64::from(n), y: 0.0 }).collect()
        };
        let few = by_chance(&lenses(14_000), 2500);
        assert_eq!(few.len(), 2800);
        for (n, m) in few.iter().enumerate() {
            assert_eq!(m.i as usize / 5, n);
        }
        // In step with nothing.
        for place in 0..5 {
            let share = few.iter().filter(|m| m.i % 5 == place).count();
            assert!((450..670).contains(&share), "{share} at {place}");
        }
        assert_eq!(by_chance(&lenses(3000), 2500).len(), 3000);
    }
}
