//! Which of how many parts: `2/4`.

use std::fmt;
use std::ops::Range;
use std::str::FromStr;

use serde::{Deserialize, Serialize};

/// One of several parts of the study's Monte Carlos, counted from 1.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub struct Shard {
    number: u64,
    of: u64,
}

impl Shard {
    /// The `number`-th of `of`; both are known to be right.
    pub(super) const fn new(number: u64, of: u64) -> Self {
        Self { number, of }
    }

    /// Which one it is, from 1.
    #[must_use]
    pub const fn number(self) -> u64 {
        self.number
    }

    /// How many there are.
    #[must_use]
    pub const fn of(self) -> u64 {
        self.of
    }

    /// Its share of so many items: the shares of all shards are one after the other, none has more than one item more than
    /// another, and together they are all items.
    #[must_use]
    pub fn range(self, count: u64) -> Range<u64> {
        // The product of two u64 fits into a u128, and its share of `count` back into a u64.
        let bound = |number: u64| (u128::from(number) * u128::from(count) / u128::from(self.of)) as u64;
        bound(self.number - 1)..bound(self.number)
    }
}

impl FromStr for Shard {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let expected = || format!("expected K/N, such as 2/4 for the second of four parts, not \"{text}\"");
        let (number, of) = text.split_once('/').ok_or_else(expected)?;
        let number: u64 = number.trim().parse().map_err(|_| expected())?;
        let of: u64 = of.trim().parse().map_err(|_| expected())?;
        match (number, of) {
            (_, 0) => Err("there is no part of none: N of K/N is 1 or more".to_owned()),
            (0, _) => Err(format!("parts are counted from 1: the first of {of} is 1/{of}, not 0/{of}")),
            (number, of) if number > of => Err(format!("there is no part {number} of {of}: the last one is {of}/{of}")),
            (number, of) => Ok(Self { number, of }),
        }
    }
}

impl TryFrom<String> for Shard {
    type Error = String;

    fn try_from(text: String) -> Result<Self, String> {
        text.parse()
    }
}

impl From<Shard> for String {
    fn from(shard: Shard) -> Self {
        shard.to_string()
    }
}

impl fmt::Display for Shard {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}/{}", self.number, self.of)
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn shares_are_all_items_once_and_even(of in 1u64..40, count in 0u64..1000) {
            let mut next = 0;
            for number in 1..=of {
                let range = Shard { number, of }.range(count);
                prop_assert_eq!(range.start, next);
                prop_assert!((count / of..=count.div_ceil(of)).contains(&(range.end - range.start)));
                next = range.end;
            }
            prop_assert_eq!(next, count);
        }
    }

    #[test]
    fn the_most_of_everything_does_not_overflow() {
        let shard: Shard = format!("{0}/{0}", u64::MAX).parse().unwrap();
        assert_eq!(shard.range(u64::MAX), u64::MAX - 1..u64::MAX);
    }

    #[test]
    fn what_is_no_shard_says_what_would_be() {
        for (text, says) in [
            ("2", "expected K/N"),
            ("a/4", "expected K/N"),
            ("-1/4", "expected K/N"),
            ("1/", "expected K/N"),
            ("0/4", "counted from 1"),
            ("5/4", "the last one is 4/4"),
            ("1/0", "1 or more"),
        ] {
            let error = text.parse::<Shard>().unwrap_err();
            assert!(error.contains(says), "{text}: {error}");
        }
        assert_eq!("3/4".parse::<Shard>().unwrap().to_string(), "3/4");
    }
}
