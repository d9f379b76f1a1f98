//! Steps of an iteration that goes to and fro.

use nalgebra::DVector;

/// Shortens steps that go to and fro.
///
/// Pairs are weighed by how well they match: where one of them is in doubt, steps may lead for ever from a state with it
/// to one without and back. From half of the iterations on every step back has all that follow taken half as long.
#[derive(Debug)]
pub(in crate::imaging) struct Damping {
    iterations: usize,
    done: usize,
    factor: f64,
    before: Option<DVector<f64>>,
}

impl Damping {
    pub(in crate::imaging) const fn new(iterations: usize) -> Self {
        Self { iterations, done: 0, factor: 1.0, before: None }
    }

    /// The next step, as long as it is to be. With other unknowns it begins anew.
    pub(in crate::imaging) fn damped(&mut self, step: &DVector<f64>) -> DVector<f64> {
        if self.before.as_ref().is_some_and(|before| before.len() != step.len()) {
            *self = Self::new(self.iterations);
        }
        let back = self.before.as_ref().is_some_and(|before| before.dot(step) < 0.0);
        if back && 2 * self.done >= self.iterations {
            self.factor *= 0.5;
        }
        self.done += 1;
        let damped = step * self.factor;
        self.before = Some(step.clone());
        damped
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn steps_to_and_fro_are_shortened_and_others_are_not() {
        let step = |x: f64| DVector::from_vec(vec![x, 0.1 * x]);
        let mut damping = Damping::new(20);
        for k in 0..10 {
            let there = if k % 2 == 0 { 1.0 } else { -1.0 };
            assert_eq!(damping.damped(&step(there)), step(there), "the first half of the iterations is free");
        }
        let lengths: Vec<f64> =
            (0..8).map(|k| damping.damped(&step(if k % 2 == 0 { 1.0 } else { -1.0 })).amax()).collect();
        assert_eq!(lengths[..3], [0.5, 0.25, 0.125]);
        assert!(lengths[7] < 0.005, "{lengths:?}");
        let mut damping = Damping::new(2);
        for x in [1.0, -1.0, 1.0] {
            damping.damped(&step(x));
        }
        assert_eq!(damping.damped(&step(-1.0)), 0.125 * step(-1.0));
        let wider = DVector::from_vec(vec![1.0, 0.1, 0.01]);
        assert_eq!(damping.damped(&wider), wider);
        let mut damping = Damping::new(4);
        for _ in 0..4 {
            assert_eq!(damping.damped(&step(0.3)), step(0.3));
        }
    }
}
