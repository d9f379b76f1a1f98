//! Each principal's share of what is kept for all of them.

/// Makes room for one more of those that are a principal's own: the first of them go until fewer than `share` are left.
pub(super) fn keep_share<T>(kept: &mut Vec<T>, share: usize, is_own: impl Fn(&T) -> bool) {
    let own = kept.iter().filter(|one| is_own(one)).count();
    let mut surplus = (own + 1).saturating_sub(share);
    kept.retain(|one| {
        let goes = surplus > 0 && is_own(one);
        surplus -= usize::from(goes);
        !goes
    });
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_principals_own_oldest_goes_and_nobody_elses() {
        let mut kept = vec![("b", 0), ("a", 1), ("a", 2), ("b", 3), ("a", 4)];
        let is_a = |one: &(&str, i32)| one.0 == "a";
        keep_share(&mut kept, 4, is_a);
        assert_eq!(kept.len(), 5);
        keep_share(&mut kept, 2, is_a);
        assert_eq!(kept, [("b", 0), ("b", 3), ("a", 4)]);
        keep_share(&mut kept, 2, is_a);
        assert_eq!(kept.len(), 3);
    }
}
