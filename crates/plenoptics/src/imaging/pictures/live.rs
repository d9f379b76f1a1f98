//! Pictures of frame after frame: what does not change from one to the next is worked out once.

use std::sync::Arc;

use super::setting::{Setting, check_exposure};
use super::{PictureError, Pictures, Pose, Table};
use crate::imaging::measurement::{FrameOptions, WhiteModel, evened};
use crate::optics::MlaMode;
use crate::raw::RawImage;

/// Makes pictures of the frames of one camera. Grid and vignetting of the last frame are kept while they fit the next,
/// followed where the array moves, and found anew where it is lost; distances are worked out anew with the pose only.
#[derive(Debug, Clone)]
pub struct LivePictures {
    white: Option<WhiteModel>,
    options: FrameOptions,
    mode: MlaMode,
    setting: Option<Setting>,
    table: Option<(Pose, Arc<Table>)>,
}

impl LivePictures {
    /// Nothing known yet but the white frame, where there is one.
    #[must_use]
    pub const fn new(white: Option<WhiteModel>, options: FrameOptions, mode: MlaMode) -> Self {
        Self { white, options, mode, setting: None, table: None }
    }

    /// Makes the next frame ready. Without a pose there are no distances, and no refocusing at one.
    ///
    /// # Errors
    /// [`PictureError`] says what is wrong with the frame; the next one starts anew.
    pub fn next(&mut self, raw: &RawImage, pose: Option<&Pose>) -> Result<Pictures, PictureError> {
        let even = evened(raw, self.options.mosaic);
        let setting = match self.setting.take().and_then(|setting| setting.followed(&even)) {
            Some(setting) => setting,
            None => Setting::of(&even, self.white.as_ref(), &self.options)?,
        };
        check_exposure(raw, &setting.grid)?;
        let table = pose.map(|pose| match &self.table {
            Some((known, table)) if known == pose && table.serves(&setting.grid) => Arc::clone(table),
            _ => Arc::new(Table::new(&setting.grid, pose, self.mode)),
        });
        self.table = pose.copied().zip(table.clone());
        let pictures = Pictures::of(&even, &setting, &self.options, self.mode, table);
        self.setting = Some(setting);
        pictures
    }
}
