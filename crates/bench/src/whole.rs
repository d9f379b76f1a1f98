//! Whole numbers as JSON has them: `554.0` is one, says JSON Schema, and some languages write no other.

use std::fmt;
use std::marker::PhantomData;

use serde::de::{Deserialize, Deserializer, Error, Unexpected, Visitor};

/// Beyond this the whole numbers that a fraction can be are no longer all of them.
const EXACT: f64 = 9_007_199_254_740_992.0;

/// A whole number of zero or more.
struct Whole<T>(T);

struct Read<T>(PhantomData<T>);

impl<T: TryFrom<u64>> Visitor<'_> for Read<T> {
    type Value = Whole<T>;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "a whole number of 0 or more that fits into {}", std::any::type_name::<T>())
    }

    fn visit_u64<E: Error>(self, number: u64) -> Result<Whole<T>, E> {
        T::try_from(number).map(Whole).map_err(|_| E::invalid_value(Unexpected::Unsigned(number), &self))
    }

    fn visit_f64<E: Error>(self, number: f64) -> Result<Whole<T>, E> {
        if number.fract() == 0.0 && (0.0..=EXACT).contains(&number) {
            return self.visit_u64(number as u64);
        }
        Err(E::invalid_value(Unexpected::Float(number), &self))
    }
}

impl<'de, T: TryFrom<u64>> Deserialize<'de> for Whole<T> {
    fn deserialize<D: Deserializer<'de>>(from: D) -> Result<Self, D::Error> {
        from.deserialize_any(Read(PhantomData))
    }
}

/// For `#[serde(deserialize_with)]`: a whole number.
///
/// # Errors
/// What is no whole number, is below zero, or does not fit.
pub fn whole<'de, D: Deserializer<'de>, T: TryFrom<u64>>(from: D) -> Result<T, D::Error> {
    Whole::deserialize(from).map(|Whole(number)| number)
}

/// For `#[serde(deserialize_with)]` beside `default`: a whole number, or none.
///
/// # Errors
/// As [`whole`].
pub fn whole_or_none<'de, D: Deserializer<'de>, T: TryFrom<u64>>(from: D) -> Result<Option<T>, D::Error> {
    Ok(Option::<Whole<T>>::deserialize(from)?.map(|Whole(number)| number))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[derive(Debug, PartialEq, serde::Deserialize)]
    struct Asked {
        #[serde(deserialize_with = "whole")]
        step: u8,
        #[serde(default, deserialize_with = "whole_or_none")]
        steps: Option<u32>,
    }

    #[test]
    fn a_whole_number_may_be_written_with_a_point() {
        let read = |text: &str| serde_json::from_str::<Asked>(text);
        assert_eq!(read(r#"{"step": 7}"#).unwrap(), Asked { step: 7, steps: None });
        assert_eq!(read(r#"{"step": 7.0, "steps": 554.0}"#).unwrap(), Asked { step: 7, steps: Some(554) });
        assert_eq!(read(r#"{"step": 7e1, "steps": null}"#).unwrap(), Asked { step: 70, steps: None });
        for wrong in ["7.5", "-1", "-1.0", "256", "256.0", "1e300", "\"7\"", "null", "true"] {
            let error = read(&format!(r#"{{"step": {wrong}}}"#)).unwrap_err().to_string();
            assert!(error.contains("a whole number"), "{wrong}: {error}");
        }
    }
}
