//! Where a configuration came from.

use std::path::{Path, PathBuf};

use super::{Config, PRESET_ORIGIN};

/// Where a configuration came from.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum ConfigOrigin {
    /// No file: the reference preset.
    Preset,
    /// A file.
    File(PathBuf),
    /// Another, with keys of the camera set otherwise on the command line.
    Overridden(Box<Self>),
}

impl ConfigOrigin {
    /// The origin of a configuration that was `before` and of which keys have been set one by one to give `after`.
    #[must_use]
    pub fn overridden(self, before: &Config, after: &Config) -> Self {
        if after.has_camera_of(before) { self } else { Self::Overridden(Box::new(self)) }
    }

    /// The file, where there is one.
    #[must_use]
    pub fn file(&self) -> Option<&Path> {
        match self {
            Self::Preset => None,
            Self::File(path) => Some(path),
            Self::Overridden(origin) => origin.file(),
        }
    }

    /// The origin alone: the preset's name or the file's.
    #[must_use]
    pub fn name(&self) -> String {
        match self {
            Self::Preset => PRESET_ORIGIN.to_owned(),
            Self::File(path) => path.display().to_string(),
            Self::Overridden(origin) => format!("{}, with overrides", origin.name()),
        }
    }

    /// Where the design's numbers come from, to be shown with them. A file that holds the preset's camera says so.
    #[must_use]
    pub fn describe(&self, config: &Config) -> String {
        match self {
            Self::File(path) if config.has_preset_camera() => {
                format!("{}, which holds the {PRESET_ORIGIN}", path.display())
            }
            _ => self.name(),
        }
    }
}

impl Config {
    /// Whether the camera, the shell, the water and the object distances are those of the reference preset.
    #[must_use]
    pub fn has_preset_camera(&self) -> bool {
        self.has_camera_of(&Self::default())
    }

    fn has_camera_of(&self, other: &Self) -> bool {
        self.design() == other.design() && self.sensor == other.sensor
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
        let overridden = ConfigOrigin::Preset.overridden(&Config::default(), &config);
        assert_eq!(overridden.describe(&config), "reference preset, inferred from Table 2, with overrides");
        config = Config::default();
        config.bench.simulation.seed = 9;
        assert_eq!(ConfigOrigin::Preset.overridden(&Config::default(), &config), ConfigOrigin::Preset);
    }
}
