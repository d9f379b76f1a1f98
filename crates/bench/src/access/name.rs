//! What a token's holder may be called.

use unicode_properties::{GeneralCategoryGroup, UnicodeGeneralCategory as _};

/// Longest name, characters.
pub const LONGEST: usize = 64;
/// The names that can be, as a regular expression of JSON Schema. Two blocks are given whole: accents apart from their
/// letters, and the scripts of South and South-East Asia, where vowels are marks on letters.
pub const PATTERN: &str = r"^[\p{L}\p{N}\u0300-\u036f\u0900-\u0fff .@_-]*[\p{L}\p{N}\u0300-\u036f\u0900-\u0fff.@_-][\p{L}\p{N}\u0300-\u036f\u0900-\u0fff .@_-]*$";

/// A name without the blanks around it, if it can be one: 1 to 64 letters and digits of any script, blanks and `.@_-`.
pub(super) fn name(text: &str) -> Option<&str> {
    let name = text.trim_matches(' ');
    let can_be = !name.is_empty() && text.chars().count() <= LONGEST && text.chars().all(is_of_a_name);
    can_be.then_some(name)
}

fn is_of_a_name(c: char) -> bool {
    " .@_-".contains(c)
        || matches!(c.general_category_group(), GeneralCategoryGroup::Letter | GeneralCategoryGroup::Number)
        || matches!(c, '\u{300}'..='\u{36f}' | '\u{900}'..='\u{fff}')
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_name_is_of_any_script_and_of_nothing_that_is_not_seen() {
        for good in [
            "Ana",
            "  bench 2 ",
            "a.b@c_d-e",
            "José",
            "Jose\u{301}",
            "Οδυσσέας",
            "Фёдор",
            "山田 太郎",
            "עדה",
            "हिन्दी",
            "สมชาย",
            "한국",
        ] {
            assert_eq!(name(good), Some(good.trim()), "{good}");
        }
        for bad in [
            "",
            "   ",
            "a\nb",
            "a\tb",
            "<b>",
            "a/b",
            "a\u{202e}b",
            "a\u{200b}",
            "a\u{a0}b",
            "\u{fffd}",
            "€",
            &"x".repeat(65),
        ] {
            assert_eq!(name(bad), None, "{bad:?}");
        }
    }
}
