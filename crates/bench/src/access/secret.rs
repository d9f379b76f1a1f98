//! Secrets of 256 random bits, and what is kept of them.

use std::fmt;

use ring::rand::{SecureRandom as _, SystemRandom};
use serde::{Deserialize, Deserializer, Serialize, Serializer, de};
use subtle::ConstantTimeEq as _;

/// Bytes of randomness in a secret.
const BYTES: usize = 32;

/// A secret as its holder has it: shown once, never kept, and not printed by `{:?}`.
#[derive(Clone)]
pub struct Secret(String);

impl Secret {
    /// A new secret: `prefix`, by which a reader knows what it is for, and 64 hexadecimal digits.
    ///
    /// # Errors
    /// When the system has no randomness to give.
    pub fn random(prefix: &str) -> std::io::Result<Self> {
        let mut bytes = [0; BYTES];
        SystemRandom::new()
            .fill(&mut bytes)
            .map_err(|_| std::io::Error::other("the system gives no random numbers"))?;
        Ok(Self(format!("{prefix}{}", hex(&bytes))))
    }

    /// The secret itself, to be shown to its holder.
    #[must_use]
    pub fn reveal(&self) -> &str {
        &self.0
    }

    /// What is kept of it.
    #[must_use]
    pub fn digest(&self) -> Digest {
        Digest::of(&self.0)
    }
}

impl fmt::Debug for Secret {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("Secret(…)")
    }
}

/// SHA-256 of a secret. A secret has 256 random bits, so that a slow hash would add nothing.
#[derive(Debug, Clone, Copy)]
pub struct Digest([u8; 32]);

impl Digest {
    /// The digest of a secret as presented.
    #[must_use]
    pub fn of(secret: &str) -> Self {
        let mut digest = [0; 32];
        digest.copy_from_slice(ring::digest::digest(&ring::digest::SHA256, secret.as_bytes()).as_ref());
        Self(digest)
    }

    /// Whether both are of the same secret, in a time that does not depend on where they differ.
    #[must_use]
    pub fn matches(&self, other: &Self) -> bool {
        self.0.ct_eq(&other.0).into()
    }
}

/// Bytes as hexadecimal digits.
fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}

impl Serialize for Digest {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_str(&hex(&self.0))
    }
}

impl<'de> Deserialize<'de> for Digest {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let text = String::deserialize(deserializer)?;
        let wrong = || de::Error::custom("a SHA-256 is 64 hexadecimal digits");
        if text.len() != 64 || !text.is_ascii() {
            return Err(wrong());
        }
        let mut digest = [0; 32];
        for (index, byte) in digest.iter_mut().enumerate() {
            *byte = u8::from_str_radix(&text[2 * index..2 * index + 2], 16).map_err(|_| wrong())?;
        }
        Ok(Self(digest))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_secret_is_long_random_known_by_its_prefix_and_not_printed() {
        let (one, two) = (Secret::random("plenalign_").unwrap(), Secret::random("plenalign_").unwrap());
        assert_eq!(one.reveal().len(), "plenalign_".len() + 64);
        assert!(one.reveal().starts_with("plenalign_"));
        assert!(!one.digest().matches(&two.digest()));
        assert!(one.digest().matches(&Digest::of(one.reveal())));
        assert!(!format!("{one:?}").contains(&one.reveal()[10..]));
    }

    #[test]
    fn a_digest_is_kept_as_sha_256_in_hexadecimal() {
        // FIPS 180-2, appendix B.1.
        let text = serde_json::to_string(&Digest::of("abc")).unwrap();
        assert_eq!(text, "\"ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad\"");
        assert!(serde_json::from_str::<Digest>(&text).unwrap().matches(&Digest::of("abc")));
        for wrong in ["\"\"", "\"ba78\"", &text.replace('b', "z")] {
            assert!(serde_json::from_str::<Digest>(wrong).is_err(), "{wrong}");
        }
    }
}
