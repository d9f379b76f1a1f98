//! A white frame of another setting, as the reason why a frame gives no spacing.

use super::spacing::SpacingError;
use super::vignetting::ProfileFit;

/// The white frame does not fit a frame, and no spacing is found by the frame's own profile: with one that fits there may be.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[error(
    "the white frame does not fit: {fit}; take one with this aperture, at this setting (by the frame's own profile: {failed})"
)]
pub struct WhiteMisfit {
    /// How well its profile fits.
    pub fit: ProfileFit,
    /// What failed without it, in words.
    pub failed: String,
}

impl WhiteMisfit {
    /// Where a profile that fits a frame so is behind a failure.
    pub(super) fn behind(failed: &SpacingError, fit: Option<ProfileFit>) -> Option<Self> {
        match failed {
            SpacingError::NoTexture { .. }
            | SpacingError::OneDirection { .. }
            | SpacingError::NoMatch { .. }
            | SpacingError::BeyondRange { .. }
            | SpacingError::OtherMode { .. }
            | SpacingError::Unsettled { .. }
            | SpacingError::FixedPattern { .. }
            | SpacingError::Ambiguous { .. }
            | SpacingError::Moved { .. } => {
                fit.filter(|fit| !fit.fits()).map(|fit| Self { fit, failed: failed.to_string() })
            }
            // Of these no profile is the cause; light changes it itself.
            SpacingError::WrongSize { .. }
            | SpacingError::TooFewMicroImages { .. }
            | SpacingError::Saturated { .. }
            | SpacingError::Dark { .. }
            | SpacingError::Impossible { .. } => None,
        }
    }
}
