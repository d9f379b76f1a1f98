//! FluidNC's configuration, as its dump (`$CD`) shows it: sections within sections, two spaces deeper each.

use std::collections::BTreeMap;

/// Real-time bytes, which are in no key.
const ECHOED: [char; 5] = ['?', '!', '~', '\u{18}', '\u{fffd}'];
/// The question for the dump.
const ASKED: &str = "$CD";

/// Every key of a configuration by its way from the root, e.g. `axes/x/homing/cycle`. A section is a key without a value.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Tree(BTreeMap<String, String>);

impl Tree {
    /// Reads a dump. A line that does not fit where it stands is an error, and not passed over: with a line lost, what
    /// follows would be read as another axis's.
    ///
    /// # Errors
    /// What does not fit, in words.
    pub fn from_lines(lines: &[String]) -> Result<Self, String> {
        let mut tree = BTreeMap::new();
        let mut way: Vec<&str> = Vec::new();
        // What an echoing adapter sends back of the question, and of the status requests meanwhile.
        let lines: Vec<String> = lines.iter().map(|line| line.replace(ECHOED, "")).collect();
        for line in lines.iter().filter(|line| line.trim() != ASKED) {
            let text = line.trim_start_matches(' ');
            let (indent, depth) = (line.len() - text.len(), (line.len() - text.len()) / 2);
            let Some((key, value)) = text.split_once(':').filter(|(key, _)| is_key(key)) else {
                return Err(format!("`{}` is no line of a configuration", text.escape_debug()));
            };
            if indent % 2 != 0 || depth > way.len() {
                return Err(format!("`{}` belongs to no section", text.escape_debug()));
            }
            way.truncate(depth);
            let value = value.trim();
            // What holds a colon is told in quotes.
            let value = value.strip_prefix('\'').and_then(|value| value.strip_suffix('\'')).unwrap_or(value);
            let path = way.iter().chain([&key]).copied().collect::<Vec<_>>().join("/");
            if tree.insert(path.to_ascii_lowercase(), value.to_owned()).is_some() {
                return Err(format!("`{path}` is told twice"));
            }
            if value.is_empty() {
                way.push(key);
            }
        }
        Ok(Self(tree))
    }

    /// Whether a key or a section is there.
    #[must_use]
    pub fn has(&self, path: &str) -> bool {
        self.0.contains_key(path)
    }

    /// A value as it is told.
    #[must_use]
    pub fn get(&self, path: &str) -> Option<&str> {
        self.0.get(path).map(String::as_str)
    }

    /// A value that is a number.
    #[must_use]
    pub fn number(&self, path: &str) -> Option<f64> {
        self.get(path)?.parse().ok().filter(|value: &f64| value.is_finite())
    }

    /// A value that is `true` or `false`.
    #[must_use]
    pub fn flag(&self, path: &str) -> Option<bool> {
        match self.get(path)? {
            "true" => Some(true),
            "false" => Some(false),
            _ => None,
        }
    }

    /// The keys below a section, each with its value: what is deeper has its way within the section.
    pub fn below<'a>(&'a self, section: &str) -> impl Iterator<Item = (&'a str, &'a str)> + use<'a> {
        let begin = format!("{section}/");
        let from = self.0.range(begin.clone()..);
        from.map_while(move |(path, value)| Some((path.strip_prefix(&begin)?, value.as_str())))
    }

    /// The keys whose values differ from another configuration's, or that only one of the two has.
    pub fn differences<'a>(&'a self, other: &'a Self) -> impl Iterator<Item = &'a str> {
        let here = self.0.iter().filter(|(path, value)| other.0.get(*path) != Some(value));
        let there = other.0.keys().filter(|path| !self.0.contains_key(*path));
        here.map(|(path, _)| path.as_str()).chain(there.map(String::as_str))
    }
}

fn is_key(key: &str) -> bool {
    !key.is_empty() && key.bytes().all(|byte| byte.is_ascii_alphanumeric() || byte == b'_')
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn lines(text: &str) -> Vec<String> {
        text.lines().map(str::to_owned).collect()
    }

    const DUMP: &str = "board: None\nname: 'a: bench'\nstepping: \n  engine: RMT\n  idle_ms: 255\naxes: \n  x: \n    \
                        steps_per_mm: 800.000000\n    homing: \n      positive_direction: false\n  y: \n    \
                        steps_per_mm: 400.000000\nmacros: \n  startup_line0: \n  startup_line1: \nreport_inches: false";

    #[test]
    fn a_dump_is_read_by_its_indentation() {
        let tree = Tree::from_lines(&lines(DUMP)).unwrap();
        assert_eq!(tree.number("axes/x/steps_per_mm"), Some(800.0));
        assert_eq!(tree.number("axes/y/steps_per_mm"), Some(400.0));
        assert_eq!(tree.flag("axes/x/homing/positive_direction"), Some(false));
        assert_eq!((tree.get("name"), tree.get("macros/startup_line1")), (Some("a: bench"), Some("")));
        assert_eq!((tree.flag("report_inches"), tree.flag("board"), tree.number("board")), (Some(false), None, None));
        assert_eq!(tree.below("stepping").collect::<Vec<_>>(), [("engine", "RMT"), ("idle_ms", "255")]);
        assert!(tree.has("axes/y") && !tree.has("axes/z"));
        let other = Tree::from_lines(&lines(&DUMP.replace("false\n  y", "true\n  y"))).unwrap();
        assert_eq!(tree.differences(&other).collect::<Vec<_>>(), ["axes/x/homing/positive_direction"]);
    }

    #[test]
    fn what_does_not_fit_is_an_error_and_no_other_axiss_value() {
        let all = lines(DUMP);
        // The line that begins the y axis: what is y's would be x's.
        let mut lost = all.clone();
        lost.remove(10);
        assert!(Tree::from_lines(&lost).unwrap_err().contains("twice"), "{lost:?}");
        let mut joined = all.clone();
        let next = joined.remove(9);
        joined[8].push_str(&next);
        assert!(
            Tree::from_lines(&joined).is_err()
                || Tree::from_lines(&joined).unwrap().flag("axes/x/homing/positive_direction").is_none()
        );
        for wrong in ["      deep: 1", "odd", " cycle: 1", "name: x"] {
            let mut wrongly = all.clone();
            wrongly.insert(2, wrong.to_owned());
            assert!(Tree::from_lines(&wrongly).is_err(), "{wrong}");
        }
    }

    proptest! {
        #[test]
        fn no_lines_break_the_reader(lines in proptest::collection::vec("[ a-z:'0-9]{0,20}", 0..30)) {
            let _ = Tree::from_lines(&lines);
        }
    }
}
