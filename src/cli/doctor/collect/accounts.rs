//! Users of the machine and their groups.

use std::ffi::CString;

use nix::unistd::{Gid, Group, Uid, User, getegid, geteuid, getgrouplist, getgroups};

use crate::cli::doctor::facts::Account;

/// Where a service's unit file may be, the one in force first.
const UNITS: [&str; 3] = [
    "/etc/systemd/system/plenalign.service",
    "/usr/lib/systemd/system/plenalign.service",
    "/lib/systemd/system/plenalign.service",
];
/// What in a unit file gives groups beyond the user's own.
const GROUPS_KEY: &str = "SupplementaryGroups=";

/// Who runs this command.
pub(super) fn of_this_process() -> Account {
    let uid = geteuid();
    let user = User::from_uid(uid).ok().flatten();
    let mut gids: Vec<u32> = getgroups().unwrap_or_default().into_iter().map(Gid::as_raw).collect();
    gids.push(getegid().as_raw());
    let name = user.as_ref().map_or_else(|| format!("user {uid}"), |user| user.name.clone());
    let listed_gids = user.as_ref().map(listed).unwrap_or_default();
    Account { name, uid: uid.as_raw(), gids, listed_gids }
}

/// The user that the service runs as, with the groups that its unit gives it; absent where there is none.
pub(super) fn of_service(name: &str) -> Option<Account> {
    let user = User::from_name(name).ok().flatten().filter(|user| user.uid != Uid::from_raw(0))?;
    let mut gids = listed(&user);
    let unit = UNITS.iter().find_map(|path| std::fs::read_to_string(path).ok()).unwrap_or_default();
    let named = unit_groups(&unit);
    gids.extend(named.iter().filter_map(|group| Some(Group::from_name(group).ok()??.gid.as_raw())));
    Some(Account { name: user.name, uid: user.uid.as_raw(), listed_gids: gids.clone(), gids })
}

/// Every group of a user by the machine's lists.
fn listed(user: &User) -> Vec<u32> {
    let name = CString::new(user.name.as_str()).unwrap_or_default();
    getgrouplist(&name, user.gid).unwrap_or_default().into_iter().map(Gid::as_raw).collect()
}

/// The groups that a unit file gives its service.
fn unit_groups(unit: &str) -> Vec<&str> {
    unit.lines().filter_map(|line| line.trim().strip_prefix(GROUPS_KEY)).flat_map(str::split_whitespace).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_services_unit_gives_it_groups() {
        let unit = std::fs::read_to_string(concat!(env!("CARGO_MANIFEST_DIR"), "/deploy/plenalign.service")).unwrap();
        assert_eq!(unit_groups(&unit), ["dialout", "video"]);
        assert!(unit_groups("[Service]\nUser=plenalign\n").is_empty());
    }

    #[test]
    fn this_process_is_somebody() {
        let account = of_this_process();
        assert_eq!(account.uid, geteuid().as_raw());
        assert!(account.gids.contains(&getegid().as_raw()) && !account.name.is_empty());
        assert_eq!(of_service("nobody-has-this-name"), None);
    }
}
