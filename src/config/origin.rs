//! Where a configuration came from.

use std::path::PathBuf;

use super::{Config, PRESET_ORIGIN};

/// Where a configuration came from.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum ConfigOrigin {
    /// No file: the reference preset.
    Preset,
    /// A file.
    File(PathBuf),
}

impl ConfigOrigin {
    /// The origin alone: the preset's name or the file's.
    #[must_use]
    pub fn name(&self) -> String {
        match self {
            Self::Preset => PRESET_ORIGIN.to_owned(),
            Self::File(path) => path.display().to_string(),
        }
    }

    /// Where the design's numbers come from, to be shown with them. Judged by the numbers themselves: a file that holds
    /// the preset's camera says so, and a preset with overrides of its camera no longer passes for it.
    #[must_use]
    pub fn describe(&self, config: &Config) -> String {
        match (self, config.has_preset_camera()) {
            (Self::Preset, true) => PRESET_ORIGIN.to_owned(),
            (Self::Preset, false) => format!("{PRESET_ORIGIN}, with overrides"),
            (Self::File(path), true) => format!("{}, which holds the {PRESET_ORIGIN}", path.display()),
            (Self::File(path), false) => path.display().to_string(),
        }
    }
}

impl Config {
    /// Whether the camera, the shell, the water and the object distances are those of the reference preset.
    #[must_use]
    pub fn has_preset_camera(&self) -> bool {
        let preset = Self::default();
        self.design() == preset.design() && self.sensor == preset.sensor
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_preset_is_named_wherever_its_numbers_are() {
        let mut config = Config::default();
        let file = ConfigOrigin::File("bench.toml".into());
        assert_eq!(ConfigOrigin::Preset.describe(&config), "reference preset, inferred from Table 2");
        assert!(file.describe(&config).contains("inferred from Table 2"));
        config.main_lens.focal_length_mm = 25.0;
        assert_eq!(file.describe(&config), "bench.toml");
        assert!(ConfigOrigin::Preset.describe(&config).ends_with("with overrides"));
    }
}
