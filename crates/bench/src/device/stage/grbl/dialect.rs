//! Which of Grbl and its heirs a controller is, by what it calls itself.

use super::without_echo;

/// Grbl itself, or a firmware that speaks its protocol with other numbers and settings of its own.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Dialect {
    /// Grbl 1.1.
    #[default]
    Grbl,
    /// grblHAL.
    GrblHal,
    /// FluidNC: configured by a file, not by numbered settings.
    FluidNc,
}

/// What a controller calls itself.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Version {
    /// Which firmware it is.
    pub dialect: Dialect,
    /// Its name and version, e.g. `Grbl 1.1h`, `GrblHAL 1.1f`, `FluidNC v3.9.1`.
    pub words: String,
}

impl Version {
    /// Whether it is one that this program drives.
    #[must_use]
    pub fn is_known(&self) -> bool {
        let of = |begins: &[&str]| begins.iter().any(|begin| self.words.starts_with(begin));
        match self.dialect {
            Dialect::Grbl => of(&["Grbl 1.1"]),
            Dialect::GrblHal => of(&["GrblHAL 1.1"]),
            // Before 3.7 a jog of one axis drew every other one into its soft limits.
            Dialect::FluidNc => {
                let minor = self.words.strip_prefix("FluidNC v3.").and_then(|rest| rest.split(['.', '-']).next());
                minor.and_then(|minor| minor.parse().ok()).is_some_and(|minor: u32| minor >= 7) || of(&["FluidNC v4."])
            }
        }
    }

    /// Whether more has to be asked for to know which it is: FluidNC's users may change its start-up line.
    #[must_use]
    pub fn is_unclear(&self) -> bool {
        self.dialect == Dialect::Grbl && ["Grbl 3.", "Grbl 4."].iter().any(|begin| self.words.starts_with(begin))
    }
}

fn fluidnc(told: &str) -> Option<Version> {
    let (_, told) = told.split_once("FluidNC ")?;
    let version = told.split([' ', ':', ']', ',']).next()?;
    let is_version =
        version.len() <= 24 && version.starts_with('v') && version[1..].starts_with(|c: char| c.is_ascii_digit());
    is_version.then(|| Version { dialect: Dialect::FluidNc, words: format!("FluidNC {version}") })
}

/// The version in a start-up line: `Grbl 1.1h ['$' for help]`, `GrblHAL 1.1f [...`, `Grbl 3.9 [FluidNC v3.9.1 (wifi) ...`.
/// Noise before it on the line is passed over: a board that resets when its port is opened spits some.
#[must_use]
pub fn banner(line: &str) -> Option<Version> {
    let start = line.find("Grbl ").or_else(|| line.find("GrblHAL "))?;
    let rest = &line[start..];
    let (version, more) = rest.split_at(rest.find(" [")?);
    let (_, digits) = version.split_once(' ')?;
    if !digits.starts_with(|c: char| c.is_ascii_digit()) || digits.len() > 12 {
        return None;
    }
    let dialect = if version.starts_with("GrblHAL") { Dialect::GrblHal } else { Dialect::Grbl };
    Some(fluidnc(more).unwrap_or_else(|| Version { dialect, words: version.to_owned() }))
}

/// The version in the answer to [`BUILD_INFO`](super::BUILD_INFO), in the words of a start-up line.
#[must_use]
pub fn version(lines: &[String]) -> Option<Version> {
    let told = lines.iter().find_map(|line| without_echo(line).strip_prefix("[VER:"))?;
    if let Some(version) = fluidnc(told) {
        return Some(version);
    }
    // Such as 1.1h.20190825: the version, the day it was built on, a name.
    let (number, rest) = told.split_once('.')?;
    let minor = rest.split(['.', ':', ']', ' ']).next().filter(|minor| !minor.is_empty())?;
    let hal = lines.iter().any(|line| line.to_ascii_lowercase().contains("grblhal"));
    let (dialect, name) = if hal { (Dialect::GrblHal, "GrblHAL") } else { (Dialect::Grbl, "Grbl") };
    Some(Version { dialect, words: format!("{name} {number}.{minor}") })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn told(lines: &[&str]) -> Option<Version> {
        version(&lines.iter().map(|&line| line.to_owned()).collect::<Vec<_>>())
    }

    fn words(version: Option<Version>) -> Option<String> {
        version.map(|version| version.words)
    }

    #[test]
    fn each_calls_itself_the_same_at_its_start_and_when_it_is_asked() {
        for (line, lines, dialect, name) in [
            ("Grbl 1.1h ['$' for help]", vec!["[VER:1.1h.20190825:]", "[OPT:V,15,128]"], Dialect::Grbl, "Grbl 1.1h"),
            (
                "GrblHAL 1.1f ['$' or '$HELP' for help]",
                vec!["[VER:1.1f.20230825:a bench]", "[FIRMWARE:grblHAL]"],
                Dialect::GrblHal,
                "GrblHAL 1.1f",
            ),
            (
                "Grbl 3.9 [FluidNC v3.9.1 (wifi) '$' for help]",
                vec!["[VER:3.9 FluidNC v3.9.1:]", "[OPT:PHS]"],
                Dialect::FluidNc,
                "FluidNC v3.9.1",
            ),
            (
                "Grbl 4.0 [FluidNC v4.0.4 (noradio) '$' for help]",
                vec!["[VER:4.0 FluidNC v4.0.4 (ESP32-WROVER) :]"],
                Dialect::FluidNc,
                "FluidNC v4.0.4",
            ),
        ] {
            let version = Version { dialect, words: name.to_owned() };
            assert!(version.is_known(), "{name}");
            assert_eq!(banner(line), Some(version.clone()));
            assert_eq!(banner(&format!("\u{fffd}x{line}")), Some(version.clone()));
            assert_eq!(told(&lines), Some(version));
        }
    }

    #[test]
    fn what_is_no_version_is_none() {
        assert_eq!((told(&["[OPT:V]"]), told(&["[VER:1]"])), (None, None));
        assert_eq!(banner("Grbl something else"), None);
        assert_eq!(words(banner("Grbl 0.9j ['$' for help]")).as_deref(), Some("Grbl 0.9j"));
        for other in [
            "Grbl 0.9j ['$' for help]",
            "Grbl 5.0 [FluidNC v5.0.0 (wifi) '$' for help]",
            "Grbl 3.6 [FluidNC v3.6.8 (wifi) '$' for help]",
            "Grbl 3.9 [a bench]",
        ] {
            assert!(banner(other).is_some_and(|version| !version.is_known()), "{other}");
        }
    }
}
